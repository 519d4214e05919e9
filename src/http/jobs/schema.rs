//! What a job's body may hold, for the document.
//!
//! Bodies are read by [`crate::jobs::request`], which lists every fault with its pointer and caps arrays before memory
//! is taken for them; serde would stop at the first. These types say the same shape to clients, and `agreement.rs` holds
//! that both know the same members and choices.

use std::collections::BTreeMap;

use serde::Deserialize;
use utoipa::ToSchema;

/// A job request.
#[derive(Deserialize, ToSchema)]
#[schema(as = JobRequest)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct JobRequestBody {
    #[schema(max_length = 256)]
    name: Option<String>,
    /// Keys have no colon; 64 labels at most, 256 bytes each.
    labels: Option<BTreeMap<String, String>>,
    #[schema(min_items = 1)]
    scans: Vec<ScanBody>,
    noise: NoiseBody,
    map: MapRequestBody,
    fit: Option<FitRequestBody>,
    /// Higher runs first.
    #[schema(minimum = -1000, maximum = 1000)]
    priority: Option<i32>,
    /// From submission; past it the job is failed.
    #[schema(minimum = 0.001, maximum = 2678400.0)]
    deadline_seconds: Option<f64>,
}

/// A request as it was accepted: a job's, an update's or a join's.
#[derive(Deserialize, ToSchema)]
#[schema(as = AcceptedRequest)]
#[serde(untagged)]
#[allow(dead_code)]
pub enum AcceptedRequestBody {
    Job(JobRequestBody),
    Update(UpdateRequestBody),
    Join(JoinRequestBody),
}

/// New scans for a map that is there: a job request without `map`.
#[derive(Deserialize, ToSchema)]
#[schema(as = UpdateRequest)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct UpdateRequestBody {
    #[schema(max_length = 256)]
    name: Option<String>,
    /// Keys have no colon; 64 labels at most, 256 bytes each.
    labels: Option<BTreeMap<String, String>>,
    #[schema(min_items = 1)]
    scans: Vec<ScanBody>,
    /// Of these scans; those of before keep theirs.
    noise: NoiseBody,
    /// How the parent was fitted, where it is left out.
    fit: Option<FitRequestBody>,
    /// Higher runs first.
    #[schema(minimum = -1000, maximum = 1000)]
    priority: Option<i32>,
    /// From submission; past it the job is failed.
    #[schema(minimum = 0.001, maximum = 2678400.0)]
    deadline_seconds: Option<f64>,
}

/// Maps to be joined into one.
#[derive(Deserialize, ToSchema)]
#[schema(as = JoinRequest)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct JoinRequestBody {
    #[schema(max_length = 256)]
    name: Option<String>,
    /// Keys have no colon; 64 labels at most, 256 bytes each.
    labels: Option<BTreeMap<String, String>>,
    /// The first is held where its pose says.
    #[schema(min_items = 1, max_items = 64)]
    maps: Vec<JoinedMapBody>,
    map: JoinedMapRequestBody,
    /// Poses are refined, and weights calibrated.
    fit: Option<FitRequestBody>,
    /// Higher runs first.
    #[schema(minimum = -1000, maximum = 1000)]
    priority: Option<i32>,
    /// From submission; past it the job is failed.
    #[schema(minimum = 0.001, maximum = 2678400.0)]
    deadline_seconds: Option<f64>,
}

/// A recording that has the scans, and what a job's body has beside them.
#[derive(ToSchema)]
#[schema(as = RecordingRequest)]
#[allow(dead_code)]
pub struct RecordingBody {
    /// An MCAP recording of a ROS 2 robot or a CARMEN log; it may be gzipped.
    #[schema(value_type = String, format = Binary)]
    recording: Vec<u8>,
    options: RecordingOptionsBody,
}

/// A job's body without scans, and which scans of the recording to take.
#[derive(Deserialize, ToSchema)]
#[schema(as = RecordingOptions)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct RecordingOptionsBody {
    #[schema(max_length = 256)]
    name: Option<String>,
    /// Keys have no colon; 64 labels at most, 256 bytes each.
    labels: Option<BTreeMap<String, String>>,
    noise: NoiseBody,
    map: MapRequestBody,
    fit: Option<FitRequestBody>,
    /// Higher runs first.
    #[schema(minimum = -1000, maximum = 1000)]
    priority: Option<i32>,
    /// From submission; past it the job is failed.
    #[schema(minimum = 0.001, maximum = 2678400.0)]
    deadline_seconds: Option<f64>,
    /// The topic with the scans, where there are several.
    #[schema(max_length = 256)]
    scan_topic: Option<String>,
    /// What says where they were taken, where there are several: a frame of `/tf`, an odometry or a pose topic.
    #[schema(max_length = 256)]
    pose_topic: Option<String>,
    /// Take every so many scans.
    #[schema(minimum = 1)]
    every: Option<u64>,
    /// The first scan taken, counted from 0.
    #[schema(minimum = 0)]
    from: Option<u64>,
    /// One past the last scan taken.
    #[schema(minimum = 1)]
    to: Option<u64>,
}

/// A map to be joined, and where its frame lies in the joined one.
#[derive(Deserialize, ToSchema)]
#[schema(as = JoinedMap)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct JoinedMapBody {
    id: String,
    /// A guess; of the first map, which is held, the origin where it is left out.
    pose: Option<PoseBody>,
    /// Row-major in (x, y, theta): how good the guess is; 0.5 m and 0.15 rad where it is left out.
    #[schema(min_items = 9, max_items = 9)]
    pose_covariance: Option<Vec<f64>>,
}

/// The map that maps are joined into.
#[derive(Deserialize, ToSchema)]
#[schema(as = JoinedMapSpec)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct JoinedMapRequestBody {
    /// The first map's where it is left out.
    distance: Option<DistanceName>,
    /// The spacing of control points, metres.
    #[schema(exclusive_minimum = 0.0)]
    resolution: f64,
    /// The area; without it, the returns and poses plus `margin`.
    bounds: Option<BoundsBody>,
    /// Metres; three cells by default.
    margin: Option<f64>,
    /// Whether a map with more control points in use than one fit may have is fitted in parts, which is the default, or
    /// refused.
    tiling: Option<Tiling>,
}

/// One laser scan; beam k has bearing angle_min + k angle_increment from the pose's heading.
#[derive(Deserialize, ToSchema)]
#[schema(as = Scan)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct ScanBody {
    pose: PoseBody,
    /// Row-major in (x, y, theta), symmetric positive semi-definite; replaces sigma_x, sigma_y and sigma_theta.
    #[schema(min_items = 9, max_items = 9)]
    pose_covariance: Option<Vec<f64>>,
    angle_min: f64,
    angle_increment: f64,
    range_min: f64,
    range_max: f64,
    /// Metres; null, or outside [range_min, range_max], is no return.
    ranges: Vec<Option<f64>>,
}

/// Metres and radians.
#[derive(Deserialize, ToSchema)]
#[schema(as = Pose)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct PoseBody {
    x: f64,
    y: f64,
    theta: f64,
}

/// Standard deviations: metres, and radians for theta.
#[derive(Deserialize, ToSchema)]
#[schema(as = Noise)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct NoiseBody {
    #[schema(exclusive_minimum = 0.0)]
    sigma_x: f64,
    #[schema(exclusive_minimum = 0.0)]
    sigma_y: f64,
    #[schema(exclusive_minimum = 0.0)]
    sigma_theta: f64,
    #[schema(exclusive_minimum = 0.0)]
    sigma_range: f64,
}

#[derive(Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[allow(dead_code)]
enum Tiling {
    /// The default.
    Auto,
    None,
}

/// The map to fit.
#[derive(Deserialize, ToSchema)]
#[schema(as = MapRequest)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct MapRequestBody {
    distance: DistanceName,
    /// The spacing of control points, metres.
    #[schema(exclusive_minimum = 0.0)]
    resolution: f64,
    /// The area; without it, the returns and poses plus `margin`.
    bounds: Option<BoundsBody>,
    /// Metres; three cells by default.
    margin: Option<f64>,
    /// Whether a map with more control points in use than one fit may have is fitted in parts, which is the default, or
    /// refused.
    tiling: Option<Tiling>,
}

/// Metres.
#[derive(Deserialize, ToSchema)]
#[schema(as = Bounds)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct BoundsBody {
    min: [f64; 2],
    max: [f64; 2],
}

/// How to fit it; everything is optional.
#[derive(Deserialize, ToSchema)]
#[schema(as = FitRequest)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct FitRequestBody {
    /// `calibrated` by default.
    weighting: Option<WeightingName>,
    /// `refined` by default; of `paper`, `fixed`.
    poses: Option<PosesName>,
    #[schema(minimum = 1, maximum = 1000, default = 100)]
    max_iterations: Option<u32>,
    /// The relative gradient that counts as converged; 1e-8 by default.
    tolerance: Option<f64>,
    /// Per quadrature point for paper, per square metre for calibrated.
    eikonal_weight: Option<f64>,
    /// The Geman-McClure scale of the Eikonal residual.
    eikonal_scale: Option<f64>,
    /// The thin-plate weight.
    smoothing: Option<f64>,
    /// What stands for what the spline cannot follow, metres; 2.5 % of the resolution by default.
    model_sigma: Option<f64>,
    /// Control points are in use where evidence is at most this many cells away, and null elsewhere. By default an sdf
    /// has all, and a vdf those within half a cell, or two standard deviations of its poses where these are refined.
    band: Option<f64>,
}

/// `sdf`: signed, negative in free space. `vdf`: the vector from the nearest surface point.
#[derive(Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[allow(dead_code)]
pub enum DistanceName {
    Sdf,
    Vdf,
}

/// The published objective, or ours.
#[derive(Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[allow(dead_code)]
pub enum WeightingName {
    Paper,
    Calibrated,
}

/// Whether poses are unknowns of the fit.
#[derive(Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[allow(dead_code)]
pub enum PosesName {
    Fixed,
    Refined,
}

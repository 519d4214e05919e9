//! The contract in machine-readable form (OpenAPI 3.1). `openapi/openapi.json` is a snapshot of it that a test holds.
//!
//! Requests are validated by hand ([`crate::jobs::request`]), so their shapes are described here for the document
//! alone.

use std::collections::BTreeMap;

use serde_json::Value;
use utoipa::{OpenApi, ToSchema};

use super::{covariance, events, jobs, maps, pictures, query, service};

/// A job request.
#[derive(ToSchema)]
#[schema(as = JobRequest)]
#[allow(dead_code)]
pub struct JobRequestBody {
    #[schema(max_length = 256)]
    name: Option<String>,
    labels: Option<BTreeMap<String, String>>,
    #[schema(min_items = 1)]
    scans: Vec<ScanBody>,
    noise: NoiseBody,
    map: MapRequestBody,
    fit: Option<FitRequestBody>,
    /// Higher runs first.
    #[schema(minimum = -1000, maximum = 1000)]
    priority: Option<i32>,
}

/// One laser scan; beam k has bearing angle_min + k angle_increment from the pose's heading.
#[derive(ToSchema)]
#[schema(as = Scan)]
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
#[derive(ToSchema)]
#[schema(as = Pose)]
#[allow(dead_code)]
pub struct PoseBody {
    x: f64,
    y: f64,
    theta: f64,
}

/// Standard deviations: metres, and radians for theta.
#[derive(ToSchema)]
#[schema(as = Noise)]
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

/// The map to fit.
#[derive(ToSchema)]
#[schema(as = MapRequest)]
#[allow(dead_code)]
pub struct MapRequestBody {
    /// `sdf` (signed, negative in free space) or `vdf` (the vector from the nearest surface point)
    distance: String,
    /// The spacing of control points, metres.
    #[schema(exclusive_minimum = 0.0)]
    resolution: f64,
    /// The area; without it, the returns and poses plus `margin`.
    bounds: Option<BoundsBody>,
    /// Metres; three cells by default.
    margin: Option<f64>,
}

/// Metres.
#[derive(ToSchema)]
#[schema(as = Bounds)]
#[allow(dead_code)]
pub struct BoundsBody {
    min: [f64; 2],
    max: [f64; 2],
}

/// How to fit it; everything is optional.
#[derive(ToSchema)]
#[schema(as = FitRequest)]
#[allow(dead_code)]
pub struct FitRequestBody {
    /// `calibrated` (default) or `paper`
    weighting: Option<String>,
    /// `refined` (default of calibrated, where affordable) or `fixed`
    poses: Option<String>,
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

/// A lattice of control points.
#[derive(ToSchema)]
#[schema(as = Lattice)]
#[allow(dead_code)]
pub struct LatticeBody {
    origin: [f64; 2],
    resolution: f64,
    cells: [u32; 2],
    control_points: [u32; 2],
}

/// What a fit reports about itself.
#[derive(ToSchema)]
#[schema(as = Fit)]
#[allow(dead_code)]
pub struct FitBody {
    weighting: String,
    converged: bool,
    iterations: u32,
    factorisations: u32,
    objective: f64,
    gradient_norm: f64,
    relative_gradient: f64,
    positive_definite: bool,
    observations: u32,
    seconds: f64,
    #[schema(value_type = Object)]
    weights: Value,
    /// vdf: the share of the returns left out because beams of other scans passed where they were.
    seen_through: Option<f64>,
    /// vdf: the share of the space fitted that lies at the cut locus, where the field jumps.
    cut_locus: Option<f64>,
    /// vdf: the control points in use; the others are null.
    active_control_points: Option<u32>,
}

/// A map's coefficients, x fastest.
#[derive(ToSchema)]
#[schema(as = Coefficients)]
#[allow(dead_code)]
pub struct CoefficientsBody {
    lattice: LatticeBody,
    /// Of a signed map; null where a control point is not in use.
    sdf: Option<Vec<Option<f64>>>,
    /// Of a vector map; null where a control point is not in use.
    vdf_x: Option<Vec<Option<f64>>>,
    vdf_y: Option<Vec<Option<f64>>>,
}

/// Variances of the coefficients, x fastest, square metres.
#[derive(ToSchema)]
#[schema(as = Diagonal)]
#[allow(dead_code)]
pub struct DiagonalBody {
    kind: String,
    lattice: LatticeBody,
    /// Of a signed map; null where a control point is not in use.
    sdf: Option<Vec<Option<f64>>>,
    /// Of a vector map; null where a control point is not in use.
    vdf_x: Option<Vec<Option<f64>>>,
    vdf_y: Option<Vec<Option<f64>>>,
}

/// The poses of a map's scans.
#[derive(ToSchema)]
#[schema(as = Poses)]
#[allow(dead_code)]
pub struct PosesBody {
    /// `refined` or `fixed`
    treatment: String,
    poses: Vec<RefinedPoseBody>,
}

/// A pose with its covariance, row-major in (x, y, theta); null where poses were fixed.
#[derive(ToSchema)]
#[schema(as = RefinedPose)]
#[allow(dead_code)]
pub struct RefinedPoseBody {
    pose: PoseBody,
    covariance: Option<Vec<f64>>,
    posterior_covariance: Option<Vec<f64>>,
}

/// An RFC 9457 problem.
#[derive(ToSchema)]
#[schema(as = Problem)]
#[allow(dead_code)]
pub struct ProblemBody {
    /// A stable URI that ends in a slug.
    r#type: String,
    title: String,
    status: u16,
    detail: String,
    instance: String,
    request_id: String,
    /// Of a 422: every fault, with a JSON Pointer or the name of a query parameter.
    errors: Option<Vec<FaultBody>>,
}

/// One fault.
#[derive(ToSchema)]
#[schema(as = Fault)]
#[allow(dead_code)]
pub struct FaultBody {
    pointer: Option<String>,
    parameter: Option<String>,
    detail: String,
}

#[derive(OpenApi)]
#[openapi(
    info(title = "mapfit", description = "Distance maps with their covariance, from laser scans."),
    paths(
        jobs::submit, jobs::list, jobs::get, jobs::request, jobs::cancel, events::events,
        maps::list, maps::get, maps::delete, maps::coefficients, maps::poses,
        covariance::covariance, query::query, pictures::contours, pictures::ogm, pictures::grid, pictures::image,
        service::openapi, service::livez, service::readyz,
    ),
    tags(
        (name = "jobs", description = "Scans in: submission, states, cancellation"),
        (name = "maps", description = "Maps out: coefficients, covariance, queries, pictures"),
        (name = "service", description = "Health and documentation"),
    )
)]
struct Contract;

/// The OpenAPI document.
pub fn document() -> utoipa::openapi::OpenApi {
    Contract::openapi()
}

//! What a job's body may hold, for the document.
//!
//! Bodies are read by [`crate::jobs::request`], which lists every fault with its pointer and caps arrays before memory
//! is taken for them; serde would stop at the first. These types say the same shape to clients, and the test below holds
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

#[cfg(test)]
mod tests {
    use serde_json::{Map, Value, json};

    use super::super::recording::Options;
    use crate::http::document;
    use crate::http::shared::problem::Problem;
    use crate::jobs::{JobRequest, Limits, RequestError, Sightings, join_body};

    /// A name that no schema has, and a text that is among no choices.
    const STRANGER: &str = "a stranger";

    /// What a parser says of a document: pointers, and what is wrong there.
    type Faults = Vec<(String, String)>;

    struct Schemas(Value);

    impl Schemas {
        fn of_the_document() -> Self {
            let document: Value = serde_json::from_str(&document()).unwrap();
            Self(document["components"]["schemas"].clone())
        }

        /// A schema behind its references, and behind the choice of null.
        fn resolved<'a>(&'a self, schema: &'a Value) -> &'a Value {
            if let Some(name) = schema["$ref"].as_str().and_then(|name| name.strip_prefix("#/components/schemas/")) {
                return self.resolved(&self.0[name]);
            }
            let choices = schema["oneOf"].as_array();
            match choices.and_then(|all| all.iter().find(|one| one["type"] != "null")) {
                Some(own) => self.resolved(own),
                None => schema,
            }
        }

        /// A document with every member that a schema knows and one that it does not, and with no valid choice anywhere;
        /// and what a parser that agrees says of it, by pointer.
        fn provocation(&self, schema: &Value, at: &str, expected: &mut Vec<(String, Vec<String>)>) -> Value {
            let schema = self.resolved(schema);
            if let Some(choices) = schema["enum"].as_array() {
                let choices = choices.iter().map(|choice| choice.as_str().unwrap().to_owned());
                expected.push((at.to_owned(), choices.collect()));
                return json!(STRANGER);
            }
            if let Some(properties) = schema["properties"].as_object() {
                expected.push((format!("{at}/{STRANGER}"), properties.keys().cloned().collect()));
                let known = properties
                    .iter()
                    .map(|(name, own)| (name.clone(), self.provocation(own, &format!("{at}/{name}"), expected)));
                let members: Map<String, Value> = known.chain([(STRANGER.to_owned(), json!(1))]).collect();
                return members.into();
            }
            let kind = schema["type"].as_array().and_then(|kinds| kinds.iter().find(|kind| *kind != "null"));
            match kind.unwrap_or(&schema["type"]).as_str() {
                Some("array") => {
                    let count = schema["minItems"].as_u64().unwrap_or(2).max(1);
                    (0..count).map(|k| self.provocation(&schema["items"], &format!("{at}/{k}"), expected)).collect()
                }
                Some("string") => json!("text"),
                Some("object") => json!({"a": "b"}),
                _ => json!(1),
            }
        }

        /// Holds a schema against a parser, both ways.
        fn agrees(&self, name: &str, parse: impl Fn(&[u8]) -> Faults) {
            let mut expected = Vec::new();
            let provocation = self.provocation(&self.0[name], "", &mut expected);
            assert!(!expected.is_empty(), "{name} is not in the document");
            let faults = parse(provocation.to_string().as_bytes());
            let expects = |pointer: &str| expected.iter().any(|(own, _)| own == pointer);
            let unknown = |(pointer, detail): &&(String, String)| {
                !expects(pointer) && (detail.contains("is not known here") || detail.contains("must be one of"))
            };
            for (pointer, names) in &expected {
                let said = faults.iter().find(|(own, _)| own == pointer);
                let (_, detail) = said.unwrap_or_else(|| panic!("{name}: nothing is said of {pointer} in {faults:?}"));
                let told = listed(detail);
                let mut names = names.clone();
                names.sort();
                assert_eq!(told, names, "{name}: the parser and the document differ at {pointer}: {detail}");
            }
            let strangers: Vec<_> = faults.iter().filter(unknown).collect();
            assert!(strangers.is_empty(), "{name}: the parser does not know what the document has: {strangers:?}");
        }
    }

    /// The names in "is not known here; a, b are" and in "must be one of a, b".
    fn listed(detail: &str) -> Vec<String> {
        let list = detail.strip_prefix("is not known here; ").and_then(|rest| rest.strip_suffix(" are"));
        let list = list.or_else(|| detail.strip_prefix("must be one of ")).unwrap_or_else(|| panic!("{detail}"));
        let mut names: Vec<String> = list.split(", ").map(str::to_owned).collect();
        names.sort();
        names
    }

    fn of_request<T>(read: Result<T, RequestError>) -> Faults {
        match read {
            Err(RequestError::Faults(faults)) => {
                faults.into_iter().map(|fault| (fault.pointer, fault.detail)).collect()
            }
            Err(other) => panic!("{other}"),
            Ok(_) => panic!("it has a stranger in it"),
        }
    }

    fn of_problem<T>(read: Result<T, Problem>) -> Faults {
        let errors = read.err().expect("it has a stranger in it").errors;
        errors.into_iter().map(|fault| (fault.pointer.unwrap_or_default(), fault.detail)).collect()
    }

    fn job() -> JobRequest {
        let pose = json!({"x": 1.0, "y": 1.0, "theta": 0.0});
        let scan = json!({"pose": pose, "angle_min": 0.0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 9.0,
            "ranges": [1.0]});
        let job = json!({"scans": [scan], "map": {"distance": "sdf", "resolution": 0.5},
            "noise": {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.01, "sigma_range": 0.01}});
        JobRequest::parse(job.to_string().as_bytes(), &Limits::default()).unwrap()
    }

    #[test]
    fn the_document_and_the_parsers_know_the_same_members_and_choices() {
        let (schemas, limits, job) = (Schemas::of_the_document(), Limits::default(), job());
        schemas.agrees("JobRequest", |json| of_request(JobRequest::parse(json, &limits)));
        schemas.agrees("UpdateRequest", |json| of_request(job.updated(json, &limits)));
        schemas.agrees("JoinRequest", |json| of_request(join_body(json, &limits)));
        schemas.agrees("LocalizeBody", |json| of_request(Sightings::parse(json, &limits)));
        schemas.agrees("RecordingOptions", |json| of_problem(Options::read(json, &limits)));
    }
}

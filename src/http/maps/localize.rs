//! Where scans were taken, on a map.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, Uri};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::resumed::turn_with_joint;
use crate::geometry::{Cov3, Pose};
use crate::http::jobs::schema::{NoiseBody, PoseBody};
use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::negotiate::{JSON, negotiate};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::http::shared::{AppState, Caller};
use crate::jobs::Sightings;
use crate::localize::{AT_ONCE, Ground, Hypothesis, LocalizeError, Localizer, Located};
use crate::map::FittedMap;
use crate::uncertainty::{Joint, Kind, UncertaintyError};
use crate::worker::Reserved;

/// A job's scan, whose pose is what is known of it beforehand; null is anywhere on the map.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
struct SightedScan {
    #[schema(required)]
    pose: Option<PoseBody>,
    #[schema(min_items = 9, max_items = 9)]
    pose_covariance: Option<Vec<f64>>,
    angle_min: f64,
    angle_increment: f64,
    range_min: f64,
    range_max: f64,
    /// Metres; null, or outside [range_min, range_max], is no return.
    ranges: Vec<Option<f64>>,
}

/// A motion from one scan to the next, in the frame of the former.
#[derive(Deserialize, ToSchema)]
#[schema(as = Motion)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
struct MotionBody {
    x: f64,
    y: f64,
    theta: f64,
    /// Row-major in (x, y, theta), symmetric positive definite.
    #[schema(min_items = 9, max_items = 9)]
    covariance: Vec<f64>,
}

/// What is asked.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct LocalizeBody {
    /// At most 1,000; along one trajectory, 200.
    #[schema(min_items = 1, max_items = 1000)]
    scans: Vec<SightedScan>,
    noise: NoiseBody,
    /// The map's covariance: `propagated` (default) or `posterior`
    kind: Option<Kind>,
    /// One fewer than scans: makes them one trajectory.
    #[schema(max_items = 199)]
    motions: Option<Vec<MotionBody>>,
    /// Distinct poses a scan, at most; 1 by default.
    #[schema(minimum = 0, maximum = 50)]
    hypotheses: Option<u32>,
}

/// Where a scan was taken.
#[derive(Serialize, ToSchema)]
#[schema(as = LocatedScan)]
struct LocatedBody {
    /// null where the scan fits nowhere.
    #[schema(required)]
    pose: Option<Pose>,
    /// Row-major in (x, y, theta), the map's own uncertainty included.
    #[schema(required)]
    covariance: Option<[f64; 9]>,
    converged: bool,
    /// Returns that agree with the map.
    used: usize,
    left_out: usize,
    chi_squared: f64,
    degrees_of_freedom: usize,
    /// The best first.
    hypotheses: Vec<HypothesisBody>,
}

/// A pose, and how probable it is among those that were found.
#[derive(Serialize, ToSchema)]
#[schema(as = Hypothesis)]
struct HypothesisBody {
    pose: Pose,
    probability: f64,
}

/// Poses in the scans' order.
#[derive(Serialize, ToSchema)]
#[schema(as = Localization)]
struct LocalizationBody {
    poses: Vec<LocatedBody>,
}

/// Locate scans on a map.
#[utoipa::path(post, operation_id = "localize_scans", path = "/v1/maps/{id}/localize", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path)),
    request_body(content((LocalizeBody = "application/json"))),
    responses((status = 200, description = "poses in the scans' order", body = LocalizationBody), Refused))]
pub async fn localize_scans(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let (record, body) = state.before(state.map_record(&caller, &id).await, body)?;
    let mut params = Params::of(&uri);
    let ((), body) = state.before(negotiate(&headers, &mut params, &[JSON]).and_then(|_| params.finish()), body)?;
    let received = state.read_body(&headers, body, &[JSON.media]).await?;
    let limits = state.workshop.limits;
    let read = move |_: &Leash| Ok(Sightings::parse(&received.unpack()?, &limits)?);
    let asked = state.compute.run(Queue::Requests, read).await?;
    // Packed, it was counted by less than it is now.
    let counted = state.hold(size_of::<f64>() * asked.ranges())?;
    // What takes seconds waits for its like, so that nobody who asks a little waits for it.
    let queue = if asked.is_light() { Queue::Answers } else { Queue::Heavy };
    let (turn, map, joint) = turn_with_joint(&state, &caller, &record, queue).await?;
    let kept = state.clone();
    let find = move |leash: &Leash| {
        let _counted = counted;
        let go_on = || leash.holds();
        let _held = match queue {
            Queue::Heavy => Some(reserved(&kept, &joint, &asked, &go_on)?),
            _ => None,
        };
        let ground = ground(&kept, &record.id, &map);
        let localizer = Localizer::new(&map, &ground, &joint, asked.kind);
        let located = match &asked.motions {
            None => localizer.each(&asked.scans, asked.hypotheses, &go_on),
            Some(motions) => localizer.along(&asked.scans, motions, asked.hypotheses, &go_on),
        };
        let poses = located.map_err(refused)?.into_iter().map(LocatedBody::of).collect();
        to_json(&LocalizationBody { poses })
    };
    let body = turn.run(find).await?;
    let body = state.answers.take(body.len())?.body(body);
    Ok(([("content-type", JSON.media)], body).into_response())
}

/// The memory that a long question takes, from what fits share.
fn reserved<'a>(
    state: &'a AppState,
    joint: &Joint,
    asked: &Sightings,
    go_on: &dyn Fn() -> bool,
) -> Result<Reserved<'a>, Problem> {
    let together = if asked.motions.is_some() { asked.scans.len() } else { AT_ONCE };
    state.workshop.reserve(joint.most_bytes(3 * together) as u64, go_on).ok_or_else(Problem::too_slow)
}

/// The raster of a map, kept or formed now.
fn ground(state: &AppState, id: &str, map: &FittedMap) -> Arc<Ground> {
    state.grounds.get(id).unwrap_or_else(|| {
        let formed = Arc::new(Ground::of(map));
        state.grounds.keep(id, formed.clone(), formed.held_bytes());
        formed
    })
}

fn refused(error: LocalizeError) -> Problem {
    match error {
        LocalizeError::Cancelled | LocalizeError::Uncertainty(UncertaintyError::Cancelled) => Problem::too_slow(),
        // The question was validated: what is left is the service's own.
        other => Problem::internal(&other),
    }
}

impl LocatedBody {
    fn of(located: Located) -> Self {
        let hypothesis = |own: Hypothesis| HypothesisBody { pose: own.pose, probability: own.probability };
        let row_major = |c: Cov3| std::array::from_fn(|k| c[(k / 3, k % 3)]);
        Self {
            pose: located.pose,
            covariance: located.covariance.map(row_major),
            converged: located.pose.is_some(),
            used: located.used,
            left_out: located.left_out,
            chi_squared: located.chi_squared,
            degrees_of_freedom: located.degrees_of_freedom,
            hypotheses: located.hypotheses.into_iter().map(hypothesis).collect(),
        }
    }
}

//! Where the frames of joined maps lie.

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use super::request::{MapRequest, Settled};
use crate::geometry::Pose;
use crate::http::shared::compute::Queue;
use crate::http::shared::kept::unpack;
use crate::http::shared::negotiate::JSON;
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::jobs::Stored;

/// The frames of a joined map; none of any other.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Frames)]
struct FramesBody {
    frames: Vec<FrameBody>,
}

/// Where a map's frame lies in the joined map's.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Frame)]
struct FrameBody {
    map_id: String,
    pose: Pose,
    /// Row-major in (x, y, theta); zero of the first, which is held.
    covariance: [f64; 9],
}

/// Where the frames of the maps that were joined to this one lie in its own, as the fit found them.
#[utoipa::path(get, operation_id = "get_map_frames", path = "/v1/maps/{id}/frames", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path)),
    responses((status = 200, description = "a frame a map of the join, in its order; of a map that is no join there are none", body = FramesBody),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_frames(request: MapRequest) -> Result<Response, Problem> {
    let wanted = match request.settle(&[JSON])? {
        Settled::Unchanged(response) => return Ok(response),
        Settled::Wanted(wanted) => wanted,
    };
    let (state, record) = (&wanted.state, &wanted.record);
    let (turn, map) = state.turn_with(Queue::Requests, record).await?;
    let packed = state.workshop.records.request(&wanted.caller.tenant, &record.job_id).await?;
    let packed =
        packed.ok_or_else(|| Problem::not_found("the map's job is gone, and with it what its frames are called"))?;
    if map.frames.is_empty() {
        return wanted.respond(to_json(&FramesBody { frames: Vec::new() })?);
    }
    let limits = state.workshop.limits;
    let (packed, bytes) = turn.measured(packed, u64::MAX).await?;
    let held = state.may_unpack(&turn, bytes).await?;
    let tell = move |_: &_| {
        let _held = held;
        let stored = unpack(&packed)?;
        let request = Stored::read(&stored).and_then(|stored| stored.request(&limits));
        let request = request.map_err(|error| Problem::internal(&error))?;
        let frames = request.joined.iter().flat_map(|joined| joined.frames(&map));
        let frames = frames.map(|(map_id, pose, covariance)| FrameBody {
            map_id: map_id.to_owned(),
            pose,
            covariance: std::array::from_fn(|k| covariance[(k / 3, k % 3)]),
        });
        to_json(&FramesBody { frames: frames.collect() })
    };
    let body = turn.run(tell).await?;
    wanted.respond(body)
}

//! A join: several maps as one, as a job of its own.
//!
//! As with an update, what is kept of it is all that it is fitted from: the maps' stored requests and its own body.

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

use super::dry_run::DryRun;
use super::record::JobBody;
use super::schema::JoinRequestBody;
use super::submit::{Submitted, accept, idempotency_key, new_job, within_memory};
use crate::http::shared::compute::{Leash, Queue, Turn};
use crate::http::shared::kept::{most_unpacked, unpack};
use crate::http::shared::negotiate::JSON;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};
use crate::jobs::{Fault, JobRequest, JoinBody, Limits, Stored, join_body};
use crate::store::NewJob;

/// Join maps into one.
///
/// `pose` is where a map's frame lies in the joined frame, a guess but for the first map, which is held. Frames are found
/// from the guesses, and refined with all scans' poses in one fit; a join whose frames are not determined, or whose guess
/// is wrong, fails and says so. Every scan counts once.
#[utoipa::path(post, operation_id = "join_maps", path = "/v1/joins", tag = "jobs", security(("key" = ["submit"])),
    params(
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255,
            description = "makes a repeat of the same body return the first job"),
        ("dry_run" = Option<bool>, Query, description = "true: say what the map would be and cost where the guesses are, and keep nothing")),
    request_body(content = JoinRequestBody, description = "the maps, where they may lie, and the map to fit"),
    responses(
        (status = 202, body = JobBody, description = "accepted", headers(("location" = String, description = "the job's address"))),
        (status = 200, body = Submitted, description = "this key and body were accepted before; or, of a dry run, what it would be"),
        (status = 409, body = crate::http::shared::problem::ProblemBody, content_type = "application/problem+json",
            description = "the request that one of the maps was fitted from is gone"),
        Refused,
    ))]
pub async fn join_maps(
    State(state): State<AppState>,
    caller: Caller,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let dry_run = params.choice("dry_run", &[("false", false), ("true", true)]);
    let ((), body) = state.before(params.finish(), body)?;
    let received = state.read_body(&headers, body, &[JSON.media]).await?;
    let key = idempotency_key(&headers)?;
    let (limits, quota, budget) = (state.workshop.limits, state.limits.quota, state.workshop.rules.memory);
    let read = move |_: &Leash| {
        let json = received.unpack()?;
        let join = join_body(&json, &limits)?;
        Ok((json, join))
    };
    let turn = state.compute.turn(Queue::Requests).await?;
    let (json, join) = turn.run(read).await?;
    let (packed, bytes) = stored_requests(&state, &turn, &caller, &join).await?;
    let held = state.may_unpack(&turn, bytes).await?;
    if dry_run {
        let try_out = move |leash: &Leash| {
            let _held = held;
            let (request, _) = whole(join, &packed, &json, &limits)?;
            DryRun::of(&request, &|| leash.holds()).ok_or_else(Problem::too_slow)
        };
        return Ok(Json(turn.run(try_out).await?).into_response());
    }
    let prepare = move |leash: &Leash| {
        let _held = held;
        let (request, stored) = whole(join, &packed, &json, &limits)?;
        within_memory(&request, budget, ("/map/resolution", "a coarser resolution or fewer maps need less"), leash)?;
        let digest = hex::encode(Sha256::digest(&json));
        new_job(request, &stored, key.map(|key| (key, digest)))
    };
    let new = turn.run(prepare).await?;
    drop(turn);
    accept(&state, NewJob { tenant: caller.tenant.to_string(), quota: Some(quota), ..new }).await
}

/// What is kept of the maps' requests, packed, in the join's order, and its bytes once it is unpacked. Maps that are not
/// there are faults of the body.
async fn stored_requests(
    state: &AppState,
    turn: &Turn,
    caller: &Caller,
    join: &JoinBody,
) -> Result<(Vec<Vec<u8>>, u64), Problem> {
    let (mut packed, mut faults, mut bytes) = (Vec::new(), Vec::new(), 0_u64);
    let most = most_unpacked(state.workshop.rules.memory);
    for (k, member) in join.members.iter().enumerate() {
        let Some(record) = state.workshop.records.map(&caller.tenant, &member.id).await? else {
            let detail = format!("there is no map {}", member.id);
            faults.push(Fault { pointer: format!("/maps/{k}/id"), detail });
            continue;
        };
        let own = state.workshop.records.request(&caller.tenant, &record.job_id).await?;
        let own = own.ok_or_else(|| {
            let detail =
                format!("the job {} and its request are gone, and with it the scans of the map", record.job_id);
            Problem::new(StatusCode::CONFLICT, "request-gone", "The map's request is gone", detail)
        })?;
        let (own, more) = turn.measured(own, most).await?;
        bytes = bytes.saturating_add(more);
        packed.push(own);
        if bytes > most {
            let detail =
                format!("together, the maps' requests are more than {most} bytes, which is what is joined at once");
            return Err(Problem::invalid(vec![Fault { pointer: "/maps".into(), detail }]));
        }
    }
    if faults.is_empty() { Ok((packed, bytes)) } else { Err(Problem::invalid(faults)) }
}

/// The request of all scans, and what to keep of it.
fn whole(join: JoinBody, packed: &[Vec<u8>], body: &[u8], limits: &Limits) -> Result<(JobRequest, Vec<u8>), Problem> {
    let members = packed.iter().map(|packed| unpack(packed)).collect::<Result<Vec<_>, _>>()?;
    let maps = members.iter().map(|member| Stored::read(member)?.request(limits));
    let maps = maps.collect::<Result<Vec<_>, _>>().map_err(|error| Problem::internal(&error))?;
    let request = join.request(&maps, limits)?;
    let stored = Stored::joined(members, body).ok_or_else(|| {
        let detail = "this is more than may be kept of one job, or joins of joins are nested too deeply".into();
        Problem::invalid(vec![Fault { pointer: "/maps".into(), detail }])
    })?;
    Ok((request, stored.to_bytes().map_err(|error| Problem::internal(&error))?))
}

//! An update: new scans for a map that is there, as a job of its own.
//!
//! What is kept of it is the parent's stored request and the new scans, so nothing that becomes of the parent, or of its
//! job, while this one waits can take anything from it.

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

use super::dry_run::DryRun;
use super::record::JobBody;
use super::schema::UpdateRequestBody;
use super::submit::{Submitted, accept, idempotency_key, new_job, within_memory};
use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::kept::{most_unpacked, told, unpack};
use crate::http::shared::negotiate::JSON;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};
use crate::jobs::{Fault, JobRequest, Limits, Lineage, MapRecord, Stored};
use crate::store::NewJob;

/// A parent's stored request no larger than this, packed and unpacked, is read where small bodies are.
const SMALL: usize = 64 << 10;
const LARGE: u64 = 1 << 20;

/// Update a map with new scans.
///
/// A job whose map has `parent` this one, and knows what a fit of all scans together would know; this map stays as it is.
/// The lattice's cells are the parent's; where the parent's request had no bounds, it grows to hold what the new scans
/// met.
#[utoipa::path(post, operation_id = "update_map", path = "/v1/maps/{id}/updates", tag = "maps", security(("key" = ["submit"])),
    params(("id" = String, Path),
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255,
            description = "makes a repeat of the same body for the same map return the first job"),
        ("dry_run" = Option<bool>, Query, description = "true: say what the map would be and cost, and keep nothing")),
    request_body(content = UpdateRequestBody, description = "new scans and their noise; may be gzip or zstd"),
    responses(
        (status = 202, body = JobBody, description = "accepted", headers(("location" = String, description = "the job's address"))),
        (status = 200, body = Submitted, description = "this key and body were accepted before; or, of a dry run, what it would be"),
        (status = 409, body = crate::http::shared::problem::ProblemBody, content_type = "application/problem+json",
            description = "the request that the map was fitted from is gone"),
        Refused,
    ))]
pub async fn update_map(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let dry_run = params.choice("dry_run", &[("false", false), ("true", true)]);
    let ((), body) = state.before(params.finish(), body)?;
    let ((record, packed), body) = state.before(parent(&state, &caller, &id).await, body)?;
    let received = state.read_body(&headers, body, &[JSON.media]).await?;
    let key = idempotency_key(&headers)?;
    let (limits, quota, budget) = (state.workshop.limits, state.limits.quota, state.workshop.rules.memory);
    let most = most_unpacked(budget);
    let (turn, packed) = match packed {
        Some(packed) => (state.compute.turn(received.queue()).await?, packed),
        None => (state.compute.turn(Queue::Requests).await?, kept(&state, &caller, &record).await?),
    };
    let (packed, bytes) = turn.measured(packed, most).await?;
    if bytes > most {
        let detail =
            format!("what the map was formed from is more than {most} bytes, which is what is updated at once");
        return Err(Problem::invalid(vec![Fault { pointer: "/scans".into(), detail }]));
    }
    let held = state.may_unpack(&turn, bytes).await?;
    let update = Update { lineage: Lineage { parent: Some(record.id), version: record.version + 1 }, packed };
    if dry_run {
        let try_out = move |leash: &Leash| {
            let _held = held;
            let (request, _) = update.stored(&received.unpack()?, &limits)?;
            DryRun::of(&request, &|| leash.holds()).ok_or_else(Problem::too_slow)
        };
        return Ok(Json(turn.run(try_out).await?).into_response());
    }
    let prepare = move |leash: &Leash| {
        let _held = held;
        update.job(&received.unpack()?, key, &limits, (budget, leash))
    };
    let new = turn.run(prepare).await?;
    drop(turn);
    accept(&state, NewJob { tenant: caller.tenant.to_string(), quota: Some(quota), ..new }).await
}

/// A map and, where it is small, what is kept of its job's request: what is large is read in a turn, so that nobody holds
/// it who still sends his own.
async fn parent(state: &AppState, caller: &Caller, id: &str) -> Result<(MapRecord, Option<Vec<u8>>), Problem> {
    let record = state.map_record(caller, id).await?;
    let packed = kept(state, caller, &record).await?;
    let small = packed.len() <= SMALL && told(&packed).is_some_and(|bytes| bytes <= LARGE);
    Ok((record, small.then_some(packed)))
}

/// What is kept of the request of a map's job, packed.
async fn kept(state: &AppState, caller: &Caller, record: &MapRecord) -> Result<Vec<u8>, Problem> {
    let packed = state.workshop.records.request(&caller.tenant, &record.job_id).await?;
    packed.ok_or_else(|| {
        let detail = format!("the job {} and its request are gone, and with it the scans of the map", record.job_id);
        Problem::new(StatusCode::CONFLICT, "request-gone", "The map's request is gone", detail)
    })
}

/// An update whose own body is still to come.
struct Update {
    lineage: Lineage,
    /// The parent's stored request.
    packed: Vec<u8>,
}

impl Update {
    /// The request of all scans, and what to keep of it.
    fn stored(&self, body: &[u8], limits: &Limits) -> Result<(JobRequest, Vec<u8>), Problem> {
        let parent = unpack(&self.packed)?;
        let parent = Stored::read(&parent).map_err(|error| Problem::internal(&error))?;
        let before = parent.request(limits).map_err(|error| Problem::internal(&error))?;
        let request = before.updated(body, limits)?;
        let stored = parent.updated(self.lineage.clone(), body).ok_or_else(|| {
            let detail = "with all that the map was formed from, this is more than may be kept of one job".into();
            Problem::invalid(vec![Fault { pointer: "/scans".into(), detail }])
        })?;
        Ok((request, stored.to_bytes().map_err(|error| Problem::internal(&error))?))
    }

    fn job(
        &self,
        body: &[u8],
        key: Option<String>,
        limits: &Limits,
        (budget, leash): (u64, &Leash),
    ) -> Result<NewJob, Problem> {
        let (request, stored) = self.stored(body, limits)?;
        let advice = "all scans of the map count, with those it has already";
        within_memory(&request, budget, ("/scans", advice), leash)?;
        // The same body for another map is another request.
        let parent = self.lineage.parent.as_deref().unwrap_or_default();
        let digest = Sha256::new().chain_update(parent).chain_update(b"\n").chain_update(body).finalize();
        new_job(request, &stored, key.map(|key| (key, hex::encode(digest))))
    }
}

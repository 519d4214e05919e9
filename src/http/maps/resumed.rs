//! A map's fit, found again at its end: what is not stored with a map is formed from there.
//!
//! The job's request and the map together say where the fit ended; `fit::resume` assembles the system there. That takes
//! about the memory that the fit took, so it is reserved from what fits share. What blocks of the covariance are formed
//! from is kept for the next, in a cache bounded in bytes.

use std::sync::Arc;

use axum::http::StatusCode;

use crate::fit::Estimate;
use crate::http::shared::compute::{Leash, Queue, Turn};
use crate::http::shared::kept::unpack;
use crate::http::shared::problem::Problem;
use crate::http::shared::{AppState, Caller};
use crate::jobs::{MapRecord, Stored};
use crate::map::FittedMap;
use crate::uncertainty::{Factors, Joint};

/// What a map's fit is found again from.
struct Ended {
    map: Arc<FittedMap>,
    packed: Vec<u8>,
}

/// A turn, and within it a map and what blocks of its covariance are formed from. Whoever asks a little has a turn among
/// his like where that is known, and is among those who form it where it is not.
pub async fn turn_with_joint(
    state: &AppState,
    caller: &Caller,
    record: &MapRecord,
    queue: Queue,
) -> Result<(Turn, Arc<FittedMap>, Arc<Joint>), Problem> {
    if queue != Queue::Heavy && state.joints.get(&record.id).is_some() {
        let (turn, map) = state.turn_with(queue, record).await?;
        if let Some(known) = state.joints.get(&record.id) {
            return Ok((turn, map, known));
        }
    }
    let (turn, map) = state.turn_with(Queue::Heavy, record).await?;
    let joint = joint(state, caller, record, (&turn, &map)).await?;
    Ok((turn, map, joint))
}

/// What blocks of the covariance are formed from, kept or formed now.
async fn joint(
    state: &AppState,
    caller: &Caller,
    record: &MapRecord,
    (turn, map): (&Turn, &Arc<FittedMap>),
) -> Result<Arc<Joint>, Problem> {
    // Whoever was ahead in the queue may have formed it.
    if let Some(known) = state.joints.get(&record.id) {
        return Ok(known);
    }
    let ended = Ended::of(state, caller, record, map).await?;
    let (again, id) = (state.clone(), record.id.clone());
    let form = move |leash: &Leash| {
        let formed = ended.with_estimate(&again.workshop, leash, |estimate| {
            Joint::of(estimate, &|_| leash.holds()).map_err(|error| Problem::internal(&error))
        })?;
        let formed = Arc::new(formed);
        again.joints.keep(&id, formed.clone(), formed.held_bytes());
        Ok(formed)
    };
    turn.run(form).await
}

/// An answer made from what any entry of the covariance is formed from.
pub async fn from_factors(
    state: &AppState,
    caller: &Caller,
    record: &MapRecord,
    make: impl FnOnce(Factors) -> Result<Vec<u8>, Problem> + Send + 'static,
) -> Result<Vec<u8>, Problem> {
    let (turn, map) = state.turn_with(Queue::Heavy, record).await?;
    let ended = Ended::of(state, caller, record, &map).await?;
    let workshop = state.workshop.clone();
    let form = move |leash: &Leash| {
        ended.with_estimate(&workshop, leash, |mut estimate| {
            let factors = Factors::of(&mut estimate).map_err(|error| Problem::internal(&error))?;
            drop(estimate);
            leash.goes_on()?;
            make(factors)
        })
    };
    turn.run(form).await
}

impl Ended {
    async fn of(state: &AppState, caller: &Caller, record: &MapRecord, map: &Arc<FittedMap>) -> Result<Self, Problem> {
        let packed = state.workshop.records.request(&caller.tenant, &record.job_id).await?;
        let packed =
            packed.ok_or_else(|| Problem::not_found("the map's job is gone, and with it what this is formed from"))?;
        Ok(Self { map: map.clone(), packed })
    }

    /// What `form` makes of the fit's end, within the memory that fits share.
    fn with_estimate<T>(
        &self,
        workshop: &crate::worker::Workshop,
        leash: &Leash,
        form: impl FnOnce(Estimate) -> Result<T, Problem>,
    ) -> Result<T, Problem> {
        let stored = unpack(&self.packed)?;
        let request = Stored::read(&stored).and_then(|stored| stored.request(&workshop.limits));
        let request = request.map_err(|error| Problem::internal(&error))?;
        drop(stored);
        let (_, cost) = request.cost(&|| leash.holds()).ok_or_else(Problem::too_slow)?;
        if !workshop.allows(cost.bytes as u64) {
            return Err(too_large(cost.bytes));
        }
        let _held = workshop.reserve(cost.bytes as u64, &|| leash.holds()).ok_or_else(Problem::too_slow)?;
        let estimate = request.resume(&self.map, &|| leash.holds());
        leash.goes_on()?;
        let estimate = estimate.map_err(|error| Problem::internal(&error))?;
        form(estimate)
    }
}

/// 503: a map that was fitted where there was more memory, or before there was less.
fn too_large(bytes: f64) -> Problem {
    let detail = format!(
        "forming this takes about {:.0} MB, more than fits and such answers may hold together (--memory); `diagonal`, \
         `sparse` and queries take none of it",
        bytes / 1e6
    );
    Problem { detail, ..Problem::of_status(StatusCode::SERVICE_UNAVAILABLE) }
}

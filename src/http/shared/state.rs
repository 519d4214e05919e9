//! What every handler shares.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::http::header;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::Serialize;
use utoipa::ToSchema;

use super::cache::Cache;
use super::caller::Caller;
use super::compute::{Compute, Queue, Turn};
use super::kept::most_unpacked;
use super::keyed::Keyed;
use super::page::Page;
use super::problem::{Problem, to_json};
use super::rate::Rates;
use super::ration::{Ration, Share};
use super::rules::Rules;
use crate::jobs::{Job, MapRecord};
use crate::localize::Ground;
use crate::map::FittedMap;
use crate::store::{MAP_FILE, Quota};
use crate::uncertainty::Joint;
use crate::worker::Workshop;

/// Rows of a list that are written as they are asked for.
const SMALL_PAGE: usize = 100;
/// Maps that are loaded side by side, where ids fall apart.
const STRIPES: usize = 16;

pub struct Service {
    pub workshop: Arc<Workshop>,
    pub compute: Compute,
    pub limits: HttpLimits,
    /// Bytes of request bodies, and of answers on their way, that are held at once.
    pub bodies: Ration,
    pub answers: Ration,
    /// Bytes of kept requests that are unpacked at once.
    pub unpacked: Ration,
    /// The OpenAPI document.
    pub document: Bytes,
    /// What its routes need, and how often a key may ask.
    pub rules: Rules,
    pub rates: Rates,
    keyed: Keyed,
    maps: Cache<FittedMap>,
    /// One of them is held while a map is loaded, which by its id.
    loading: [tokio::sync::Mutex<()>; STRIPES],
    /// By map: what blocks of its covariance are formed from.
    pub joints: Cache<Joint>,
    /// By map: its raster that scans are looked for on.
    pub grounds: Cache<Ground>,
}

pub type AppState = Arc<Service>;

/// What the HTTP side may use of the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HttpLimits {
    /// Bytes a request body may have after decompression.
    pub body: usize,
    /// Bytes of all request bodies that are held at once, and of all answers on their way.
    pub bodies: usize,
    pub answers: usize,
    /// Bytes of loaded maps that are kept for the next request.
    pub cache: usize,
    /// Bytes that are kept of what blocks of covariances are formed from, and of rasters that scans are looked for on.
    pub joints: usize,
    pub grounds: usize,
    /// How long an answer may take.
    pub patience: Duration,
    /// Open connections.
    pub connections: usize,
    /// Requests a key may make in a second; `None` counts none.
    pub requests_a_second: Option<u32>,
    /// What a tenant may have.
    pub quota: Quota,
}

impl Default for HttpLimits {
    fn default() -> Self {
        Self {
            body: 64 << 20,
            bodies: 128 << 20,
            answers: 128 << 20,
            cache: 128 << 20,
            joints: 128 << 20,
            grounds: 16 << 20,
            patience: Duration::from_secs(60),
            connections: 8192,
            requests_a_second: None,
            quota: Quota { queued: 100_000, bytes: i64::MAX },
        }
    }
}

impl Service {
    pub fn new(workshop: Arc<Workshop>, limits: HttpLimits, document: String) -> Self {
        let unpacked = usize::try_from(most_unpacked(workshop.rules.memory)).unwrap_or(usize::MAX);
        let unpacked = Ration::new(unpacked);
        Self {
            rules: Rules::of(&document),
            rates: Rates::new(limits.requests_a_second),
            keyed: Keyed::default(),
            workshop,
            document: document.into(),
            limits,
            compute: Compute::new(limits.patience),
            bodies: Ration::new(limits.bodies),
            answers: Ration::new(limits.answers),
            unpacked,
            maps: Cache::new(limits.cache),
            loading: Default::default(),
            joints: Cache::new(limits.joints),
            grounds: Cache::new(limits.grounds),
        }
    }

    /// Whether nobody comes in without a key.
    pub async fn has_keys(&self) -> Result<bool, Problem> {
        Ok(self.keyed.has_keys(&*self.workshop.records).await?)
    }

    /// A job, 404 where there is none.
    pub async fn job(&self, caller: &Caller, id: &str) -> Result<Job, Problem> {
        let job = self.workshop.records.job(&caller.tenant, id).await?;
        job.ok_or_else(|| Problem::not_found(format!("there is no job {id}")))
    }

    /// A map's record, 404 where there is none.
    pub async fn map_record(&self, caller: &Caller, id: &str) -> Result<MapRecord, Problem> {
        let record = self.workshop.records.map(&caller.tenant, id).await?;
        record.ok_or_else(|| Problem::not_found(format!("there is no map {id}")))
    }

    /// A turn, and within it a map. Whoever waits for a turn holds no map: where it was thrown out meanwhile it is loaded
    /// once more. Small questions wait so little that they do, and never load one in a turn of theirs.
    pub async fn turn_with(&self, queue: Queue, record: &MapRecord) -> Result<(Turn, Arc<FittedMap>), Problem> {
        let until = self.compute.until();
        let loaded = match self.maps.get(&record.id) {
            Some(_) => None,
            None => Some(self.load_once(record, until).await?),
        };
        let held = loaded.filter(|_| queue == Queue::Small);
        let turn = self.compute.turn_by(queue, until).await?;
        let map = match held {
            Some(map) => map,
            None => self.load(&turn, record).await?,
        };
        Ok((turn, map))
    }

    /// Many who ask for one map at once load it once.
    async fn load_once(&self, record: &MapRecord, until: Instant) -> Result<Arc<FittedMap>, Problem> {
        let loading = tokio::time::timeout_at(until.into(), self.loading[stripe(&record.id)].lock());
        let _loading = loading.await.map_err(|_| Problem::too_slow())?;
        if let Some(map) = self.maps.get(&record.id) {
            return Ok(map);
        }
        self.load(&self.compute.turn_by(Queue::Loading, until).await?, record).await
    }

    /// A map's arrays, from memory or, within a turn, from its artifacts.
    pub async fn load(&self, turn: &Turn, record: &MapRecord) -> Result<Arc<FittedMap>, Problem> {
        if let Some(map) = self.maps.get(&record.id) {
            return Ok(map);
        }
        let bytes = self.workshop.artifacts.get(&record.prefix, MAP_FILE, record.sha256.as_deref());
        let bytes = turn.within(bytes).await??;
        let map = turn.run(move |_| Ok(Arc::new(FittedMap::from_npz(&bytes)?))).await?;
        self.maps.keep(&record.id, map.clone(), map.held_bytes());
        Ok(map)
    }

    /// The right to unpack kept requests of so many bytes, for as long as it is held.
    pub async fn may_unpack(&self, turn: &Turn, bytes: u64) -> Result<Share, Problem> {
        self.unpacked.wait(usize::try_from(bytes).unwrap_or(usize::MAX), turn.until()).await
    }

    /// A page of a list. Labels are what clients make of them: a thousand rows may be megabytes, which are formed off the
    /// threads that answer, and counted until they are taken.
    pub async fn page<T: Serialize + ToSchema + Send + 'static>(&self, page: Page<T>) -> Result<Response, Problem> {
        let json = match page.items.len() {
            0..=SMALL_PAGE => to_json(&page)?,
            _ => self.compute.run(Queue::Small, move |_| to_json(&page)).await?,
        };
        let body = self.answers.take(json.len())?.body(json);
        Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
    }

    /// Forgets a deleted map.
    pub fn forget(&self, id: &str) {
        self.maps.forget(id);
        self.joints.forget(id);
        self.grounds.forget(id);
    }
}

fn stripe(id: &str) -> usize {
    id.bytes().fold(0, |sum, byte| (31 * sum + usize::from(byte)) % STRIPES)
}

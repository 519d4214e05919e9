//! Fitted maps never change: strong ETags for clients, a few loaded maps kept in memory for ourselves.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use tokio::sync::Semaphore;

use super::negotiate::Format;
use super::problem::Problem;
use super::{Service, TENANT};
use crate::jobs::MapRecord;
use crate::map::FittedMap;

/// Maps kept in memory.
const KEPT: usize = 8;

/// The maps used last, and a bound on how many requests compute at once.
pub struct MapCache {
    kept: Mutex<Vec<(String, Arc<FittedMap>)>>,
    requests: Arc<Semaphore>,
    answers: Arc<Semaphore>,
}

/// Which work waits for which: a submission never waits for a map's answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Queue {
    /// Requests being read: short.
    Requests,
    /// Answers made from maps' arrays.
    Answers,
}

impl Default for MapCache {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(2, |n| n.get());
        let permits = || Arc::new(Semaphore::new(cores));
        Self { kept: Mutex::default(), requests: permits(), answers: permits() }
    }
}

/// Lives as long as a request's client waits; work that is done for it asks whether it still does.
#[derive(Debug, Default)]
pub struct Waiting(Arc<AtomicBool>);

impl Waiting {
    /// Asks, from wherever the work runs.
    pub fn asker(&self) -> impl Fn() -> bool + Send + 'static {
        let left = self.0.clone();
        move || !left.load(Ordering::Relaxed)
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Service {
    /// A map's record, 404 where there is none.
    pub async fn map_record(&self, id: &str) -> Result<MapRecord, Problem> {
        let record = self.workshop.records.map(TENANT, id).await?;
        record.ok_or_else(|| Problem::not_found(format!("there is no map {id}")))
    }

    /// A map's arrays, from memory or from its artifacts.
    pub async fn load(&self, record: &MapRecord) -> Result<Arc<FittedMap>, Problem> {
        {
            let mut kept = self.maps.kept.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(at) = kept.iter().position(|(id, _)| *id == record.id) {
                let hit = kept.remove(at);
                let map = hit.1.clone();
                kept.push(hit);
                return Ok(map);
            }
        }
        let bytes = self.workshop.artifacts.get(&record.prefix, "map.npz").await?;
        let map = self.compute(Queue::Answers, move || Ok(Arc::new(FittedMap::from_npz(&bytes)?))).await?;
        let mut kept = self.maps.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(id, _)| *id != record.id);
        if kept.len() >= KEPT {
            kept.remove(0);
        }
        kept.push((record.id.clone(), map.clone()));
        Ok(map)
    }

    /// Forgets a deleted map.
    pub fn forget(&self, id: &str) {
        self.maps.kept.lock().unwrap_or_else(PoisonError::into_inner).retain(|(kept, _)| kept != id);
    }

    /// Runs work that takes milliseconds or more off the threads that answer, a bounded number at a time.
    pub async fn compute<T: Send + 'static>(
        &self,
        queue: Queue,
        work: impl FnOnce() -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let permits = match queue {
            Queue::Requests => &self.maps.requests,
            Queue::Answers => &self.maps.answers,
        };
        // The semaphores are never closed, so a permit always comes. It goes with the work, not with the client: one that
        // leaves does not make room for another while its work still runs.
        let permit = permits.clone().acquire_owned().await.ok();
        let work = move || {
            let _permit = permit;
            work()
        };
        tokio::task::spawn_blocking(work).await?
    }
}

/// The ETag of one representation of a map: of its address, format and the version that renders it.
pub struct Tag(String);

impl Tag {
    pub fn of(uri: &Uri, format: Format) -> Self {
        let mut digest = Sha256::new();
        for part in [env!("CARGO_PKG_VERSION"), uri.path(), uri.query().unwrap_or_default(), format.media] {
            digest.update(part.as_bytes());
            digest.update([0]);
        }
        let hex: String = digest.finalize()[..16].iter().map(|byte| format!("{byte:02x}")).collect();
        Self(format!("\"{hex}\""))
    }

    /// 304 where the client has this representation.
    pub fn not_modified(&self, headers: &HeaderMap) -> Option<Response> {
        let asked = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
        let mut known = asked.flat_map(|list| list.split(',')).map(|tag| tag.trim().trim_start_matches("W/"));
        known.any(|tag| tag == self.0 || tag == "*").then(|| {
            let mut response = StatusCode::NOT_MODIFIED.into_response();
            self.mark(&mut response);
            response
        })
    }

    /// The answer with its tag.
    pub fn respond(&self, format: Format, body: impl Into<Body>) -> Response {
        let mut response = Response::new(body.into());
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(format.media));
        self.mark(&mut response);
        response
    }

    fn mark(&self, response: &mut Response) {
        if let Ok(tag) = HeaderValue::from_str(&self.0) {
            response.headers_mut().insert(header::ETAG, tag);
        }
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
        response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    }
}

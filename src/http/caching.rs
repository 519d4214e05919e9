//! Fitted maps never change: strong ETags for clients, a few loaded maps kept in memory for ourselves.

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
    computing: Semaphore,
}

impl Default for MapCache {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(2, |n| n.get());
        Self { kept: Mutex::default(), computing: Semaphore::new(cores) }
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
        let map = self.compute(move || Ok(Arc::new(FittedMap::from_npz(&bytes)?))).await?;
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
        work: impl FnOnce() -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        // The semaphore is never closed, so a permit always comes.
        let _permit = self.maps.computing.acquire().await.ok();
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

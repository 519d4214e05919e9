//! How many requests a second a key may make: a bucket a key, filled steadily, that holds one second's worth.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};

use super::problem::Problem;

/// Keys that are remembered at most; beyond, full buckets are forgotten.
const MOST_KEYS: usize = 10_000;

/// Requests of all keys.
pub struct Rates {
    /// Requests a second; `None` counts nothing.
    limit: Option<u32>,
    buckets: Mutex<HashMap<String, (f64, Instant)>>,
}

impl Rates {
    pub fn new(limit: Option<u32>) -> Self {
        Self { limit, buckets: Mutex::default() }
    }

    /// Counts a request: how many are left now, or 429.
    pub fn count(&self, key: &str) -> Result<Option<u32>, Problem> {
        let Some(limit) = self.limit else { return Ok(None) };
        let (full, now) = (f64::from(limit), Instant::now());
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        let filled = |(left, at): (f64, Instant)| (left + full * (now - at).as_secs_f64()).min(full);
        if buckets.len() > MOST_KEYS {
            buckets.retain(|_, bucket| filled(*bucket) < full);
        }
        let left = buckets.get(key).map_or(full, |bucket| filled(*bucket));
        if left < 1.0 {
            let detail = format!("more than {limit} requests a second with this key");
            return Err(Problem {
                retry_after: Some(1),
                ..Problem::new(StatusCode::TOO_MANY_REQUESTS, "too-many-requests", "Too many requests", detail)
            });
        }
        buckets.insert(key.to_owned(), (left - 1.0, now));
        Ok(Some((left - 1.0) as u32))
    }

    /// Tells the client where it stands (draft-ietf-httpapi-ratelimit-headers).
    pub fn mark(&self, headers: &mut HeaderMap, left: u32) {
        let Some(limit) = self.limit else { return };
        let mut set = |name: &'static str, text: String| {
            if let Ok(value) = HeaderValue::from_str(&text) {
                headers.insert(HeaderName::from_static(name), value);
            }
        };
        set("ratelimit-policy", format!("\"requests\";q={limit};w=1"));
        set("ratelimit", format!("\"requests\";r={left};t=1"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_holds_a_second_and_belongs_to_its_key() {
        let rates = Rates::new(Some(3));
        assert_eq!(
            [rates.count("a").unwrap(), rates.count("a").unwrap(), rates.count("a").unwrap()].map(Option::unwrap),
            [2, 1, 0]
        );
        assert_eq!(rates.count("a").unwrap_err().status, StatusCode::TOO_MANY_REQUESTS);
        assert!(rates.count("b").is_ok());
        assert!(Rates::new(None).count("a").unwrap().is_none());
    }
}

//! How many requests a second a key may make: a bucket a key, filled steadily, that holds one second's worth.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use axum::http::StatusCode;

use super::problem::Problem;
use super::standing::Standing;

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

    /// Counts a request: where its key stands now, or 429.
    pub fn count(&self, key: &str) -> Result<Option<Standing>, Problem> {
        let Some(limit) = self.limit else { return Ok(None) };
        let with = |left| Standing { policy: "requests", quota: limit.into(), window: Some(1), left, reset: 1 };
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
                standing: Some(Box::new(with(0))),
                ..Problem::new(StatusCode::TOO_MANY_REQUESTS, "too-many-requests", "Too many requests", detail)
            });
        }
        buckets.insert(key.to_owned(), (left - 1.0, now));
        Ok(Some(with((left - 1.0) as u64)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_holds_a_second_and_belongs_to_its_key() {
        let rates = Rates::new(Some(3));
        let left = || rates.count("a").map(|standing| standing.unwrap().left);
        assert_eq!([left().unwrap(), left().unwrap(), left().unwrap()], [2, 1, 0]);
        let over = left().unwrap_err();
        assert_eq!((over.status, over.standing.unwrap().left), (StatusCode::TOO_MANY_REQUESTS, 0));
        assert!(rates.count("b").is_ok());
        assert!(Rates::new(None).count("a").unwrap().is_none());
    }
}

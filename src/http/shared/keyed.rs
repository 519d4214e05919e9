//! Whether nobody comes in without a key: every request asks, so the store is not asked each time.
//!
//! Once there was a key there always is: a revoked one stays known. That there is none is remembered for a moment, shorter than
//! the process takes that makes one (`mapfit keys create`).

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::store::{Keys, StoreError};

/// How long it counts that there was no key.
const MOMENT: Duration = Duration::from_millis(20);

/// See the module.
pub struct Keyed {
    began: Instant,
    keyed: AtomicBool,
    /// Nanoseconds from the beginning until which there is no key.
    keyless_until: AtomicU64,
}

impl Default for Keyed {
    fn default() -> Self {
        Self { began: Instant::now(), keyed: AtomicBool::new(false), keyless_until: AtomicU64::new(0) }
    }
}

impl Keyed {
    pub async fn has_keys(&self, keys: &(impl Keys + ?Sized)) -> Result<bool, StoreError> {
        if self.keyed.load(Ordering::Relaxed) {
            return Ok(true);
        }
        // Before the store is asked: its answer is no younger.
        let asked = self.began.elapsed();
        if asked < Duration::from_nanos(self.keyless_until.load(Ordering::Relaxed)) {
            return Ok(false);
        }
        let keyed = keys.has_keys().await?;
        if keyed {
            self.keyed.store(true, Ordering::Relaxed);
        } else {
            self.keyless_until.fetch_max((asked + MOMENT).as_nanos() as u64, Ordering::Relaxed);
        }
        Ok(keyed)
    }
}

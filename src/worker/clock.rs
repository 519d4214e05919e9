//! How long an attempt has been at work. Waiting for memory, which others hold, is no work of its own.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A clock that runs from its making on.
pub(super) struct Clock {
    within: Duration,
    /// What was counted until it last stopped, and since when it runs.
    counted: Mutex<(Duration, Option<Instant>)>,
}

impl Clock {
    pub fn new(within: Duration) -> Self {
        Self { within, counted: Mutex::new((Duration::ZERO, Some(Instant::now()))) }
    }

    /// Stands still while something is waited for.
    pub fn without<T>(&self, wait: impl FnOnce() -> T) -> T {
        let counted = || self.counted.lock().unwrap_or_else(PoisonError::into_inner);
        let spent = self.spent();
        *counted() = (spent, None);
        let outcome = wait();
        *counted() = (spent, Some(Instant::now()));
        outcome
    }

    /// Whether the attempt has taken as long as one may.
    pub fn is_up(&self) -> bool {
        self.spent() >= self.within
    }

    fn spent(&self) -> Duration {
        let (before, since) = *self.counted.lock().unwrap_or_else(PoisonError::into_inner);
        before + since.map_or(Duration::ZERO, |since| since.elapsed())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_waited_for_does_not_count() {
        let clock = Clock::new(Duration::from_millis(150));
        clock.without(|| std::thread::sleep(Duration::from_millis(300)));
        assert!(!clock.is_up());
        std::thread::sleep(Duration::from_millis(200));
        assert!(clock.is_up());
    }
}

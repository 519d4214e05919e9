//! How far a walk over the tree is, and whether it goes on.
//!
//! Work is counted in multiply-adds, of which the symbolic analysis knows the sum: a share of it is a share of the time.
//! Whoever walks asks here, between two supernodes; whoever watches is asked from here, and stops all of them at once.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::error::SparseError;

/// What takes fewer multiply-adds is done almost before a thread has been started.
const SMALL: f64 = 1e7;
/// Work between two questions whether to go on, in multiply-adds.
const BREATH: u64 = 100_000_000;

/// How far a walk is, in proportion to the work, and whether it goes on. Shared by those who walk.
pub(super) struct Pace {
    whole: f64,
    /// Multiply-adds.
    done: AtomicU64,
    /// How much was done when it was last asked.
    told: AtomicU64,
    stopped: AtomicBool,
}

impl Pace {
    pub fn of(whole: f64) -> Self {
        Self { whole, done: AtomicU64::new(0), told: AtomicU64::new(0), stopped: AtomicBool::new(false) }
    }

    /// Whether it is done almost before a thread has been started.
    pub fn is_short(&self) -> bool {
        self.whole < SMALL
    }

    /// So much more is done.
    pub fn step(&self, work: f64) -> Result<(), SparseError> {
        self.done.fetch_add(work as u64, Ordering::Relaxed);
        self.goes_on()
    }

    /// Tells how far it is, and asks.
    pub fn ask(&self, go_on: &dyn Fn(f64) -> bool) -> Result<(), SparseError> {
        let done = self.done.load(Ordering::Relaxed);
        self.told.store(done, Ordering::Relaxed);
        if !go_on(done as f64 / self.whole.max(1.0)) {
            self.stop();
        }
        self.goes_on()
    }

    /// Multiply-adds so far.
    #[cfg(test)]
    pub fn work_done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Asks where enough was done since it last did.
    pub fn ask_at_times(&self, go_on: &dyn Fn(f64) -> bool) -> Result<(), SparseError> {
        let since = self.done.load(Ordering::Relaxed) - self.told.load(Ordering::Relaxed);
        if since < BREATH { self.goes_on() } else { self.ask(go_on) }
    }

    pub fn goes_on(&self) -> Result<(), SparseError> {
        if self.stopped.load(Ordering::Relaxed) { Err(SparseError::Stopped) } else { Ok(()) }
    }
}

/// Whoever panics leaves nobody waiting for it.
pub(super) struct StopsOthers<'p>(pub &'p Pace);

impl Drop for StopsOthers<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

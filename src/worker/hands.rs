//! Solver threads that have nothing to do, lent to fits of this process.
//!
//! A solver that claims a job while its thread is lent begins at once: for a moment there is a thread more than solvers. A
//! pass over the elimination tree is short beside a fit, and whoever borrowed asks anew before the next.

use std::sync::atomic::{AtomicIsize, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::jobs::{Parts, Progress};
use crate::sparse::{self, Lender};

/// How many solvers wait for work; less than none where those lent were called back.
pub(super) struct Hands {
    idle: AtomicIsize,
    /// Jobs in parts that run in this process.
    divided: AtomicUsize,
    /// Solvers there are.
    solvers: AtomicUsize,
}

/// A job in parts, while it runs.
pub(super) struct Divided<'a>(&'a Hands);

/// A solver at work; it waits again once this is dropped.
pub(super) struct AtWork<'a>(&'a Hands);

impl Hands {
    pub fn none() -> Self {
        Self { idle: AtomicIsize::new(0), divided: AtomicUsize::new(0), solvers: AtomicUsize::new(0) }
    }

    /// So many solvers are there, and wait.
    pub fn arrive(&self, count: usize) {
        self.solvers.fetch_add(count, Ordering::Relaxed);
        self.join(count);
    }

    pub fn solvers(&self) -> usize {
        self.solvers.load(Ordering::Relaxed)
    }

    /// So many more solvers wait.
    pub fn join(&self, count: usize) {
        self.idle.fetch_add(count as isize, Ordering::Relaxed);
    }

    pub fn at_work(&self) -> AtWork<'_> {
        self.idle.fetch_sub(1, Ordering::Relaxed);
        AtWork(self)
    }

    /// Whether a job in parts runs here.
    pub fn divide(&self) -> bool {
        self.divided.load(Ordering::Relaxed) > 0
    }

    pub fn divided(&self) -> Divided<'_> {
        self.divided.fetch_add(1, Ordering::Relaxed);
        Divided(self)
    }

    fn lend(&self, most: usize) -> usize {
        let lent = |idle: isize| (most as isize).min(idle).max(0);
        let before = self.idle.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |idle| Some(idle - lent(idle)));
        lent(before.unwrap_or_default()) as usize
    }
}

impl Drop for AtWork<'_> {
    fn drop(&mut self) {
        self.0.join(1);
    }
}

impl Drop for Divided<'_> {
    fn drop(&mut self) {
        self.0.divided.fetch_sub(1, Ordering::Relaxed);
    }
}

/// What one job borrows; where it is fitted in parts, its progress says how far they are.
pub(super) struct Borrower {
    pub hands: Arc<Hands>,
    pub progress: Arc<Mutex<Progress>>,
}

impl Lender for Borrower {
    fn count(&self) -> usize {
        self.hands.solvers().saturating_sub(1)
    }

    fn lend(&self, most: usize) -> usize {
        self.hands.lend(most)
    }

    fn give_back(&self, count: usize) {
        self.hands.join(count);
    }

    fn told(&self, &sparse::Parts { total, done, running }: &sparse::Parts) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(parts) = &mut progress.parts {
            *parts = Parts { total, done, running };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_are_lent_than_wait() {
        let hands = Hands::none();
        hands.join(3);
        let own = hands.at_work();
        assert_eq!((hands.lend(5), hands.lend(5)), (2, 0));
        let called_back = hands.at_work();
        hands.join(2);
        assert_eq!(hands.lend(5), 1);
        hands.join(1);
        drop((own, called_back));
        assert_eq!(hands.lend(5), 3);
    }
}

//! The threads that work on one system.
//!
//! Work comes in items whose results do not depend on who does them, and is put together in the items' order: the same
//! bytes with one thread as with many. How many there are is the [`Lender`]'s to say, anew for every pass: a service
//! lends the threads that have nothing else to do.

use std::fmt;
use std::num::NonZero;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::abroad::Abroad;
use super::error::SparseError;
use super::pace::Pace;

/// How often a team that works is told from outside whether to go on.
const LOOK: Duration = Duration::from_millis(20);
/// A team of more threads than this is no small one.
const SMALL_TEAM: usize = 4;

/// Who has threads to lend.
pub trait Lender: Send + Sync {
    /// How many threads there are to lend, whoever has them now.
    fn count(&self) -> usize;
    /// Lends so many threads at most; `give_back` is told of as many.
    fn lend(&self, most: usize) -> usize;
    fn give_back(&self, count: usize);
    /// Told of a walk's branches as they are begun and done.
    fn told(&self, _parts: &Parts) {}
}

/// How far a walk is with the branches of a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Parts {
    pub total: usize,
    pub done: usize,
    pub running: usize,
}

/// See the module. The default is one thread, the caller's.
#[derive(Clone, Default)]
pub struct Team {
    lender: Option<Arc<dyn Lender>>,
    abroad: Option<Arc<dyn Abroad>>,
}

impl fmt::Debug for Team {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(if self.lender.is_some() { "Team" } else { "Team of one" })
    }
}

/// So many threads, the caller's among them.
struct Fixed(usize);

impl Lender for Fixed {
    fn count(&self) -> usize {
        self.0
    }

    fn lend(&self, most: usize) -> usize {
        most.min(self.0)
    }

    fn give_back(&self, _: usize) {}
}

/// Gives threads back however the work ends.
pub(super) struct Loan<'a> {
    lender: &'a dyn Lender,
    pub count: usize,
}

impl Drop for Loan<'_> {
    fn drop(&mut self) {
        self.lender.give_back(self.count);
    }
}

impl Team {
    /// The caller's thread alone.
    pub const fn alone() -> Self {
        Self { lender: None, abroad: None }
    }

    /// Of so many threads, the caller's among them.
    pub fn of(threads: NonZero<usize>) -> Self {
        Self::threads(threads.get())
    }

    pub(super) fn threads(count: usize) -> Self {
        Self { lender: (count > 1).then(|| Arc::new(Fixed(count - 1)) as Arc<dyn Lender>), abroad: None }
    }

    /// Of one thread a core.
    pub fn of_this_machine() -> Self {
        Self::of(std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN))
    }

    /// Of the caller's thread and those that the lender lends.
    pub fn with(lender: Arc<dyn Lender>) -> Self {
        Self { lender: Some(lender), abroad: None }
    }

    /// And of others elsewhere, who may take branches.
    pub fn and_abroad(self, abroad: Arc<dyn Abroad>) -> Self {
        Self { abroad: Some(abroad), ..self }
    }

    /// Whether it has few threads: for them a few large branches are better than a large top.
    pub(super) fn is_small(&self) -> bool {
        self.lender.as_deref().map_or(0, Lender::count) < SMALL_TEAM
    }

    pub(super) fn abroad(&self) -> Option<&dyn Abroad> {
        self.abroad.as_deref()
    }

    /// Does every item, and gives the results in the items' order.
    pub(crate) fn each<T: Send, R: Send>(&self, items: Vec<T>, work: impl Fn(T) -> R + Sync) -> Vec<R> {
        let Some(loan) = self.borrow(items.len()) else { return items.into_iter().map(work).collect() };
        let (queue, done) = (Mutex::new(items.into_iter().enumerate()), Mutex::new(Vec::new()));
        beside(loan.count, &|| {
            while let Some((k, item)) = next(&queue) {
                let result = work(item);
                done.lock().unwrap_or_else(PoisonError::into_inner).push((k, result));
            }
        });
        let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
        done.sort_unstable_by_key(|(k, _)| *k);
        done.into_iter().map(|(_, result)| result).collect()
    }

    /// The same, for long work: while the team is at it, the caller's thread watches, and `pace` is asked whether to go on.
    /// Items ask their [`Pace`] in turn; one that fails stops the others.
    pub(super) fn each_at_pace<T: Send, R: Send>(
        &self,
        items: Vec<T>,
        pace: &Pace,
        go_on: &dyn Fn(f64) -> bool,
        work: impl Fn(T) -> Result<R, SparseError> + Sync,
    ) -> Result<Vec<R>, SparseError> {
        let told = self.told(items.len());
        let work = |item| {
            told.begun();
            let outcome = pace.goes_on().and_then(|()| work(item)).inspect_err(|_| pace.stop());
            told.ended();
            outcome
        };
        if pace.is_short() {
            pace.ask(go_on)?;
            return all_or_why_not(items.into_iter().map(work).collect());
        }
        let loan = self.borrow(items.len());
        let crew = Self::threads(loan.as_ref().map_or(1, |loan| loan.count + 1));
        let work = &work;
        let mut watch = || {
            // Told to stop, the items end by themselves.
            let _ = pace.ask(go_on);
        };
        let mut done = Err(SparseError::Stopped);
        watched(Box::new(|| done = all_or_why_not(crew.each(items, work))), &mut watch);
        done
    }

    /// Who is told how far the branches are, so many.
    pub(super) fn told(&self, total: usize) -> Told<'_> {
        Told { lender: self.lender.as_deref(), parts: Mutex::new(Parts { total, ..Parts::default() }) }
    }

    pub(super) fn borrow(&self, items: usize) -> Option<Loan<'_>> {
        let lender = self.lender.as_deref().filter(|_| items > 1)?;
        let count = lender.lend(items - 1);
        (count > 0).then_some(Loan { lender, count })
    }
}

/// Tells a lender how far branches are.
pub(super) struct Told<'a> {
    lender: Option<&'a dyn Lender>,
    parts: Mutex<Parts>,
}

impl Told<'_> {
    pub fn begun(&self) {
        self.tell(|parts| parts.running += 1);
    }

    pub fn ended(&self) {
        self.tell(|parts| (parts.running, parts.done) = (parts.running - 1, parts.done + 1));
    }

    fn tell(&self, change: fn(&mut Parts)) {
        if let Some(lender) = self.lender {
            let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
            change(&mut parts);
            lender.told(&parts);
        }
    }
}

/// Does the same on the caller's thread and on so many others. Whatever it is: starting threads is compiled once.
fn beside(others: usize, work: &(dyn Fn() + Sync)) {
    std::thread::scope(|scope| {
        let others: Vec<_> = (0..others).map(|_| scope.spawn(work)).collect();
        work();
        others.into_iter().for_each(joined);
    });
}

/// Does work on a thread of its own, while the caller's watches.
pub(super) fn watched(work: Box<dyn FnOnce() + Send + '_>, watch: &mut dyn FnMut()) {
    let (ended, watcher) = (AtomicBool::new(false), std::thread::current());
    std::thread::scope(|scope| {
        let end = End { ended: &ended, watcher };
        let busy = scope.spawn(move || {
            let _told_even_by_a_panic = end;
            work();
        });
        while !ended.load(Ordering::Acquire) {
            watch();
            std::thread::park_timeout(LOOK);
        }
        joined(busy);
    });
}

/// Waits for what others do.
pub(super) fn pause() {
    std::thread::sleep(LOOK);
}

/// Wakes whoever watches, once work has ended.
struct End<'a> {
    ended: &'a AtomicBool,
    watcher: std::thread::Thread,
}

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Release);
        self.watcher.unpark();
    }
}

/// All results, or why there are none: the failure that stopped the others, not that they were stopped.
pub(super) fn all_or_why_not<R>(results: Vec<Result<R, SparseError>>) -> Result<Vec<R>, SparseError> {
    let errors = results.iter().filter_map(|result| result.as_ref().err());
    match errors.into_iter().find(|error| **error != SparseError::Stopped) {
        Some(error) => Err(error.clone()),
        None => results.into_iter().collect(),
    }
}

fn next<T>(queue: &Mutex<impl Iterator<Item = T>>) -> Option<T> {
    queue.lock().unwrap_or_else(PoisonError::into_inner).next()
}

/// A thread's outcome; its panic goes on in this one.
fn joined<R>(thread: std::thread::ScopedJoinHandle<'_, R>) -> R {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU64;

    use super::*;

    fn threads(count: usize) -> Team {
        Team::of(NonZero::new(count).unwrap())
    }

    #[test]
    fn results_come_in_the_items_order_however_many_work() {
        for count in 1..5 {
            let squares = threads(count).each((0..100).collect(), |k: u64| k * k);
            assert!(squares.into_iter().eq((0..100).map(|k| k * k)));
        }
    }

    #[test]
    fn who_watches_is_woken_when_the_work_is_done() {
        let begun = std::time::Instant::now();
        for _ in 0..200 {
            threads(2).each_at_pace(vec![1, 2], &Pace::of(1e9), &|_| true, Ok).unwrap();
        }
        assert!(begun.elapsed() < 100 * LOOK, "{:?}", begun.elapsed());
    }

    #[test]
    fn a_team_told_to_stop_stops_however_many_work() {
        for count in [1, 3] {
            let pace = Pace::of(1e9);
            let told = std::cell::Cell::new(0);
            let go_on = |_: f64| {
                told.set(told.get() + 1);
                told.get() < 3
            };
            let outcome = threads(count).each_at_pace((0..1000).collect(), &pace, &go_on, |_: usize| {
                std::thread::sleep(Duration::from_millis(1));
                pace.step(1.0)
            });
            assert_eq!(outcome, Err(SparseError::Stopped));
        }
    }

    #[test]
    fn one_that_fails_stops_the_others_and_says_why() {
        for count in [1, 3] {
            let pace = Pace::of(1e9);
            let outcome = threads(count).each_at_pace((0..1000).collect(), &pace, &|_| true, |k: usize| {
                std::thread::sleep(Duration::from_millis(1));
                if k == 2 { Err(SparseError::NotPositiveDefinite) } else { pace.step(1.0) }
            });
            assert_eq!(outcome, Err(SparseError::NotPositiveDefinite));
            assert!(pace.work_done() < 20);
        }
    }

    #[test]
    fn a_lender_gets_back_what_it_lent() {
        struct Counted(AtomicU64);
        impl Lender for Counted {
            fn count(&self) -> usize {
                2
            }
            fn lend(&self, most: usize) -> usize {
                self.0.fetch_add(most.min(2) as u64, Ordering::Relaxed);
                most.min(2)
            }
            fn give_back(&self, count: usize) {
                self.0.fetch_sub(count as u64, Ordering::Relaxed);
            }
        }
        let lender = Arc::new(Counted(AtomicU64::new(0)));
        let team = Team::with(lender.clone());
        assert_eq!(team.each(vec![1, 2, 3], |k| k + 1), [2, 3, 4]);
        assert_eq!(lender.0.load(Ordering::Relaxed), 0);
    }
}

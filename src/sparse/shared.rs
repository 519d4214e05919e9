//! A pass whose branches are done here or elsewhere.
//!
//! The team's threads take branches from the front; others take them from wherever they like. A thread that finds the
//! rest with others waits, and asks again for what they have: where one is gone, its branch is done here.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::abroad::Offer;
use super::error::SparseError;
use super::pace::{Pace, StopsOthers};
use super::parcel::{Answer, Parcel};
use super::team::{Team, Told, all_or_why_not, pause, watched};

/// How branches become parcels, and answers results.
pub(super) struct Post<'p, T, R> {
    /// How many multiply-adds a branch is.
    pub work: &'p (dyn Fn(usize) -> f64 + Sync),
    pub parcel: &'p (dyn Fn(&T) -> Parcel + Sync),
    /// `None` where the answer is not one to this question.
    pub accept: &'p (dyn Fn(&mut T, Answer) -> Option<R> + Sync),
}

/// A branch of a pass.
struct Slot<T, R> {
    state: Mutex<State<T, R>>,
    /// Nobody else has it any more.
    ours: AtomicBool,
    /// Somebody has begun it.
    begun: AtomicBool,
}

enum State<T, R> {
    /// Nobody has done it; it may be with others.
    Open(T),
    /// A thread of the team is at it.
    Taken,
    Done(Result<R, SparseError>),
}

impl<T, R> Slot<T, R> {
    fn of(item: T) -> Self {
        Self { state: Mutex::new(State::Open(item)), ours: AtomicBool::new(false), begun: AtomicBool::new(false) }
    }

    fn state(&self) -> MutexGuard<'_, State<T, R>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_open(&self) -> bool {
        matches!(*self.state(), State::Open(_))
    }

    fn take(&self) -> Option<T> {
        let mut state = self.state();
        match std::mem::replace(&mut *state, State::Taken) {
            State::Open(item) => Some(item),
            other => {
                *state = other;
                None
            }
        }
    }

    /// With the branch, as long as nobody has begun it here.
    fn with<A>(&self, own: impl FnOnce(&mut T) -> A) -> Option<A> {
        match &mut *self.state() {
            State::Open(item) => Some(own(item)),
            _ => None,
        }
    }

    /// Begun, by whomever; told once.
    fn begin(&self, told: &Told<'_>) {
        if !self.begun.swap(true, Ordering::Relaxed) {
            told.begun();
        }
    }

    /// Done by what came for it, where it is open and that fits; whether it did.
    fn settle(&self, accept: impl FnOnce(&mut T) -> Option<R>) -> Option<bool> {
        let mut state = self.state();
        let State::Open(item) = &mut *state else { return None };
        let accepted = accept(item);
        let fits = accepted.is_some();
        if let Some(result) = accepted {
            *state = State::Done(Ok(result));
        }
        Some(fits)
    }

    fn done(&self, outcome: Result<R, SparseError>) {
        *self.state() = State::Done(outcome);
    }

    fn outcome(self) -> Result<R, SparseError> {
        match self.state.into_inner().unwrap_or_else(PoisonError::into_inner) {
            State::Done(outcome) => outcome,
            _ => Err(SparseError::Stopped),
        }
    }
}

impl Team {
    /// [`Team::each_at_pace`], by others, too, where the team knows any: the same results.
    pub(super) fn each_anywhere<T: Send, R: Send>(
        &self,
        items: Vec<T>,
        pace: &Pace,
        go_on: &dyn Fn(f64) -> bool,
        post: &Post<'_, T, R>,
        work: impl Fn(T) -> Result<R, SparseError> + Sync,
    ) -> Result<Vec<R>, SparseError> {
        let offer = self.abroad().filter(|_| items.len() > 1 && !pace.is_short());
        let Some(offer) = offer.and_then(|abroad| abroad.offer(items.len())) else {
            return self.each_at_pace(items, pace, go_on, work);
        };
        let told = self.told(items.len());
        let loan = self.borrow(items.len());
        let count = loan.as_ref().map_or(1, |loan| loan.count + 1);
        let slots: Vec<Slot<T, R>> = items.into_iter().map(Slot::of).collect();
        let here = |own: usize| {
            let _others = StopsOthers(pace);
            // One of the threads has the correspondence, which takes time on disks and networks.
            let mut goes_on = true;
            while goes_on && pace.goes_on().is_ok() {
                goes_on = match own {
                    0 => correspond(&slots, &*offer, pace, &told, post),
                    _ => pass_by(&slots, &*offer, pace, &told, &work),
                };
                if goes_on {
                    pause();
                }
            }
        };
        let crew = || drop(Self::threads(count + 1).each((0..count + 1).collect(), here));
        watched(Box::new(crew), &mut || {
            // Told to stop, the threads end by themselves.
            let _ = pace.ask(&|share| go_on(share) && offer.goes_on());
        });
        drop(offer);
        all_or_why_not(slots.into_iter().map(Slot::outcome).collect())
    }
}

/// A thread's way along the branches: does those that nobody else has. Whether others still have some.
fn pass_by<T, R>(
    slots: &[Slot<T, R>],
    offer: &dyn Offer,
    pace: &Pace,
    told: &Told<'_>,
    work: &(impl Fn(T) -> Result<R, SparseError> + Sync),
) -> bool {
    let mut elsewhere = false;
    for (k, slot) in slots.iter().enumerate().filter(|(_, slot)| slot.is_open()) {
        if pace.goes_on().is_err() {
            return false;
        }
        if !slot.ours.load(Ordering::Relaxed) && !offer.keep(k) {
            elsewhere = true;
        } else if let Some(item) = slot.take() {
            slot.begin(told);
            slot.done(work(item).inspect_err(|_| pace.stop()));
            told.ended();
        }
    }
    elsewhere
}

/// Sends what others wait for, and takes what they bring. Whether any branch is still open.
fn correspond<T, R>(
    slots: &[Slot<T, R>],
    offer: &dyn Offer,
    pace: &Pace,
    told: &Told<'_>,
    post: &Post<'_, T, R>,
) -> bool {
    for branch in offer.wanted() {
        let Some(slot) = slots.get(branch) else { continue };
        if let Some(parcel) = slot.with(|item| (post.parcel)(item)) {
            slot.begin(told);
            offer.send(branch, &parcel);
        }
    }
    while let Some((branch, answer)) = offer.answer() {
        let Some(slot) = slots.get(branch) else { continue };
        match slot.settle(|item| (post.accept)(item, answer)) {
            Some(true) => {
                // Whether to go on is asked by whoever works.
                let _ = pace.step((post.work)(branch));
                told.ended();
            }
            // Nothing that fits came back: it is done here.
            Some(false) => slot.ours.store(true, Ordering::Relaxed),
            None => {}
        }
    }
    slots.iter().any(Slot::is_open)
}

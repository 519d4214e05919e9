//! What fits, and answers that form one anew, may hold together: what needs more than is free waits for others to end.
//!
//! First come, first served: one that needs much waits no longer than those before it take, and is not passed by smaller
//! ones for ever.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often a fit that waits looks whether it was cancelled.
const LOOK: Duration = Duration::from_millis(100);

/// Bytes that fits share.
pub struct Memory {
    whole: u64,
    shared: Mutex<Shared>,
    given_back: Condvar,
}

struct Shared {
    free: u64,
    /// Who waits, by number, the first come first.
    waiting: VecDeque<u64>,
    next: u64,
}

/// Bytes that a fit holds; given back when it is dropped.
pub struct Reserved<'a> {
    memory: &'a Memory,
    bytes: u64,
}

impl Memory {
    pub fn new(whole: u64) -> Self {
        let shared = Shared { free: whole, waiting: VecDeque::new(), next: 0 };
        Self { whole, shared: Mutex::new(shared), given_back: Condvar::new() }
    }

    /// Whether so many bytes are ever free.
    pub fn allows(&self, bytes: u64) -> bool {
        bytes <= self.whole
    }

    /// Waits for so many bytes while `goes_on` holds; `None` where it does not any more. What needs more than there is
    /// takes all of it.
    pub fn reserve(&self, bytes: u64, goes_on: &dyn Fn() -> bool) -> Option<Reserved<'_>> {
        let bytes = bytes.min(self.whole);
        let mut shared = self.lock();
        let own = shared.next;
        shared.next += 1;
        shared.waiting.push_back(own);
        let has_turn = loop {
            if shared.waiting.front() == Some(&own) && shared.free >= bytes {
                break true;
            }
            if !goes_on() {
                break false;
            }
            shared = self.given_back.wait_timeout(shared, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        };
        shared.waiting.retain(|other| *other != own);
        if has_turn {
            shared.free -= bytes;
        }
        drop(shared);
        self.given_back.notify_all();
        has_turn.then_some(Reserved { memory: self, bytes })
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Reserved<'_> {
    fn drop(&mut self) {
        self.memory.lock().free += self.bytes;
        self.memory.given_back.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_held_is_waited_for() {
        let memory = Memory::new(10);
        let held = memory.reserve(7, &|| true).unwrap();
        assert!(memory.reserve(4, &|| false).is_none());
        assert!(memory.reserve(3, &|| false).is_some());
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| memory.reserve(100, &|| true).map(|all| all.bytes));
            std::thread::sleep(Duration::from_millis(20));
            drop(held);
            assert_eq!(waits.join().unwrap(), Some(10));
        });
    }

    #[test]
    fn who_needs_much_is_not_passed_by_those_who_came_later() {
        let memory = Memory::new(10);
        let held = memory.reserve(7, &|| true).unwrap();
        std::thread::scope(|scope| {
            let large = scope.spawn(|| memory.reserve(10, &|| true).is_some());
            while memory.lock().waiting.is_empty() {
                std::thread::yield_now();
            }
            assert!(memory.reserve(1, &|| false).is_none(), "three are free, but not for who came later");
            drop(held);
            assert!(large.join().unwrap());
        });
        assert!(memory.reserve(10, &|| false).is_some(), "who gave up does not stand in the way");
    }
}

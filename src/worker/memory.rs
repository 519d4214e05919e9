//! What fits may hold together: one that needs more than is free waits for others to end.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// How often a fit that waits looks whether it was cancelled.
const LOOK: Duration = Duration::from_millis(100);

/// Bytes that fits share.
pub struct Memory {
    whole: u64,
    free: Mutex<u64>,
    given_back: Condvar,
}

/// Bytes that a fit holds; given back when it is dropped.
pub struct Reserved<'a> {
    memory: &'a Memory,
    bytes: u64,
}

impl Memory {
    pub fn new(whole: u64) -> Self {
        Self { whole, free: Mutex::new(whole), given_back: Condvar::new() }
    }

    /// Waits for so many bytes while `goes_on` holds; `None` where it does not any more. What needs more than there is
    /// takes all of it.
    pub fn reserve(&self, bytes: u64, goes_on: &dyn Fn() -> bool) -> Option<Reserved<'_>> {
        let bytes = bytes.min(self.whole);
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        while *free < bytes {
            if !goes_on() {
                return None;
            }
            free = self.given_back.wait_timeout(free, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
        *free -= bytes;
        Some(Reserved { memory: self, bytes })
    }
}

impl Drop for Reserved<'_> {
    fn drop(&mut self) {
        *self.memory.free.lock().unwrap_or_else(PoisonError::into_inner) += self.bytes;
        self.memory.given_back.notify_all();
    }
}

/// The memory that this process may use: its cgroup's limit, or the machine's.
pub fn of_this_machine() -> u64 {
    let read = |file: &str| std::fs::read_to_string(file).ok();
    let limit = read("/sys/fs/cgroup/memory.max").and_then(|text| text.trim().parse::<u64>().ok());
    let machine = read("/proc/meminfo").and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("MemTotal:"))?;
        line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kilobytes| kilobytes << 10)
    });
    let machine = machine.unwrap_or(4 << 30);
    limit.map_or(machine, |limit| limit.min(machine))
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
}

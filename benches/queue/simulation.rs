//! The queue as a discrete-event simulation: jobs arrive, wait, are claimed and run, by the rule that the stores keep.
//!
//! Highest priority first, then the tenant with the fewest running jobs, then the one that was served longest ago, then the
//! oldest. As in `migrations/sqlite/0002` only the head of each tenant's queue at a priority takes part, so an event costs a
//! logarithm of the number of tenants.
//! Times are seconds; nothing is random in here: the same arrivals give the same waits.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap, VecDeque};

/// A job to come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    pub at: f64,
    pub tenant: u32,
    pub priority: i32,
    /// From its claim to its end.
    pub service: f64,
}

/// Who works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crew {
    pub workers: usize,
    /// From a job's end to the same worker's next claim, where one waits.
    pub between: f64,
    /// From a job's arrival to its claim, where a worker is idle.
    pub pickup: f64,
}

/// A time that can be ordered; none is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Time(f64);

impl Eq for Time {}

impl PartialOrd for Time {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Time {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// The head of a queue: what is compared, then whose it is.
type Turn = (Reverse<i32>, usize, usize, usize, u32);

#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    /// A worker may claim.
    Free,
    /// A tenant's job ends.
    Ends(u32),
}

#[derive(Default)]
struct Queue {
    /// Jobs by their place in the order of arrival.
    waiting: BTreeMap<(u32, i32), VecDeque<usize>>,
    running: BTreeMap<u32, usize>,
    /// Of each tenant that was ever served, which of all claims was its last, counted from 1.
    served: BTreeMap<u32, usize>,
    claims: usize,
    turns: BTreeSet<Turn>,
}

impl Queue {
    fn turn(&self, (tenant, priority): (u32, i32)) -> Option<Turn> {
        let head = self.waiting.get(&(tenant, priority))?.front()?;
        let of = |counts: &BTreeMap<u32, usize>| counts.get(&tenant).copied().unwrap_or(0);
        Some((Reverse(priority), of(&self.running), of(&self.served), *head, tenant))
    }

    /// Changes something about a tenant, with its turns taken out before and put back after.
    fn changed(&mut self, tenant: u32, change: impl FnOnce(&mut Self)) {
        let lanes = |queue: &Self| -> Vec<Turn> {
            let own = queue.waiting.range((tenant, i32::MIN)..=(tenant, i32::MAX));
            own.filter_map(|(lane, _)| queue.turn(*lane)).collect()
        };
        for turn in lanes(self) {
            self.turns.remove(&turn);
        }
        change(self);
        self.turns.extend(lanes(self));
    }

    fn arrive(&mut self, job: usize, tenant: u32, priority: i32) {
        self.changed(tenant, |queue| queue.waiting.entry((tenant, priority)).or_default().push_back(job));
    }

    fn claim(&mut self) -> Option<usize> {
        let (Reverse(priority), _, _, job, tenant) = *self.turns.first()?;
        self.changed(tenant, |queue| {
            if let Some(lane) = queue.waiting.get_mut(&(tenant, priority)) {
                lane.pop_front();
                if lane.is_empty() {
                    queue.waiting.remove(&(tenant, priority));
                }
            }
            *queue.running.entry(tenant).or_default() += 1;
            queue.claims += 1;
            queue.served.insert(tenant, queue.claims);
        });
        Some(job)
    }

    fn end(&mut self, tenant: u32) {
        self.changed(tenant, |queue| {
            let running = queue.running.entry(tenant).or_default();
            *running = running.saturating_sub(1);
        });
    }
}

/// How long each job waits, in the order of the arrivals, which are sorted by time.
pub fn waits(arrivals: &[Arrival], crew: Crew) -> Vec<f64> {
    let mut waits = vec![0.0; arrivals.len()];
    let (mut queue, mut idle) = (Queue::default(), crew.workers);
    // What happens when, the earliest first; at one time in the order in which it was planned.
    let mut events: BinaryHeap<Reverse<(Time, usize, Event)>> = BinaryHeap::new();
    let mut planned = 0;
    let mut next = 0;
    loop {
        let happens = events.peek().map(|Reverse((at, ..))| at.0);
        let arrives = arrivals.get(next).map(|arrival| arrival.at);
        let now = match (arrives, happens) {
            (Some(at), happens) if happens.is_none_or(|happens| at <= happens) => {
                let Arrival { tenant, priority, .. } = arrivals[next];
                queue.arrive(next, tenant, priority);
                next += 1;
                at
            }
            (_, Some(at)) => {
                if let Some(Reverse((_, _, event))) = events.pop() {
                    match event {
                        Event::Free => idle += 1,
                        Event::Ends(tenant) => queue.end(tenant),
                    }
                }
                at
            }
            (Some(_), None) | (None, None) => return waits,
        };
        while idle > 0 {
            let Some(job) = queue.claim() else { break };
            idle -= 1;
            let Arrival { at, tenant, service, .. } = arrivals[job];
            let claimed = now.max(at + crew.pickup);
            waits[job] = claimed - at;
            for (when, event) in
                [(claimed + service, Event::Ends(tenant)), (claimed + service + crew.between, Event::Free)]
            {
                events.push(Reverse((Time(when), planned, event)));
                planned += 1;
            }
        }
    }
}

/// The value that a share of all does not exceed; 0 of none.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(place.clamp(1, sorted.len().max(1)) - 1).copied().unwrap_or(0.0)
}

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

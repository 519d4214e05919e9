//! Parts of jobs: branches of a fit's elimination, which the attempt that fits offers and any worker takes.
//!
//! A part is a job of the queue in small: taken under a lease, fenced by how often it was taken, done again by another where
//! its worker is gone, which costs it alone. What it is about (its parcel, and the answer to it) are artifacts under the
//! pass's prefix, named by part and claim, so that nobody who comes late writes over anybody. Workers hold parts of attempts
//! that run, and of no others.

use std::time::Duration;

use async_trait::async_trait;

use super::StoreError;

/// One pass over the branches of an attempt's system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pass {
    pub job_id: String,
    pub attempt: i64,
    /// Where its artifacts lie; no two passes share one.
    pub prefix: String,
}

/// A part of a pass, as somebody took it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    pub prefix: String,
    pub number: i64,
    /// How often it was taken, this time included.
    pub claim: i64,
}

impl Part {
    /// The names of its parcel and of its answer, under the prefix.
    pub fn files(&self) -> [String; 2] {
        ["parcel", "answer"].map(|what| format!("{}-{}.{what}.npz", self.number, self.claim))
    }
}

/// How a part stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// Nobody has it, or whoever had it is gone.
    Free,
    Taken,
    /// Its answer is there.
    Delivered,
}

impl Standing {
    pub(super) fn of(is_taken: bool, is_delivered: bool) -> Self {
        match (is_delivered, is_taken) {
            (true, _) => Self::Delivered,
            (false, true) => Self::Taken,
            (false, false) => Self::Free,
        }
    }
}

/// What a worker is told of a part that it holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// Its parcel is not there yet.
    Waits,
    /// Its parcel is there.
    Sent,
    /// The part is another's, or nobody's any more.
    Lost,
}

impl Hold {
    /// By whether the parcel was sent, where the part is held.
    pub(super) fn of(sent: Option<bool>) -> Self {
        match sent {
            Some(true) => Self::Sent,
            Some(false) => Self::Waits,
            None => Self::Lost,
        }
    }
}

/// Parts, as attempts offer them and workers hold them.
#[async_trait]
pub trait PartBoard: Send + Sync {
    /// Offers so many parts, in place of those of the attempt's earlier passes; `false` where its lease is lost.
    async fn offer_parts(&self, pass: &Pass, count: usize) -> Result<bool, StoreError>;
    /// The parts on offer, with how each stands.
    async fn parts_of(&self, prefix: &str) -> Result<Vec<(Part, Standing)>, StoreError>;
    /// Takes a part that is free off the offer; whether it was.
    async fn keep_part(&self, prefix: &str, number: i64) -> Result<bool, StoreError>;
    /// A part's parcel is there; `false` where it is not held under this claim any more.
    async fn send_part(&self, part: &Part) -> Result<bool, StoreError>;
    /// Takes all parts of a pass off the offer.
    async fn withdraw_parts(&self, prefix: &str) -> Result<(), StoreError>;

    /// Takes a part of any attempt that runs, the last of a pass first: its attempt begins with the first. One that was taken
    /// twice is not taken again: its attempt does it.
    async fn take_part(&self, worker: &str, lease: Duration) -> Result<Option<Part>, StoreError>;
    /// Holds a part for so much longer; not at all gives it back.
    async fn hold_part(&self, part: &Part, lease: Duration) -> Result<Hold, StoreError>;
    /// A part's answer is there; `false` where it is not held any more.
    async fn deliver_part(&self, part: &Part) -> Result<bool, StoreError>;
}

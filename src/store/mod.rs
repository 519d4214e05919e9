//! Where jobs and maps are kept: [`Records`] of what there is, [`Artifacts`] for the maps' arrays.
//!
//! Records are a port for each of their users: clients submit and read by the [`JobBoard`] and the [`MapShelf`], publish
//! by [`Places`]; workers hold jobs by [`Leases`] and share large ones by the [`PartBoard`]; a service keeps its [`Housekeeping`], [`Keys`] and [`Webhooks`]; all of it
//! goes out and in by [`Backup`]. What is decided (how often a job is begun, what a lapsed one comes to) is decided in [`crate::jobs::lifecycle`].
//!
//! The promises, which every implementation keeps and one conformance suite checks:
//!
//! - Accepted is durable: the row is committed before the answer is sent, its idempotency key in the same transaction.
//! - A claim takes one job, by priority, then by how few jobs of its tenant run, then by how long ago its tenant was
//!   served, then by age, and raises `attempt`.
//! - Every later write is fenced by `id AND attempt AND status = 'running'`. `false` means the lease is lost: the solver
//!   stops, and nothing was written. A late worker can never overwrite a newer result.
//! - Leases live by the database's clock. A lapsed lease costs an attempt; a job out of attempts has failed.
//! - What a webhook is to tell is queued in the transaction that makes it happen.

mod artifacts;
mod backup;
mod board;
mod housekeeping;
mod intake;
mod keys;
mod leases;
mod parts;
mod places;
mod postgres;
mod rows;
mod schema;
mod shelf;
mod sqlite;
mod webhooks;

use thiserror::Error;

pub use artifacts::{Artifacts, ArtifactsError, MAP_FILE};
pub use backup::{Backup, Row, Saved, Take, tables as saved_tables};
pub use board::{Cancellation, JobBoard, Listing, NewJob, Quota, Relabelling, Removal, Submission};
pub use housekeeping::{Holdings, Housekeeping, Judge, LIGHT, Total, Totals, Written};
pub use keys::{ApiKey, Keys, NewKey};
pub use leases::{Claim, Leases, Terms};
pub use parts::{Hold, Part, PartBoard, Pass, Standing};
pub use places::{Guard, Place, Places, Publication};
pub use postgres::PostgresStore;
pub use shelf::{MapRemoval, MapShelf};
pub use sqlite::SqliteStore;
pub use webhooks::{Delivered, Delivery, DeliveryStatus, DueDelivery, NewWebhook, Webhook, Webhooks};

#[derive(Debug, Error)]
pub enum StoreError {
    #[error("the database did not answer: {0}")]
    Database(#[from] sqlx::Error),
    #[error("the database could not be set up: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    #[error("a stored record is damaged: {0}")]
    Damaged(#[from] serde_json::Error),
    #[error("a stored record is damaged: unknown {what} {value}")]
    Unknown { what: &'static str, value: String },
    #[error("a saved row cannot be restored: {0}")]
    NotRestored(String),
    #[error("what was read cannot be kept: {0}")]
    NotKept(#[from] std::io::Error),
}

/// All of a store's ports.
pub trait Records: JobBoard + Leases + PartBoard + MapShelf + Places + Keys + Webhooks + Housekeeping + Backup {}

impl<S: JobBoard + Leases + PartBoard + MapShelf + Places + Keys + Webhooks + Housekeeping + Backup> Records for S {}

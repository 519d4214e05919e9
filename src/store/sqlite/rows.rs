//! Which columns records are read from. Named one by one: a statement that a process has prepared stays right when a newer
//! one adds columns.

pub use crate::store::rows::{aged_map, delivery, job, key, map, place, webhook};

/// A job's columns, all but what leases need.
pub const JOB: &str = "id, tenant, name, labels, status, progress, message, problem, created, started, finished, updated, \
                       attempt, priority, map_id, revision, retry_of, deadline, traceparent";

/// A map's columns.
pub const MAP: &str =
    "id, job_id, tenant, name, labels, created, distance, lattice, fit, prefix, bytes, sha256, parent, version";
/// A key's columns, a webhook's, a delivery's.
pub const KEY: &str = "id, tenant, name, scopes, sha256, created, revoked";
pub const WEBHOOK: &str = "id, url, events, created";
pub const DELIVERY: &str =
    "serial, id, webhook_id, event, status, attempts, created, last_attempt, next_attempt, error";

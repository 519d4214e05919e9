//! Which columns records are read from. Named one by one: a worker of yesterday reads on while a migration adds some.

pub use crate::store::rows::{aged_map, delivery, job, key, map, place, webhook};

/// A job's columns, of `jobs AS j` and of [`LEASE`]: while it runs, its lease knows better.
pub const JOB: &str = "j.id, j.tenant, j.name, j.labels, j.status, COALESCE(l.progress, j.progress) AS progress, \
                       j.message, j.problem, j.created, j.started, j.finished, \
                       GREATEST(j.updated, l.updated) AS updated, j.attempt, j.priority, j.map_id, \
                       j.revision + COALESCE(l.beats, 0) AS revision, j.retry_of, j.deadline, \
                       j.traceparent";
pub const LEASE: &str = " LEFT JOIN leases AS l ON l.job_id = j.id";
/// A map's columns, of `maps AS m`.
pub const MAP: &str = "m.id, m.job_id, m.tenant, m.name, m.labels, m.created, m.distance, m.lattice, m.fit, m.prefix, \
                       m.bytes, m.sha256, m.parent, m.version";

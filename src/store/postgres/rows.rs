//! Records from rows. Columns are named one by one: a worker of yesterday reads on while a migration adds some.

use serde::de::DeserializeOwned;
use sqlx::Row;
use sqlx::postgres::PgRow;

use crate::fit::Distance;
use crate::jobs::{Job, JobStatus, MapRecord};
use crate::store::{ApiKey, Delivery, DeliveryStatus, Place, StoreError, Webhook};

/// A job's columns, of `jobs AS j` and of [`LEASE`]: while it runs, its lease knows better.
pub const JOB: &str = "j.id, j.tenant, j.name, j.labels, j.status, COALESCE(l.progress, j.progress) AS progress, \
                       j.message, j.problem, j.created, j.started, j.finished, \
                       GREATEST(j.updated, l.updated) AS updated, j.attempt, j.priority, j.map_id, \
                       j.revision + COALESCE(l.beats, 0) AS revision, j.retry_of, j.deadline";
pub const LEASE: &str = " LEFT JOIN leases AS l ON l.job_id = j.id";
/// A map's columns, of `maps AS m`.
pub const MAP: &str = "m.id, m.job_id, m.tenant, m.name, m.labels, m.created, m.distance, m.lattice, m.fit, m.prefix, \
                       m.bytes, m.sha256, m.parent, m.version";

pub fn job(row: &PgRow) -> Result<Job, StoreError> {
    let status: String = row.try_get("status")?;
    let problem: Option<String> = row.try_get("problem")?;
    Ok(Job {
        id: row.try_get("id")?,
        tenant: row.try_get("tenant")?,
        name: row.try_get("name")?,
        labels: json(row, "labels")?,
        status: JobStatus::from_name(&status).ok_or(StoreError::Unknown { what: "status", value: status })?,
        progress: json(row, "progress")?,
        message: row.try_get("message")?,
        created: row.try_get("created")?,
        started: row.try_get("started")?,
        finished: row.try_get("finished")?,
        updated: row.try_get("updated")?,
        attempt: row.try_get("attempt")?,
        priority: row.try_get("priority")?,
        map_id: row.try_get("map_id")?,
        problem: problem.as_deref().map(serde_json::from_str).transpose()?,
        revision: row.try_get("revision")?,
        retry_of: row.try_get("retry_of")?,
        deadline: row.try_get("deadline")?,
    })
}

pub fn map(row: &PgRow) -> Result<MapRecord, StoreError> {
    let name: String = row.try_get("distance")?;
    let distance = Distance::ALL.into_iter().find(|distance| distance.name() == name);
    Ok(MapRecord {
        id: row.try_get("id")?,
        job_id: row.try_get("job_id")?,
        tenant: row.try_get("tenant")?,
        name: row.try_get("name")?,
        labels: json(row, "labels")?,
        created: row.try_get("created")?,
        distance: distance.ok_or(StoreError::Unknown { what: "distance", value: name })?,
        lattice: json(row, "lattice")?,
        fit: json(row, "fit")?,
        prefix: row.try_get("prefix")?,
        bytes: row.try_get("bytes")?,
        sha256: row.try_get("sha256")?,
        parent: row.try_get("parent")?,
        version: row.try_get("version")?,
    })
}

pub fn place(row: &PgRow) -> Result<Place, StoreError> {
    Ok(Place {
        name: row.try_get("name")?,
        version: row.try_get("version")?,
        map_id: row.try_get("map_id")?,
        note: row.try_get("note")?,
        published: row.try_get("published")?,
        sha256: row.try_get("sha256")?,
        serial: row.try_get("serial")?,
    })
}

pub fn key(row: &PgRow) -> Result<ApiKey, StoreError> {
    Ok(ApiKey {
        id: row.try_get("id")?,
        tenant: row.try_get("tenant")?,
        name: row.try_get("name")?,
        scopes: json(row, "scopes")?,
        sha256: row.try_get("sha256")?,
        created: row.try_get("created")?,
        revoked: row.try_get("revoked")?,
    })
}

pub fn webhook(row: &PgRow) -> Result<Webhook, StoreError> {
    Ok(Webhook {
        id: row.try_get("id")?,
        url: row.try_get("url")?,
        events: json(row, "events")?,
        created: row.try_get("created")?,
    })
}

pub fn delivery(row: &PgRow) -> Result<Delivery, StoreError> {
    let name: String = row.try_get("status")?;
    let status = DeliveryStatus::ALL.into_iter().find(|status| status.name() == name);
    Ok(Delivery {
        serial: row.try_get("serial")?,
        id: row.try_get("id")?,
        webhook_id: row.try_get("webhook_id")?,
        event: row.try_get("event")?,
        status: status.ok_or(StoreError::Unknown { what: "status", value: name })?,
        attempts: row.try_get("attempts")?,
        created: row.try_get("created")?,
        last_attempt: row.try_get("last_attempt")?,
        next_attempt: row.try_get("next_attempt")?,
        error: row.try_get("error")?,
    })
}

fn json<T: DeserializeOwned>(row: &PgRow, column: &str) -> Result<T, StoreError> {
    let text: &str = row.try_get(column)?;
    Ok(serde_json::from_str(text)?)
}

//! Records from rows.

use serde::de::DeserializeOwned;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use crate::fit::Distance;
use crate::jobs::{Job, JobStatus, MapRecord};
use crate::store::{ApiKey, Delivery, DeliveryStatus, Place, StoreError, Webhook};

/// A job's columns, all but what leases need.
pub const JOB: &str = "id, tenant, name, labels, status, progress, message, problem, created, started, finished, updated, \
                       attempt, priority, map_id, revision, retry_of, deadline";

/// A map's columns. Named one by one: a statement that a process has prepared stays right when a newer one adds columns.
pub const MAP: &str =
    "id, job_id, tenant, name, labels, created, distance, lattice, fit, prefix, bytes, sha256, parent, version";

pub fn job(row: &SqliteRow) -> Result<Job, StoreError> {
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

pub fn map(row: &SqliteRow) -> Result<MapRecord, StoreError> {
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

pub fn place(row: &SqliteRow) -> Result<Place, StoreError> {
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

pub fn key(row: &SqliteRow) -> Result<ApiKey, StoreError> {
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

pub fn webhook(row: &SqliteRow) -> Result<Webhook, StoreError> {
    Ok(Webhook {
        id: row.try_get("id")?,
        url: row.try_get("url")?,
        events: json(row, "events")?,
        created: row.try_get("created")?,
    })
}

pub fn delivery(row: &SqliteRow) -> Result<Delivery, StoreError> {
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

fn json<T: DeserializeOwned>(row: &SqliteRow, column: &str) -> Result<T, StoreError> {
    Ok(serde_json::from_str(row.try_get(column)?)?)
}

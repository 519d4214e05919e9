//! Records from rows, of either database: what a column holds is the same, what a row is is not.

use std::time::Duration;

use serde::de::DeserializeOwned;
use sqlx::Row;

use super::{ApiKey, Delivery, DeliveryStatus, Place, StoreError, Webhook};
use crate::fit::Distance;
use crate::jobs::{Job, JobStatus, MapRecord};

/// A row whose columns are asked for by name.
pub trait Columns {
    fn text(&self, column: &str) -> Result<String, sqlx::Error>;
    fn some_text(&self, column: &str) -> Result<Option<String>, sqlx::Error>;
    fn number(&self, column: &str) -> Result<i64, sqlx::Error>;
    fn some_number(&self, column: &str) -> Result<Option<i64>, sqlx::Error>;
    fn small(&self, column: &str) -> Result<i32, sqlx::Error>;
    fn some_small(&self, column: &str) -> Result<Option<i32>, sqlx::Error>;
    fn some_real(&self, column: &str) -> Result<Option<f64>, sqlx::Error>;
    fn blob(&self, column: &str) -> Result<Vec<u8>, sqlx::Error>;
    fn some_blob(&self, column: &str) -> Result<Option<Vec<u8>>, sqlx::Error>;
}

macro_rules! columns {
    ($row:ty: $($name:ident -> $kind:ty),+) => {
        impl Columns for $row {
            $(fn $name(&self, column: &str) -> Result<$kind, sqlx::Error> {
                self.try_get(column)
            })+
        }
    };
    ($($row:ty),+) => {
        $(columns!($row: text -> String, some_text -> Option<String>, number -> i64, some_number -> Option<i64>,
                   small -> i32, some_small -> Option<i32>, some_real -> Option<f64>, blob -> Vec<u8>,
                   some_blob -> Option<Vec<u8>>);)+
    };
}
columns!(sqlx::sqlite::SqliteRow, sqlx::postgres::PgRow);

pub fn job(row: &impl Columns) -> Result<Job, StoreError> {
    let status = row.text("status")?;
    let problem = row.some_text("problem")?;
    Ok(Job {
        id: row.text("id")?,
        tenant: row.text("tenant")?,
        name: row.some_text("name")?,
        labels: json(row, "labels")?,
        status: JobStatus::from_name(&status).ok_or(StoreError::Unknown { what: "status", value: status })?,
        progress: json(row, "progress")?,
        message: row.some_text("message")?,
        created: row.number("created")?,
        started: row.some_number("started")?,
        finished: row.some_number("finished")?,
        updated: row.number("updated")?,
        attempt: row.number("attempt")?,
        priority: row.small("priority")?,
        map_id: row.some_text("map_id")?,
        problem: problem.as_deref().map(serde_json::from_str).transpose()?,
        revision: row.number("revision")?,
        retry_of: row.some_text("retry_of")?,
        deadline: row.some_number("deadline")?,
        traceparent: row.some_text("traceparent")?,
    })
}

pub fn map(row: &impl Columns) -> Result<MapRecord, StoreError> {
    let name = row.text("distance")?;
    let distance = Distance::ALL.into_iter().find(|distance| distance.name() == name);
    Ok(MapRecord {
        id: row.text("id")?,
        job_id: row.text("job_id")?,
        tenant: row.text("tenant")?,
        name: row.some_text("name")?,
        labels: json(row, "labels")?,
        created: row.number("created")?,
        distance: distance.ok_or(StoreError::Unknown { what: "distance", value: name })?,
        lattice: json(row, "lattice")?,
        fit: json(row, "fit")?,
        prefix: row.text("prefix")?,
        bytes: row.number("bytes")?,
        sha256: row.some_text("sha256")?,
        parent: row.some_text("parent")?,
        version: row.number("version")?,
    })
}

/// A map with its age, milliseconds in the column `age`.
pub fn aged_map(row: &impl Columns) -> Result<(MapRecord, Duration), StoreError> {
    Ok((map(row)?, Duration::from_millis(u64::try_from(row.number("age")?).unwrap_or(0))))
}

pub fn place(row: &impl Columns) -> Result<Place, StoreError> {
    Ok(Place {
        name: row.text("name")?,
        version: row.number("version")?,
        map_id: row.text("map_id")?,
        note: row.some_text("note")?,
        published: row.number("published")?,
        sha256: row.some_text("sha256")?,
        serial: row.number("serial")?,
    })
}

pub fn key(row: &impl Columns) -> Result<ApiKey, StoreError> {
    Ok(ApiKey {
        id: row.text("id")?,
        tenant: row.text("tenant")?,
        name: row.some_text("name")?,
        scopes: json(row, "scopes")?,
        sha256: row.blob("sha256")?,
        created: row.number("created")?,
        revoked: row.some_number("revoked")?,
    })
}

pub fn webhook(row: &impl Columns) -> Result<Webhook, StoreError> {
    Ok(Webhook {
        id: row.text("id")?,
        url: row.text("url")?,
        events: json(row, "events")?,
        created: row.number("created")?,
    })
}

pub fn delivery(row: &impl Columns) -> Result<Delivery, StoreError> {
    let name = row.text("status")?;
    let status = DeliveryStatus::ALL.into_iter().find(|status| status.name() == name);
    Ok(Delivery {
        serial: row.number("serial")?,
        id: row.text("id")?,
        webhook_id: row.text("webhook_id")?,
        event: row.text("event")?,
        status: status.ok_or(StoreError::Unknown { what: "status", value: name })?,
        attempts: row.number("attempts")?,
        created: row.number("created")?,
        last_attempt: row.some_number("last_attempt")?,
        next_attempt: row.some_number("next_attempt")?,
        error: row.some_text("error")?,
    })
}

fn json<T: DeserializeOwned>(row: &impl Columns, column: &str) -> Result<T, StoreError> {
    Ok(serde_json::from_str(&row.text(column)?)?)
}

//! Everything there is, at one moment, as rows; and rows put back, in a store of either kind.
//!
//! A row goes out as a JSON object of its columns, in either database the same: texts as they are kept (labels, lattices and
//! the like are JSON within), bytes in base64. What belongs together goes together, in one transaction: a job with its
//! request and its idempotency keys, a place with its versions.
//!
//! Left out are webhooks' deliveries: those that wait would be made twice. A job that runs goes out as one that waits: it is
//! begun again wherever it is restored.

use async_trait::async_trait;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::StoreError;
use super::rows::Columns;
use crate::jobs::Progress;

/// A row, by its columns.
pub type Row = serde_json::Map<String, Value>;

/// Rows that go out and in together, by table: the first is what the others belong to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Saved {
    Key {
        key: Row,
    },
    Job {
        job: Row,
        request: Vec<Row>,
        idempotency_keys: Vec<Row>,
    },
    Map {
        map: Row,
    },
    /// Its versions in the order in which they were published.
    Place {
        place: Row,
        versions: Vec<Row>,
    },
    Webhook {
        webhook: Row,
    },
}

/// Who takes what is saved.
pub type Take<'a> = dyn FnMut(Saved) -> std::io::Result<()> + Send + 'a;

#[async_trait]
pub trait Backup: Send + Sync {
    /// Everything as it is at one moment: keys, jobs, maps, places by their last publication, webhooks. What happens
    /// meanwhile is not in it, and waits for nothing.
    async fn save(&self, take: &mut Take<'_>) -> Result<(), StoreError>;
    /// Puts back what is not there, in one transaction; how many of these. What is there stays as it is.
    async fn restore(&self, saved: &[Saved]) -> Result<usize, StoreError>;
}

/// What a column holds; any may be null.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    Number,
    Small,
    Real,
    Blob,
}
use Kind::{Blob, Number, Real, Small, Text};

/// Its name, and what it holds.
pub(super) type Column = (&'static str, Kind);

pub(super) struct Table {
    pub name: &'static str,
    pub columns: &'static [Column],
}

pub(super) const KEYS: Table = Table {
    name: "api_keys",
    columns: &[
        ("id", Text),
        ("tenant", Text),
        ("name", Text),
        ("scopes", Text),
        ("sha256", Blob),
        ("created", Number),
        ("revoked", Number),
    ],
};
pub(super) const JOBS: Table = Table {
    name: "jobs",
    columns: &[
        ("id", Text),
        ("tenant", Text),
        ("name", Text),
        ("labels", Text),
        ("status", Text),
        ("progress", Text),
        ("message", Text),
        ("problem", Text),
        ("created", Number),
        ("started", Number),
        ("finished", Number),
        ("updated", Number),
        ("attempt", Number),
        ("priority", Small),
        ("map_id", Text),
        ("revision", Number),
        ("not_before", Number),
        ("retry_of", Text),
        ("deadline", Number),
        ("traceparent", Text),
    ],
};
pub(super) const REQUESTS: Table = Table { name: "requests", columns: &[("job_id", Text), ("request", Blob)] };
pub(super) const IDEMPOTENCY: Table =
    Table { name: "idempotency_keys", columns: &[("tenant", Text), ("key", Text), ("body", Text), ("job_id", Text)] };
pub(super) const MAPS: Table = Table {
    name: "maps",
    columns: &[
        ("id", Text),
        ("job_id", Text),
        ("tenant", Text),
        ("name", Text),
        ("labels", Text),
        ("created", Number),
        ("distance", Text),
        ("lattice", Text),
        ("fit", Text),
        ("min_x", Real),
        ("min_y", Real),
        ("max_x", Real),
        ("max_y", Real),
        ("prefix", Text),
        ("bytes", Number),
        ("sha256", Text),
        ("parent", Text),
        ("version", Number),
    ],
};
pub(super) const PLACES: Table =
    Table { name: "places", columns: &[("tenant", Text), ("name", Text), ("version", Number)] };
/// Without the serial, which a store gives out itself.
pub(super) const VERSIONS: Table = Table {
    name: "place_versions",
    columns: &[
        ("tenant", Text),
        ("name", Text),
        ("version", Number),
        ("map_id", Text),
        ("note", Text),
        ("published", Number),
    ],
};
pub(super) const WEBHOOKS: Table = Table {
    name: "webhooks",
    columns: &[("id", Text), ("tenant", Text), ("url", Text), ("events", Text), ("secret", Text), ("created", Number)],
};

/// Places by their last publication, so that the order of lists stays.
pub(super) const PLACES_IN_ORDER: &str = "SELECT p.tenant AS tenant, p.name AS name, p.version AS version FROM places AS p \
     JOIN place_versions AS v ON (v.tenant, v.name, v.version) = (p.tenant, p.name, p.version) ORDER BY v.serial";

/// The tables that are saved, with their columns: what a migration adds goes in here, or is made anew by whoever restores.
pub fn tables() -> Vec<(&'static str, Vec<&'static str>)> {
    let all = [KEYS, JOBS, REQUESTS, IDEMPOTENCY, MAPS, PLACES, VERSIONS, WEBHOOKS];
    all.map(|table| (table.name, table.columns.iter().map(|(column, _)| *column).collect())).to_vec()
}

impl Table {
    pub fn list(&self) -> String {
        self.columns.iter().map(|(column, _)| *column).collect::<Vec<_>>().join(", ")
    }

    /// Rows on some condition.
    pub fn select(&self, condition: &str) -> String {
        format!("SELECT {} FROM {} WHERE {condition}", self.list(), self.name)
    }

    /// The columns that a row has. What an older version did not save yet gets the schema's default; what a newer one saved,
    /// and nobody here knows, is an error.
    pub fn of(&self, row: &Row) -> Result<Vec<Column>, StoreError> {
        if let Some(unknown) = row.keys().find(|column| !self.columns.iter().any(|(name, _)| name == column)) {
            return Err(StoreError::NotRestored(format!("{} has no column {unknown}", self.name)));
        }
        Ok(self.columns.iter().filter(|(name, _)| row.contains_key(*name)).copied().collect())
    }

    /// A row of these columns, where there is none of its key.
    pub fn insert(&self, columns: &[Column]) -> String {
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        let places: Vec<String> = (1..=columns.len()).map(|k| format!("${k}")).collect();
        let (names, places) = (names.join(", "), places.join(", "));
        format!("INSERT INTO {} ({names}) VALUES ({places}) ON CONFLICT DO NOTHING", self.name)
    }

    pub fn read(&self, row: &impl Columns) -> Result<Row, StoreError> {
        let value = |&(column, kind): &Column| {
            let value = match kind {
                Text => row.some_text(column)?.map(Value::from),
                Number => row.some_number(column)?.map(Value::from),
                Small => row.some_small(column)?.map(Value::from),
                Real => row.some_real(column)?.map(Value::from),
                Blob => row.some_blob(column)?.map(|bytes| STANDARD.encode(bytes).into()),
            };
            Ok((column.to_owned(), value.unwrap_or(Value::Null)))
        };
        self.columns.iter().map(value).collect()
    }
}

/// A job that runs becomes one that waits, as if it had been handed back.
pub(super) fn handed_back(mut job: Row) -> Result<Row, StoreError> {
    if job["status"] == "running" {
        let progress: Progress = serde_json::from_str(job["progress"].as_str().unwrap_or_default())?;
        job["progress"] = serde_json::to_string(&progress.again())?.into();
        job["attempt"] = (job["attempt"].as_i64().unwrap_or(1) - 1).into();
        job["status"] = "accepted".into();
    }
    Ok(job)
}

pub(super) fn bytes(value: &Value) -> Result<Option<Vec<u8>>, StoreError> {
    let wrong = |error: base64::DecodeError| StoreError::NotRestored(format!("bytes in base64: {error}"));
    value.as_str().map(|text| STANDARD.decode(text).map_err(wrong)).transpose()
}

impl Saved {
    /// Its rows by table, the first first.
    pub(super) fn rows(&self) -> Vec<(&'static Table, &Row)> {
        match self {
            Self::Key { key } => vec![(&KEYS, key)],
            Self::Job { job, request, idempotency_keys } => {
                let own = [(&JOBS, job)].into_iter();
                let requests = request.iter().map(|row| (&REQUESTS, row));
                own.chain(requests).chain(idempotency_keys.iter().map(|row| (&IDEMPOTENCY, row))).collect()
            }
            Self::Map { map } => vec![(&MAPS, map)],
            Self::Place { place, versions } => {
                [(&PLACES, place)].into_iter().chain(versions.iter().map(|row| (&VERSIONS, row))).collect()
            }
            Self::Webhook { webhook } => vec![(&WEBHOOKS, webhook)],
        }
    }
}

/// [`Backup`] of a store: the same statements in either database, which only the types of a connection tell apart.
macro_rules! backup_of {
    ($store:ident, $database:ident) => {
        /// Rows that are read at once. A job comes with its request.
        const PAGE: i64 = 64;
        type Reading = sqlx::Transaction<'static, sqlx::$database>;

        async fn rows(tx: &mut Reading, table: &Table, sql: String, given: &[&str]) -> Result<Vec<Row>, StoreError> {
            let mut query = sqlx::query(AssertSqlSafe(sql));
            for value in given {
                query = query.bind(value.to_string());
            }
            query.fetch_all(&mut **tx).await?.iter().map(|row| table.read(row)).collect()
        }

        /// The rows with the next ids; none at the end.
        async fn page(tx: &mut Reading, table: &Table, after: &mut String) -> Result<Vec<Row>, StoreError> {
            let sql = format!("{} ORDER BY id LIMIT {PAGE}", table.select("id > $1"));
            let page = rows(tx, table, sql, &[&after[..]]).await?;
            let last = page.last().and_then(|row| row["id"].as_str());
            *after = last.unwrap_or_default().to_owned();
            Ok(page)
        }

        async fn each(
            tx: &mut Reading,
            table: &Table,
            take: &mut (dyn FnMut(Row) -> std::io::Result<()> + Send),
        ) -> Result<(), StoreError> {
            let mut after = String::new();
            loop {
                let page = page(tx, table, &mut after).await?;
                if page.is_empty() {
                    return Ok(());
                }
                for row in page {
                    take(row)?;
                }
            }
        }

        async fn each_job(tx: &mut Reading, take: &mut Take<'_>) -> Result<(), StoreError> {
            let mut after = String::new();
            loop {
                let jobs = page(tx, &backup::JOBS, &mut after).await?;
                let Some(first) = jobs.first().and_then(|job| job["id"].as_str()) else { return Ok(()) };
                let (range, within) = ("job_id >= $1 AND job_id <= $2 ORDER BY job_id", [first, &after[..]]);
                let requests = rows(tx, &backup::REQUESTS, backup::REQUESTS.select(range), &within).await?;
                let keys = rows(tx, &backup::IDEMPOTENCY, backup::IDEMPOTENCY.select(range), &within).await?;
                for job in jobs {
                    let of = |rows: &[Row]| rows.iter().filter(|row| row["job_id"] == job["id"]).cloned().collect();
                    let (request, idempotency_keys) = (of(&requests), of(&keys));
                    take(Saved::Job { job: backup::handed_back(job)?, request, idempotency_keys })?;
                }
            }
        }

        #[async_trait]
        impl Backup for $store {
            async fn save(&self, take: &mut Take<'_>) -> Result<(), StoreError> {
                let mut tx = self.begin_reading().await?;
                each(&mut tx, &backup::KEYS, &mut |key| take(Saved::Key { key })).await?;
                each_job(&mut tx, take).await?;
                each(&mut tx, &backup::MAPS, &mut |map| take(Saved::Map { map })).await?;
                for place in rows(&mut tx, &backup::PLACES, backup::PLACES_IN_ORDER.to_owned(), &[]).await? {
                    let own = [&place["tenant"], &place["name"]].map(|name| name.as_str().unwrap_or_default());
                    let versions = backup::VERSIONS.select("tenant = $1 AND name = $2 ORDER BY serial");
                    let versions = rows(&mut tx, &backup::VERSIONS, versions, &own).await?;
                    take(Saved::Place { place, versions })?;
                }
                each(&mut tx, &backup::WEBHOOKS, &mut |webhook| take(Saved::Webhook { webhook })).await?;
                Ok(tx.rollback().await?)
            }

            async fn restore(&self, saved: &[Saved]) -> Result<usize, StoreError> {
                let (mut tx, mut restored) = (self.begin().await?, 0);
                for saved in saved {
                    for (k, (table, row)) in saved.rows().into_iter().enumerate() {
                        let columns = table.of(row)?;
                        let mut insert = sqlx::query(AssertSqlSafe(table.insert(&columns)));
                        for (column, kind) in columns {
                            let value = &row[column];
                            insert = match kind {
                                Kind::Text => insert.bind(value.as_str().map(str::to_owned)),
                                Kind::Number => insert.bind(value.as_i64()),
                                Kind::Small => {
                                    insert.bind(value.as_i64().and_then(|number| i32::try_from(number).ok()))
                                }
                                Kind::Real => insert.bind(value.as_f64()),
                                Kind::Blob => insert.bind(backup::bytes(value)?),
                            };
                        }
                        let is_new = insert.execute(&mut *tx).await?.rows_affected() == 1;
                        if k == 0 && !is_new {
                            break;
                        }
                        restored += usize::from(k == 0);
                    }
                }
                tx.commit().await?;
                Ok(restored)
            }
        }
    };
}
pub(super) use backup_of;

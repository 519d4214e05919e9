//! Names under which maps follow one another.

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, Sqlite, Transaction};

use super::{SqliteStore, now, rows};
use crate::store::{Guard, Place, Places, Publication, StoreError};

const VERSION: &str = "SELECT v.name, v.version, v.map_id, v.note, v.published, v.serial, m.sha256 \
                       FROM place_versions AS v JOIN maps AS m ON m.id = v.map_id";
const CURRENT: &str = "JOIN places AS p ON (p.tenant, p.name, p.version) = (v.tenant, v.name, v.version)";
const LATEST: &str = "SELECT v.serial, v.version FROM place_versions AS v JOIN places AS p \
                      ON (p.tenant, p.name, p.version) = (v.tenant, v.name, v.version) WHERE p.tenant = ? AND p.name = ?";
const HAS_MAP: &str = "SELECT count(*) FROM maps WHERE id = ? AND tenant = ?";
const NAME: &str = "INSERT INTO places (tenant, name, version) VALUES (?, ?, ?) \
                    ON CONFLICT (tenant, name) DO UPDATE SET version = excluded.version";
const INSERT: &str = concat!(
    "INSERT INTO place_versions (tenant, name, version, map_id, note, published) VALUES (?, ?, ?, ?, ?, ",
    now!(),
    ")"
);
const REMOVE: &str = "DELETE FROM places WHERE tenant = ? AND name = ?";
const SERIALS: &str = "SELECT v.tenant, v.name, v.serial FROM json_each(?) AS asked JOIN places AS p \
                       ON (p.tenant, p.name) = (asked.value ->> 0, asked.value ->> 1) JOIN place_versions AS v \
                       ON (v.tenant, v.name, v.version) = (p.tenant, p.name, p.version)";

#[async_trait]
impl Places for SqliteStore {
    async fn publish(
        &self,
        tenant: &str,
        name: &str,
        map_id: &str,
        note: Option<&str>,
        guard: &Guard,
    ) -> Result<Publication, StoreError> {
        let mut tx = self.begin().await?;
        let latest = latest(&mut tx, tenant, name).await?;
        if !guard.holds(latest.map(|(serial, _)| serial)) {
            return Ok(Publication::Refused);
        }
        let maps: i64 = sqlx::query_scalar(HAS_MAP).bind(map_id).bind(tenant).fetch_one(&mut *tx).await?;
        if maps == 0 {
            return Ok(Publication::NoMap);
        }
        let version = latest.map_or(1, |(_, version)| version + 1);
        sqlx::query(NAME).bind(tenant).bind(name).bind(version).execute(&mut *tx).await?;
        let insert = sqlx::query(INSERT).bind(tenant).bind(name).bind(version).bind(map_id).bind(note);
        insert.execute(&mut *tx).await?;
        let query = format!("{VERSION} WHERE v.tenant = ? AND v.name = ? AND v.version = ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name).bind(version);
        let place = rows::place(&query.fetch_one(&mut *tx).await?)?;
        tx.commit().await?;
        Ok(Publication::Published(place))
    }

    async fn place(&self, tenant: &str, name: &str) -> Result<Option<Place>, StoreError> {
        let query = format!("{VERSION} {CURRENT} WHERE p.tenant = ? AND p.name = ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name);
        query.fetch_optional(&self.readers).await?.as_ref().map(rows::place).transpose()
    }

    async fn place_version(&self, tenant: &str, name: &str, version: i64) -> Result<Option<Place>, StoreError> {
        let query = format!("{VERSION} WHERE v.tenant = ? AND v.name = ? AND v.version = ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name).bind(version);
        query.fetch_optional(&self.readers).await?.as_ref().map(rows::place).transpose()
    }

    async fn places(&self, tenant: &str, before: Option<i64>, limit: i64) -> Result<Vec<Place>, StoreError> {
        let query = format!("{VERSION} {CURRENT} WHERE p.tenant = ? AND v.serial < ? ORDER BY v.serial DESC LIMIT ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(before.unwrap_or(i64::MAX)).bind(limit);
        query.fetch_all(&self.readers).await?.iter().map(rows::place).collect()
    }

    async fn place_versions(
        &self,
        tenant: &str,
        name: &str,
        before: Option<i64>,
        limit: i64,
    ) -> Result<Vec<Place>, StoreError> {
        let query =
            format!("{VERSION} WHERE v.tenant = ? AND v.name = ? AND v.version < ? ORDER BY v.version DESC LIMIT ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name).bind(before.unwrap_or(i64::MAX));
        query.bind(limit).fetch_all(&self.readers).await?.iter().map(rows::place).collect()
    }

    async fn remove_place(&self, tenant: &str, name: &str, guard: &Guard) -> Result<Option<bool>, StoreError> {
        let mut tx = self.begin().await?;
        let latest = latest(&mut tx, tenant, name).await?;
        if latest.is_some() && !guard.holds(latest.map(|(serial, _)| serial)) {
            return Ok(None);
        }
        sqlx::query(REMOVE).bind(tenant).bind(name).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(Some(latest.is_some()))
    }

    async fn place_serials(&self, places: &[(String, String)]) -> Result<Vec<((String, String), i64)>, StoreError> {
        let asked = serde_json::to_string(places)?;
        let rows: Vec<(String, String, i64)> = sqlx::query_as(SERIALS).bind(asked).fetch_all(&self.readers).await?;
        Ok(rows.into_iter().map(|(tenant, name, serial)| ((tenant, name), serial)).collect())
    }
}

/// The serial and the version of what is published.
async fn latest(
    tx: &mut Transaction<'static, Sqlite>,
    tenant: &str,
    name: &str,
) -> Result<Option<(i64, i64)>, StoreError> {
    Ok(sqlx::query_as(LATEST).bind(tenant).bind(name).fetch_optional(&mut **tx).await?)
}

//! Names under which maps follow one another. Publications of one place follow one another, too: each holds the place's
//! lock, which is there before the place is.

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, Postgres, Transaction};

use super::{PUBLICATIONS, PostgresStore, now, rows};
use crate::store::{Guard, Place, Places, Publication, StoreError};

const VERSION: &str = "SELECT v.name, v.version, v.map_id, v.note, v.published, v.serial, m.sha256 \
                       FROM place_versions AS v JOIN maps AS m ON m.id = v.map_id";
const CURRENT: &str = "JOIN places AS p ON (p.tenant, p.name, p.version) = (v.tenant, v.name, v.version)";
const LOCK: &str = "SELECT pg_advisory_xact_lock(place_key($1, $2))";
const LATEST: &str = "SELECT v.serial, v.version FROM place_versions AS v JOIN places AS p \
                      ON (p.tenant, p.name, p.version) = (v.tenant, v.name, v.version) \
                      WHERE p.tenant = $1 AND p.name = $2";
/// Holds the map, so that it is not removed before it is named.
const HAS_MAP: &str = "SELECT id FROM maps WHERE id = $1 AND tenant = $2 FOR KEY SHARE";
const NAME: &str = "INSERT INTO places (tenant, name, version) VALUES ($1, $2, $3) \
                    ON CONFLICT (tenant, name) DO UPDATE SET version = excluded.version";
const INSERT: &str = concat!(
    "INSERT INTO place_versions (tenant, name, version, map_id, note, published) VALUES ($1, $2, $3, $4, $5, ",
    now!(),
    ")"
);
/// With the commit. Publications are few, so that they may commit one after the other, as transactions do that notify.
const TELL: &str = "SELECT pg_notify($1, '')";
const REMOVE: &str = "DELETE FROM places WHERE tenant = $1 AND name = $2";
const SERIALS: &str = "SELECT v.tenant, v.name, v.serial FROM unnest($1::text[], $2::text[]) AS asked (tenant, name) \
                       JOIN places AS p ON (p.tenant, p.name) = (asked.tenant, asked.name) JOIN place_versions AS v \
                       ON (v.tenant, v.name, v.version) = (p.tenant, p.name, p.version)";

#[async_trait]
impl Places for PostgresStore {
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
        let map: Option<String> =
            sqlx::query_scalar(HAS_MAP).bind(map_id).bind(tenant).fetch_optional(&mut *tx).await?;
        if map.is_none() {
            return Ok(Publication::NoMap);
        }
        let version = latest.map_or(1, |(_, version)| version + 1);
        sqlx::query(NAME).bind(tenant).bind(name).bind(version).execute(&mut *tx).await?;
        let insert = sqlx::query(INSERT).bind(tenant).bind(name).bind(version).bind(map_id).bind(note);
        insert.execute(&mut *tx).await?;
        sqlx::query(TELL).bind(PUBLICATIONS).execute(&mut *tx).await?;
        let query = format!("{VERSION} WHERE v.tenant = $1 AND v.name = $2 AND v.version = $3");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name).bind(version);
        let place = rows::place(&query.fetch_one(&mut *tx).await?)?;
        tx.commit().await?;
        Ok(Publication::Published(place))
    }

    async fn place(&self, tenant: &str, name: &str) -> Result<Option<Place>, StoreError> {
        let query = format!("{VERSION} {CURRENT} WHERE p.tenant = $1 AND p.name = $2");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name);
        query.fetch_optional(&self.pool).await?.as_ref().map(rows::place).transpose()
    }

    async fn place_version(&self, tenant: &str, name: &str, version: i64) -> Result<Option<Place>, StoreError> {
        let query = format!("{VERSION} WHERE v.tenant = $1 AND v.name = $2 AND v.version = $3");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name).bind(version);
        query.fetch_optional(&self.pool).await?.as_ref().map(rows::place).transpose()
    }

    async fn places(&self, tenant: &str, before: Option<i64>, limit: i64) -> Result<Vec<Place>, StoreError> {
        let query =
            format!("{VERSION} {CURRENT} WHERE v.tenant = $1 AND v.serial < $2 ORDER BY v.serial DESC LIMIT $3");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(before.unwrap_or(i64::MAX)).bind(limit);
        query.fetch_all(&self.pool).await?.iter().map(rows::place).collect()
    }

    async fn place_versions(
        &self,
        tenant: &str,
        name: &str,
        before: Option<i64>,
        limit: i64,
    ) -> Result<Vec<Place>, StoreError> {
        let query = format!(
            "{VERSION} WHERE v.tenant = $1 AND v.name = $2 AND v.version < $3 ORDER BY v.version DESC LIMIT $4"
        );
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(name).bind(before.unwrap_or(i64::MAX));
        query.bind(limit).fetch_all(&self.pool).await?.iter().map(rows::place).collect()
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
        let (tenants, names): (Vec<String>, Vec<String>) = places.iter().cloned().unzip();
        let query = sqlx::query_as(SERIALS).bind(tenants).bind(names);
        let rows: Vec<(String, String, i64)> = query.fetch_all(&self.pool).await?;
        Ok(rows.into_iter().map(|(tenant, name, serial)| ((tenant, name), serial)).collect())
    }
}

/// The serial and the version of what is published, which stays so until the transaction ends.
async fn latest(
    tx: &mut Transaction<'static, Postgres>,
    tenant: &str,
    name: &str,
) -> Result<Option<(i64, i64)>, StoreError> {
    sqlx::query(LOCK).bind(tenant).bind(name).execute(&mut **tx).await?;
    Ok(sqlx::query_as(LATEST).bind(tenant).bind(name).fetch_optional(&mut **tx).await?)
}

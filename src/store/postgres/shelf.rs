//! Maps as clients see them.

use async_trait::async_trait;
use sqlx::AssertSqlSafe;

use super::rows::{self, MAP};
use super::{PostgresStore, listed};
use crate::jobs::MapRecord;
use crate::store::{Listing, MapRemoval, MapShelf, Relabelling, StoreError};

const RELABEL: &str = "UPDATE maps SET name = CASE WHEN $3 THEN $4 ELSE name END, labels = COALESCE($5, labels) \
                       WHERE id = $1 AND tenant = $2";
/// Waits for publications of this map that are under way; those that come later wait for the removal.
const HOLD: &str = "SELECT 1 FROM maps WHERE id = $1 AND tenant = $2 FOR UPDATE";
const NAMED: &str = "SELECT name FROM place_versions WHERE map_id = $1 AND tenant = $2 LIMIT 1";

#[async_trait]
impl MapShelf for PostgresStore {
    async fn map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError> {
        let query = format!("SELECT {MAP} FROM maps AS m WHERE m.id = $1 AND m.tenant = $2");
        let row = sqlx::query(AssertSqlSafe(query)).bind(id).bind(tenant).fetch_optional(&self.pool).await?;
        row.as_ref().map(rows::map).transpose()
    }

    async fn maps(&self, listing: &Listing) -> Result<Vec<MapRecord>, StoreError> {
        let mut query = listed::page(&listed::MAPS, listing);
        query.build().fetch_all(&self.pool).await?.iter().map(rows::map).collect()
    }

    async fn relabel_map(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<MapRecord>, StoreError> {
        let labels = change.labels.as_ref().map(serde_json::to_string).transpose()?;
        let update = sqlx::query(RELABEL).bind(id).bind(tenant);
        let update = update.bind(change.name.is_some()).bind(change.name.clone().flatten()).bind(labels);
        update.execute(&self.pool).await?;
        self.map(tenant, id).await
    }

    async fn remove_map(&self, tenant: &str, id: &str) -> Result<MapRemoval, StoreError> {
        let mut tx = self.begin().await?;
        sqlx::query(HOLD).bind(id).bind(tenant).execute(&mut *tx).await?;
        let named: Option<String> = sqlx::query_scalar(NAMED).bind(id).bind(tenant).fetch_optional(&mut *tx).await?;
        if let Some(place) = named {
            return Ok(MapRemoval::Named(place));
        }
        let remove = format!("DELETE FROM maps AS m WHERE m.id = $1 AND m.tenant = $2 RETURNING {MAP}");
        let removed = sqlx::query(AssertSqlSafe(remove)).bind(id).bind(tenant).fetch_all(&mut *tx).await?;
        tx.commit().await?;
        Ok(match removed.first() {
            Some(row) => MapRemoval::Removed(Box::new(rows::map(row)?)),
            None => MapRemoval::Unknown,
        })
    }
}

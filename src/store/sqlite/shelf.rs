//! Maps as clients see them.

use async_trait::async_trait;
use sqlx::AssertSqlSafe;

use super::rows::{self, MAP};
use super::{SqliteStore, listed};
use crate::jobs::MapRecord;
use crate::store::{Listing, MapRemoval, MapShelf, Relabelling, StoreError};

const RELABEL: &str = "UPDATE maps SET name = CASE WHEN ? THEN ? ELSE name END, labels = COALESCE(?, labels) \
                       WHERE id = ? AND tenant = ?";
const NAMED: &str = "SELECT name FROM place_versions WHERE map_id = ? AND tenant = ? LIMIT 1";
const REMOVE: &str = "DELETE FROM maps WHERE id = ? AND tenant = ? RETURNING ";

#[async_trait]
impl MapShelf for SqliteStore {
    async fn map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError> {
        let query = format!("SELECT {MAP} FROM maps WHERE id = ? AND tenant = ?");
        let row = sqlx::query(AssertSqlSafe(query)).bind(id).bind(tenant).fetch_optional(&self.readers).await?;
        row.as_ref().map(rows::map).transpose()
    }

    async fn maps(&self, listing: &Listing) -> Result<Vec<MapRecord>, StoreError> {
        let mut query = listed::page(&listed::MAPS, MAP, listing);
        query.build().fetch_all(&self.readers).await?.iter().map(rows::map).collect()
    }

    async fn relabel_map(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<MapRecord>, StoreError> {
        let mut tx = self.begin().await?;
        let labels = change.labels.as_ref().map(serde_json::to_string).transpose()?;
        let update = sqlx::query(RELABEL).bind(change.name.is_some()).bind(change.name.clone().flatten()).bind(labels);
        update.bind(id).bind(tenant).execute(&mut *tx).await?;
        tx.commit().await?;
        self.map(tenant, id).await
    }

    async fn remove_map(&self, tenant: &str, id: &str) -> Result<MapRemoval, StoreError> {
        let mut tx = self.begin().await?;
        let named: Option<String> = sqlx::query_scalar(NAMED).bind(id).bind(tenant).fetch_optional(&mut *tx).await?;
        if let Some(place) = named {
            return Ok(MapRemoval::Named(place));
        }
        let remove = sqlx::query(AssertSqlSafe(format!("{REMOVE}{MAP}"))).bind(id).bind(tenant);
        let removed = remove.fetch_all(&mut *tx).await?;
        tx.commit().await?;
        Ok(match removed.first() {
            Some(row) => MapRemoval::Removed(Box::new(rows::map(row)?)),
            None => MapRemoval::Unknown,
        })
    }
}

//! API keys.

use async_trait::async_trait;
use sqlx::AssertSqlSafe;

use super::rows::{self, KEY};
use super::{SqliteStore, now};
use crate::store::{ApiKey, Keys, NewKey, StoreError};

const INSERT: &str = concat!(
    "INSERT INTO api_keys (id, tenant, name, scopes, sha256, created) VALUES (?, ?, ?, ?, ?, ",
    now!(),
    ") RETURNING "
);
const REVOKE: &str = concat!("UPDATE api_keys SET revoked = COALESCE(revoked, ", now!(), ") WHERE id = ?");

#[async_trait]
impl Keys for SqliteStore {
    async fn add_key(&self, key: &NewKey) -> Result<ApiKey, StoreError> {
        let mut tx = self.begin().await?;
        let insert =
            sqlx::query(AssertSqlSafe(format!("{INSERT}{KEY}"))).bind(&key.id).bind(&key.tenant).bind(&key.name);
        let insert = insert.bind(serde_json::to_string(&key.scopes)?).bind(&key.sha256[..]);
        let rows = insert.fetch_all(&mut *tx).await?;
        tx.commit().await?;
        rows.first().map_or_else(|| Err(sqlx::Error::RowNotFound.into()), rows::key)
    }

    async fn key(&self, id: &str) -> Result<Option<ApiKey>, StoreError> {
        let query = sqlx::query(AssertSqlSafe(format!("SELECT {KEY} FROM api_keys WHERE id = ?"))).bind(id);
        query.fetch_optional(&self.readers).await?.as_ref().map(rows::key).transpose()
    }

    async fn keys(&self) -> Result<Vec<ApiKey>, StoreError> {
        let query = sqlx::query(AssertSqlSafe(format!("SELECT {KEY} FROM api_keys ORDER BY created, id")));
        query.fetch_all(&self.readers).await?.iter().map(rows::key).collect()
    }

    async fn revoke_key(&self, id: &str) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let known = sqlx::query(REVOKE).bind(id).execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(known)
    }

    async fn has_keys(&self) -> Result<bool, StoreError> {
        let query = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM api_keys)");
        Ok(query.fetch_one(&self.readers).await?)
    }
}

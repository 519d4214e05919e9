//! API keys.

use async_trait::async_trait;

use super::{PostgresStore, now, rows};
use crate::store::{ApiKey, Keys, NewKey, StoreError};

const INSERT: &str = concat!(
    "INSERT INTO api_keys (id, tenant, name, scopes, sha256, created) VALUES ($1, $2, $3, $4, $5, ",
    now!(),
    ") RETURNING id, tenant, name, scopes, sha256, created, revoked"
);
const KEY: &str = "SELECT id, tenant, name, scopes, sha256, created, revoked FROM api_keys WHERE id = $1";
const ALL: &str = "SELECT id, tenant, name, scopes, sha256, created, revoked FROM api_keys ORDER BY created, id";
const REVOKE: &str = concat!("UPDATE api_keys SET revoked = COALESCE(revoked, ", now!(), ") WHERE id = $1");

#[async_trait]
impl Keys for PostgresStore {
    async fn add_key(&self, key: &NewKey) -> Result<ApiKey, StoreError> {
        let insert = sqlx::query(INSERT).bind(&key.id).bind(&key.tenant).bind(&key.name);
        let insert = insert.bind(serde_json::to_string(&key.scopes)?).bind(&key.sha256[..]);
        let rows = insert.fetch_all(&self.pool).await?;
        rows.first().map_or_else(|| Err(sqlx::Error::RowNotFound.into()), rows::key)
    }

    async fn key(&self, id: &str) -> Result<Option<ApiKey>, StoreError> {
        sqlx::query(KEY).bind(id).fetch_optional(&self.pool).await?.as_ref().map(rows::key).transpose()
    }

    async fn keys(&self) -> Result<Vec<ApiKey>, StoreError> {
        sqlx::query(ALL).fetch_all(&self.pool).await?.iter().map(rows::key).collect()
    }

    async fn revoke_key(&self, id: &str) -> Result<bool, StoreError> {
        Ok(sqlx::query(REVOKE).bind(id).execute(&self.pool).await?.rows_affected() == 1)
    }

    async fn has_keys(&self) -> Result<bool, StoreError> {
        let query = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM api_keys)");
        Ok(query.fetch_one(&self.pool).await?)
    }
}

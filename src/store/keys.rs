//! API keys: whose they are and what they may do. The keys themselves are nowhere.

use async_trait::async_trait;

use super::StoreError;

/// A key to be kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewKey {
    pub id: String,
    pub tenant: String,
    pub name: Option<String>,
    /// Names, in order.
    pub scopes: Vec<String>,
    pub sha256: [u8; 32],
}

/// What is known of a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ApiKey {
    pub id: String,
    pub tenant: String,
    pub name: Option<String>,
    pub scopes: Vec<String>,
    pub sha256: Vec<u8>,
    /// Milliseconds since 1970, by the database's clock.
    pub created: i64,
    pub revoked: Option<i64>,
}

#[async_trait]
pub trait Keys: Send + Sync {
    async fn add_key(&self, key: &NewKey) -> Result<ApiKey, StoreError>;
    /// Revoked ones, too.
    async fn key(&self, id: &str) -> Result<Option<ApiKey>, StoreError>;
    /// All, oldest first, revoked ones too.
    async fn keys(&self) -> Result<Vec<ApiKey>, StoreError>;
    /// Whether there is such a key.
    async fn revoke_key(&self, id: &str) -> Result<bool, StoreError>;
    /// Whether a key was ever made: from then on nobody comes in without one.
    async fn has_keys(&self) -> Result<bool, StoreError>;
}

//! What clients do with maps.

use async_trait::async_trait;

use super::{Listing, Relabelling, StoreError};
use crate::jobs::MapRecord;

/// What became of a map's removal.
#[derive(Debug, Clone, PartialEq)]
pub enum MapRemoval {
    Removed(Box<MapRecord>),
    /// A place, by name, has it as one of its versions.
    Named(String),
    Unknown,
}

/// Maps as clients see them. Another tenant's are not there.
#[async_trait]
pub trait MapShelf: Send + Sync {
    async fn map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError>;
    async fn maps(&self, listing: &Listing) -> Result<Vec<MapRecord>, StoreError>;
    async fn relabel_map(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<MapRecord>, StoreError>;
    async fn remove_map(&self, tenant: &str, id: &str) -> Result<MapRemoval, StoreError>;
}

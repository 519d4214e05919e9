//! Names under which maps follow one another.

use async_trait::async_trait;

use super::StoreError;

/// A version of a place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    pub name: String,
    pub version: i64,
    pub map_id: String,
    pub note: Option<String>,
    /// Milliseconds since 1970, by the database's clock.
    pub published: i64,
    /// Of the map's file, where it is known.
    pub sha256: Option<String>,
    /// Grows with every publication of any place.
    pub serial: i64,
}

/// What has to hold of a place for a publication.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Guard {
    Nothing,
    /// There is none of this name.
    New,
    /// There is one.
    Existing,
    /// One of these serials is its.
    Serials(Vec<i64>),
}

impl Guard {
    /// Whether it holds of the place there is.
    pub fn holds(&self, serial: Option<i64>) -> bool {
        match self {
            Self::Nothing => true,
            Self::New => serial.is_none(),
            Self::Existing => serial.is_some(),
            Self::Serials(known) => serial.is_some_and(|serial| known.contains(&serial)),
        }
    }
}

/// What became of a publication.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Publication {
    /// As the first version, or a later one.
    Published(Place),
    /// The guard did not hold.
    Refused,
    NoMap,
}

/// Places as clients see them. Another tenant's are not there.
#[async_trait]
pub trait Places: Send + Sync {
    /// Publishes a map as the next version.
    async fn publish(
        &self,
        tenant: &str,
        name: &str,
        map_id: &str,
        note: Option<&str>,
        guard: &Guard,
    ) -> Result<Publication, StoreError>;
    async fn place(&self, tenant: &str, name: &str) -> Result<Option<Place>, StoreError>;
    async fn place_version(&self, tenant: &str, name: &str, version: i64) -> Result<Option<Place>, StoreError>;
    /// Published last first, those with serials below `before`.
    async fn places(&self, tenant: &str, before: Option<i64>, limit: i64) -> Result<Vec<Place>, StoreError>;
    /// Newest first, those below `before`.
    async fn place_versions(
        &self,
        tenant: &str,
        name: &str,
        before: Option<i64>,
        limit: i64,
    ) -> Result<Vec<Place>, StoreError>;
    /// Whether there was one.
    async fn remove_place(&self, tenant: &str, name: &str, guard: &Guard) -> Result<Option<bool>, StoreError>;
    /// The serials of these places, by (tenant, name); what is gone is left out.
    async fn place_serials(&self, places: &[(String, String)]) -> Result<Vec<((String, String), i64)>, StoreError>;
}

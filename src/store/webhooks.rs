//! Whom to tell of what, and what was told. Deliveries are queued by the store itself, in the transaction of their event.

use std::time::Duration;

use async_trait::async_trait;

use super::StoreError;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewWebhook {
    pub tenant: String,
    pub url: String,
    pub events: Vec<String>,
    /// What deliveries are signed with.
    pub secret: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Webhook {
    pub id: String,
    pub url: String,
    pub events: Vec<String>,
    /// Milliseconds since 1970, by the database's clock.
    pub created: i64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeliveryStatus {
    Pending,
    Delivered,
    Failed,
}

impl DeliveryStatus {
    pub const ALL: [Self; 3] = [Self::Pending, Self::Delivered, Self::Failed];

    pub fn name(self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Delivered => "delivered",
            Self::Failed => "failed",
        }
    }
}

/// An event to be told, and how that went so far.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Delivery {
    /// Grows with every delivery.
    pub serial: i64,
    pub id: String,
    pub webhook_id: String,
    pub event: String,
    pub status: DeliveryStatus,
    pub attempts: i64,
    pub created: i64,
    pub last_attempt: Option<i64>,
    pub next_attempt: Option<i64>,
    pub error: Option<String>,
}

/// A delivery to be made now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DueDelivery {
    pub id: String,
    pub webhook_id: String,
    pub url: String,
    pub secret: String,
    /// JSON.
    pub payload: String,
    /// This is the attempt of this number, from 1.
    pub attempt: i64,
}

/// How an attempt at a delivery ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Delivered {
    Yes,
    /// Once more after a while.
    NotYet(Duration, String),
    Never(String),
}

#[async_trait]
pub trait Webhooks: Send + Sync {
    async fn add_webhook(&self, hook: &NewWebhook) -> Result<Webhook, StoreError>;
    async fn webhook(&self, tenant: &str, id: &str) -> Result<Option<Webhook>, StoreError>;
    /// Newest first, those with ids below `before`.
    async fn webhooks(&self, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Webhook>, StoreError>;
    /// With its deliveries; whether there was one.
    async fn remove_webhook(&self, tenant: &str, id: &str) -> Result<bool, StoreError>;
    /// Newest first, those with serials below `before`.
    async fn deliveries(&self, webhook_id: &str, before: Option<i64>, limit: i64) -> Result<Vec<Delivery>, StoreError>;
    /// Takes deliveries that are due, but none of these webhooks: until `hold` has passed nobody else takes them.
    async fn take_deliveries(
        &self,
        limit: i64,
        hold: Duration,
        except: &[String],
    ) -> Result<Vec<DueDelivery>, StoreError>;
    /// Fenced by the attempt; `false` where it was taken by another meanwhile.
    async fn settle_delivery(&self, id: &str, attempt: i64, outcome: &Delivered) -> Result<bool, StoreError>;
    /// Forgets deliveries that ended longer ago than this; how many, of so many at most.
    async fn forget_deliveries(&self, age: Duration, limit: i64) -> Result<u64, StoreError>;
}

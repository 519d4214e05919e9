//! Webhooks and deliveries, as clients see them, and what a new webhook must be.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::http::shared::members::{Member, Members, reads};
use crate::http::shared::page::timestamp;
use crate::http::shared::problem::Problem;
use crate::jobs::Fault;
use crate::store::{Delivery, DeliveryStatus, Webhook};
use crate::worker::webhooks::{Allowed, SECRET_PREFIX};

/// Of what one can be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
pub enum Event {
    #[serde(rename = "job.successful")]
    JobSuccessful,
    #[serde(rename = "job.failed")]
    JobFailed,
    #[serde(rename = "job.dismissed")]
    JobDismissed,
    #[serde(rename = "place.published")]
    PlacePublished,
}

impl Event {
    fn name(self) -> &'static str {
        match self {
            Self::JobSuccessful => "job.successful",
            Self::JobFailed => "job.failed",
            Self::JobDismissed => "job.dismissed",
            Self::PlacePublished => "place.published",
        }
    }
}

/// Whom to tell of what.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = NewWebhook)]
pub struct NewWebhookBody {
    /// http or https; deliveries are POSTs to it.
    #[schema(format = "uri", max_length = 2048)]
    pub url: String,
    #[schema(min_items = 1, max_items = 16)]
    pub events: Vec<Event>,
    /// `whsec_` and 24 to 64 bytes in base64, as Standard Webhooks has them; one is made where it is missing.
    pub secret: Option<String>,
}

impl Members for NewWebhookBody {
    const MEMBERS: &'static [Member] = &[
        ("url", true, reads::<String>),
        ("events", true, reads::<Vec<Event>>),
        ("secret", false, reads::<Option<String>>),
    ];
}

/// A webhook.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Webhook)]
pub struct WebhookBody {
    #[schema(format = "uuid")]
    pub id: String,
    pub url: String,
    pub events: Vec<String>,
    #[schema(format = "date-time", required)]
    pub created: Option<String>,
    /// In the answer to its creation alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub secret: Option<String>,
}

/// An event told, or to be told.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Delivery)]
pub struct DeliveryBody {
    /// The `webhook-id` of its requests: the same for every attempt.
    pub id: String,
    pub webhook_id: String,
    pub event: String,
    /// `pending`, `delivered` or `failed`
    pub status: &'static str,
    pub attempts: i64,
    #[schema(format = "date-time", required)]
    pub created: Option<String>,
    #[schema(format = "date-time", required)]
    pub last_attempt: Option<String>,
    /// Null once it is delivered or has failed for good.
    #[schema(format = "date-time", required)]
    pub next_attempt: Option<String>,
    /// Why the last attempt failed.
    #[schema(required)]
    pub error: Option<String>,
}

impl From<Webhook> for WebhookBody {
    fn from(hook: Webhook) -> Self {
        let created = timestamp(hook.created);
        Self { id: hook.id, url: hook.url, events: hook.events, created, secret: None }
    }
}

impl From<Delivery> for DeliveryBody {
    fn from(delivery: Delivery) -> Self {
        let waits = delivery.status == DeliveryStatus::Pending;
        Self {
            id: delivery.id,
            webhook_id: delivery.webhook_id,
            event: delivery.event,
            status: delivery.status.name(),
            attempts: delivery.attempts,
            created: timestamp(delivery.created),
            last_attempt: delivery.last_attempt.and_then(timestamp),
            next_attempt: delivery.next_attempt.filter(|_| waits).and_then(timestamp),
            error: delivery.error,
        }
    }
}

impl NewWebhookBody {
    /// The events' names and the secret, or every fault.
    pub fn checked(&self, allowed: &Allowed) -> Result<(Vec<String>, String), Problem> {
        let mut faults = Vec::new();
        let mut fault = |pointer: &str, detail: String| faults.push(Fault { pointer: pointer.into(), detail });
        if let Err(why) = allowed.target(&self.url) {
            fault("/url", why);
        }
        let mut events = self.events.clone();
        events.sort_unstable();
        events.dedup();
        if events.is_empty() {
            fault("/events", "name at least one".into());
        }
        let secret = self.secret.clone().map_or_else(new_secret, Ok)?;
        let bytes = secret.strip_prefix(SECRET_PREFIX).and_then(|text| STANDARD.decode(text).ok());
        if !bytes.is_some_and(|bytes| (24..=64).contains(&bytes.len())) {
            fault("/secret", format!("must be {SECRET_PREFIX} and 24 to 64 bytes in base64"));
        }
        match faults.is_empty() {
            true => Ok((events.into_iter().map(|event| event.name().to_owned()).collect(), secret)),
            false => Err(Problem::invalid(faults)),
        }
    }
}

fn new_secret() -> Result<String, Problem> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(|error| Problem::internal(&error))?;
    Ok(format!("{SECRET_PREFIX}{}", STANDARD.encode(bytes)))
}

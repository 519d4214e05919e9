//! Telling others: deliveries that the store has queued, signed and retried as Standard Webhooks 1.0 says
//! (standardwebhooks.com), and never to an address that is not allowed (`target`).
//!
//! At least once: a delivery is taken for a while, sent, and only then marked. A process that dies in between leaves it
//! to the next; the `webhook-id` lets the receiver see it twice and act once.

mod signature;
mod target;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::task::JoinSet;
use ureq::Agent;
use ureq::unversioned::resolver::{DefaultResolver, Resolver};
use ureq::unversioned::transport::DefaultConnector;

pub use signature::{PREFIX as SECRET_PREFIX, signature};
pub use target::Allowed;

use self::target::Guarded;
use super::Workshop;
use crate::store::{Delivered, DueDelivery};

/// How long a receiver may take.
const WITHIN: Duration = Duration::from_secs(15);
/// How long a delivery is held while it is sent: longer than sending can take. So soon it is made again where its sender died.
const HOLD: Duration = Duration::from_secs(30);
/// Deliveries sent at once, and those that are taken together.
const AT_ONCE: usize = 64;
const TAKEN: usize = 8;
/// A webhook with so many under way gets no more for now: a receiver that is slow keeps places from nobody else.
const OF_ONE: usize = 4;
/// How often is looked for what nobody told of.
const LOOK: Duration = Duration::from_millis(500);
/// Seconds between attempts, the schedule that Standard Webhooks suggests.
const PAUSES: [u64; 9] = [5, 300, 1800, 7200, 18_000, 36_000, 50_400, 72_000, 86_400];

/// Sends what is due until the service drains.
pub(super) async fn deliver(workshop: Arc<Workshop>) {
    let agent = agent(Guarded { allowed: workshop.rules.webhooks.clone(), names: DefaultResolver::default() });
    let (mut under_way, mut counts) = (JoinSet::new(), HashMap::<String, usize>::new());
    while !workshop.is_draining() {
        let told = workshop.hooks.notified();
        let busy: Vec<String> =
            counts.iter().filter(|(_, count)| **count >= OF_ONE).map(|(webhook, _)| webhook.clone()).collect();
        let limit = TAKEN.min(AT_ONCE - under_way.len());
        // Where all places are taken, nothing is asked for.
        let due = match limit {
            0 => Ok(Vec::new()),
            limit => workshop.records.take_deliveries(limit as i64, HOLD, &busy).await,
        };
        let due = due.unwrap_or_else(|error| {
            tracing::warn!(%error, "webhooks that are due could not be looked for");
            Vec::new()
        });
        let found = !due.is_empty();
        for delivery in due {
            *counts.entry(delivery.webhook_id.clone()).or_default() += 1;
            // A task of its own: it may hold a connection of the store's that looking for more waits for.
            under_way.spawn(one(workshop.clone(), agent.clone(), delivery));
        }
        // What was sent makes room; what was begun is looked after while more is looked for.
        let patience = if found { Duration::ZERO } else { LOOK };
        tokio::select! {
            Some(ended) = under_way.join_next() => {
                // One that panicked does not say whose it was.
                match ended {
                    Ok(webhook) => {
                        counts.entry(webhook).and_modify(|count| *count = count.saturating_sub(1));
                    }
                    Err(_) => counts.clear(),
                }
                counts.retain(|_, count| *count > 0);
            }
            _ = tokio::time::timeout(patience, told) => {}
            () = workshop.drained() => {}
        }
    }
    // Those that are on their way may still arrive.
    under_way.detach_all();
}

/// Who calls: nobody but whom its resolver names.
fn agent(names: impl Resolver) -> Agent {
    let config = Agent::config_builder()
        .timeout_global(Some(WITHIN))
        .max_redirects(0)
        .http_status_as_error(false)
        .proxy(None)
        .user_agent(concat!("mapfit/", env!("CARGO_PKG_VERSION")))
        .build();
    Agent::with_parts(config, DefaultConnector::default(), names)
}

/// Makes a delivery; says of which webhook it was.
async fn one(workshop: Arc<Workshop>, agent: Agent, delivery: DueDelivery) -> String {
    let (id, webhook, attempt) = (delivery.id.clone(), delivery.webhook_id.clone(), delivery.attempt);
    let sent = tokio::task::spawn_blocking(move || send(&agent, &delivery)).await;
    let outcome = match sent.unwrap_or_else(|error| Err(Refusal::ForNow(error.to_string()))) {
        Ok(()) => Delivered::Yes,
        Err(Refusal::ForGood(why)) => Delivered::Never(why),
        Err(Refusal::ForNow(why)) => match PAUSES.get(attempt.clamp(1, 100) as usize - 1) {
            Some(pause) => Delivered::NotYet(Duration::from_secs(*pause), why),
            None => Delivered::Never(why),
        },
    };
    tracing::debug!(delivery = %id, attempt, ?outcome, "a webhook was called");
    workshop.metrics.delivered(match outcome {
        Delivered::Yes => "delivered",
        Delivered::NotYet(..) => "retried",
        Delivered::Never(_) => "failed",
    });
    if let Err(error) = workshop.records.settle_delivery(&id, attempt, &outcome).await {
        tracing::warn!(delivery = %id, %error, "what became of a delivery could not be stored; it is made again");
    }
    webhook
}

/// Why a delivery was not made.
enum Refusal {
    ForNow(String),
    ForGood(String),
}

fn send(agent: &Agent, delivery: &DueDelivery) -> Result<(), Refusal> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let signed = signature(&delivery.secret, &delivery.id, now, &delivery.payload);
    let signed = signed.ok_or_else(|| Refusal::ForGood("the webhook's secret cannot be read".into()))?;
    let request = agent
        .post(&delivery.url)
        .header("content-type", "application/json")
        .header("webhook-id", &delivery.id)
        .header("webhook-timestamp", now.to_string())
        .header("webhook-signature", signed);
    match request.send(delivery.payload.as_bytes()) {
        Ok(answer) if answer.status().is_success() => Ok(()),
        // The receiver says that it will never want this.
        Ok(answer) if answer.status().as_u16() == 410 => Err(Refusal::ForGood("the receiver answered 410".into())),
        Ok(answer) => Err(Refusal::ForNow(format!("the receiver answered {}", answer.status().as_u16()))),
        Err(error) => Err(Refusal::ForNow(error.to_string())),
    }
}

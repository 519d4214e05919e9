//! By what rules work is done.

use std::time::Duration;

use super::allowance::of_this_machine;
use super::webhooks::Allowed;
use crate::jobs::Retention;

#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// How long a claim holds without a heartbeat.
    pub lease: Duration,
    /// How often what nobody names, and what is kept no longer, is swept.
    pub sweep_every: Duration,
    /// How long one attempt may take.
    pub attempt_within: Duration,
    /// How long a fit that was told to stop is waited for: longer than the longest step takes. Then it is left to itself.
    pub stops_within: Duration,
    /// Bytes that fits may hold together.
    pub memory: u64,
    /// Jobs of one tenant that run at once, at most.
    pub running_a_tenant: i64,
    /// Where webhooks may go beside public addresses.
    pub webhooks: Allowed,
    pub keep_maps: Retention,
    /// How long a delivery that has ended is listed.
    pub keep_deliveries: Duration,
}

impl Default for Rules {
    fn default() -> Self {
        Self {
            lease: Duration::from_secs(10),
            sweep_every: Duration::from_secs(3600),
            attempt_within: Duration::from_secs(3600),
            stops_within: Duration::from_secs(120),
            memory: of_this_machine() / 2,
            running_a_tenant: i64::MAX,
            webhooks: Allowed::default(),
            keep_maps: Retention::default(),
            keep_deliveries: Duration::from_secs(30 * 24 * 3600),
        }
    }
}

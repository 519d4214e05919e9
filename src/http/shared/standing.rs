//! Where a client stands with what it may have so much of: requests a second, or a quota.

use axum::http::{HeaderMap, HeaderName, HeaderValue};

/// Where a client stands with something it may have so much of (draft-ietf-httpapi-ratelimit-headers).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Standing {
    pub policy: &'static str,
    /// How much there may be; in so many seconds, where it comes back by itself.
    pub quota: u64,
    pub window: Option<u32>,
    pub left: u64,
    /// Seconds after which there may be more.
    pub reset: u32,
}

impl Standing {
    /// Tells it, beside what is told of other policies.
    pub fn tell(&self, headers: &mut HeaderMap) {
        let Self { policy, quota, left, reset, .. } = self;
        let window = self.window.map(|seconds| format!(";w={seconds}")).unwrap_or_default();
        let mut add = |name: &'static str, text: String| {
            if let Ok(value) = HeaderValue::from_str(&text) {
                headers.append(HeaderName::from_static(name), value);
            }
        };
        add("ratelimit-policy", format!("\"{policy}\";q={quota}{window}"));
        add("ratelimit", format!("\"{policy}\";r={left};t={reset}"));
    }
}

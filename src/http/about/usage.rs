//! What a tenant has, and what it may have.

use axum::Json;
use axum::extract::State;
use axum::http::Uri;
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};

/// What a tenant has, and what it may have.
#[derive(Debug, Serialize, ToSchema)]
pub struct Usage {
    tenant: String,
    queued_jobs: Amount,
    running_jobs: Amount,
    /// Of maps.
    stored_bytes: Amount,
    maps: Amount,
    /// A key.
    requests_a_second: Amount,
}

/// How much there is, where that is counted, and how much there may be; null is without limit.
#[derive(Debug, Serialize, ToSchema)]
pub struct Amount {
    #[schema(required)]
    used: Option<i64>,
    #[schema(required)]
    limit: Option<i64>,
}

impl Amount {
    fn of(used: i64, limit: i64) -> Self {
        Self { used: Some(used), limit: Some(limit).filter(|limit| *limit < i64::MAX) }
    }
}

/// What the caller's tenant has, and what it may have.
#[utoipa::path(get, operation_id = "get_usage", path = "/v1/usage", tag = "service", security(("key" = ["read"])),
    responses((status = 200, description = "what there is, and its limits", body = Usage), Refused))]
pub async fn get_usage(State(state): State<AppState>, caller: Caller, uri: Uri) -> Result<Json<Usage>, Problem> {
    Params::of(&uri).finish()?;
    let held = state.workshop.records.holdings(&caller.tenant).await?;
    let (quota, rules) = (state.limits.quota, &state.workshop.rules);
    Ok(Json(Usage {
        tenant: caller.tenant.to_string(),
        queued_jobs: Amount::of(held.queued, quota.queued),
        running_jobs: Amount::of(held.running, rules.running_a_tenant),
        stored_bytes: Amount::of(held.bytes, quota.bytes),
        maps: Amount::of(held.maps, i64::MAX),
        requests_a_second: Amount { used: None, limit: state.limits.requests_a_second.map(i64::from) },
    }))
}

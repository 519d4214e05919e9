//! A change of name and labels (RFC 7396: what is null is taken away, what is missing stays; labels are replaced whole).

use std::collections::BTreeMap;

use axum::body::Body;
use axum::http::HeaderMap;
use serde::Deserialize;
use utoipa::ToSchema;

use super::AppState;
use super::negotiate::JSON;
use super::problem::Problem;
use crate::jobs::{JobRequest, RequestError};
use crate::store::Relabelling;

/// What to change.
#[derive(Deserialize, ToSchema)]
#[schema(as = Relabelling)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct RelabelBody {
    /// Null takes it away.
    #[schema(max_length = 256)]
    name: Option<String>,
    /// In place of those there are.
    labels: Option<BTreeMap<String, String>>,
}

/// Reads a change from a body.
pub async fn relabelling(state: &AppState, headers: &HeaderMap, body: Body) -> Result<Relabelling, Problem> {
    let json = state.read_few(headers, body, &[JSON.media, "application/merge-patch+json"]).await?;
    let (name, labels) = JobRequest::parse_labels(&json).map_err(|error| match error {
        RequestError::Document(error) => error.into(),
        RequestError::Faults(faults) => Problem::invalid(faults),
        damaged @ RequestError::Damaged(_) => Problem::internal(&damaged),
    })?;
    Ok(Relabelling { name, labels })
}

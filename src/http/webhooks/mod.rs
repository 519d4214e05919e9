//! Webhooks: whom to tell of what. What is told, and how, is the [worker](crate::worker)'s business.

mod record;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};

use self::record::{DeliveryBody, NewWebhookBody, WebhookBody};
use crate::http::shared::page::Page;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::standing::Standing;
use crate::http::shared::{AppState, Caller};
use crate::store::{Delivery, NewWebhook, Webhook};

/// Webhooks a tenant may have.
const MOST_WEBHOOKS: i64 = 100;
/// Seconds after which somebody may have removed one.
const AGAIN: u32 = 60;

/// Be told of what happens. The secret is in this answer and nowhere else.
#[utoipa::path(post, operation_id = "add_webhook", path = "/v1/webhooks", tag = "webhooks", security(("key" = ["admin"])),
    request_body(content = NewWebhookBody),
    responses((status = 201, description = "the webhook, with its secret", body = WebhookBody,
            headers(("location" = String, description = "the webhook's address"))), Refused))]
pub async fn add_webhook(
    State(state): State<AppState>,
    caller: Caller,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    let wanted: NewWebhookBody = state.read_small(&headers, body).await?;
    let (events, secret) = wanted.checked(&state.workshop.rules.webhooks)?;
    let records = &state.workshop.records;
    if records.webhooks(&caller.tenant, None, MOST_WEBHOOKS).await?.len() as i64 >= MOST_WEBHOOKS {
        let detail = format!("the tenant has {MOST_WEBHOOKS} webhooks already");
        let quota = MOST_WEBHOOKS.unsigned_abs();
        let standing = Standing { policy: "webhooks", quota, window: None, left: 0, reset: AGAIN };
        let problem = Problem::new(StatusCode::TOO_MANY_REQUESTS, "over-quota", "Over quota", detail);
        return Err(Problem { retry_after: Some(AGAIN), standing: Some(Box::new(standing)), ..problem });
    }
    let tenant = caller.tenant.to_string();
    let hook = NewWebhook { tenant, url: wanted.url, events, secret: secret.clone() };
    let made = records.add_webhook(&hook).await?;
    let location = format!("/v1/webhooks/{}", made.id);
    let body = Json(WebhookBody { secret: Some(secret), ..WebhookBody::from(made) });
    let mut response = (StatusCode::CREATED, body).into_response();
    if let Ok(location) = HeaderValue::from_str(&location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// List webhooks, newest first.
#[utoipa::path(get, operation_id = "list_webhooks", path = "/v1/webhooks", tag = "webhooks", security(("key" = ["read"])),
    params(("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query)),
    responses((status = 200, description = "a page of webhooks", body = Page<WebhookBody>), Refused))]
pub async fn list_webhooks(State(state): State<AppState>, caller: Caller, uri: Uri) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.page();
    params.finish()?;
    let hooks = state.workshop.records.webhooks(&caller.tenant, before.as_deref(), limit + 1).await?;
    state.page(Page::<WebhookBody>::of(hooks, limit, |hook: &Webhook| &hook.id)).await
}

/// A webhook.
#[utoipa::path(get, operation_id = "get_webhook", path = "/v1/webhooks/{id}", tag = "webhooks", security(("key" = ["read"])),
    params(("id" = String, Path)),
    responses((status = 200, description = "the webhook", body = WebhookBody), Refused))]
pub async fn get_webhook(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Json<WebhookBody>, Problem> {
    Params::of(&uri).finish()?;
    Ok(Json(named(&state, &caller, &id).await?.into()))
}

/// Be told no more. What was not yet told never is.
#[utoipa::path(delete, operation_id = "remove_webhook", path = "/v1/webhooks/{id}", tag = "webhooks",
    security(("key" = ["admin"])), params(("id" = String, Path)),
    responses((status = 204, description = "removed, with its deliveries"), Refused))]
pub async fn remove_webhook(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<StatusCode, Problem> {
    Params::of(&uri).finish()?;
    match state.workshop.records.remove_webhook(&caller.tenant, &id).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(Problem::not_found(format!("there is no webhook {id}"))),
    }
}

/// What a webhook was told, or is to be told, newest first.
#[utoipa::path(get, operation_id = "list_deliveries", path = "/v1/webhooks/{id}/deliveries", tag = "webhooks",
    security(("key" = ["read"])),
    params(("id" = String, Path), ("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query)),
    responses((status = 200, description = "a page of deliveries", body = Page<DeliveryBody>), Refused))]
pub async fn list_deliveries(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.numbered_page();
    params.finish()?;
    named(&state, &caller, &id).await?;
    let deliveries = state.workshop.records.deliveries(&id, before, limit + 1).await?;
    state.page(Page::<DeliveryBody>::numbered(deliveries, limit, |delivery: &Delivery| delivery.serial)).await
}

async fn named(state: &AppState, caller: &Caller, id: &str) -> Result<Webhook, Problem> {
    let hook = state.workshop.records.webhook(&caller.tenant, id).await?;
    hook.ok_or_else(|| Problem::not_found(format!("there is no webhook {id}")))
}

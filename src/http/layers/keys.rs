//! Who is let in to which route, by key, scope and rate; decided before a body is read.
//!
//! What a route needs is in [`crate::http::shared::rules`].

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::access;
use crate::http::shared::AppState;
use crate::http::shared::caller::{Caller, Scope};
use crate::http::shared::problem::Problem;
use crate::http::shared::rules::Rule;
use crate::http::shared::standing::Standing;

/// Lets in whoever has the key that the route needs.
pub async fn let_in(State(state): State<AppState>, path: MatchedPath, request: Request, next: Next) -> Response {
    let rule = state.rules.of_route(request.method(), path.as_str());
    let (parts, body) = request.into_parts();
    let admitted = admit(&state, &parts.headers, rule).await;
    // Whoever is refused sees it, also while they still send.
    let ((caller, standing), body) = match state.before(admitted, body) {
        Ok(admitted) => admitted,
        Err(problem) => return problem.into_response(),
    };
    let mut request = Request::from_parts(parts, body);
    request.extensions_mut().insert(caller);
    let mut response = next.run(request).await;
    if let Some(standing) = standing {
        standing.tell(response.headers_mut());
    }
    response
}

/// The caller, and where its key stands where requests are counted.
async fn admit(state: &AppState, headers: &HeaderMap, rule: Rule) -> Result<(Caller, Option<Standing>), Problem> {
    if rule == Rule::Open {
        return Ok((Caller::anybody(), None));
    }
    let (caller, counted_as) = match state.has_keys().await? {
        false => (Caller::anybody(), String::new()),
        true => authenticate(state, headers).await?,
    };
    let standing = state.rates.count(&counted_as)?;
    match rule {
        Rule::Open => {}
        Rule::Scope(scope) => caller.needs(scope)?,
        Rule::Closed => caller.needs_no_key()?,
    }
    Ok((caller, standing))
}

async fn authenticate(state: &AppState, headers: &HeaderMap) -> Result<(Caller, String), Problem> {
    let refuse = |detail: &str| Problem::new(StatusCode::UNAUTHORIZED, "unauthorized", "A key is needed", detail);
    let given = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let Some(given) = given else { return Err(refuse("send Authorization: Bearer KEY")) };
    let key =
        given.split_once(' ').filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer")).map(|(_, key)| key.trim());
    let known = match key.and_then(access::id_of) {
        Some(id) => state.workshop.records.key(id).await?,
        None => None,
    };
    match (key, known) {
        (Some(key), Some(known)) if access::opens(key, &known) => {
            let scopes = known.scopes.iter().filter_map(|name| Scope::from_name(name)).collect();
            Ok((Caller::with_key(&known.tenant, scopes), known.id))
        }
        _ => Err(refuse("the key is not known here, or was revoked")),
    }
}

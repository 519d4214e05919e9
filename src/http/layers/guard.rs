//! Who may ask at all, and what a browser may do with an answer.
//!
//! Without API keys (with them, see [`super::keys`]) the service trusts whoever is on the machine, and so a page that a browser on it was lured to must not
//! be: a name that an attacker lets point to 127.0.0.1 (DNS rebinding) shows in `Host`, and a foreign page in `Origin`.
//! Both must name a loopback address. Pages carry a content security policy without wildcards, their scripts by hash.

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

use crate::http::shared::AppState;
use crate::http::shared::problem::Problem;

/// Refuses what does not come from this machine, by the names it uses.
pub async fn loopback_only(State(state): State<AppState>, request: Request, next: Next) -> Response {
    let mut named = request.headers().get_all(header::HOST).iter();
    let host = named.next().map(|host| host.to_str().unwrap_or_default().to_owned());
    if named.next().is_some() {
        // RFC 9112, 3.2.
        let detail = "a request has one Host".into();
        return Problem { detail, ..Problem::of_status(StatusCode::BAD_REQUEST) }.into_response();
    }
    // An absolute target wins over Host (RFC 9112, 3.2.2).
    let target = request.uri().authority().map(|authority| authority.as_str().to_owned());
    let host = target.or(host);
    let local = host.as_deref().is_some_and(is_loopback);
    let origin = request.headers().get(header::ORIGIN).map(|origin| origin.to_str().unwrap_or_default());
    let foreign = origin.is_some_and(|origin| !origin.split_once("://").is_some_and(|(_, host)| is_loopback(host)));
    // Only who is not of this machine makes the store be asked: health is told while the database is away.
    let refusal = match (local, foreign) {
        (true, false) => return next.run(request).await,
        (false, _) => "Host does not name a loopback address of this machine",
        (true, true) => "the page that asks (Origin) is not of this machine",
    };
    match state.has_keys().await {
        Ok(false) => refused(refusal),
        // A key is what a lured page does not have. Where that cannot be told, nobody comes in below `/v1` either.
        Ok(true) | Err(_) => next.run(request).await,
    }
}

fn refused(detail: &str) -> Response {
    Problem::new(StatusCode::FORBIDDEN, "forbidden", "Forbidden", detail).into_response()
}

fn is_loopback(authority: &str) -> bool {
    let Ok(authority) = authority.parse::<Authority>() else { return false };
    let host = authority.host().trim_start_matches('[').trim_end_matches(']');
    host.eq_ignore_ascii_case("localhost") || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

static NOSNIFF: (HeaderName, HeaderValue) = (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));

/// Gives every answer `nosniff`, and pages that bring no policy of their own the one for pages without inline scripts.
pub async fn secured(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    response.headers_mut().insert(NOSNIFF.0.clone(), NOSNIFF.1.clone());
    let content = response.headers().get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    let is_page = content.is_some_and(|content| content.starts_with("text/html"));
    if is_page && !response.headers().contains_key(header::CONTENT_SECURITY_POLICY) {
        response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy(""));
    }
    response
}

/// The policy of a page: its own scripts, from this service or inline, and pictures that it was given as data.
pub fn policy(page: &str) -> HeaderValue {
    let hashes: String = inline_scripts(page)
        .map(|script| format!(" 'sha256-{}'", STANDARD.encode(Sha256::digest(script.as_bytes()))))
        .collect();
    let policy = format!(
        "default-src 'self'; script-src 'self'{hashes}; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; \
         object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    );
    HeaderValue::from_str(&policy).unwrap_or(HeaderValue::from_static("default-src 'self'; frame-ancestors 'none'"))
}

fn inline_scripts(page: &str) -> impl Iterator<Item = &str> {
    page.split("<script").skip(1).filter_map(|rest| {
        let (attributes, rest) = rest.split_once('>')?;
        let (script, _) = rest.split_once("</script>")?;
        (!attributes.contains("src=")).then_some(script)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_names_are_let_in() {
        for host in ["localhost", "LOCALHOST:8080", "127.0.0.1:80", "127.8.3.1", "[::1]:9", "[::1]"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["evil.example", "127.0.0.1.evil.example", "10.0.0.1", "", "localhost.evil:80", "null", "[::2]"] {
            assert!(!is_loopback(host), "{host}");
        }
    }

    #[test]
    fn a_policy_names_inline_scripts_by_their_hash() {
        let page = "<script src=\"a.js\"></script><script type=module>let x = 1</script>";
        assert_eq!(inline_scripts(page).collect::<Vec<_>>(), ["let x = 1"]);
        let policy = policy(page);
        assert!(policy.to_str().unwrap().contains("'sha256-") && !policy.to_str().unwrap().contains('*'));
    }
}

//! The console: jobs, maps and places in a browser. Its built files are in the binary (`console/dist`; a test builds them
//! anew and compares), so building the service needs no Node.

use std::borrow::Cow;

use axum::extract::Path;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{EmbeddedFile, RustEmbed};

use crate::http::layers::guard::policy;
use crate::http::shared::problem::Problem;

#[derive(RustEmbed)]
#[folder = "console/dist"]
struct Built;

/// Names are hashes of what is in them.
const FOR_EVER: HeaderValue = HeaderValue::from_static("public, max-age=31536000, immutable");
const ASK_AGAIN: HeaderValue = HeaderValue::from_static("no-cache");

/// The page; all of its views are behind `#`.
pub async fn page() -> Result<Response, Problem> {
    let mut response = served("index.html", ASK_AGAIN)?;
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy(""));
    Ok(response)
}

/// Its scripts, styles and pictures.
pub async fn asset(Path(name): Path<String>) -> Result<Response, Problem> {
    served(&format!("assets/{name}"), FOR_EVER)
}

/// The licences of what is built in.
pub async fn licenses() -> Result<Response, Problem> {
    served("licenses.md", ASK_AGAIN)
}

fn served(name: &str, keep: HeaderValue) -> Result<Response, Problem> {
    let Some(EmbeddedFile { data, .. }) = Built::get(name) else {
        return Err(Problem::not_found("there is no such file"));
    };
    let content = match name.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("md") => "text/markdown; charset=utf-8",
        _ => "application/octet-stream",
    };
    let body = match data {
        Cow::Borrowed(bytes) => axum::body::Body::from(bytes),
        Cow::Owned(bytes) => axum::body::Body::from(bytes),
    };
    let content = (header::CONTENT_TYPE, HeaderValue::from_static(content));
    Ok(([content, (header::CACHE_CONTROL, keep)], body).into_response())
}

//! Fitted maps never change: every representation has a strong ETag (RFC 9110, 8.8.3).

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

use super::negotiate::Format;

/// The ETag of one representation of a map: of its address, format and the version that renders it, and of what may
/// change of it.
pub struct Tag(String);

impl Tag {
    pub fn of(uri: &Uri, format: Format, version: &str) -> Self {
        let mut digest = Sha256::new();
        for part in [env!("CARGO_PKG_VERSION"), uri.path(), uri.query().unwrap_or_default(), format.media, version] {
            digest.update(part.as_bytes());
            digest.update([0]);
        }
        Self(format!("\"{}\"", hex::encode(&digest.finalize()[..16])))
    }

    /// 304 where the client has this representation.
    pub fn not_modified(&self, headers: &HeaderMap) -> Option<Response> {
        let asked = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
        let mut known = asked.flat_map(|list| list.split(',')).map(|tag| tag.trim().trim_start_matches("W/"));
        known.any(|tag| tag == self.0 || tag == "*").then(|| {
            let mut response = StatusCode::NOT_MODIFIED.into_response();
            self.mark(&mut response);
            response
        })
    }

    /// The answer with its tag.
    pub fn respond(&self, format: Format, body: impl Into<Body>) -> Response {
        let mut response = Response::new(body.into());
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(format.media));
        self.mark(&mut response);
        response
    }

    fn mark(&self, response: &mut Response) {
        if let Ok(tag) = HeaderValue::from_str(&self.0) {
            response.headers_mut().insert(header::ETAG, tag);
        }
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
        response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    }
}

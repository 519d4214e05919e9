//! Which answers are compressed, where `Accept-Encoding` allows: JSON and text, not what is packed already, and not events,
//! which would wait for a full block.

use axum::http::header;
use http_body::Body;
use tower_http::compression::Predicate;

/// Shorter answers are not worth it.
const SHORTEST: u64 = 512;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Texts;

impl Predicate for Texts {
    fn should_compress<B: Body>(&self, response: &axum::http::Response<B>) -> bool {
        let media = response.headers().get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
        let media = media.unwrap_or_default().split(';').next().unwrap_or_default();
        let text = media.ends_with("json") || media.ends_with("xml") || media.starts_with("text/");
        text && media != "text/event-stream" && response.body().size_hint().lower() >= SHORTEST
    }
}

//! Request bodies: JSON, decompressed already, read whole up to the limit.

use axum::body::Body;
use axum::http::{HeaderMap, StatusCode, header};
use bytes::Bytes;
use http_body_util::{BodyExt, LengthLimitError, Limited};

use super::problem::Problem;

/// The body's bytes. The limit applies after decompression, so a bomb is cut off where it outgrows it.
pub async fn read_json(headers: &HeaderMap, body: Body, limit: usize) -> Result<Bytes, Problem> {
    let media = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let media = media.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    if media != "application/json" && !(media.starts_with("application/") && media.ends_with("+json")) {
        return Err(Problem::of_status(StatusCode::UNSUPPORTED_MEDIA_TYPE));
    }
    match Limited::new(body, limit).collect().await {
        Ok(collected) => Ok(collected.to_bytes()),
        Err(error) if is_too_large(&*error) => {
            let detail = format!("the body is larger than {limit} bytes after decompression");
            Err(Problem { detail, ..Problem::of_status(StatusCode::PAYLOAD_TOO_LARGE) })
        }
        Err(error) => {
            let detail = format!("the body cannot be read: {error}");
            Err(Problem { detail, ..Problem::of_status(StatusCode::BAD_REQUEST) })
        }
    }
}

fn is_too_large(error: &(dyn std::error::Error + 'static)) -> bool {
    let mut link = Some(error);
    while let Some(error) = link {
        if error.is::<LengthLimitError>() {
            return true;
        }
        link = error.source();
    }
    false
}

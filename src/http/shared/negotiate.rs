//! Which format to answer in: `?format=` where it is given, else `Accept` (RFC 9110, with q-values), else the first.

use axum::http::{HeaderMap, header};
use utoipa::ToSchema;

use super::params::Params;
use super::problem::Problem;

/// A format on offer: its name for `?format=`, and its media type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    pub name: &'static str,
    pub media: &'static str,
}

pub const JSON: Format = Format { name: "json", media: "application/json" };
pub const GEOJSON: Format = Format { name: "geojson", media: "application/geo+json" };
pub const NPZ: Format = Format { name: "npz", media: "application/x-npz" };
/// Arrays in a request.
pub const NPY: &str = "application/x-npy";
pub const MCAP: Format = Format { name: "mcap", media: "application/x-mcap" };
/// A file and what is asked of it, in a request.
pub const MULTIPART: &str = "multipart/form-data";
pub const PNG: Format = Format { name: "png", media: "image/png" };
pub const SVG: Format = Format { name: "svg", media: "image/svg+xml" };
pub const TIFF: Format = Format { name: "tiff", media: "image/tiff" };
pub const ZIP: Format = Format { name: "zip", media: "application/zip" };

/// A file's bytes, for the document.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[allow(dead_code)]
pub struct Binary(Vec<u8>);

/// The format to answer in, of those on offer, the default first.
pub fn negotiate(headers: &HeaderMap, params: &mut Params, offered: &[Format]) -> Result<Format, Problem> {
    if let Some(name) = params.text("format") {
        if let Some(format) = offered.iter().find(|format| format.name == name) {
            return Ok(*format);
        }
        let names: Vec<&str> = offered.iter().map(|format| format.name).collect();
        params.fault("format", format!("must be one of {}", names.join(", ")));
        return Ok(offered[0]);
    }
    let accepted: Vec<&str> = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    if accepted.is_empty() {
        return Ok(offered[0]);
    }
    let accepted = accepted.join(",");
    // The best quality wins; among equals, what is offered first.
    let best = offered
        .iter()
        .map(|format| (quality(&accepted, format.media), *format))
        .rev()
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(quality, _)| *quality > 0.0);
    let media: Vec<&str> = offered.iter().map(|format| format.media).collect();
    best.map(|(_, format)| format).ok_or_else(|| Problem::not_acceptable(&media))
}

/// The quality the most specific matching range gives a media type.
fn quality(accept: &str, media: &str) -> f64 {
    let mut best = (0, 0.0);
    for range in accept.split(',') {
        let mut parts = range.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default().to_ascii_lowercase();
        let q = parts.find_map(|p| p.strip_prefix("q=")).and_then(|q| q.parse::<f64>().ok()).unwrap_or(1.0);
        let specificity = if name == media {
            3
        } else if name.strip_suffix("/*").is_some_and(|kind| media.starts_with(&format!("{kind}/"))) {
            2
        } else if name == "*/*" || name == "*" {
            1
        } else {
            continue;
        };
        if specificity > best.0 {
            best = (specificity, q);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(accept: &str) -> Option<&'static str> {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        let mut params = Params::of(&"/".parse().unwrap());
        negotiate(&headers, &mut params, &[GEOJSON, SVG, PNG]).ok().map(|format| format.name)
    }

    #[test]
    fn the_best_quality_wins_and_the_default_among_equals() {
        assert_eq!(chosen("*/*"), Some("geojson"));
        assert_eq!(chosen("image/*"), Some("svg"));
        assert_eq!(chosen("image/svg+xml;q=0.2, image/png"), Some("png"));
        assert_eq!(chosen("text/html, */*;q=0.1"), Some("geojson"));
        assert_eq!(chosen("*/*;q=0.5, application/geo+json;q=0"), Some("svg"));
        assert_eq!(chosen("text/html"), None);
    }
}

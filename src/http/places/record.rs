//! A place, as clients see it, and what guards it.

use std::collections::BTreeMap;

use axum::Json;
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::http::shared::members::{Member, Members, reads};
use crate::http::shared::page::timestamp;
use crate::http::shared::problem::Problem;
use crate::store::{Guard, Place};

/// A place, or a version of it.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Place)]
pub struct PlaceBody {
    pub name: String,
    /// 1 for the first map published there.
    pub version: i64,
    #[schema(format = "uuid")]
    pub map_id: String,
    #[schema(required)]
    pub note: Option<String>,
    #[schema(format = "date-time", required)]
    pub published: Option<String>,
    /// Of the map's file as it is stored, in hexadecimal; null where a version from before these were kept fitted it.
    #[schema(required)]
    pub sha256: Option<String>,
    /// Addresses by relation.
    pub links: BTreeMap<&'static str, String>,
}

/// What to publish.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = NewVersion)]
pub struct PublishBody {
    #[schema(min_length = 1)]
    pub map_id: String,
    #[schema(max_length = 1024)]
    pub note: Option<String>,
}

impl Members for PublishBody {
    const MEMBERS: &'static [Member] = &[("map_id", true, reads::<String>), ("note", false, reads::<Option<String>>)];
}

/// Which version to publish again.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Rollback {
    #[schema(minimum = 1)]
    pub version: i64,
}

impl Members for Rollback {
    const MEMBERS: &'static [Member] = &[("version", true, reads::<i64>)];
}

impl From<Place> for PlaceBody {
    fn from(place: Place) -> Self {
        let itself = format!("/v1/places/{}", place.name);
        let links = BTreeMap::from([
            ("versions", format!("{itself}/versions")),
            ("map", format!("/v1/maps/{}", place.map_id)),
            ("self", itself),
        ]);
        Self {
            name: place.name,
            version: place.version,
            map_id: place.map_id,
            note: place.note,
            published: timestamp(place.published),
            sha256: place.sha256,
            links,
        }
    }
}

/// The strong ETag of a place: of its last publication, of which there never is another.
pub fn tag(place: &Place) -> String {
    format!("\"p{}\"", place.serial)
}

/// A place with its tag.
pub fn tagged(place: Place) -> Response {
    let tag = HeaderValue::from_str(&tag(&place));
    let mut response = Json(PlaceBody::from(place)).into_response();
    if let Ok(tag) = tag {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
    response
}

/// The tags of a conditional header.
pub fn tags(headers: &HeaderMap, name: HeaderName) -> Vec<String> {
    let lists = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    lists.flat_map(|list| list.split(',')).map(|tag| tag.trim().to_owned()).collect()
}

/// What a request's conditions (RFC 9110, 13.1) ask of the place.
pub fn guard(headers: &HeaderMap) -> Guard {
    if tags(headers, header::IF_NONE_MATCH).iter().any(|tag| tag == "*") {
        return Guard::New;
    }
    let wanted = tags(headers, header::IF_MATCH);
    match &wanted[..] {
        [] => Guard::Nothing,
        any if any.iter().any(|tag| tag == "*") => Guard::Existing,
        // A weak tag never matches here, and one that is not ours no place.
        some => Guard::Serials(
            some.iter().filter_map(|tag| tag.strip_prefix("\"p")?.strip_suffix('"')?.parse().ok()).collect(),
        ),
    }
}

/// 412: another was faster, or there is one already.
pub fn precondition_failed(name: &str) -> Problem {
    let detail = format!("the place {name} is not as If-Match or If-None-Match say; read it again");
    Problem::new(axum::http::StatusCode::PRECONDITION_FAILED, "precondition-failed", "The place has changed", detail)
}

/// Whether this is a place's name.
pub fn is_name(name: &str) -> bool {
    let first = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit();
    let later = |c: u8| first(c) || matches!(c, b'.' | b'_' | b'-');
    let bytes = name.as_bytes();
    (1..=63).contains(&bytes.len()) && first(bytes[0]) && bytes[1..].iter().all(|c| later(*c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_become_guards() {
        let with = |name: HeaderName, value: &'static str| {
            guard(&HeaderMap::from_iter([(name, HeaderValue::from_static(value))]))
        };
        assert_eq!(guard(&HeaderMap::new()), Guard::Nothing);
        assert_eq!(with(header::IF_NONE_MATCH, "*"), Guard::New);
        assert_eq!(with(header::IF_MATCH, "*"), Guard::Existing);
        assert_eq!(with(header::IF_MATCH, "\"p7\", W/\"p8\", \"x\""), Guard::Serials(vec![7]));
    }

    #[test]
    fn names_are_those_of_the_contract() {
        let longest = "a".repeat(63);
        for name in ["a", "0", "hall-2.north_b", &longest] {
            assert!(is_name(name), "{name}");
        }
        let longer = "a".repeat(64);
        for name in ["", "A", "-a", ".", "a b", "ä", "a/b", &longer] {
            assert!(!is_name(name), "{name}");
        }
    }
}

//! Errors as RFC 9457 problems.
//!
//! A handler returns a [`Problem`]; it travels in the response's extensions to [`crate::http::layers::conventions::finish`], which
//! knows the request's id and path and writes the body.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::{IntoResponses, ToSchema};

use super::standing::Standing;
use crate::jobs::{DocumentError, Fault, RequestError};
use crate::map::ArchiveError;
use crate::map::npz::NpzError;
use crate::render::RenderError;
use crate::store::{ArtifactsError, StoreError};
use crate::uncertainty::UncertaintyError;

/// A problem; see the module.
#[derive(Debug, Clone)]
pub struct Problem {
    pub status: StatusCode,
    /// The last part of `type`; clients may match on it.
    pub slug: &'static str,
    pub title: &'static str,
    pub detail: String,
    pub errors: Vec<FaultBody>,
    /// Seconds after which to try again, of a 429 or 503.
    pub retry_after: Option<u32>,
    /// Of a 429: what there was too much of.
    pub standing: Option<Box<Standing>>,
}

/// An RFC 9457 problem.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Problem)]
pub struct ProblemBody {
    /// A stable URI that ends in a slug.
    r#type: String,
    title: &'static str,
    status: u16,
    detail: String,
    instance: String,
    request_id: String,
    /// Of a 422: every fault.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schema(required = false)]
    errors: Vec<FaultBody>,
}

/// One fault: of the body, by a JSON Pointer (RFC 6901), or of a query parameter, by its name.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = Fault)]
pub struct FaultBody {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pointer: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameter: Option<String>,
    pub detail: String,
}

/// How any route refuses.
#[derive(IntoResponses)]
#[allow(dead_code)]
pub enum Refused {
    /// What is wrong with the request
    #[response(status = "4XX", content_type = "application/problem+json")]
    ByClient(ProblemBody),
    /// The service cannot answer now, or failed
    #[response(status = "5XX", content_type = "application/problem+json")]
    ByService(ProblemBody),
}

impl Problem {
    pub fn new(status: StatusCode, slug: &'static str, title: &'static str, detail: impl Into<String>) -> Self {
        Self { status, slug, title, detail: detail.into(), errors: Vec::new(), retry_after: None, standing: None }
    }

    /// The problem of a status that needs no more words.
    pub fn of_status(status: StatusCode) -> Self {
        let (slug, title, detail) = match status {
            StatusCode::BAD_REQUEST => ("bad-request", "Bad request", "the request cannot be read"),
            StatusCode::NOT_FOUND => ("not-found", "Not found", "no such resource"),
            StatusCode::METHOD_NOT_ALLOWED => {
                ("method-not-allowed", "Method not allowed", "this resource has other methods; see Allow")
            }
            StatusCode::NOT_ACCEPTABLE => ("not-acceptable", "Not acceptable", "no format you accept is on offer"),
            StatusCode::PAYLOAD_TOO_LARGE => ("too-large", "Too large", "the body is larger than the limit"),
            StatusCode::UNSUPPORTED_MEDIA_TYPE => (
                "unsupported-media-type",
                "Unsupported media type",
                "send application/json, as it is or with Content-Encoding gzip or zstd",
            ),
            StatusCode::SERVICE_UNAVAILABLE => ("unavailable", "Unavailable", "try again later"),
            status if status.is_server_error() => ("internal-error", "Internal error", "the service failed"),
            _ => ("bad-request", "Bad request", "the request cannot be answered"),
        };
        Self::new(status, slug, title, detail)
    }

    pub fn not_found(detail: impl Into<String>) -> Self {
        Self { detail: detail.into(), ..Self::of_status(StatusCode::NOT_FOUND) }
    }

    pub fn not_acceptable(offered: &[&str]) -> Self {
        let detail = format!("on offer: {}", offered.join(", "));
        Self { detail, ..Self::of_status(StatusCode::NOT_ACCEPTABLE) }
    }

    /// 503: what was asked for did not come in time.
    pub fn too_slow() -> Self {
        let detail =
            "the answer took longer than a request may (--request-seconds); the service is busy, or it asks for much";
        Self { detail: detail.into(), ..Self::of_status(StatusCode::SERVICE_UNAVAILABLE) }
    }

    /// 422 with a fault a pointer.
    pub fn invalid(faults: Vec<Fault>) -> Self {
        let detail = match &faults[..] {
            [one] => format!("{}: {}", if one.pointer.is_empty() { "the document" } else { &one.pointer }, one.detail),
            many => format!("{} faults; see errors", many.len()),
        };
        let fault = |f: Fault| FaultBody { pointer: Some(f.pointer), parameter: None, detail: f.detail };
        let errors = faults.into_iter().map(fault).collect();
        Self { errors, ..Self::unprocessable(detail) }
    }

    /// 422 with a fault a query parameter.
    pub fn invalid_parameters(faults: Vec<(String, String)>) -> Self {
        let detail = faults.iter().map(|(name, detail)| format!("{name} {detail}")).collect::<Vec<_>>().join("; ");
        let fault = |(name, detail)| FaultBody { pointer: None, parameter: Some(name), detail };
        let errors = faults.into_iter().map(fault).collect();
        Self { errors, ..Self::unprocessable(detail) }
    }

    pub fn unprocessable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid-request", "The request is invalid", detail)
    }

    pub fn internal(error: &dyn std::error::Error) -> Self {
        tracing::error!(%error, "an answer could not be made");
        Self::of_status(StatusCode::INTERNAL_SERVER_ERROR)
    }

    /// The body, for a request's path and id.
    pub fn body(&self, instance: &str, request_id: &str) -> ProblemBody {
        ProblemBody {
            r#type: format!("/problems/{}", self.slug),
            title: self.title,
            status: self.status.as_u16(),
            detail: self.detail.clone(),
            instance: instance.to_owned(),
            request_id: request_id.to_owned(),
            errors: self.errors.clone(),
        }
    }
}

/// RFC 6750: how to come in.
const CHALLENGE: HeaderValue = HeaderValue::from_static("Bearer realm=\"mapfit\"");

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = self.status.into_response();
        let may_pass = matches!(self.status, StatusCode::SERVICE_UNAVAILABLE | StatusCode::TOO_MANY_REQUESTS);
        if let Some(seconds) = self.retry_after.or(may_pass.then_some(5)) {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if self.status == StatusCode::UNAUTHORIZED {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, CHALLENGE);
        }
        if let Some(standing) = &self.standing {
            standing.tell(response.headers_mut());
        }
        response.extensions_mut().insert(self);
        response
    }
}

impl From<RequestError> for Problem {
    fn from(error: RequestError) -> Self {
        match error {
            RequestError::Document(error) => error.into(),
            RequestError::Faults(faults) => Self::invalid(faults),
            damaged @ RequestError::Damaged(_) => Self::internal(&damaged),
        }
    }
}

impl From<DocumentError> for Problem {
    fn from(error: DocumentError) -> Self {
        let status = match error {
            DocumentError::Syntax(_) => StatusCode::BAD_REQUEST,
            DocumentError::TooLarge { .. } => StatusCode::PAYLOAD_TOO_LARGE,
        };
        let plain = Self::of_status(status);
        let slug = if status == StatusCode::BAD_REQUEST { "malformed-json" } else { plain.slug };
        Self { detail: error.to_string(), slug, ..plain }
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Database(_) => {
                tracing::error!(%error, "the database failed");
                let detail = "the database cannot be reached or written; nothing was changed";
                Self { detail: detail.into(), ..Self::of_status(StatusCode::SERVICE_UNAVAILABLE) }
            }
            other => Self::internal(&other),
        }
    }
}

impl From<ArtifactsError> for Problem {
    fn from(error: ArtifactsError) -> Self {
        match &error {
            ArtifactsError::Store(object_store::Error::NotFound { .. }) => {
                tracing::error!(%error, "an artifact is missing");
                let detail = "the map's arrays are missing from the artifact store; its record is still there";
                Self::new(StatusCode::INTERNAL_SERVER_ERROR, "artifact-missing", "The map's arrays are missing", detail)
            }
            ArtifactsError::Damaged(_) => {
                tracing::error!(%error, "an artifact is damaged");
                let detail =
                    "the map's arrays in the artifact store are not what was written there; none of them is served";
                Self::new(StatusCode::INTERNAL_SERVER_ERROR, "artifact-damaged", "The map's arrays are damaged", detail)
            }
            ArtifactsError::Store(_) | ArtifactsError::Folder(_) => {
                tracing::error!(%error, "the artifact store failed");
                let detail = "the artifact store cannot be reached or read";
                Self { detail: detail.into(), ..Self::of_status(StatusCode::SERVICE_UNAVAILABLE) }
            }
            _ => Self::internal(&error),
        }
    }
}

impl From<ArchiveError> for Problem {
    fn from(error: ArchiveError) -> Self {
        Self::internal(&error)
    }
}

impl From<RenderError> for Problem {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Unwanted => Self::too_slow(),
            error => Self::internal(&error),
        }
    }
}

impl From<UncertaintyError> for Problem {
    fn from(error: UncertaintyError) -> Self {
        Self::internal(&error)
    }
}

impl From<tokio::task::JoinError> for Problem {
    fn from(error: tokio::task::JoinError) -> Self {
        Self::internal(&error)
    }
}

impl From<NpzError> for Problem {
    fn from(error: NpzError) -> Self {
        Self::internal(&error)
    }
}

/// An answer's JSON.
pub fn to_json(value: &impl Serialize) -> Result<Vec<u8>, Problem> {
    serde_json::to_vec(value).map_err(|error| Problem::internal(&error))
}

//! Distance, gradient and uncertainty at a client's points.

mod answer;
mod columns;
pub mod question;

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, Uri};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;

use self::answer::QueryAnswer;
use self::question::{Question, marks, parse, points_of_npy};
use super::request::KINDS;
use crate::http::shared::compute::Leash;
use crate::http::shared::negotiate::{Binary, JSON, NPY, NPZ, negotiate};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};
use crate::uncertainty::Kind;

/// [x, y], metres.
#[derive(Debug, Deserialize, ToSchema)]
#[schema(min_items = 2, max_items = 2)]
#[allow(dead_code)]
pub struct Point(Vec<f64>);

/// An array of the answer.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
#[allow(dead_code)]
pub enum FieldName {
    Distance,
    Gradient,
    Sigma,
    Nearest,
    Clearance,
    Observed,
    GradientCovariance,
    DistanceGradientCovariance,
    Vector,
    VectorCovariance,
}

/// What is asked.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub struct QueryBody {
    /// [x, y] each, metres.
    #[schema(max_items = 250000)]
    pub points: Vec<Point>,
    /// `propagated` (default) or `posterior`
    pub kind: Option<Kind>,
    /// The arrays to answer with; all by default.
    pub fields: Option<Vec<FieldName>>,
}

const FIELDS: [&str; 10] = [
    "distance",
    "gradient",
    "sigma",
    "nearest",
    "clearance",
    "observed",
    "gradient_covariance",
    "distance_gradient_covariance",
    "vector",
    "vector_covariance",
];
/// Which distance has the fields from this one on, by place in [`FIELDS`].
const SIGNED_ALONE: std::ops::Range<usize> = 6..8;
const VECTOR_ALONE: std::ops::Range<usize> = 8..10;

/// Ask a map about points.
#[utoipa::path(post, operation_id = "query_map", path = "/v1/maps/{id}/query", tag = "maps", security(("key" = ["read"])), params(("id" = String, Path),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "npy bodies: propagated (default) or posterior"),
        ("fields" = Option<String>, Query, pattern = "^(distance|gradient|sigma|nearest|clearance|observed|gradient_covariance|distance_gradient_covariance|vector|vector_covariance)(,(distance|gradient|sigma|nearest|clearance|observed|gradient_covariance|distance_gradient_covariance|vector|vector_covariance))*$", description = "npy bodies: comma-separated; all by default"),
        ("format" = Option<String>, Query, pattern = "^(json|npz)$", description = "json or npz")),
    request_body(content((QueryBody = "application/json"), (Binary = "application/x-npy"))),
    responses((status = 200, description = "arrays in the points' order; npz has NaN for null",
            content((QueryAnswer = "application/json"), (Binary = "application/x-npz"))),
        Refused))]
pub async fn query_map(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let (record, body) = state.before(state.map_record(&caller, &id).await, body)?;
    let received = state.read_body(&headers, body, &[JSON.media, NPY]).await?;
    let mut params = Params::of(&uri);
    let format = negotiate(&headers, &mut params, &[JSON, NPZ])?;
    let kind = params.choice("kind", &KINDS);
    let fields = params.text("fields").map(|text| marks(&text.split(',').collect::<Vec<_>>()));
    if let Some(Err(unknown)) = &fields {
        params.fault("fields", format!("{unknown} is not one of {}", FIELDS.join(", ")));
    }
    params.finish()?;
    let fields = fields.and_then(Result::ok).unwrap_or([true; FIELDS.len()]);
    let (turn, map) = state.turn_with(received.queue_of_answer(), &record).await?;
    let rations = state.answers.clone();
    let form = move |leash: &Leash| {
        let question = match received.media {
            NPY => Question { points: points_of_npy(&received.unpack()?)?, kind, fields },
            _ => parse(&received.unpack()?)?,
        };
        let share = rations.take(QueryAnswer::bytes(&question))?;
        let answer = QueryAnswer::of(&map, &question, &|| leash.holds())?;
        if format == NPZ {
            return Ok(share.body(answer.npz()?));
        }
        let text = answer.json(question.points.len());
        Ok(share.stream(text.map(|piece| piece.map_err(Into::into))))
    };
    let body = turn.run(form).await?;
    Ok(([("content-type", format.media)], body).into_response())
}

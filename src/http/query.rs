//! Distance, gradient and uncertainty at a client's points.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::AppState;
use super::maps::to_json;
use super::problem::Problem;
use crate::geometry::Vec2;
use crate::jobs::Fault;
use crate::jobs::document::Node;
use crate::map::{Field, FittedMap};
use crate::uncertainty::Kind;

/// Points in one query at most.
const MOST_POINTS: usize = 250_000;
const MOST_FAULTS: usize = 100;

/// Arrays in the order of the points; a point outside the lattice has nulls, and one where no control points are in use
/// has nothing but `observed`.
#[derive(Debug, Default, Serialize, ToSchema)]
pub struct QueryAnswer {
    pub kind: &'static str,
    /// Metres; of an sdf negative in free space.
    pub distance: Vec<Option<f64>>,
    pub gradient: Vec<Option<[f64; 2]>>,
    /// The standard deviation of the distance, metres.
    pub sigma: Vec<Option<f64>>,
    /// Whether there is evidence here: a beam passed, or a surface was met within half a cell.
    pub observed: Vec<Option<bool>>,
    /// [xx, xy, yy]
    pub gradient_covariance: Vec<Option<[f64; 3]>>,
    /// The distance's covariance with the gradient, [dx, dy].
    pub distance_gradient_covariance: Vec<Option<[f64; 2]>>,
    /// vdf alone: from the nearest surface point, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector: Option<Vec<Option<[f64; 2]>>>,
    /// vdf alone: [xx, xy, yy]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector_covariance: Option<Vec<Option<[f64; 3]>>>,
}

/// What is asked.
#[derive(Debug, ToSchema)]
#[allow(dead_code)]
pub struct QueryBody {
    /// [x, y] each, metres.
    pub points: Vec<[f64; 2]>,
    /// `propagated` (default) or `posterior`
    pub kind: Option<String>,
}

/// Ask a map about points.
#[utoipa::path(post, path = "/v1/maps/{id}/query", tag = "maps", params(("id" = String, Path)),
    request_body = QueryBody,
    responses((status = 200, body = QueryAnswer),
        (status = "4XX", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn query(
    State(state): State<AppState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let bytes = state.read_json(&headers, body).await;
    let record = state.map_record(&id).await?;
    let bytes = bytes?;
    let map = state.load(&record).await?;
    let answer = state
        .compute(move || {
            let (points, kind) = parse(&bytes)?;
            to_json(&answer(&map, &points, kind))
        })
        .await?;
    Ok(([("content-type", "application/json")], answer).into_response())
}

fn answer(map: &FittedMap, points: &[Vec2], kind: Kind) -> QueryAnswer {
    let mut answer =
        QueryAnswer { kind: if kind == Kind::Propagated { "propagated" } else { "posterior" }, ..Default::default() };
    if matches!(map.field, Field::Vector { .. }) {
        (answer.vector, answer.vector_covariance) = (Some(Vec::new()), Some(Vec::new()));
    }
    for &p in points {
        let at = map.query(p, kind);
        answer.distance.push(at.map(|a| a.distance));
        answer.gradient.push(at.map(|a| [a.gradient.x, a.gradient.y]));
        answer.sigma.push(at.map(|a| a.sigma));
        answer.observed.push(map.observed(p));
        let packed = |c: crate::geometry::Cov2| [c[(0, 0)], c[(0, 1)], c[(1, 1)]];
        answer.gradient_covariance.push(at.map(|a| packed(a.gradient_covariance)));
        let with = at.map(|a| a.distance_gradient_covariance);
        answer.distance_gradient_covariance.push(with.map(|c| [c.x, c.y]));
        if let (Some(vectors), Some(covariances)) = (&mut answer.vector, &mut answer.vector_covariance) {
            let vector = at.and_then(|a| a.vector);
            vectors.push(vector.map(|(v, _)| [v.x, v.y]));
            covariances.push(vector.map(|(_, c)| c));
        }
    }
    answer
}

fn parse(json: &[u8]) -> Result<(Vec<Vec2>, Kind), Problem> {
    let document = Node::parse(json, 4 * MOST_POINTS).map_err(Problem::from)?;
    let mut faults = Vec::new();
    let mut fault = |pointer: String, detail: String| {
        if faults.len() < MOST_FAULTS {
            faults.push(Fault { pointer, detail });
        }
    };
    let kind = match document.member("kind") {
        None | Some(Node::Null) => Kind::Propagated,
        Some(Node::Text(name)) if name == "propagated" => Kind::Propagated,
        Some(Node::Text(name)) if name == "posterior" => Kind::Posterior,
        Some(_) => {
            fault("/kind".into(), "must be one of propagated, posterior".into());
            Kind::Propagated
        }
    };
    let mut points = Vec::new();
    match (&document, document.member("points")) {
        (Node::Object(_), Some(Node::Numbers(none))) if none.is_empty() => {}
        (Node::Object(_), Some(Node::Array(rows))) if rows.len() > MOST_POINTS => {
            fault("/points".into(), format!("{} points; the limit is {MOST_POINTS}", rows.len()));
        }
        (Node::Object(_), Some(Node::Array(rows))) => {
            for (k, row) in rows.iter().enumerate() {
                match row {
                    Node::Numbers(p) if p.len() == 2 && p.iter().all(|v| v.is_finite()) => {
                        points.push(Vec2::new(p[0], p[1]));
                    }
                    _ => fault(format!("/points/{k}"), "a point is [x, y]".into()),
                }
            }
        }
        (Node::Object(_), None) => fault("/points".into(), "is required".into()),
        (Node::Object(_), Some(_)) => fault("/points".into(), "must be an array of [x, y]".into()),
        (other, _) => fault(String::new(), format!("a query is an object, not {}", other.kind())),
    }
    if faults.is_empty() { Ok((points, kind)) } else { Err(Problem::invalid(faults)) }
}

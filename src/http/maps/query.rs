//! Distance, gradient and uncertainty at a client's points.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, Uri};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::request::KINDS;
use crate::fit::Distance;
use crate::geometry::{Cov2, Vec2};
use crate::http::shared::AppState;
use crate::http::shared::compute::Queue;
use crate::http::shared::negotiate::{Binary, JSON, NPY, NPZ, negotiate};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::http::shared::ration;
use crate::jobs::Fault;
use crate::jobs::document::Node;
use crate::map::npz::{NpzError, NpzWriter};
use crate::map::{Answer, FittedMap};
use crate::uncertainty::Kind;

/// Points in one query at most.
const MOST_POINTS: usize = 250_000;
/// What parsing a point may cost: its array, and its two numbers.
const COST_OF_A_POINT: usize = 12;
const MOST_FAULTS: usize = 100;

/// Arrays in the order of the points, those of `fields`; a point outside the lattice has nulls, and one where no control
/// points are in use has nothing but `observed` and `clearance`.
#[derive(Debug, Default, Serialize, ToSchema)]
pub struct QueryAnswer {
    pub kind: &'static str,
    /// To the nearest surface, metres; of an sdf negative in free space.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<Vec<Option<f64>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gradient: Option<Vec<Option<[f64; 2]>>>,
    /// The standard deviation of the distance, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Vec<Option<f64>>>,
    /// The surface point that the distance is measured from; null where the map has no surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nearest: Option<Vec<Option<[f64; 2]>>>,
    /// The unsigned distance to the nearest surface or to space that nobody observed, whichever is nearer, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clearance: Option<Vec<Option<f64>>>,
    /// Whether there is evidence here: a beam passed, or a surface was met within half a cell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observed: Option<Vec<Option<bool>>>,
    /// sdf alone: [xx, xy, yy]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gradient_covariance: Option<Vec<Option<[f64; 3]>>>,
    /// sdf alone: the distance's covariance with the gradient, [dx, dy].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_gradient_covariance: Option<Vec<Option<[f64; 2]>>>,
    /// vdf alone: the spline's value, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector: Option<Vec<Option<[f64; 2]>>>,
    /// vdf alone: [xx, xy, yy]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector_covariance: Option<Vec<Option<[f64; 3]>>>,
}

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

/// A question about points.
struct Question {
    points: Vec<Vec2>,
    kind: Kind,
    /// A mark for each of [`FIELDS`].
    fields: [bool; FIELDS.len()],
}

/// Ask a map about points.
#[utoipa::path(post, operation_id = "query_map", path = "/v1/maps/{id}/query", tag = "maps", params(("id" = String, Path),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "npy bodies: propagated (default) or posterior"),
        ("fields" = Option<String>, Query, pattern = "^(distance|gradient|sigma|nearest|clearance|observed|gradient_covariance|distance_gradient_covariance|vector|vector_covariance)(,(distance|gradient|sigma|nearest|clearance|observed|gradient_covariance|distance_gradient_covariance|vector|vector_covariance))*$", description = "npy bodies: comma-separated; all by default"),
        ("format" = Option<String>, Query, pattern = "^(json|npz)$", description = "json or npz")),
    request_body(content((QueryBody = "application/json"), (Binary = "application/x-npy"))),
    responses((status = 200, description = "arrays in the points' order; npz has NaN for null",
            content((QueryAnswer = "application/json"), (Binary = "application/x-npz"))),
        Refused))]
pub async fn query_map(
    State(state): State<AppState>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let record = match state.map_record(&id).await {
        Ok(record) => record,
        Err(problem) => {
            state.discard(body);
            return Err(problem);
        }
    };
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
    let map = state.load(&record).await?;
    let answer = state
        .compute
        .run(Queue::Answers, move |_| {
            let question = match received.media {
                NPY => Question { points: points_of_npy(&received.unpack()?)?, kind, fields },
                _ => parse(&received.unpack()?)?,
            };
            let answer = answer(&map, &question);
            if format == NPZ { Ok(answer_npz(&answer)?) } else { to_json(&answer) }
        })
        .await?;
    let body = ration::answer(&state.answers, answer)?;
    Ok(([("content-type", format.media)], body).into_response())
}

fn answer(map: &FittedMap, question: &Question) -> QueryAnswer {
    let Question { points, kind, fields } = question;
    let vector = map.field.distance() == Distance::Vector;
    let wanted = |name: &str| {
        let at = FIELDS.iter().position(|field| *field == name).unwrap_or(usize::MAX);
        let other = if vector { SIGNED_ALONE } else { VECTOR_ALONE };
        fields.get(at).copied().unwrap_or(false) && !other.contains(&at)
    };
    let surface = ["distance", "gradient", "sigma", "gradient_covariance", "distance_gradient_covariance"];
    let asked = surface.iter().chain(&["vector", "vector_covariance"]).any(|name| wanted(name));
    let answers: Vec<Option<Answer>> = match asked {
        true => points.iter().map(|p| map.query(*p, *kind)).collect(),
        false => Vec::new(),
    };
    fn each<T>(wanted: bool, answers: &[Option<Answer>], of: impl Fn(&Answer) -> Option<T>) -> Option<Vec<Option<T>>> {
        wanted.then(|| answers.iter().map(|at| at.as_ref().and_then(&of)).collect())
    }
    fn at<T>(wanted: bool, points: &[Vec2], of: impl Fn(Vec2) -> Option<T>) -> Option<Vec<Option<T>>> {
        wanted.then(|| points.iter().map(|p| of(*p)).collect())
    }
    let packed = |c: Cov2| [c[(0, 0)], c[(0, 1)], c[(1, 1)]];
    QueryAnswer {
        kind: if *kind == Kind::Propagated { "propagated" } else { "posterior" },
        distance: each(wanted("distance"), &answers, |a| Some(a.distance)),
        gradient: each(wanted("gradient"), &answers, |a| Some(a.gradient.into())),
        sigma: each(wanted("sigma"), &answers, |a| Some(a.sigma)),
        nearest: match asked && vector {
            true => each(wanted("nearest"), &answers, |a| a.nearest.map(Into::into)),
            false => at(wanted("nearest"), points, |p| map.nearest(p).map(Into::into)),
        },
        clearance: at(wanted("clearance"), points, |p| map.clearance(p)),
        observed: at(wanted("observed"), points, |p| map.observed(p)),
        gradient_covariance: each(wanted("gradient_covariance"), &answers, |a| a.slopes.map(|s| packed(s.gradient))),
        distance_gradient_covariance: each(wanted("distance_gradient_covariance"), &answers, |a| {
            a.slopes.map(|s| s.with_distance.into())
        }),
        vector: each(wanted("vector"), &answers, |a| a.vector.map(|(v, _)| v.into())),
        vector_covariance: each(wanted("vector_covariance"), &answers, |a| a.vector.map(|(_, c)| c)),
    }
}

/// The answer as arrays of the same names; what is null is NaN, and false for `observed`.
fn answer_npz(answer: &QueryAnswer) -> Result<Vec<u8>, NpzError> {
    fn rows<const K: usize>(
        npz: &mut NpzWriter,
        name: &str,
        rows: &Option<Vec<Option<[f64; K]>>>,
    ) -> Result<(), NpzError> {
        if let Some(rows) = rows {
            let flat: Vec<f64> = rows.iter().flat_map(|row| row.unwrap_or([f64::NAN; K])).collect();
            npz.array(name, &[rows.len(), K], &flat)?;
        }
        Ok(())
    }
    let mut npz = NpzWriter::default();
    for (name, values) in [("distance", &answer.distance), ("sigma", &answer.sigma), ("clearance", &answer.clearance)] {
        if let Some(values) = values {
            let values: Vec<f64> = values.iter().map(|v| v.unwrap_or(f64::NAN)).collect();
            npz.array(name, &[values.len()], &values)?;
        }
    }
    rows(&mut npz, "gradient", &answer.gradient)?;
    rows(&mut npz, "nearest", &answer.nearest)?;
    rows(&mut npz, "gradient_covariance", &answer.gradient_covariance)?;
    rows(&mut npz, "distance_gradient_covariance", &answer.distance_gradient_covariance)?;
    rows(&mut npz, "vector", &answer.vector)?;
    rows(&mut npz, "vector_covariance", &answer.vector_covariance)?;
    if let Some(observed) = &answer.observed {
        let observed: Vec<bool> = observed.iter().map(|seen| seen.unwrap_or(false)).collect();
        npz.array("observed", &[observed.len()], &observed)?;
    }
    npz.finish()
}

/// Marks for the named fields, or the name that is none.
fn marks(names: &[&str]) -> Result<[bool; FIELDS.len()], String> {
    let mut marks = [false; FIELDS.len()];
    for name in names {
        let at = FIELDS.iter().position(|field| field == name).ok_or_else(|| (*name).to_owned())?;
        marks[at] = true;
    }
    Ok(marks)
}

/// Points from a float64 array of shape (n, 2).
fn points_of_npy(bytes: &[u8]) -> Result<Vec<Vec2>, Problem> {
    let bad = |detail: String| Problem::invalid(vec![Fault { pointer: String::new(), detail }]);
    let file = npyz::NpyFile::new(bytes).map_err(|error| bad(format!("is not an npy file: {error}")))?;
    let [count, 2] = file.shape()[..] else { return Err(bad("must have the shape (n, 2)".into())) };
    if count > MOST_POINTS as u64 {
        return Err(bad(format!("{count} points; the limit is {MOST_POINTS}")));
    }
    let by_columns = file.order() == npyz::Order::Fortran;
    let flat: Vec<f64> = file.into_vec().map_err(|error| bad(format!("must be float64: {error}")))?;
    if let Some(at) = flat.iter().position(|v| !v.is_finite()) {
        return Err(bad(format!("number {at} is not finite")));
    }
    let n = count as usize;
    let point = |k: usize| match by_columns {
        true => Vec2::new(flat[k], flat[n + k]),
        false => Vec2::new(flat[2 * k], flat[2 * k + 1]),
    };
    Ok((0..n).map(point).collect())
}

fn parse(json: &[u8]) -> Result<Question, Problem> {
    let document = Node::parse(json, COST_OF_A_POINT * (MOST_POINTS + 1)).map_err(Problem::from)?;
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
    let fields = match document.member("fields") {
        None | Some(Node::Null) => Ok([true; FIELDS.len()]),
        Some(Node::Numbers(none)) if none.is_empty() => marks(&[]),
        Some(Node::Array(names)) => {
            let text = |node: &Node| if let Node::Text(name) = node { name.clone() } else { node.kind().to_owned() };
            let names: Vec<String> = names.iter().map(text).collect();
            marks(&names.iter().map(String::as_str).collect::<Vec<_>>())
        }
        Some(other) => Err(other.kind().to_owned()),
    };
    if let Err(unknown) = &fields {
        fault("/fields".into(), format!("{unknown} is not one of {}", FIELDS.join(", ")));
    }
    if let Node::Object(members) = &document {
        for (name, _) in members.iter().filter(|(name, _)| !["points", "kind", "fields"].contains(&name.as_str())) {
            fault(format!("/{}", name.replace('~', "~0").replace('/', "~1")), "is not known here".into());
        }
    }
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
    match (faults.is_empty(), fields) {
        (true, Ok(fields)) => Ok(Question { points, kind, fields }),
        _ => Err(Problem::invalid(faults)),
    }
}

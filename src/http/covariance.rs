//! The covariance of the coefficients, in five forms.
//!
//! `diagonal` and `sparse` are stored with the map. `block` and `full` are solved for on demand, from the stored
//! factors; `factors` hands those out. See [`crate::uncertainty`] for the two kinds.

use axum::response::Response;
use serde_json::json;

use super::TENANT;
use super::caching::{Queue, Waiting};
use super::maps::{lattice_json, to_json};
use super::negotiate::{Format, JSON, NPZ};
use super::params::Params;
use super::problem::Problem;
use super::representation::{MapRequest, Settled};
use crate::jobs::JobRequest;
use crate::map::FittedMap;
use crate::map::npz::NpzWriter;
use crate::map::{factors_npz, on_lattice_npz, scipy_sparse};
use crate::spline::Lattice;
use crate::uncertainty::{Factors, Kind};

/// Control points in a `block` at most.
const LARGEST_BLOCK: usize = 1024;
/// Coefficients of a map whose `full` covariance is given: 128 MB.
const LARGEST_FULL: usize = 4_000;

pub(crate) const KINDS: [(&str, Kind); 2] = [("propagated", Kind::Propagated), ("posterior", Kind::Posterior)];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Diagonal,
    Block,
    Sparse,
    Full,
    Factors,
}

/// A window of control points: first column and row, and how many.
#[derive(Debug, Clone, Copy)]
struct Window {
    i0: usize,
    j0: usize,
    ni: usize,
    nj: usize,
}

/// The covariance of a map's coefficients.
#[utoipa::path(get, operation_id = "get_map_covariance", path = "/v1/maps/{id}/covariance", tag = "maps",
    params(("id" = String, Path),
        ("kind" = Option<String>, Query, description = "propagated (default) or posterior"),
        ("form" = Option<String>, Query, description = "diagonal (default), block, sparse, full or factors"),
        ("i0" = Option<u32>, Query, description = "block: first control point along x"),
        ("j0" = Option<u32>, Query, description = "block: first control point along y"),
        ("ni" = Option<u32>, Query, description = "block: control points along x"),
        ("nj" = Option<u32>, Query, description = "block: control points along y"),
        ("format" = Option<String>, Query, description = "json or npz")),
    responses((status = 200, description = "`sdf` (diagonal), `matrix` (block, full), a scipy.sparse archive (sparse), \
            or Hessian and inputs in CSC parts (factors)",
            content((super::openapi::DiagonalBody = "application/json"), (Vec<u8> = "application/x-npz"))),
        (status = 304, description = "unchanged"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn covariance(mut request: MapRequest) -> Result<Response, Problem> {
    let (lattice, params) = (&request.record.lattice, &mut request.params);
    let kind = params.choice("kind", &KINDS);
    let forms = [
        ("diagonal", Form::Diagonal),
        ("block", Form::Block),
        ("sparse", Form::Sparse),
        ("full", Form::Full),
        ("factors", Form::Factors),
    ];
    let form = params.choice("form", &forms);
    let window = (form == Form::Block).then(|| window(params, lattice)).flatten();
    let components = request.record.distance.components();
    let coefficients = components * lattice.len();
    if form == Form::Full && coefficients > LARGEST_FULL {
        params.fault("form", format!("full is for {LARGEST_FULL} coefficients at most; this map has {coefficients}"));
    }
    let offered: &[Format] = if matches!(form, Form::Diagonal | Form::Block) { &[JSON, NPZ] } else { &[NPZ] };
    let wanted = match request.settle(offered)? {
        Settled::Unchanged(response) => return Ok(response),
        Settled::Wanted(wanted) => wanted,
    };
    let format = wanted.format;
    let one: Vec<usize> = match (form, window) {
        (Form::Diagonal, _) => return wanted.from_map(move |map, _, format| diagonal(map, kind, format)).await,
        (Form::Sparse, _) => return wanted.from_map(move |map, _, _| Ok(scipy_sparse(&map.field, kind)?)).await,
        (Form::Block, Some(window)) => points_of(&wanted.record.lattice, &window),
        (Form::Full, _) => (0..wanted.record.lattice.len()).collect(),
        _ => Vec::new(),
    };
    let n = wanted.record.lattice.len();
    let points: Vec<usize> = (0..components).flat_map(|k| one.iter().map(move |point| k * n + point)).collect();
    let packed = wanted.state.workshop.records.request(TENANT, &wanted.record.job_id).await?;
    let packed =
        packed.ok_or_else(|| Problem::not_found("the map's job is gone, and with it what this is formed from"))?;
    let map = wanted.state.load(&wanted.record).await?;
    let limits = wanted.state.workshop.limits;
    let waiting = Waiting::default();
    let go_on = waiting.asker();
    let make = move || {
        let json = zstd::decode_all(&packed[..]).map_err(|error| Problem::internal(&error))?;
        let request = JobRequest::parse(&json, &limits).map_err(|error| Problem::internal(&error))?;
        let factors = request.factors(&map).map_err(|error| Problem::internal(&error))?;
        if form == Form::Factors {
            return Ok(factors_npz(&factors)?);
        }
        dense(&factors, &map, (kind, &go_on), &points, window, format)
    };
    let body = wanted.state.compute(Queue::Answers, make).await?;
    drop(waiting);
    Ok(wanted.respond(body))
}

fn window(params: &mut Params, lattice: &Lattice) -> Option<Window> {
    let [nx, ny] = lattice.control_points();
    let mut corner = |name: &str, low: usize, high: usize| {
        if params.text(name).is_none() {
            params.fault(name, "is required for form=block");
        }
        params.number(name, low, high)
    };
    let (i0, j0) = (corner("i0", 0, nx - 1), corner("j0", 0, ny - 1));
    let (ni, nj) = (corner("ni", 1, nx), corner("nj", 1, ny));
    let window = Window { i0: i0?, j0: j0?, ni: ni?, nj: nj? };
    if window.i0 + window.ni > nx {
        params.fault("ni", format!("the window leaves the lattice, which has {nx} control points along x"));
    }
    if window.j0 + window.nj > ny {
        params.fault("nj", format!("the window leaves the lattice, which has {ny} control points along y"));
    }
    if window.ni * window.nj > LARGEST_BLOCK {
        params.fault("ni", format!("a block has {LARGEST_BLOCK} control points at most"));
    }
    Some(window)
}

fn points_of(lattice: &Lattice, window: &Window) -> Vec<usize> {
    let [nx, _] = lattice.control_points();
    let rows = window.j0..window.j0 + window.nj;
    rows.flat_map(|j| (window.i0..window.i0 + window.ni).map(move |i| i + j * nx)).collect()
}

fn diagonal(map: &FittedMap, kind: Kind, format: Format) -> Result<Vec<u8>, Problem> {
    let variances = map.field.variances(kind);
    if format == NPZ {
        let arrays: Vec<(&str, &[f64])> = variances.iter().map(|(name, values)| (*name, &values[..])).collect();
        return Ok(on_lattice_npz(map.lattice(), &arrays)?);
    }
    let mut body = json!({"kind": kind, "form": "diagonal", "lattice": lattice_json(map.lattice())});
    variances.into_iter().for_each(|(name, values)| body[name] = json!(values));
    to_json(&body)
}

fn dense(
    factors: &Factors,
    map: &FittedMap,
    (kind, go_on): (Kind, &dyn Fn() -> bool),
    points: &[usize],
    window: Option<Window>,
    format: Format,
) -> Result<Vec<u8>, Problem> {
    let n = points.len();
    let mut matrix = factors.block(kind, points, go_on)?;
    let stencil = map.field.stencil();
    let unused = |k: usize| !stencil.is_active(points[k] % stencil.dimension());
    (0..n * n).filter(|k| unused(k / n) || unused(k % n)).for_each(|k| matrix[k] = f64::NAN);
    if format == NPZ {
        let mut npz = NpzWriter::default();
        npz.array("matrix", &[n, n], &matrix)?;
        return Ok(npz.finish()?);
    }
    let rows: Vec<&[f64]> = matrix.chunks(n).collect();
    let window = window.map(|w| json!({"i0": w.i0, "j0": w.j0, "ni": w.ni, "nj": w.nj}));
    to_json(&json!({"kind": kind, "form": "block", "window": window, "matrix": rows}))
}

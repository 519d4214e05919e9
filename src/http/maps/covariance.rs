//! The covariance of the coefficients, in five forms.
//!
//! `diagonal` and `sparse` are stored with the map. `block` and `full` are formed on demand at the fit's end, found
//! again; `factors` hands out what any entry is formed from. See [`crate::uncertainty`] for the two kinds.

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use super::arrays::OnLattice;
use super::record::LatticeBody;
use super::request::{KINDS, MapRequest, Settled};
use super::resumed::{from_factors, turn_with_joint};
use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::negotiate::{Binary, Format, JSON, NPZ};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::map::FittedMap;
use crate::map::npz::NpzWriter;
use crate::map::{factors_npz, on_lattice_npz, scipy_sparse};
use crate::sparse::Team;
use crate::spline::Lattice;
use crate::uncertainty::{Joint, Kind};

/// Control points in a `block` at most.
const LARGEST_BLOCK: usize = 1024;
/// Coefficients of a map whose `full` covariance is given: 128 MB.
const LARGEST_FULL: usize = 4_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Diagonal,
    Block,
    Sparse,
    Full,
    Factors,
}

/// A window of control points: first column and row, and how many.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
struct Window {
    i0: usize,
    j0: usize,
    ni: usize,
    nj: usize,
}

/// Variances of the coefficients, square metres.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Diagonal)]
struct DiagonalBody {
    kind: Kind,
    form: &'static str,
    lattice: LatticeBody,
    #[serde(flatten)]
    values: OnLattice,
}

/// The dense covariance of a window's coefficients, square metres; null where a control point is not in use.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Block)]
struct BlockBody {
    kind: Kind,
    form: &'static str,
    #[schema(required)]
    window: Option<Window>,
    /// Row by row, x fastest within the window; a vector map has the x set before the y set.
    matrix: Vec<Vec<Option<f64>>>,
}

/// Either, by `form`.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[schema(as = Covariance)]
#[allow(dead_code)]
enum CovarianceBody {
    Diagonal(DiagonalBody),
    Block(BlockBody),
}

/// The covariance of a map's coefficients.
#[utoipa::path(get, operation_id = "get_map_covariance", path = "/v1/maps/{id}/covariance", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("form" = Option<String>, Query, pattern = "^(diagonal|block|sparse|full|factors)$", description = "diagonal (default), block, sparse, full or factors"),
        ("i0" = Option<u32>, Query, description = "block: first control point along x"),
        ("j0" = Option<u32>, Query, description = "block: first control point along y"),
        ("ni" = Option<u32>, Query, description = "block: control points along x"),
        ("nj" = Option<u32>, Query, description = "block: control points along y"),
        ("format" = Option<String>, Query, pattern = "^(json|npz)$", description = "json or npz")),
    responses((status = 200, description = "`sdf` (diagonal), `matrix` (block, full), a scipy.sparse archive (sparse), \
            or Hessian and inputs in CSC parts (factors)",
            content((CovarianceBody = "application/json"), (Binary = "application/x-npz"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_covariance(mut request: MapRequest) -> Result<Response, Problem> {
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
        (Form::Diagonal, _) => return wanted.from_map(move |map, _, format, _| diagonal(map, kind, format)).await,
        (Form::Sparse, _) => return wanted.from_map(move |map, _, _, _| Ok(scipy_sparse(&map.field, kind)?)).await,
        (Form::Block, Some(window)) => points_of(&wanted.record.lattice, &window),
        (Form::Full, _) => (0..wanted.record.lattice.len()).collect(),
        _ => Vec::new(),
    };
    let n = wanted.record.lattice.len();
    let points: Vec<usize> = (0..components).flat_map(|k| one.iter().map(move |point| k * n + point)).collect();
    if form == Form::Factors {
        let body =
            from_factors(&wanted.state, &wanted.caller, &wanted.record, |factors| Ok(factors_npz(&factors)?)).await?;
        return wanted.respond(body);
    }
    let (turn, map, joint) = turn_with_joint(&wanted.state, &wanted.caller, &wanted.record, Queue::Heavy).await?;
    let workshop = wanted.state.workshop.clone();
    let make = move |leash: &Leash| {
        let need = joint.block_bytes(&points).map_err(|error| Problem::internal(&error))?;
        let _held = workshop.reserve(need as u64, &|| leash.holds()).ok_or_else(Problem::too_slow)?;
        dense(&joint, &map, (kind, leash), &points, window, format)
    };
    let body = turn.run(make).await?;
    wanted.respond(body)
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
    let values = OnLattice::of(variances.iter().map(|(name, values)| (*name, &values[..])));
    to_json(&DiagonalBody { kind, form: "diagonal", lattice: LatticeBody::of(map.lattice()), values })
}

fn dense(
    joint: &Joint,
    map: &FittedMap,
    (kind, leash): (Kind, &Leash),
    points: &[usize],
    window: Option<Window>,
    format: Format,
) -> Result<Vec<u8>, Problem> {
    let n = points.len();
    let mut matrix = joint.block(kind, points, &Team::of_this_machine(), &|| leash.holds())?;
    let stencil = map.field.stencil();
    let unused = |k: usize| !stencil.is_active(points[k] % stencil.dimension());
    (0..n * n).filter(|k| unused(k / n) || unused(k % n)).for_each(|k| matrix[k] = f64::NAN);
    if format == NPZ {
        let mut npz = NpzWriter::stored();
        npz.array("matrix", &[n, n], &matrix)?;
        return Ok(npz.finish()?);
    }
    let matrix = matrix.chunks(n).map(|row| row.iter().map(|v| Some(*v).filter(|v| v.is_finite())).collect()).collect();
    to_json(&BlockBody { kind, form: "block", window, matrix })
}

//! A map's arrays: coefficients, surfaces and poses.

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use super::record::LatticeBody;
use super::request::MapRequest;
use crate::fit::Poses;
use crate::geometry::{Cov3, Pose};
use crate::http::shared::negotiate::{Binary, JSON, NPZ};
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::jobs::MapRecord;
use crate::map::{FittedMap, on_lattice_npz, surfaces_npz};

/// A number a control point, x fastest; null where one is not in use. A signed map has `sdf`, a vector map the others.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = OnLattice)]
pub struct OnLattice {
    #[serde(skip_serializing_if = "Option::is_none")]
    sdf: Option<Vec<Option<f64>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vdf_x: Option<Vec<Option<f64>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vdf_y: Option<Vec<Option<f64>>>,
}

impl OnLattice {
    /// By the arrays' names.
    pub fn of<'a>(arrays: impl IntoIterator<Item = (&'static str, &'a [f64])>) -> Self {
        let mut on_lattice = Self { sdf: None, vdf_x: None, vdf_y: None };
        for (name, values) in arrays {
            let values = values.iter().map(|v| Some(*v).filter(|v| v.is_finite())).collect();
            match name {
                "sdf" => on_lattice.sdf = Some(values),
                "vdf_x" => on_lattice.vdf_x = Some(values),
                _ => on_lattice.vdf_y = Some(values),
            }
        }
        on_lattice
    }
}

/// A map's coefficients.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Coefficients)]
struct CoefficientsBody {
    lattice: LatticeBody,
    #[serde(flatten)]
    values: OnLattice,
}

/// The poses of a map's scans.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = FittedPoses)]
struct PosesBody {
    treatment: Poses,
    poses: Vec<FittedPose>,
}

/// A pose with its covariances, row-major in (x, y, theta); null where poses were fixed.
#[derive(Debug, Serialize, ToSchema)]
struct FittedPose {
    pose: Pose,
    #[schema(required)]
    covariance: Option<[f64; 9]>,
    #[schema(required)]
    posterior_covariance: Option<[f64; 9]>,
}

/// A map's coefficients, x fastest.
#[utoipa::path(get, operation_id = "get_map_coefficients", path = "/v1/maps/{id}/coefficients", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path), ("format" = Option<String>, Query, pattern = "^(json|npz)$", description = "json or npz")),
    responses((status = 200, description = "`{lattice, sdf}` or `{lattice, vdf_x, vdf_y}`; or npz with those of shape (ny+3, nx+3), \
            `origin`, `resolution`. Null (NaN) where a control point is not in use",
            content((CoefficientsBody = "application/json"), (Binary = "application/x-npz"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_coefficients(request: MapRequest) -> Result<Response, Problem> {
    let make = |map: &FittedMap, _: &MapRecord, format| {
        let (lattice, arrays) = (map.lattice(), map.field.coefficients());
        match format {
            NPZ => Ok(on_lattice_npz(lattice, &arrays)?),
            _ => to_json(&CoefficientsBody { lattice: LatticeBody::of(lattice), values: OnLattice::of(arrays) }),
        }
    };
    request.answer(&[JSON, NPZ], make).await
}

/// What a client needs to measure distances itself, without the service.
#[utoipa::path(get, operation_id = "get_map_surfaces", path = "/v1/maps/{id}/surfaces", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path), ("format" = Option<String>, Query, pattern = "^(npz)$", description = "npz")),
    responses((status = 200, description = "`ends` (n, 2, 2), `sigma` (n, 2: propagated, posterior) and `open` (n, 2) of the surfaces' \
            straight pieces; `observed` (rows, columns), lowest y first; `origin`, `resolution` of the lattice",
            content((Binary = "application/x-npz"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_surfaces(request: MapRequest) -> Result<Response, Problem> {
    request.answer(&[NPZ], |map, _, _| Ok(surfaces_npz(map)?)).await
}

/// The poses as the fit leaves them: refined with their covariances, or as reported.
#[utoipa::path(get, operation_id = "get_map_poses", path = "/v1/maps/{id}/poses", tag = "maps", security(("key" = ["read"])), params(("id" = String, Path)),
    responses((status = 200, description = "the poses", body = PosesBody), (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_poses(request: MapRequest) -> Result<Response, Problem> {
    let make = move |map: &FittedMap, _: &MapRecord, _| {
        let covariances = &map.pose_covariance;
        let fitted = |(scan, pose): (usize, &Pose)| FittedPose {
            pose: *pose,
            covariance: row_major(&covariances.propagated, scan),
            posterior_covariance: row_major(&covariances.posterior, scan),
        };
        let poses = map.poses.iter().enumerate().map(fitted).collect();
        to_json(&PosesBody { treatment: map.report.weights.poses, poses })
    };
    request.answer(&[JSON], make).await
}

fn row_major(all: &[Cov3], scan: usize) -> Option<[f64; 9]> {
    all.get(scan).map(|c| std::array::from_fn(|k| c[(k / 3, k % 3)]))
}

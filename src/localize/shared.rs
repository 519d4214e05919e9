//! The map's share in the poses' covariance: an error that all returns have in common.
//!
//! ```text
//! Lambda^-1 M C M^T Lambda^-1,   M = J^T R^-1 G
//! ```
//!
//! `M C M^T` is formed exactly, by the map's factor (see [`Joint::forms`]), far correlations by the map's poses included.
//! Beside the coefficients' errors a surface strays from its spline; a stray is one return's neighbours', too: those that
//! meet a surface in one cell share it.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::LocalizeError;
use super::descent::{Agreement, Course};
use crate::map::{FittedMap, STRAY};
use crate::sparse::Team;
use crate::uncertainty::{Joint, Kind};

/// The covariances of courses' poses, three unknowns a scan; `None` where they are not determined. What the map's factor is
/// read for, it is read for all of them at once.
pub fn covariances(
    map: &FittedMap,
    joint: &Joint,
    kind: Kind,
    courses: &[&Course],
    go_on: &dyn Fn() -> bool,
) -> Result<Vec<Option<DMatrix<f64>>>, LocalizeError> {
    let columns: Vec<_> = courses.iter().flat_map(|course| coefficients_by_pose(map, &course.fits)).collect();
    let forms = joint.forms(kind, &columns, &Team::alone(), go_on)?;
    let stray = (STRAY * map.lattice().resolution).powi(2);
    let mut first = 0;
    let own = |course: &&Course| {
        let n = course.information.nrows();
        let mut middle = DMatrix::from_fn(n, n, |a, b| forms[(first + a) * columns.len() + first + b]);
        first += n;
        let inverse = course.information.clone().cholesky()?.inverse();
        strays(map, &course.fits).into_values().for_each(|own| middle += &own * own.transpose() * stray);
        let covariance = &inverse + &inverse * middle * &inverse;
        Some(0.5 * (&covariance + covariance.transpose()))
    };
    Ok(courses.iter().map(own).collect())
}

/// `M^T`, by pose unknowns: the coefficients' shares, ascending.
fn coefficients_by_pose(map: &FittedMap, fits: &[Agreement]) -> Vec<Vec<(usize, f64)>> {
    let mut columns = vec![BTreeMap::<usize, f64>::new(); 3 * fits.len()];
    for (scan, fit) in fits.iter().enumerate() {
        for used in &fit.used {
            let Some(by_coefficients) = used.sighting.by_coefficients(map) else { continue };
            for (axis, by_pose) in used.sighting.by_pose.iter().enumerate() {
                let column = &mut columns[3 * scan + axis];
                let share = used.weight * by_pose;
                by_coefficients.iter().for_each(|(k, value)| *column.entry(*k).or_default() += share * value);
            }
        }
    }
    columns.into_iter().map(|column| column.into_iter().collect()).collect()
}

/// By cell and quarter of the compass: what poses make of a stray there.
fn strays(map: &FittedMap, fits: &[Agreement]) -> BTreeMap<(usize, i32), DVector<f64>> {
    let mut strays = BTreeMap::new();
    for (scan, fit) in fits.iter().enumerate() {
        for used in &fit.used {
            let Some(at) = map.field.locate(used.sighting.place) else { continue };
            let normal = used.sighting.normal;
            let quarter = (normal.y.atan2(normal.x) / std::f64::consts::FRAC_PI_2).round() as i32;
            let key = (map.lattice().cell_index(at.cell), quarter.rem_euclid(4));
            let own = strays.entry(key).or_insert_with(|| DVector::zeros(3 * fits.len()));
            let mut view = own.fixed_rows_mut::<3>(3 * scan);
            view += used.sighting.by_pose * used.weight;
        }
    }
    strays
}

//! How large a fit would be: found as the fit finds it, without building anything of that size.

use super::Distance;
use super::options::FitOptions;
use super::vector::DEFAULT_BAND;
use crate::scan::{Evidence, LaserScan, Return, returns_of};
use crate::sparse::dissection::entries_of_poses;
use crate::spline::Lattice;

/// A cell's control points reach so far beyond its own.
const REACH: usize = 3;

/// How large a fit is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Footprint {
    /// Control points in use, of each component.
    pub control_points: usize,
    pub scans: usize,
    pub returns: usize,
    /// Entries of the factor between poses, about.
    pub pose_entries: usize,
}

/// The footprint of a fit. Where poses are so uncertain that a vector fit reaches farther than its usual band, it uses
/// more than this. `None` where `goes_on`, asked before every scan, does not hold any more.
pub fn footprint(
    scans: &[LaserScan],
    distance: Distance,
    lattice: &Lattice,
    options: &FitOptions,
    goes_on: &dyn Fn() -> bool,
) -> Option<Footprint> {
    let usual = (distance == Distance::Vector).then_some(DEFAULT_BAND);
    let control_points = match options.band.or(usual) {
        None => lattice.len(),
        Some(band) => {
            let mut active = vec![false; lattice.len()];
            let cells = Evidence::gather_while(lattice, scans, &mut || goes_on())?.cells_within(lattice, band);
            for (k, _) in cells.iter().enumerate().filter(|(_, used)| **used) {
                let cell = [k % lattice.cells[0], k / lattice.cells[0]];
                lattice.support(cell).iter().for_each(|&point| active[point] = true);
            }
            active.into_iter().filter(|active| *active).count()
        }
    };
    let returns = returns_of(scans).len();
    Some(Footprint {
        control_points,
        scans: scans.len(),
        returns,
        pose_entries: pose_entries(scans, distance, lattice),
    })
}

/// Entries of the factor between poses, about: found from where each scan's returns lie, scan by scan.
pub fn pose_entries(scans: &[LaserScan], distance: Distance, lattice: &Lattice) -> usize {
    let corners = scans.iter().filter_map(|scan| corners(lattice, &returns_of(std::slice::from_ref(scan))));
    entries_of_poses(lattice.control_points(), distance.components(), corners) as usize
}

/// The corners of the control points that a scan's returns tell of; `None` where it has none on the lattice.
fn corners(lattice: &Lattice, returns: &[Return]) -> Option<[[usize; 2]; 4]> {
    let cells = returns.iter().filter_map(|return_| lattice.locate(return_.point)).map(|at| at.cell);
    let (low, high) = cells.fold(None, |span: Option<([usize; 2], [usize; 2])>, cell| {
        let (low, high) = span.unwrap_or((cell, cell));
        Some(([0, 1].map(|k| low[k].min(cell[k])), [0, 1].map(|k| high[k].max(cell[k]))))
    })?;
    let high = high.map(|last| last + REACH);
    Some([low, [high[0], low[1]], [low[0], high[1]], high])
}

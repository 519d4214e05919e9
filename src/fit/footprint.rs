//! How large a fit would be: found as the fit finds it, without building anything of that size.

use super::Distance;
use super::options::FitOptions;
use super::vector::DEFAULT_BAND;
use crate::scan::{Evidence, LaserScan, returns_of};
use crate::spline::Lattice;

/// How large a fit is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Footprint {
    /// Control points in use, of each component.
    pub control_points: usize,
    pub scans: usize,
    pub returns: usize,
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
    Some(Footprint { control_points, scans: scans.len(), returns: returns_of(scans).len() })
}

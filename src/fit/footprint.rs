//! How large a fit would be: found as the fit finds it, without building anything of that size.

use super::Distance;
use super::options::FitOptions;
use super::vector::DEFAULT_BAND;
use crate::scan::{Evidence, LaserScan, Return, returns_of};
use crate::sparse::dissection::{Census, entries_of_poses};
use crate::spline::Lattice;

/// A cell's control points reach so far beyond its own.
const REACH: usize = 3;

/// How large a fit is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Footprint {
    /// Control points of the whole rectangle.
    pub lattice: usize,
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
    let control_points = match band_of(distance, options) {
        None => lattice.len(),
        Some(band) => {
            let evidence = Evidence::gather_while(lattice, scans, &mut || goes_on())?;
            in_use(lattice, &evidence, band).into_iter().filter(|used| *used).count()
        }
    };
    let returns = returns_of(scans).len();
    Some(Footprint {
        lattice: lattice.len(),
        control_points,
        scans: scans.len(),
        returns,
        pose_entries: pose_entries(scans, distance, lattice),
    })
}

/// The control points in use, or somewhat more: where scans' surroundings together hold no more than `limit`, or where it
/// would take too long to see what beams pass, all of the surroundings count.
pub fn control_points(
    scans: &[LaserScan],
    distance: Distance,
    lattice: &Lattice,
    options: &FitOptions,
    limit: usize,
) -> Census {
    let size = lattice.control_points();
    let Some(band) = band_of(distance, options).filter(|_| lattice.len() > limit) else {
        return Census::of(size, |_| true);
    };
    let around = surroundings(lattice, scans, band);
    let looks: usize =
        scans.iter().map(|scan| Evidence::extent(lattice, scan).map(|span| span.len())).map(|[x, y]| x * y).sum();
    if around.total() <= limit || looks > MOST_LOOKS {
        return around;
    }
    let used = in_use(lattice, &Evidence::gather(lattice, scans), band);
    Census::of(size, |point| used[point])
}

/// How many cells around evidence have control points; `None`: all have.
fn band_of(distance: Distance, options: &FitOptions) -> Option<f64> {
    options.band.or((distance == Distance::Vector).then_some(DEFAULT_BAND))
}

fn in_use(lattice: &Lattice, evidence: &Evidence, band: f64) -> Vec<bool> {
    let mut active = vec![false; lattice.len()];
    for (k, _) in evidence.cells_within(lattice, band).iter().enumerate().filter(|(_, used)| **used) {
        let cell = [k % lattice.cells[0], k / lattice.cells[0]];
        lattice.support(cell).iter().for_each(|&point| active[point] = true);
    }
    active
}

/// The control points of the rectangles that scans look into: their corners are noted, then summed up along x and y.
fn surroundings(lattice: &Lattice, scans: &[LaserScan], band: f64) -> Census {
    let width = lattice.cells[0] + REACH + 2;
    let mut counts = vec![0i32; width * (lattice.cells[1] + REACH + 2)];
    for [x, y] in scans.iter().filter_map(|scan| Evidence::reach(lattice, scan, band)) {
        let (left, right, low, high) = (*x.start(), x.end() + REACH + 1, *y.start(), y.end() + REACH + 1);
        for (i, j, sign) in [(left, low, 1), (right, low, -1), (left, high, -1), (right, high, 1)] {
            counts[i + j * width] += sign;
        }
    }
    for row in counts.chunks_mut(width) {
        (1..width).for_each(|i| row[i] += row[i - 1]);
    }
    (width..counts.len()).for_each(|k| counts[k] += counts[k - width]);
    let [columns, rows] = lattice.control_points();
    Census::of([columns, rows], |point| counts[point % columns + point / columns * width] > 0)
}

/// Marks that are looked at to see what beams pass, at most: a second's.
const MOST_LOOKS: usize = 100_000_000;

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

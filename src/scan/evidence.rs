//! Where there is evidence: what beams passed through, and where they met a surface.
//!
//! A raster with [`SUBCELLS`] x [`SUBCELLS`] marks per lattice cell. A mark is *free* where it lies between two
//! neighbouring beams, nearer than what they met, and *surface* where it lies within half a cell of what was met.
//! Returns of neighbouring beams belong to one surface where the line between them is not nearly parallel to the beams;
//! the wedge then ends at that line, else at the nearer return. A beam without a return is evidence of nothing: beside
//! it only half the wedge counts, the half nearer to the beam that did return.

use std::ops::{Range, RangeInclusive};

use super::laser::LaserScan;
use crate::geometry::{Vec2, distance_to_segment, wrap_angle};
use crate::spline::{Lattice, Located};

/// Marks along a cell's side.
pub const SUBCELLS: usize = 4;

/// A line between neighbouring returns steeper than this against its beam (about 6 degrees) is a surface.
const GRAZING_SINE: f64 = 0.1;
/// Neighbouring returns farther apart than this many cells are not joined: what lies between was hardly seen.
const LONGEST_JOIN: f64 = 2.0;

const FREE: u8 = 1;
const SURFACE: u8 = 2;

/// What is known of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Seen {
    /// A beam passed here.
    pub free: bool,
    /// A surface was met within half a cell.
    pub surface: bool,
}

impl Seen {
    pub fn any(self) -> bool {
        self.free || self.surface
    }
}

/// The raster of evidence over a lattice.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    size: [usize; 2],
    marks: Vec<u8>,
}

impl Evidence {
    /// What the scans say about the lattice's area.
    pub fn gather(lattice: &Lattice, scans: &[LaserScan]) -> Self {
        let mut evidence = Self::nothing(lattice);
        scans.iter().for_each(|scan| evidence.add(lattice, scan));
        evidence
    }

    /// The same while `goes_on` holds, which is asked before every scan; `None` where it does not any more.
    pub fn gather_while(lattice: &Lattice, scans: &[LaserScan], goes_on: &mut dyn FnMut() -> bool) -> Option<Self> {
        let mut evidence = Self::nothing(lattice);
        for scan in scans {
            goes_on().then(|| evidence.add(lattice, scan))?;
        }
        Some(evidence)
    }

    fn nothing(lattice: &Lattice) -> Self {
        let size = lattice.cells.map(|n| n * SUBCELLS);
        Self { size, marks: vec![0; size[0] * size[1]] }
    }

    fn add(&mut self, lattice: &Lattice, scan: &LaserScan) {
        let sweep = Sweep::of(scan, lattice.resolution);
        self.mark_free(lattice, &sweep);
        self.mark_surfaces(lattice, sweep.surfaces(LONGEST_JOIN * lattice.resolution));
    }

    /// Evidence from its marks as [`Evidence::marks`] gave them; `None` where their number does not fit the lattice.
    pub fn from_marks(lattice: &Lattice, marks: Vec<u8>) -> Option<Self> {
        let size = lattice.cells.map(|n| n * SUBCELLS);
        (marks.len() == size[0] * size[1]).then_some(Self { size, marks })
    }

    /// The raster, x fastest from the lower left: bit 0 free, bit 1 surface.
    pub fn marks(&self) -> &[u8] {
        &self.marks
    }

    /// The number of marks along x and y.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// What is known at a point; nothing outside the lattice.
    pub fn at(&self, lattice: &Lattice, p: Vec2) -> Seen {
        lattice.locate(p).map_or_else(Seen::default, |at| self.located(&at))
    }

    /// What is known at a point already located.
    pub fn located(&self, located: &Located) -> Seen {
        let along = |axis: usize| {
            let sub = (located.local[axis] * SUBCELLS as f64) as usize;
            located.cell[axis] * SUBCELLS + sub.min(SUBCELLS - 1)
        };
        self.mark(along(0), along(1))
    }

    /// What is known at mark `(i, j)`.
    pub fn mark(&self, i: usize, j: usize) -> Seen {
        let mark = self.marks[i + j * self.size[0]];
        Seen { free: mark & FREE != 0, surface: mark & SURFACE != 0 }
    }

    /// The cells along an axis of so many that a mark reaches, `reach` marks far.
    fn reached(mark: usize, reach: usize, cells: usize) -> RangeInclusive<usize> {
        mark.saturating_sub(reach) / SUBCELLS..=((mark + reach) / SUBCELLS).min(cells - 1)
    }

    /// A band of so many cells, in marks.
    fn marks_of(band: f64, size: [usize; 2]) -> usize {
        (band * SUBCELLS as f64).round().clamp(0.0, size[0].max(size[1]) as f64) as usize
    }

    /// The cells, along x and y, that [`Evidence::cells_within`] can find in a scan's surroundings; `None` where it has none.
    pub fn reach(lattice: &Lattice, scan: &LaserScan, band: f64) -> Option<[RangeInclusive<usize>; 2]> {
        let marks = Self::extent(lattice, scan);
        let reach = Self::marks_of(band, lattice.cells.map(|n| n * SUBCELLS));
        let along = |axis: usize| {
            let (first, last) = (marks[axis].start, marks[axis].end.checked_sub(1)?);
            let cells = lattice.cells[axis];
            (first <= last)
                .then(|| *Self::reached(first, reach, cells).start()..=*Self::reached(last, reach, cells).end())
        };
        Some([along(0)?, along(1)?])
    }

    /// The cells, x fastest, that have a mark in them or at most `band` cells away along x and y, to a quarter of a
    /// cell.
    pub fn cells_within(&self, lattice: &Lattice, band: f64) -> Vec<bool> {
        let ([nx, ny], [width, height]) = (lattice.cells, self.size);
        let reach = Self::marks_of(band, self.size);
        let span = |mark: usize, cells: usize| Self::reached(mark, reach, cells);
        let mut rows = vec![false; nx * height];
        for (k, _) in self.marks.iter().enumerate().filter(|(_, mark)| **mark != 0) {
            span(k % width, nx).for_each(|i| rows[i + k / width * nx] = true);
        }
        let mut near = vec![false; nx * ny];
        for (k, _) in rows.iter().enumerate().filter(|(_, reached)| **reached) {
            span(k / nx, ny).for_each(|j| near[k % nx + j * nx] = true);
        }
        near
    }

    fn mark_free(&mut self, lattice: &Lattice, sweep: &Sweep<'_>) {
        let [width, _] = self.size;
        let (low, high) = sweep.extent();
        for (i, j) in self.window(lattice, low, high) {
            let mark = &mut self.marks[i + j * width];
            if *mark & FREE == 0 && sweep.passes(mark_center(lattice, i, j)) {
                *mark |= FREE;
            }
        }
    }

    /// Forgets the surfaces that were met, in favour of these pieces.
    pub fn replace_surfaces(&mut self, lattice: &Lattice, pieces: impl Iterator<Item = (Vec2, Vec2)>) {
        self.marks.iter_mut().for_each(|mark| *mark &= !SURFACE);
        self.mark_surfaces(lattice, pieces);
    }

    /// Forgets the surfaces within half a cell of the points `gone`, but for those of the points that stay.
    pub fn forget_surfaces(
        &mut self,
        lattice: &Lattice,
        gone: impl Iterator<Item = Vec2>,
        stay: impl Iterator<Item = Vec2>,
    ) {
        let mut doubtful = Self { size: self.size, marks: vec![0; self.marks.len()] };
        doubtful.mark_surfaces(lattice, gone.map(|p| (p, p)));
        let mut kept = Self { size: self.size, marks: vec![0; self.marks.len()] };
        kept.mark_surfaces(lattice, stay.map(|p| (p, p)));
        for ((mark, doubtful), kept) in self.marks.iter_mut().zip(&doubtful.marks).zip(&kept.marks) {
            if doubtful & SURFACE != 0 && kept & SURFACE == 0 {
                *mark &= !SURFACE;
            }
        }
    }

    fn mark_surfaces(&mut self, lattice: &Lattice, pieces: impl Iterator<Item = (Vec2, Vec2)>) {
        let [width, _] = self.size;
        let near = lattice.resolution / 2.0;
        for (a, b) in pieces {
            let around = Vec2::from_element(near);
            for (i, j) in self.window(lattice, a.inf(&b) - around, a.sup(&b) + around) {
                if distance_to_segment(mark_center(lattice, i, j), a, b) <= near {
                    self.marks[i + j * width] |= SURFACE;
                }
            }
        }
    }

    /// The marks whose centres may lie in a rectangle.
    fn window(&self, lattice: &Lattice, low: Vec2, high: Vec2) -> impl Iterator<Item = (usize, usize)> + use<> {
        let [columns, rows] = spans(lattice, low, high);
        rows.flat_map(move |j| columns.clone().map(move |i| (i, j)))
    }

    /// The marks, along x and y, among which all lie that a scan can make.
    pub fn extent(lattice: &Lattice, scan: &LaserScan) -> [Range<usize>; 2] {
        let (low, high) = Sweep::of(scan, lattice.resolution).extent();
        let near = Vec2::from_element(lattice.resolution / 2.0);
        spans(lattice, low - near, high + near)
    }
}

fn spans(lattice: &Lattice, low: Vec2, high: Vec2) -> [Range<usize>; 2] {
    let side = lattice.resolution / SUBCELLS as f64;
    [0, 1].map(|axis| {
        let low = ((low[axis] - lattice.origin[axis]) / side).floor().max(0.0) as usize;
        let high = ((high[axis] - lattice.origin[axis]) / side).ceil().max(0.0) as usize;
        low..high.min(lattice.cells[axis] * SUBCELLS)
    })
}

/// The centre of mark `(i, j)`.
pub(crate) fn mark_center(lattice: &Lattice, i: usize, j: usize) -> Vec2 {
    let side = lattice.resolution / SUBCELLS as f64;
    Vec2::new(lattice.origin[0] + (i as f64 + 0.5) * side, lattice.origin[1] + (j as f64 + 0.5) * side)
}

/// One scan's beams, ready to be asked what they passed.
struct Sweep<'a> {
    scan: &'a LaserScan,
    center: Vec2,
    /// Returns in the world, `None` where a beam had none.
    points: Vec<Option<Vec2>>,
    ranges: Vec<f64>,
    /// Whether the returns of beams `k` and `k + 1` lie on one surface.
    joined: Vec<bool>,
    reach: f64,
}

impl<'a> Sweep<'a> {
    fn of(scan: &'a LaserScan, resolution: f64) -> Self {
        let beams = scan.ranges.len();
        let ranges: Vec<f64> = (0..beams).map(|beam| scan.range(beam).unwrap_or(f64::NAN)).collect();
        let points: Vec<Option<Vec2>> =
            (0..beams).map(|beam| scan.range(beam).map(|range| scan.pose.project(range, scan.bearing(beam)))).collect();
        let center = scan.pose.position();
        let joined = points
            .windows(2)
            .map(|pair| match (pair[0], pair[1]) {
                (Some(a), Some(b)) => {
                    let chord = b - a;
                    let beam = (a + b) / 2.0 - center;
                    let sine = chord.perp(&beam).abs();
                    sine >= GRAZING_SINE * chord.norm() * beam.norm() || chord.norm() <= resolution / 2.0
                }
                _ => false,
            })
            .collect();
        let reach = ranges.iter().copied().fold(0.0, f64::max);
        Self { scan, center, points, ranges, joined, reach }
    }

    /// The corners of a rectangle around everything its beams passed: the scanner, what it met, and half a beam's width
    /// beside that.
    fn extent(&self) -> (Vec2, Vec2) {
        let (low, high) =
            self.points.iter().flatten().fold((self.center, self.center), |(low, high), p| (low.inf(p), high.sup(p)));
        let beside = Vec2::from_element(self.reach * self.scan.angle_increment.abs() / 2.0);
        (low - beside, high + beside)
    }

    /// Whether a beam passed the point before it met anything.
    fn passes(&self, p: Vec2) -> bool {
        let offset = p - self.center;
        let distance = offset.norm();
        if distance >= self.reach || self.scan.angle_increment == 0.0 {
            return false;
        }
        let from_first = offset.y.atan2(offset.x) - self.scan.pose.theta - self.scan.angle_min;
        let beam = self.beam_at(from_first);
        let beams = self.ranges.len();
        if beam <= -0.5 || beam >= beams as f64 - 0.5 {
            return false;
        }
        let nearest = self.ranges[(beam.round().max(0.0) as usize).min(beams - 1)];
        if beam < 0.0 || beam > beams as f64 - 1.0 {
            return distance < nearest;
        }
        let low = (beam as usize).min(beams.saturating_sub(2));
        let Some(&high_range) = self.ranges.get(low + 1) else { return distance < nearest };
        let low_range = self.ranges[low];
        if low_range.is_nan() || high_range.is_nan() {
            return distance < nearest;
        }
        match (self.points[low], self.points[low + 1]) {
            (Some(a), Some(b)) if self.joined[low] => on_the_same_side(self.center, p, a, b),
            _ => distance < low_range.min(high_range),
        }
    }

    /// The fractional index of the beam at an angle from the first one, of the turn in which the scan lies.
    fn beam_at(&self, from_first: f64) -> f64 {
        let step = self.scan.angle_increment;
        let middle = (self.ranges.len() as f64 - 1.0) * step / 2.0;
        (middle + wrap_angle(from_first - middle)) / step
    }

    /// The surfaces met: pieces between joined returns, and single returns as points.
    fn surfaces(&self, longest: f64) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
        self.points.iter().enumerate().filter_map(move |(beam, point)| {
            let a = (*point)?;
            match self.points.get(beam + 1).copied().flatten() {
                Some(b) if self.joined[beam] && (b - a).norm() <= longest => Some((a, b)),
                _ => Some((a, a)),
            }
        })
    }
}

/// Whether `p` lies on the same side of the line through `a` and `b` as `from`.
fn on_the_same_side(from: Vec2, p: Vec2, a: Vec2, b: Vec2) -> bool {
    let line = b - a;
    line.perp(&(from - a)) * line.perp(&(p - a)) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Bounds, Pose};

    /// A robot in the middle of a square room of side 4, a full turn of 1 degree, with some beams left without a
    /// return.
    fn square(missing: std::ops::Range<usize>) -> (Lattice, Evidence) {
        let ranges = (0..360)
            .map(|k| {
                let (sin, cos) = (k as f64).to_radians().sin_cos();
                if missing.contains(&k) { f64::NAN } else { 2.0 / sin.abs().max(cos.abs()) }
            })
            .collect();
        let scan = LaserScan {
            pose: Pose::new(0.0, 0.0, 0.0),
            pose_covariance: None,
            sigma_range: None,
            frame: 0,
            angle_min: 0.0,
            angle_increment: 1f64.to_radians(),
            range_min: 0.1,
            range_max: 10.0,
            ranges,
        };
        let lattice = Lattice::covering(&Bounds { min: [-3.0; 2], max: [3.0; 2] }, 0.2, 10_000).unwrap();
        let evidence = Evidence::gather(&lattice, &[scan]);
        (lattice, evidence)
    }

    #[test]
    fn inside_is_free_walls_are_surface_and_behind_is_unknown() {
        let (lattice, evidence) = square(0..0);
        let at = |x, y| evidence.at(&lattice, Vec2::new(x, y));
        assert_eq!(at(1.0, 0.5), Seen { free: true, surface: false });
        assert_eq!(at(1.96, 0.5), Seen { free: true, surface: true });
        assert_eq!(at(2.04, -1.3), Seen { free: false, surface: true });
        assert_eq!(at(2.5, 0.5), Seen::default());
        assert_eq!(at(9.0, 9.0), Seen::default());
    }

    #[test]
    fn a_beam_without_a_return_is_evidence_of_nothing() {
        let (lattice, evidence) = square(0..91);
        assert_eq!(evidence.at(&lattice, Vec2::new(1.0, 1.0)), Seen::default());
        assert!(evidence.at(&lattice, Vec2::new(-1.0, 1.0)).free);
        assert!(!evidence.at(&lattice, Vec2::new(2.0, 1.0)).surface);
    }
}

//! Level lines of the distance, and the band in which a level lies within so many standard deviations.
//!
//! Marching squares on samples finer than the lattice, then every vertex is moved onto the spline's own level by Newton
//! steps along the gradient. The band is where `|u - level| <= k sigma`, traced on the signed ratio
//! `(u - level) / sigma`, which crosses a band narrower than the sampling cleanly. Both are kept where there is
//! evidence: a level in space nobody saw is not a wall. Where a vector field vanishes is traced by [`super::walls`].

use ::contour::ContourBuilder;
use geo_types::{Coord, LineString, MultiLineString, MultiPolygon, Polygon};

use super::RenderError;
use super::walls::walls;
use crate::geometry::Vec2;
use crate::map::{Field, FittedMap};
use crate::uncertainty::Kind;

/// Samples a cell's side, where the map is not too large for it.
const FINEST: usize = 8;
/// Samples a contour is traced on at most.
const MOST_SAMPLES: usize = 4_000_000;
/// Ratios beyond this many sigma are all the same.
const FAR: f64 = 1e3;

/// A level's lines, and the band around it where one was asked for; metres in the map's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Contours {
    pub level: f64,
    pub lines: MultiLineString<f64>,
    /// The band's half-width in standard deviations, and the band.
    pub band: Option<(f64, MultiPolygon<f64>)>,
}

/// Traces a level, and with `sigma_band` the band of that many standard deviations.
pub fn contours(map: &FittedMap, level: f64, sigma_band: Option<f64>, kind: Kind) -> Result<Contours, RenderError> {
    if level == 0.0 && matches!(map.field, Field::Vector { .. }) {
        let (lines, band) = walls(map, sigma_band, kind);
        return Ok(Contours { level, lines, band: sigma_band.zip(band) });
    }
    let samples = Samples::over(map);
    let values = samples.collect(|p| map.field.value(p).map_or(FAR, |u| u - level));
    let mut lines = Vec::new();
    for line in ContourBuilder::new(samples.size[0], samples.size[1], true).lines(&values, &[0.0])? {
        for ring in line.geometry() {
            for run in samples.open_runs(&ring.0) {
                let vertices = run.into_iter().map(|p| onto_level(map, samples.to_world(p), level)).collect();
                lines.extend(split_where_seen(map, vertices));
            }
        }
    }
    let band = sigma_band.map(|k| band(map, &samples, level, k, kind).map(|band| (k, band))).transpose()?;
    Ok(Contours { level, lines: MultiLineString(lines), band })
}

fn band(map: &FittedMap, samples: &Samples, level: f64, k: f64, kind: Kind) -> Result<MultiPolygon<f64>, RenderError> {
    let ratio = |p: Vec2| match map.distance(p, kind) {
        Some((u, sigma)) if map.evidence.at(map.lattice(), p).any() => {
            ((u - level) / sigma.max(1e-12)).clamp(-FAR, FAR)
        }
        _ => FAR,
    };
    let bands =
        ContourBuilder::new(samples.size[0], samples.size[1], true).isobands(&samples.collect(ratio), &[-k, k])?;
    let polygons = bands.iter().flat_map(|band| &band.geometry().0).map(|polygon| {
        let ring = |ring: &LineString<f64>, outer: bool| {
            let points = ring.0.iter().map(|&p| samples.to_world(p)).map(|p| Coord { x: p.x, y: p.y }).collect();
            oriented(LineString(points), outer)
        };
        let holes = polygon.interiors().iter().map(|hole| ring(hole, false)).collect();
        Polygon::new(ring(polygon.exterior(), true), holes)
    });
    Ok(MultiPolygon(polygons.collect()))
}

/// The ring wound as RFC 7946 asks: counter-clockwise outside, clockwise for a hole.
fn oriented(mut ring: LineString<f64>, outer: bool) -> LineString<f64> {
    let doubled: f64 = ring.0.windows(2).map(|e| e[0].x * e[1].y - e[1].x * e[0].y).sum();
    if (doubled > 0.0) != outer {
        ring.0.reverse();
    }
    ring
}

/// Moves a vertex onto the level; where the gradient vanishes it stays.
fn onto_level(map: &FittedMap, mut p: Vec2, level: f64) -> Vec2 {
    let reach = map.lattice().resolution / FINEST as f64;
    let from = p;
    for _ in 0..4 {
        let Some((value, gradient)) = map.field.slope(p) else { return from };
        let slope2 = gradient.norm_squared();
        if slope2 < 1e-4 {
            return from;
        }
        p -= gradient * ((value - level) / slope2);
    }
    if (p - from).norm() <= reach && map.lattice().locate(p).is_some() { p } else { from }
}

/// The pieces of a line that lie where there is evidence.
fn split_where_seen(map: &FittedMap, vertices: Vec<Vec2>) -> Vec<LineString<f64>> {
    let jump = |p: Vec2| map.field.vector(p).is_some_and(|at| at.divergence() < 0.0);
    let seen = |p: Vec2| map.evidence.at(map.lattice(), p).any() && !jump(p);
    let closed = vertices.len() > 2 && vertices.first() == vertices.last();
    let mut pieces: Vec<Vec<Coord<f64>>> = vec![Vec::new()];
    for p in &vertices {
        match (seen(*p), pieces.last_mut()) {
            (true, Some(piece)) => piece.push(Coord { x: p.x, y: p.y }),
            _ => pieces.push(Vec::new()),
        }
    }
    // A closed line that was cut somewhere else than at its seam is whole across the seam.
    if closed && pieces.len() > 1 && vertices.first().is_some_and(|p| seen(*p)) {
        let mut last = pieces.pop().unwrap_or_default();
        last.extend(pieces[0].iter().skip(1));
        pieces[0] = last;
    }
    pieces.into_iter().filter(|piece| piece.len() > 1).map(LineString).collect()
}

/// A regular grid of points over the lattice, edges included.
pub(super) struct Samples {
    pub origin: [f64; 2],
    pub step: f64,
    pub size: [usize; 2],
}

impl Samples {
    pub fn over(map: &FittedMap) -> Self {
        let lattice = map.lattice();
        let per_cell = (1..=FINEST).rev().find(|k| lattice.cell_count() * k * k <= MOST_SAMPLES).unwrap_or(1);
        Self {
            origin: lattice.origin,
            step: lattice.resolution / per_cell as f64,
            size: lattice.cells.map(|n| n * per_cell + 1),
        }
    }

    fn collect(&self, value: impl Fn(Vec2) -> f64) -> Vec<f64> {
        let at = |k: usize, axis: usize| self.origin[axis] + k as f64 * self.step;
        (0..self.size[1])
            .flat_map(|j| (0..self.size[0]).map(move |i| (i, j)))
            .map(|(i, j)| value(Vec2::new(at(i, 0), at(j, 1))))
            .collect()
    }

    /// The tracer puts sample (i, j) at (i + 1/2, j + 1/2).
    fn to_world(&self, p: Coord<f64>) -> Vec2 {
        Vec2::new(self.origin[0] + (p.x - 0.5) * self.step, self.origin[1] + (p.y - 0.5) * self.step)
    }

    /// A traced ring without the pieces along the grid's edge, where the tracer closes every line.
    fn open_runs(&self, ring: &[Coord<f64>]) -> Vec<Vec<Coord<f64>>> {
        let [nx, ny] = self.size.map(|n| n as f64);
        let on_edge = |p: &Coord<f64>| p.x <= 0.0 || p.y <= 0.0 || p.x >= nx || p.y >= ny;
        let corners = ring.len().saturating_sub(1);
        let Some(first) = ring[..corners].iter().position(on_edge) else { return vec![ring.to_vec()] };
        let mut runs = vec![Vec::new()];
        for k in 1..=corners {
            let p = ring[(first + k) % corners];
            match runs.last_mut() {
                Some(run) if !on_edge(&p) => run.push(p),
                _ => runs.push(Vec::new()),
            }
        }
        runs.retain(|run| run.len() > 1);
        runs
    }
}

//! Level lines of a distance: marching squares, then every vertex moved onto the field's own level by Newton steps.
//!
//! Lines are kept where there is evidence: a level in space nobody saw is not a wall.

use ::contour::Error;

use super::samples::{FINEST, Samples};
use crate::geometry::Vec2;
use crate::map::Chart;
use crate::spline::Lattice;

/// What stands for the value where there is none.
const FAR: f64 = 1e3;

/// The lines on which a function with a gradient takes the value `level`.
pub(crate) fn level_lines(
    chart: Chart<'_>,
    level: f64,
    slope: impl Fn(Vec2) -> Option<(f64, Vec2)>,
) -> Result<Vec<Vec<Vec2>>, Error> {
    let lattice = chart.field.lattice();
    let samples = Samples::over(lattice);
    let values = samples.collect(|p| slope(p).map_or(FAR, |(value, _)| value - level));
    let lines = samples.zero_lines(&values)?;
    let moved = lines.into_iter().map(|line| line.into_iter().map(|p| onto_level(lattice, p, level, &slope)).collect());
    Ok(moved.flat_map(|line: Vec<Vec2>| split_where_seen(chart, &line)).collect())
}

/// Moves a vertex onto the level; where the gradient vanishes it stays.
fn onto_level(lattice: &Lattice, mut p: Vec2, level: f64, slope: impl Fn(Vec2) -> Option<(f64, Vec2)>) -> Vec2 {
    let reach = lattice.resolution / FINEST as f64;
    let from = p;
    for _ in 0..4 {
        let Some((value, gradient)) = slope(p) else { return from };
        let slope2 = gradient.norm_squared();
        if slope2 < 1e-4 {
            return from;
        }
        p -= gradient * ((value - level) / slope2);
    }
    if (p - from).norm() <= reach && lattice.locate(p).is_some() { p } else { from }
}

/// The pieces of a line that lie where there is evidence.
fn split_where_seen(chart: Chart<'_>, vertices: &[Vec2]) -> Vec<Vec<Vec2>> {
    let seen = |p: Vec2| chart.evidence.at(chart.field.lattice(), p).any();
    let closed = vertices.len() > 2 && vertices.first() == vertices.last();
    let mut pieces: Vec<Vec<Vec2>> = vec![Vec::new()];
    for p in vertices {
        match (seen(*p), pieces.last_mut()) {
            (true, Some(piece)) => piece.push(*p),
            _ => pieces.push(Vec::new()),
        }
    }
    // A closed line that was cut somewhere else than at its seam is whole across the seam.
    if closed && pieces.len() > 1 && vertices.first().is_some_and(|p| seen(*p)) {
        let mut last = pieces.pop().unwrap_or_default();
        last.extend(pieces[0].iter().skip(1));
        pieces[0] = last;
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

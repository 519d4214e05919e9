//! Where a vector field vanishes, and means it: walls.
//!
//! `|V|` touches zero without crossing it, and `V` also passes through zero where it jumps, half-way between two
//! surfaces. Both are told apart by how `V` grows: across a wall along its normal `n` with slope 1 (between the faces
//! of a thin one with less, but its divergence stays positive), across a jump against it. So where a surface was met,
//! each edge of a grid of samples is asked whether `n . V`, with `n` the direction of fastest growth at its middle,
//! changes sign from one end to the other; the crossings of a square's edges are joined, and the joints chained to
//! lines.

use std::collections::BTreeMap;

use super::bridges::bridged;
use super::samples::Samples;
use crate::geometry::Vec2;
use crate::map::Chart;

/// An edge of the samples' grid: its lower left sample, and whether it runs along y.
type Edge = (usize, bool);

/// The walls: lines of points where the field vanishes.
pub(super) fn walls(chart: Chart<'_>) -> Vec<Vec<Vec2>> {
    let samples = Samples::over(chart.field.lattice());
    let crossings = crossings(chart, &samples);
    let lines = chains(&joints(&crossings, samples.size[0]));
    bridged(chart, lines.into_iter().map(|line| line.iter().map(|edge| crossings[edge]).collect()).collect())
}

/// The points where walls cross the edges of the grid.
fn crossings(chart: Chart<'_>, samples: &Samples) -> BTreeMap<Edge, Vec2> {
    let [nx, ny] = samples.size;
    let place = |k: usize| samples.place(k);
    let vectors: Vec<Option<Vec2>> = (0..nx * ny).map(|k| chart.field.vector(place(k)).map(|at| at.vector)).collect();
    let mut crossings = BTreeMap::new();
    for k in 0..nx * ny {
        for (along_y, other, inside) in [(false, k + 1, k % nx + 1 < nx), (true, k + nx, k / nx + 1 < ny)] {
            let Some((a, b)) = vectors[k].zip(if inside { vectors[other] } else { None }) else { continue };
            if a.norm().min(b.norm()) > 2.0 * samples.step {
                continue;
            }
            let Some(normal) = wall_normal(chart, (place(k) + place(other)) * 0.5) else { continue };
            let (s, t) = (normal.dot(&a), normal.dot(&b));
            if (s < 0.0) != (t < 0.0) {
                crossings.insert((k, along_y), place(k) + (place(other) - place(k)) * (s / (s - t)));
            }
        }
    }
    crossings
}

/// The direction of fastest growth where the field looks like a wall and a surface was met.
fn wall_normal(chart: Chart<'_>, p: Vec2) -> Option<Vec2> {
    let at = chart.field.vector(p).filter(|at| at.divergence() > 0.0)?;
    if !chart.evidence.at(chart.field.lattice(), p).surface {
        return None;
    }
    Some(at.fastest_growth())
}

/// Which crossings lie on one square's edges: neighbours on a line.
fn joints(crossings: &BTreeMap<Edge, Vec2>, nx: usize) -> BTreeMap<Edge, Vec<Edge>> {
    let mut joints: BTreeMap<Edge, Vec<Edge>> = BTreeMap::new();
    let mut squares: BTreeMap<usize, Vec<Edge>> = BTreeMap::new();
    for &(k, along_y) in crossings.keys() {
        squares.entry(k).or_default().push((k, along_y));
        let before = if along_y { (k % nx > 0).then(|| k - 1) } else { k.checked_sub(nx) };
        if let Some(before) = before {
            squares.entry(before).or_default().push((k, along_y));
        }
    }
    for own in squares.values() {
        for pair in own.chunks_exact(2) {
            joints.entry(pair[0]).or_default().push(pair[1]);
            joints.entry(pair[1]).or_default().push(pair[0]);
        }
    }
    joints
}

/// Lines of at least two crossings: open ones from their ends first, then closed ones.
fn chains(joints: &BTreeMap<Edge, Vec<Edge>>) -> Vec<Vec<Edge>> {
    let mut lines = Vec::new();
    let mut left: BTreeMap<Edge, Vec<Edge>> = joints.clone();
    let ends: Vec<Edge> = joints.iter().filter(|(_, next)| next.len() == 1).map(|(edge, _)| *edge).collect();
    for start in ends.into_iter().chain(joints.keys().copied()) {
        let mut line = vec![start];
        let mut at = start;
        while let Some(next) = left.get_mut(&at).and_then(Vec::pop) {
            if let Some(back) = left.get_mut(&next)
                && let Some(k) = back.iter().position(|edge| *edge == at)
            {
                back.swap_remove(k);
            }
            line.push(next);
            at = next;
        }
        if line.len() > 1 {
            lines.push(line);
        }
    }
    lines
}

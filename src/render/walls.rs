//! Where a vector field vanishes, and means it: walls.
//!
//! `|V|` touches zero without crossing it, and `V` also passes through zero where it jumps, half-way between two
//! surfaces. Both are told apart by how `V` grows: across a wall along its normal `n` with slope 1 (between the faces
//! of a thin one with less, but its divergence stays positive), across a jump against it. So where a surface was met,
//! each edge of a grid of samples is asked whether `n . V`, with `n` the direction of fastest growth at its middle,
//! changes sign from one end to the other; the crossings of a square's edges are joined, and the joints chained to
//! lines. A line's band reaches as many standard deviations of `n . V` to either side.

use std::collections::BTreeMap;

use geo_types::{Coord, LineString, MultiLineString, MultiPolygon, Polygon};

use super::bridges::bridged;
use super::contour::Samples;
use crate::geometry::{Vec2, turned};
use crate::map::FittedMap;
use crate::uncertainty::Kind;

/// An edge of the samples' grid: its lower left sample, and whether it runs along y.
type Edge = (usize, bool);

/// The walls, and with `sigma_band` the band of that many standard deviations around them.
pub(super) fn walls(
    map: &FittedMap,
    sigma_band: Option<f64>,
    kind: Kind,
) -> (MultiLineString<f64>, Option<MultiPolygon<f64>>) {
    let samples = Samples::over(map);
    let crossings = crossings(map, &samples);
    let lines = chains(&joints(&crossings, samples.size[0]));
    let lines: Vec<Vec<Vec2>> =
        lines.into_iter().map(|line| line.iter().map(|edge| crossings[edge]).collect()).collect();
    let lines = bridged(map, lines);
    let coordinates = |line: &[Vec2]| LineString(line.iter().map(|p| Coord { x: p.x, y: p.y }).collect());
    let band = sigma_band.map(|k| {
        let strips = lines.iter().map(|line| Polygon::new(coordinates(&strip(map, line, k, kind)), Vec::new()));
        MultiPolygon(strips.collect())
    });
    (MultiLineString(lines.iter().map(|line| coordinates(line)).collect()), band)
}

/// The points where walls cross the edges of the grid.
fn crossings(map: &FittedMap, samples: &Samples) -> BTreeMap<Edge, Vec2> {
    let [nx, ny] = samples.size;
    let place = |k: usize| {
        Vec2::new(
            samples.origin[0] + (k % nx) as f64 * samples.step,
            samples.origin[1] + (k / nx) as f64 * samples.step,
        )
    };
    let vectors: Vec<Option<Vec2>> = (0..nx * ny).map(|k| map.field.vector(place(k)).map(|at| at.vector)).collect();
    let mut crossings = BTreeMap::new();
    for k in 0..nx * ny {
        for (along_y, other, inside) in [(false, k + 1, k % nx + 1 < nx), (true, k + nx, k / nx + 1 < ny)] {
            let Some((a, b)) = vectors[k].zip(if inside { vectors[other] } else { None }) else { continue };
            if a.norm().min(b.norm()) > 2.0 * samples.step {
                continue;
            }
            let Some(normal) = wall_normal(map, (place(k) + place(other)) * 0.5) else { continue };
            let (s, t) = (normal.dot(&a), normal.dot(&b));
            if (s < 0.0) != (t < 0.0) {
                crossings.insert((k, along_y), place(k) + (place(other) - place(k)) * (s / (s - t)));
            }
        }
    }
    crossings
}

/// The direction of fastest growth where the field looks like a wall and a surface was met.
fn wall_normal(map: &FittedMap, p: Vec2) -> Option<Vec2> {
    let at = map.field.vector(p).filter(|at| at.divergence() > 0.0)?;
    if !map.evidence.at(map.lattice(), p).surface {
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

/// The ring `k` standard deviations around a line, counter-clockwise.
fn strip(map: &FittedMap, line: &[Vec2], k: f64, kind: Kind) -> Vec<Vec2> {
    let side = |sign: f64| -> Vec<Vec2> {
        (0..line.len())
            .map(|at| {
                let ahead = line[(at + 1).min(line.len() - 1)] - line[at.saturating_sub(1)];
                let across = turned(ahead).try_normalize(0.0).unwrap_or_default();
                let sigma = map.distance(line[at], kind).map_or(0.0, |(_, sigma)| sigma);
                line[at] + across * (sign * k * sigma)
            })
            .collect()
    };
    let mut ring = side(-1.0);
    ring.extend(side(1.0).into_iter().rev());
    ring.push(ring[0]);
    ring
}

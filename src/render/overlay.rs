//! What is drawn over a map: contours, returns, poses, jumps. Each names itself in the legend where it drew something.

use super::contour::Contours;
use super::figure::Figure;
use super::legend::Sample;
use super::text::{number, ordinal};
use crate::fit::Distance;
use crate::geometry::{Pose, Vec2};
use crate::map::FittedMap;

/// Poses drawn at most: more would bury the map.
pub const MOST_POSES: usize = 60;
/// Where neighbours' nearest surface points are farther apart than this many times their own distance, plus this many
/// cells, distance is measured from another surface: the field jumps between them (as in `fit::vector`).
const JUMP: f64 = 1.5;
const SLACK: f64 = 0.5;
/// Neighbours are about this many points apart.
const JUMP_STEP: f64 = 2.0;

/// Draws the level's lines, and its band.
pub fn draw_contours(traced: &Contours, figure: &mut Figure) {
    let (points, colors) = (points_of, figure.colors());
    if let Some((sigmas, band)) = traced.band.as_ref().filter(|(_, band)| !band.0.is_empty()) {
        let style = format!("fill=\"{}\" fill-opacity=\"0.5\"", colors.band);
        for polygon in &band.0 {
            let rings: Vec<Vec<Vec2>> =
                std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(points).collect();
            figure.path(rings.iter().map(Vec::as_slice), true, &style);
        }
        figure.name(&format!("{}-sigma band", number(*sigmas)), Sample::Patch(style));
    }
    let lines: Vec<Vec<Vec2>> = traced.lines.0.iter().map(points).filter(|line| line.len() > 1).collect();
    if lines.is_empty() {
        return;
    }
    let stroke = |color: &str, width: f64| {
        format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"")
    };
    if figure.haloed {
        let halo = stroke(colors.halo, 3.0) + " stroke-opacity=\"0.8\"";
        figure.path(lines.iter().map(Vec::as_slice), false, &halo);
    }
    figure.path(lines.iter().map(Vec::as_slice), false, &stroke(colors.contour, 1.2));
    let name = if traced.level == 0.0 { "contour".into() } else { format!("contour of {} m", number(traced.level)) };
    figure.name(&name, Sample::Line(colors.contour.into()));
}

fn points_of(line: &geo_types::LineString<f64>) -> Vec<Vec2> {
    line.0.iter().map(|c| Vec2::new(c.x, c.y)).collect()
}

/// Draws the returns where the fit's poses put them.
pub(super) fn draw_returns(returns: &[Vec2], figure: &mut Figure) {
    let color = figure.colors().returns;
    figure.dots(returns.iter().copied(), 0.6, color);
    if returns.iter().any(|p| figure.axes.bounds().contains(*p)) {
        figure.name("returns", Sample::Dot(color.into()));
    }
}

/// Draws poses as arrows of one size, however large the map: every so many of them, where there are many.
pub fn draw_poses(poses: &[Pose], figure: &mut Figure) {
    let bounds = figure.axes.bounds();
    let inside: Vec<Pose> = poses.iter().copied().filter(|pose| bounds.contains(pose.position())).collect();
    if inside.is_empty() {
        return;
    }
    let every = inside.len().div_ceil(MOST_POSES);
    let drawn: Vec<Pose> = inside.into_iter().step_by(every).collect();
    let colors = figure.colors();
    let style =
        format!("fill=\"{}\" stroke=\"{}\" stroke-width=\"0.9\" stroke-linejoin=\"round\"", colors.poses, colors.halo);
    figure.darts(&drawn, &format!("class=\"poses\" {style}"));
    let name = if every == 1 { "poses".into() } else { format!("poses, every {}", ordinal(every)) };
    figure.name(&name, Sample::Dart(style));
}

/// Draws where a vector map's field jumps, a cell and more from its surfaces: where another one becomes the nearest. A
/// signed map's does not.
pub(super) fn draw_jumps(map: &FittedMap, figure: &mut Figure) {
    if map.field.distance() != Distance::Vector {
        return;
    }
    let (axes, h) = (figure.axes, map.lattice().resolution);
    let step = (JUMP_STEP * axes.scale).round().max(1.0) as usize;
    let [columns, rows] = [axes.width, axes.height].map(|side| side.div_ceil(step));
    let place = |k: usize| axes.point(step * (k % columns), step * (k / columns));
    let foot = |p: Vec2| map.nearest(p).filter(|foot| map.observed(p) == Some(true) && (p - foot).norm() > h);
    let feet: Vec<Option<Vec2>> = (0..columns * rows).map(|k| foot(place(k))).collect();
    let farthest = JUMP * step as f64 * axes.pixel() + SLACK * h;
    let apart =
        |k: usize, other: usize| feet[k].zip(feet[other]).is_some_and(|(own, next)| (own - next).norm() > farthest);
    let jumps = |&k: &usize| {
        (k % columns + 1 < columns && apart(k, k + 1)) || (k + columns < feet.len() && apart(k, k + columns))
    };
    let jumps: Vec<Vec2> = (0..feet.len()).filter(jumps).map(place).collect();
    if !jumps.is_empty() {
        let color = figure.colors().jumps;
        figure.dots(jumps, 0.5, color);
        figure.name("jumps", Sample::Dot(color.into()));
    }
}

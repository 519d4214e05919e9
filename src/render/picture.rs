//! Pictures of a map: a layer in colour, with overlays, axes in metres and a colour bar.

use colorous::Gradient;

use super::RenderError;
use super::contour::{Contours, contours};
use super::figure::{Axes, Figure};
use super::occupancy::OccupancyGrid;
use crate::fit::Distance;
use crate::geometry::{Pose, Vec2};
use crate::map::FittedMap;
use crate::uncertainty::Kind;

/// What the colours show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    Distance,
    Sigma,
    Occupancy,
}

/// What is drawn over them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlay {
    Contour,
    Points,
    Poses,
}

/// A picture's description.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    pub layer: Layer,
    pub overlays: Vec<Overlay>,
    /// Pixels of the whole figure.
    pub width: usize,
    pub kind: Kind,
    pub title: String,
}

const UNSEEN: [u8; 4] = [214, 214, 214, 255];

/// The picture as SVG.
pub fn map_picture(map: &FittedMap, picture: &Picture) -> Result<String, RenderError> {
    Ok(map_figure(map, picture)?.finish())
}

/// The picture as a figure that more can be drawn into.
pub fn map_figure(map: &FittedMap, picture: &Picture) -> Result<Figure, RenderError> {
    let mut figure = Figure::new(Axes::new(map.lattice().bounds(), picture.width), &picture.title);
    match picture.layer {
        Layer::Distance => distance_layer(map, &mut figure)?,
        Layer::Sigma => sigma_layer(map, picture.kind, &mut figure)?,
        Layer::Occupancy => occupancy_layer(map, picture.kind, &mut figure)?,
    }
    for overlay in &picture.overlays {
        match overlay {
            Overlay::Contour => {
                let traced = contours(map, 0.0, Some(2.0), picture.kind)?;
                draw_contours(&traced, &mut figure);
            }
            Overlay::Points => figure.dots(map.returns.iter().copied(), 0.6, "#d95f02"),
            Overlay::Poses => draw_poses(&map.poses, &mut figure),
        }
    }
    Ok(figure)
}

/// Contours alone, as SVG.
pub fn contour_picture(map: &FittedMap, traced: &Contours, width: usize, title: &str) -> Result<String, RenderError> {
    let mut figure = Figure::new(Axes::new(map.lattice().bounds(), width), title);
    draw_contours(traced, &mut figure);
    Ok(figure.finish())
}

fn distance_layer(map: &FittedMap, figure: &mut Figure) -> Result<(), RenderError> {
    let seen = seen_sample(map, figure.axes, |p| map.distance_and_gradient(p).map(|(u, _)| u));
    let reach = seen.last().copied().unwrap_or(1.0).max(-seen.first().copied().unwrap_or(0.0)).clamp(0.1, 1e6);
    let signed = map.field.distance() == Distance::Signed;
    let color = |u: f64| match signed {
        true => shade(colorous::RED_BLUE, 0.5 - 0.5 * u / reach),
        false => shade(colorous::YELLOW_GREEN_BLUE, u / reach),
    };
    figure.raster(|p| {
        let Some((u, _)) = map.distance_and_gradient(p) else { return UNSEEN };
        let [r, g, b] = color(u);
        if map.evidence.at(map.lattice(), p).any() {
            opaque([r, g, b])
        } else {
            // Extrapolated, so washed out.
            opaque([r, g, b].map(|v| (0.35 * f64::from(v) + 0.65 * 214.0) as u8))
        }
    })?;
    figure.color_bar(if signed { -reach } else { 0.0 }, reach, "distance (m)", color);
    Ok(())
}

fn sigma_layer(map: &FittedMap, kind: Kind, figure: &mut Figure) -> Result<(), RenderError> {
    let at = |p: Vec2| {
        let seen = map.evidence.at(map.lattice(), p).any();
        map.distance(p, kind).filter(|_| seen).map(|(_, sigma)| sigma)
    };
    let seen = seen_sample(map, figure.axes, |p| map.distance(p, kind).map(|(_, sigma)| sigma));
    let high = seen.get(seen.len().saturating_sub(1) * 99 / 100).copied().unwrap_or(1.0).max(1e-6);
    let color = |sigma: f64| shade(colorous::VIRIDIS, sigma / high);
    figure.raster(|p| at(p).map_or(UNSEEN, |sigma| opaque(color(sigma))))?;
    figure.color_bar(0.0, high, "sigma (m)", color);
    Ok(())
}

/// A layer's values where there is evidence, on every fourth pixel, ascending: what a colour scale is chosen from.
fn seen_sample(map: &FittedMap, axes: Axes, value: impl Fn(Vec2) -> Option<f64>) -> Vec<f64> {
    let (rows, columns) = (axes.height.div_ceil(4), axes.width.div_ceil(4));
    let mut seen: Vec<f64> = (0..rows * columns)
        .map(|k| axes.point(4 * (k % columns), 4 * (k / columns)))
        .filter(|&p| map.evidence.at(map.lattice(), p).any())
        .filter_map(value)
        .collect();
    seen.sort_by(f64::total_cmp);
    seen
}

fn occupancy_layer(map: &FittedMap, kind: Kind, figure: &mut Figure) -> Result<(), RenderError> {
    let grid = OccupancyGrid::of(map, map.lattice().resolution, kind);
    let color = |percent: f64| shade(colorous::GREYS, percent / 100.0);
    figure.raster(|p| {
        let cell = |axis: usize, n: usize| {
            (((p[axis] - grid.origin[axis]) / grid.resolution).floor().max(0.0) as usize).min(n - 1)
        };
        match grid.data[cell(0, grid.width) + cell(1, grid.height) * grid.width] {
            -1 => [167, 197, 214, 255],
            percent => opaque(color(f64::from(percent))),
        }
    })?;
    figure.color_bar(0.0, 100.0, "occupied (%)", color);
    Ok(())
}

/// Draws the level's lines, and its band.
pub fn draw_contours(traced: &Contours, figure: &mut Figure) {
    let points = |line: &geo_types::LineString<f64>| line.0.iter().map(|c| Vec2::new(c.x, c.y)).collect::<Vec<_>>();
    if let Some((_, band)) = &traced.band {
        for polygon in &band.0 {
            let rings: Vec<Vec<Vec2>> =
                std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(points).collect();
            figure.path(rings.iter().map(Vec::as_slice), true, "fill=\"#1b9e77\" fill-opacity=\"0.45\"");
        }
    }
    let lines: Vec<Vec<Vec2>> = traced.lines.0.iter().map(points).collect();
    figure.path(lines.iter().map(Vec::as_slice), false, "fill=\"none\" stroke=\"black\" stroke-width=\"1.2\"");
}

/// Draws poses as dots with an arrow where they look.
pub fn draw_poses(poses: &[Pose], figure: &mut Figure) {
    let length = figure.axes.bounds().size()[0] / 40.0;
    let arrows: Vec<[Vec2; 2]> = poses.iter().map(|pose| [pose.position(), pose.project(length, 0.0)]).collect();
    figure.path(
        arrows.iter().map(|arrow| arrow.as_slice()),
        false,
        "fill=\"none\" stroke=\"#7570b3\" stroke-width=\"1.5\"",
    );
    figure.dots(poses.iter().map(|pose| pose.position()), 2.5, "#7570b3");
}

pub(crate) fn shade(gradient: Gradient, t: f64) -> [u8; 3] {
    gradient.eval_continuous(if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 }).as_array()
}

fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

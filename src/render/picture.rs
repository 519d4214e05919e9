//! Pictures of a map: a layer in colour, with overlays, axes in metres, a colour bar, a legend and a scale bar.

use std::cell::Cell;

use super::axes::Axes;
use super::color_bar::ColorScale;
use super::contour::{Contours, contours_while};
use super::figure::Figure;
use super::legend::Sample;
use super::occupancy::OccupancyGrid;
use super::overlay::{draw_contours, draw_jumps, draw_poses, draw_returns};
use super::text::number;
use super::theme::{Ramp, Theme, css, mixed};
use super::{ALWAYS, RenderError, Wanted, asked_seldom, still};
use crate::fit::Distance;
use crate::geometry::Vec2;
use crate::map::{FittedMap, Sweep};
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
    /// Where a vector map's field jumps.
    Jumps,
}

/// What a picture is drawn on.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    pub title: String,
    /// Pixels of the whole figure.
    pub width: usize,
    pub theme: Theme,
    /// Whose sigma is shown.
    pub kind: Kind,
    /// Whether it is one of several on a sheet: type is not the smaller for it.
    pub panel: bool,
}

impl Page {
    /// A light page of the propagated uncertainty.
    pub fn new(title: impl Into<String>, width: usize) -> Self {
        Self { title: title.into(), width, theme: Theme::default(), kind: Kind::default(), panel: false }
    }

    /// An empty figure of a map.
    fn figure(&self, map: &FittedMap, bar: bool) -> Figure {
        let axes = match (self.panel, bar) {
            (false, false) => Axes::new,
            (false, true) => Axes::with_bar,
            (true, false) => Axes::panel,
            (true, true) => Axes::panel_with_bar,
        };
        let mut figure = Figure::themed(axes(map.lattice().bounds(), self.width), &self.title, self.theme);
        figure.subtitle(&self.about(map));
        figure
    }

    /// Which kind of map it is, how fine, and whose sigma.
    fn about(&self, map: &FittedMap) -> String {
        let distance = match map.field.distance() {
            Distance::Signed => "signed",
            Distance::Vector => "vector",
        };
        let kind = match self.kind {
            Kind::Propagated => "propagated",
            Kind::Posterior => "posterior",
        };
        let h = number(map.lattice().resolution);
        format!("h = {h} m, {distance} distance, {kind} sigma")
    }
}

/// A picture's description.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    pub layer: Layer,
    pub overlays: Vec<Overlay>,
    /// Metres a cell of the occupancy; where `None`, as fine as the eye wants and the lattice knows: a quarter of its
    /// own cells, or a pixel where that is larger.
    pub cell: Option<f64>,
    pub page: Page,
}

/// The picture as SVG.
pub fn map_picture(map: &FittedMap, picture: &Picture) -> Result<String, RenderError> {
    map_picture_while(map, picture, ALWAYS)
}

/// The picture as SVG, as long as it is wanted.
pub fn map_picture_while(map: &FittedMap, picture: &Picture, wanted: Wanted) -> Result<String, RenderError> {
    Ok(figure_while(map, picture, wanted)?.finish())
}

/// The picture as a figure that more can be drawn into.
pub fn map_figure(map: &FittedMap, picture: &Picture) -> Result<Figure, RenderError> {
    figure_while(map, picture, ALWAYS)
}

fn figure_while(map: &FittedMap, picture: &Picture, wanted: Wanted) -> Result<Figure, RenderError> {
    let page = &picture.page;
    let mut figure = match picture.layer {
        Layer::Distance => distance_layer(map, page, wanted)?,
        Layer::Sigma => sigma_layer(map, page, wanted)?,
        Layer::Occupancy => occupancy_layer(map, page, picture.cell, wanted)?,
    };
    for overlay in &picture.overlays {
        still(wanted)?;
        match overlay {
            Overlay::Contour => {
                draw_contours(&contours_while(map, 0.0, Some(2.0), page.kind, wanted)?, &mut figure);
            }
            Overlay::Points => draw_returns(&map.returns, &mut figure),
            Overlay::Poses => draw_poses(&map.poses, &mut figure),
            Overlay::Jumps => draw_jumps(map, &mut figure),
        }
    }
    Ok(figure)
}

/// Contours alone, as SVG.
pub fn contour_picture(map: &FittedMap, traced: &Contours, page: &Page) -> String {
    let mut figure = page.figure(map, false);
    draw_contours(traced, &mut figure);
    figure.finish()
}

/// What nobody saw is washed out: it is extrapolated.
const WASHED: f64 = 0.65;

fn distance_layer(map: &FittedMap, page: &Page, wanted: Wanted) -> Result<Figure, RenderError> {
    let mut figure = page.figure(map, true);
    let (theme, signed) = (page.theme, map.field.distance() == Distance::Signed);
    let mut sweep = Sweep::over(map, page.kind);
    let sample = |p| sweep.distance(p).filter(|(_, seen)| *seen).map(|(u, _)| u);
    let seen = seen_sample(figure.axes, wanted, sample)?;
    let scale = if signed { ColorScale::symmetric(&seen, 0.1) } else { ColorScale::of(&seen, 0.1) };
    let ramp = Ramp::of(|share| if signed { theme.signed(share) } else { theme.distance(share) });
    let beyond = Ramp::of(|share| mixed(ramp.at(share), theme.unseen(), WASHED));
    let color = |u: f64| ramp.at(scale.share(u));
    let washed = |u: f64| beyond.at(scale.share(u));
    let ramp = [scale.low, 0.5 * (scale.low + scale.high), scale.high].map(washed);
    let sample = [theme.unseen(), ramp[0], ramp[1], ramp[2]].map(css).into();
    fill(&mut figure, (theme.unseen(), sample), wanted, |p| {
        let (u, seen) = sweep.distance(p)?;
        Some(if seen { Shown::Seen(color(u)) } else { Shown::Beyond(washed(u)) })
    })?;
    figure.color_bar(&scale, "distance (m)", color);
    Ok(figure)
}

fn sigma_layer(map: &FittedMap, page: &Page, wanted: Wanted) -> Result<Figure, RenderError> {
    let mut figure = page.figure(map, true);
    // Near surfaces sigma is least, and its ramp dark.
    figure.haloed = true;
    let theme = page.theme;
    let mut sweep = Sweep::over(map, page.kind);
    let scale = ColorScale::of(&seen_sample(figure.axes, wanted, |p| sweep.seen_sigma(p))?, 1e-6);
    let ramp = Ramp::of(|share| theme.sigma(share));
    fill(&mut figure, (theme.unseen(), vec![css(theme.unseen())]), wanted, |p| {
        sweep.seen_sigma(p).map(|sigma| Shown::Seen(ramp.at(scale.share(sigma))))
    })?;
    // Millimetres where metres would be all zeros.
    let (unit, label) = if scale.high < 0.1 { (1e3, "sigma (mm)") } else { (1.0, "sigma (m)") };
    figure.color_bar(&scale.times(unit), label, |value| ramp.at(scale.share(value / unit)));
    Ok(figure)
}

fn occupancy_layer(map: &FittedMap, page: &Page, cell: Option<f64>, wanted: Wanted) -> Result<Figure, RenderError> {
    let mut figure = page.figure(map, true);
    let cell = cell.unwrap_or_else(|| figure.axes.pixel().max(0.25 * map.lattice().resolution));
    figure.subtitle(&format!("{}, cells of {} m", page.about(map), number((cell * 1e4).round() / 1e4)));
    let theme = page.theme;
    let grid = OccupancyGrid::of_while(map, cell, page.kind, wanted)?;
    let scale = ColorScale::whole(0.0, 100.0);
    let color = |percent: f64| theme.occupancy(scale.share(percent));
    fill(&mut figure, (theme.unknown(), vec![css(theme.unknown())]), wanted, |p| {
        let at = |axis: usize, n: usize| {
            let k = (p[axis] - grid.origin[axis]) / grid.resolution;
            (k >= 0.0 && k < n as f64).then_some(k as usize)
        };
        let percent = grid.data[at(0, grid.width)? + at(1, grid.height)? * grid.width];
        (percent >= 0).then(|| Shown::Seen(color(f64::from(percent))))
    })?;
    figure.color_bar(&scale, "occupied (%)", color);
    Ok(figure)
}

/// A place's colour.
enum Shown {
    Seen([u8; 3]),
    /// What a field says where nobody looked.
    Beyond([u8; 3]),
}

/// Fills the plot, with `unseen` where there is nothing to show, and names what nobody saw, by a sample of its colours.
fn fill(
    figure: &mut Figure,
    (unseen, sample): ([u8; 3], Vec<String>),
    wanted: Wanted,
    mut shown: impl FnMut(Vec2) -> Option<Shown>,
) -> Result<(), RenderError> {
    let (any_unseen, goes_on) = (Cell::new(false), asked_seldom(wanted));
    figure.raster(|p| {
        let [r, g, b] = match goes_on().then(|| shown(p)).flatten() {
            Some(Shown::Seen(color)) => color,
            other => {
                any_unseen.set(true);
                if let Some(Shown::Beyond(color)) = other { color } else { unseen }
            }
        };
        [r, g, b, 255]
    })?;
    still(wanted)?;
    if any_unseen.get() {
        figure.name("unseen", Sample::Stripes(sample));
    }
    Ok(())
}

/// What a layer has to show, on every fourth pixel, ascending: what a colour scale is chosen from.
fn seen_sample(axes: Axes, wanted: Wanted, value: impl FnMut(Vec2) -> Option<f64>) -> Result<Vec<f64>, RenderError> {
    let (rows, columns) = (axes.height.div_ceil(4), axes.width.div_ceil(4));
    let goes_on = asked_seldom(wanted);
    let mut seen: Vec<f64> = (0..rows * columns)
        .map(|k| axes.point(4 * (k % columns), 4 * (k / columns)))
        .take_while(|_| goes_on())
        .filter_map(value)
        .collect();
    still(wanted)?;
    seen.sort_by(f64::total_cmp);
    Ok(seen)
}

//! Where the data lie in a figure.
//!
//! A figure is laid out in points, whatever its size: type of twelve, lines of one. A figure 900 pixels wide has a
//! pixel a point, a wider one in proportion; below 630 pixels a point stays 0.7 pixels, for type smaller than that is
//! not read.

use super::text::round_length;
use crate::geometry::{Bounds, Vec2};

/// The plot's place in the figure, points: what is left, right, and right where there is a colour bar.
pub(super) const LEFT: f64 = 64.0;
const RIGHT: f64 = 18.0;
const BAR: f64 = 88.0;
/// Above and below the plot, about; what a figure takes is known when it is finished.
const ABOVE_AND_BELOW: f64 = 130.0;
/// A figure's pixels at most, and a plot's height over its width at most and at least.
const TALLEST: f64 = 4096.0;
const STEEPEST: f64 = 1.6;
const FLATTEST: f64 = 0.2;
/// A colour bar's name has room beside a plot that is no lower, points.
const LOWEST: f64 = 90.0;
/// The width in pixels of a figure in which a point is a pixel, and a point's pixels at least.
const NATURAL: f64 = 900.0;
const SMALLEST: f64 = 0.7;
/// A scale bar's share of the plot's width at most.
const SCALE_BAR: f64 = 0.2;

/// Where the data's units lie in the plot; y is up in the one and down in the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    bounds: Bounds,
    /// Points a unit, along x and y.
    units: [f64; 2],
    pub(super) labels: [&'static str; 2],
    /// The plot's size in whole pixels.
    pub width: usize,
    pub height: usize,
    /// Pixels a point.
    pub(super) scale: f64,
    /// Left and right of the plot, in whole pixels.
    margins: [f64; 2],
    /// Whether both axes are metres.
    metric: bool,
}

impl Axes {
    /// A map's axes, in metres, over `bounds` in a figure `width` pixels wide.
    pub fn new(bounds: Bounds, width: usize) -> Self {
        Self::of_map(bounds, width, (width as f64 / NATURAL).max(SMALLEST), RIGHT)
    }

    /// The same with room for a colour bar.
    pub fn with_bar(bounds: Bounds, width: usize) -> Self {
        Self::of_map(bounds, width, (width as f64 / NATURAL).max(SMALLEST), BAR)
    }

    /// A map's axes in one of several figures on a sheet, whose type is the sheet's.
    pub fn panel(bounds: Bounds, width: usize) -> Self {
        Self::of_map(bounds, width, 1.0, RIGHT)
    }

    /// The same with room for a colour bar.
    pub fn panel_with_bar(bounds: Bounds, width: usize) -> Self {
        Self::of_map(bounds, width, 1.0, BAR)
    }

    fn of_map(bounds: Bounds, width: usize, scale: f64, right: f64) -> Self {
        let [left, right] = [LEFT, right].map(|margin| (margin * scale).round());
        let room = (width as f64 - left - right).max(32.0);
        let lowest = (LOWEST * scale / room).max(FLATTEST);
        let bounds = no_flatter(bounds, lowest);
        let [x, y] = bounds.size();
        let tallest = (TALLEST - ABOVE_AND_BELOW * scale).min(STEEPEST * room);
        let pixels = (room / x).min(tallest / y);
        let [plot, height] = [x, y].map(|side| ((side * pixels).round() as usize).max(1));
        let spare = (room - plot as f64).max(0.0);
        let margins = [left + (spare / 2.0).floor(), right + (spare / 2.0).ceil()];
        let labels = ["x (m)", "y (m)"];
        Self { bounds, units: [pixels / scale; 2], labels, width: plot, height, scale, margins, metric: true }
    }

    /// A chart's axes, whose units differ, over `bounds` in a figure of so many pixels' width and a plot of so many
    /// pixels' height.
    pub fn chart(bounds: Bounds, [width, height]: [usize; 2], labels: [&'static str; 2]) -> Self {
        let [x, y] = bounds.size();
        let width = width.saturating_sub((LEFT + RIGHT) as usize).max(32);
        let units = [width as f64 / x, height as f64 / y];
        Self { bounds, units, labels, width, height, scale: 1.0, margins: [LEFT, RIGHT], metric: false }
    }

    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// The plot's size in points.
    pub(super) fn plot(&self) -> [f64; 2] {
        [self.width, self.height].map(|side| side as f64 / self.scale)
    }

    /// The whole figure's width, and what of it lies left of the plot, in points.
    pub(super) fn across(&self) -> [f64; 2] {
        let [left, right] = self.margins;
        [self.width as f64 + left + right, left].map(|pixels| pixels / self.scale)
    }

    /// The place of a point in the plot: points from its upper left corner.
    pub(super) fn place(&self, p: Vec2) -> (f64, f64) {
        ((p.x - self.bounds.min[0]) * self.units[0], (self.bounds.max[1] - p.y) * self.units[1])
    }

    /// What lies under the centre of a plot pixel, (0, 0) at the top left.
    pub fn point(&self, column: usize, row: usize) -> Vec2 {
        let along = |pixel: usize, axis: usize| (pixel as f64 + 0.5) / (self.scale * self.units[axis]);
        Vec2::new(self.bounds.min[0] + along(column, 0), self.bounds.max[1] - along(row, 1))
    }

    /// Units a pixel, along x.
    pub(super) fn pixel(&self) -> f64 {
        1.0 / (self.scale * self.units[0])
    }

    /// A round length for a scale bar: in metres and in points. `None` of a chart.
    pub(super) fn scale_bar(&self) -> Option<(f64, f64)> {
        let length = round_length(SCALE_BAR * self.bounds.size()[0]);
        self.metric.then_some((length, length * self.units[0]))
    }
}

/// The rectangle, with as much above and below it as makes it so high for its width.
fn no_flatter(bounds: Bounds, least: f64) -> Bounds {
    let [width, height] = bounds.size();
    let missing = 0.5 * (least * width - height).max(0.0);
    Bounds { min: [bounds.min[0], bounds.min[1] - missing], max: [bounds.max[0], bounds.max[1] + missing] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_as_wide_as_it_was_asked_to_be_however_long_the_map() {
        for side in [[1.0, 1.0], [1.0, 50.0], [50.0, 1.0]] {
            for width in [200, 390, 900, 4096] {
                let axes = Axes::with_bar(Bounds { min: [0.0, 0.0], max: side }, width);
                assert_eq!((axes.across()[0] * axes.scale).round() as usize, width, "{side:?}");
                assert!(axes.height <= 4096 && axes.height as f64 >= 0.15 * axes.width as f64, "{side:?} {axes:?}");
                let corner = axes.place(Vec2::new(axes.bounds().max[0], axes.bounds().min[1]));
                let [x, y] = axes.plot();
                assert!((corner.0 - x).abs() < 1.0 && (corner.1 - y).abs() < 1.0, "the plot is the map");
            }
        }
    }
}

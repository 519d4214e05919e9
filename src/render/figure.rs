//! A figure: axes, a raster or paths in them, a colour bar, a legend. It is an SVG document.

use std::fmt::Write;

use base64::Engine;

use super::raster::FONT;
use super::{RenderError, rgba_png};
use crate::geometry::{Bounds, Vec2};

const LEFT: f64 = 64.0;
const RIGHT: f64 = 96.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 48.0;
/// Figures taller than this are scaled down instead.
const TALLEST: f64 = 4096.0;

/// Where the data's units lie in the picture's pixels; y is up in the one and down in the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    bounds: Bounds,
    /// Pixels a unit, along x and y.
    scale: [f64; 2],
    labels: [&'static str; 2],
    /// The plot's size in whole pixels.
    pub width: usize,
    pub height: usize,
}

impl Axes {
    /// A map's axes, in metres, over `bounds` in a figure `width` pixels wide.
    pub fn new(bounds: Bounds, width: usize) -> Self {
        let [x, y] = bounds.size();
        let room = (width as f64 - LEFT - RIGHT).max(32.0);
        let scale = (room / x).min((TALLEST - TOP - BOTTOM) / y);
        let whole = |side: f64| ((side * scale).round() as usize).max(1);
        Self { bounds, scale: [scale; 2], labels: ["x (m)", "y (m)"], width: whole(x), height: whole(y) }
    }

    /// A chart's axes, whose units differ, over `bounds` in a plot of so many pixels.
    pub fn chart(bounds: Bounds, [width, height]: [usize; 2], labels: [&'static str; 2]) -> Self {
        let [x, y] = bounds.size();
        Self { bounds, scale: [width as f64 / x, height as f64 / y], labels, width, height }
    }

    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// The whole figure's size in pixels.
    pub(super) fn figure_size(&self) -> [f64; 2] {
        [self.width as f64 + LEFT + RIGHT, self.height as f64 + TOP + BOTTOM]
    }

    /// The pixel position of a point.
    pub fn pixel(&self, p: Vec2) -> (f64, f64) {
        (LEFT + (p.x - self.bounds.min[0]) * self.scale[0], TOP + (self.bounds.max[1] - p.y) * self.scale[1])
    }

    /// The point under the centre of a plot pixel, (0, 0) at the top left.
    pub fn point(&self, column: usize, row: usize) -> Vec2 {
        Vec2::new(
            self.bounds.min[0] + (column as f64 + 0.5) / self.scale[0],
            self.bounds.max[1] - (row as f64 + 0.5) / self.scale[1],
        )
    }
}

/// An SVG document under construction.
pub struct Figure {
    pub axes: Axes,
    svg: String,
}

impl Figure {
    pub fn new(axes: Axes, title: &str) -> Self {
        let [width, height] = axes.figure_size();
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FONT}, sans-serif\" font-size=\"12\" fill=\"#222\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        let _ = writeln!(svg, "<text x=\"{LEFT}\" y=\"22\" font-size=\"14\">{}</text>", escaped(title));
        Self { axes, svg }
    }

    /// Fills the plot with one colour a pixel (straight RGBA).
    pub fn raster(&mut self, color: impl Fn(Vec2) -> [u8; 4]) -> Result<(), RenderError> {
        let Axes { width, height, .. } = self.axes;
        let mut pixels = Vec::with_capacity(width * height * 4);
        for row in 0..height {
            for column in 0..width {
                pixels.extend(color(self.axes.point(column, row)));
            }
        }
        let png = rgba_png(width as u32, height as u32, &pixels)?;
        let encoded = base64::engine::general_purpose::STANDARD.encode(png);
        let _ = writeln!(
            self.svg,
            "<image x=\"{LEFT}\" y=\"{TOP}\" width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
             style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{encoded}\"/>"
        );
        Ok(())
    }

    /// Draws polylines as one path, with the given SVG attributes; closed ones are filled by the even-odd rule.
    pub fn path<'a>(&mut self, lines: impl IntoIterator<Item = &'a [Vec2]>, close: bool, attributes: &str) {
        let mut d = String::new();
        for line in lines {
            for (k, p) in line.iter().enumerate() {
                let (x, y) = self.axes.pixel(*p);
                let _ = write!(d, "{}{x:.2} {y:.2}", if k == 0 { 'M' } else { 'L' });
            }
            d.push_str(if close { "Z" } else { "" });
        }
        if !d.is_empty() {
            let _ = writeln!(self.svg, "<path d=\"{d}\" fill-rule=\"evenodd\" {attributes}/>");
        }
    }

    /// Draws dots, one a pixel at most.
    pub fn dots(&mut self, points: impl IntoIterator<Item = Vec2>, radius: f64, color: &str) {
        let places: std::collections::BTreeSet<(i64, i64)> = points
            .into_iter()
            .filter(|p| self.axes.bounds.contains(*p))
            .map(|p| self.axes.pixel(p))
            .map(|(x, y)| ((2.0 * x).round() as i64, (2.0 * y).round() as i64))
            .collect();
        let mut d = String::new();
        for (x, y) in places {
            let _ = write!(d, "M{} {}h0", x as f64 / 2.0, y as f64 / 2.0);
        }
        let width = 2.0 * radius;
        let _ = writeln!(
            self.svg,
            "<path d=\"{d}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>"
        );
    }

    /// A colour bar from `low` to `high` at the right.
    pub fn color_bar(&mut self, low: f64, high: f64, label: &str, color: impl Fn(f64) -> [u8; 3]) {
        let height = (self.axes.height as f64).min(320.0);
        let x = LEFT + self.axes.width as f64 + 16.0;
        let steps = 64;
        for k in 0..steps {
            let value = low + (high - low) * (k as f64 + 0.5) / steps as f64;
            let [r, g, b] = color(value);
            let y = TOP + height * (1.0 - (k + 1) as f64 / steps as f64);
            let tall = height / steps as f64 + 0.5;
            let _ = writeln!(
                self.svg,
                "<rect x=\"{x}\" y=\"{y:.2}\" width=\"12\" height=\"{tall:.2}\" fill=\"rgb({r},{g},{b})\"/>"
            );
        }
        for tick in ticks(low, high, (height / 28.0).clamp(2.0, 6.0)) {
            let y = TOP + height * (1.0 - (tick - low) / (high - low)) + 4.0;
            let _ =
                writeln!(self.svg, "<text x=\"{}\" y=\"{y:.1}\" font-size=\"11\">{}</text>", x + 17.0, number(tick));
        }
        let _ = writeln!(self.svg, "<text x=\"{x}\" y=\"{}\" font-size=\"11\">{}</text>", TOP - 8.0, escaped(label));
    }

    /// Names of what is drawn in which colour, at the right of the plot.
    pub fn legend(&mut self, entries: &[(&str, &str)]) {
        let x = LEFT + self.axes.width as f64 + 8.0;
        for (k, (name, color)) in entries.iter().enumerate() {
            let y = TOP + 10.0 + 16.0 * k as f64;
            let _ = writeln!(
                self.svg,
                "<path d=\"M{x} {y}h14\" stroke=\"{color}\" stroke-width=\"3\"/>\
                 <text x=\"{}\" y=\"{}\" font-size=\"11\">{}</text>",
                x + 18.0,
                y + 4.0,
                escaped(name)
            );
        }
    }

    /// The frame, ticks and labels; the document ends here.
    pub fn finish(mut self) -> String {
        let Axes { bounds, width, height, .. } = self.axes;
        let (right, low) = (LEFT + width as f64, TOP + height as f64);
        let _ = writeln!(
            self.svg,
            "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#222\"/>"
        );
        for tick in ticks(bounds.min[0], bounds.max[0], (width as f64 / 70.0).clamp(2.0, 12.0)) {
            let (x, _) = self.axes.pixel(Vec2::new(tick, 0.0));
            let _ = writeln!(
                self.svg,
                "<path d=\"M{x:.1} {low}v5\" stroke=\"#222\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                low + 18.0,
                number(tick)
            );
        }
        for tick in ticks(bounds.min[1], bounds.max[1], (height as f64 / 50.0).clamp(2.0, 12.0)) {
            let (_, y) = self.axes.pixel(Vec2::new(0.0, tick));
            let _ = writeln!(
                self.svg,
                "<path d=\"M{LEFT} {y:.1}h-5\" stroke=\"#222\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                LEFT - 8.0,
                y + 4.0,
                number(tick)
            );
        }
        let middle = (LEFT + right) / 2.0;
        let [x_label, y_label] = self.axes.labels;
        let _ = writeln!(self.svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{x_label}</text>", low + 38.0);
        let half = (TOP + low) / 2.0;
        let _ = writeln!(
            self.svg,
            "<text x=\"16\" y=\"{half}\" text-anchor=\"middle\" transform=\"rotate(-90 16 {half})\">{y_label}</text>"
        );
        self.svg.push_str("</svg>\n");
        self.svg
    }
}

/// Round numbers between `low` and `high`, about `count` of them: steps of 1, 2 or 5 times a power of ten.
fn ticks(low: f64, high: f64, count: f64) -> Vec<f64> {
    let raw = (high - low) / count;
    if !(raw.is_finite() && raw > 0.0) {
        return vec![low];
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw).unwrap_or(power * 10.0);
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|k| k as f64 * step).collect()
}

fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded < 0.0 { format!("\u{2212}{}", -rounded) } else { format!("{}", rounded.abs()) }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .chars()
        .filter(|c| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}'))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(-0.6, 8.6, 6.0), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(ticks(0.0, 0.03, 3.0), [0.0, 0.01, 0.02, 0.03]);
        assert_eq!(ticks(1.0, 1.0, 5.0), [1.0]);
    }
}

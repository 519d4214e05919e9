//! A figure: axes, a raster or paths in them, a colour bar, a legend, a scale bar. It is an SVG document, laid out in
//! points (see `axes`).

use std::collections::BTreeSet;
use std::fmt::Write;

use base64::Engine;

use super::axes::{Axes, LEFT};
use super::color_bar::{ColorScale, color_bar};
use super::legend::{Entry, ROW, Sample, corner, dart, rows};
use super::raster::FONT;
use super::text::{escaped, number, shortened, ticks};
use super::theme::{Colors, Theme};
use super::{RenderError, rgba_png};
use crate::geometry::{Pose, Vec2};

/// Points: above the plot, without and with a second line of title; below it, for ticks, labels and the scale bar.
const ABOVE: [f64; 2] = [36.0, 52.0];
const BELOW: f64 = 48.0;
/// Below the legend.
const FOOT: f64 = 8.0;
/// Dots are told apart to half a point.
const DOT_STEP: f64 = 0.5;

/// An SVG document under construction.
pub struct Figure {
    pub axes: Axes,
    pub(super) theme: Theme,
    /// Whether contours need a halo to be seen on what fills the plot.
    pub(super) haloed: bool,
    title: String,
    subtitle: String,
    body: String,
    legend: Vec<Entry>,
    legend_in_corner: bool,
}

impl Figure {
    pub fn new(axes: Axes, title: &str) -> Self {
        Self::themed(axes, title, Theme::Light)
    }

    pub fn themed(axes: Axes, title: &str, theme: Theme) -> Self {
        let (title, subtitle, body) = (title.to_owned(), String::new(), String::new());
        Self { axes, theme, haloed: false, title, subtitle, body, legend: Vec::new(), legend_in_corner: false }
    }

    /// A second line of title, smaller.
    pub fn subtitle(&mut self, text: &str) {
        text.clone_into(&mut self.subtitle);
    }

    pub(super) fn colors(&self) -> &'static Colors {
        self.theme.colors()
    }

    /// Fills the plot with one colour a pixel (straight RGBA).
    pub fn raster(&mut self, mut color: impl FnMut(Vec2) -> [u8; 4]) -> Result<(), RenderError> {
        let Axes { width, height, .. } = self.axes;
        let mut pixels = Vec::with_capacity(width * height * 4);
        for row in 0..height {
            for column in 0..width {
                pixels.extend(color(self.axes.point(column, row)));
            }
        }
        let png = rgba_png(width as u32, height as u32, &pixels)?;
        let encoded = base64::engine::general_purpose::STANDARD.encode(png);
        let [width, height] = self.axes.plot();
        let _ = writeln!(
            self.body,
            "<image width=\"{width:.4}\" height=\"{height:.4}\" preserveAspectRatio=\"none\" \
             style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{encoded}\"/>"
        );
        Ok(())
    }

    /// Draws polylines as one path, with the given SVG attributes; closed ones are filled by the even-odd rule.
    pub fn path<'a>(&mut self, lines: impl IntoIterator<Item = &'a [Vec2]>, close: bool, attributes: &str) {
        let mut d = String::new();
        for line in lines {
            for (k, p) in line.iter().enumerate() {
                let (x, y) = self.axes.place(*p);
                let _ = write!(d, "{}{x:.2} {y:.2}", if k == 0 { 'M' } else { 'L' });
            }
            d.push_str(if close { "Z" } else { "" });
        }
        if !d.is_empty() {
            let _ = writeln!(self.body, "<path d=\"{d}\" fill-rule=\"evenodd\" {attributes}/>");
        }
    }

    /// Draws dots, one a place at most.
    pub fn dots(&mut self, points: impl IntoIterator<Item = Vec2>, radius: f64, color: &str) {
        let places: BTreeSet<(i64, i64)> = points
            .into_iter()
            .filter(|p| self.axes.bounds().contains(*p))
            .map(|p| self.axes.place(p))
            .map(|(x, y)| ((x / DOT_STEP).round() as i64, (y / DOT_STEP).round() as i64))
            .collect();
        let mut d = String::new();
        for (x, y) in places {
            let _ = write!(d, "M{} {}h0", x as f64 * DOT_STEP, y as f64 * DOT_STEP);
        }
        let width = 2.0 * radius;
        if !d.is_empty() {
            let _ = writeln!(
                self.body,
                "<path d=\"{d}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>"
            );
        }
    }

    /// Draws arrows of one size where somebody stood, whichever way he looked.
    pub(super) fn darts(&mut self, poses: &[Pose], attributes: &str) {
        let place = |pose: &Pose| dart(self.axes.place(pose.position()).into(), -pose.theta);
        let d: String = poses.iter().map(place).collect();
        let _ = writeln!(self.body, "<path d=\"{d}\" {attributes}/>");
    }

    /// What the colours mean, at the right of a plot that has room for it there.
    pub fn color_bar(&mut self, scale: &ColorScale, label: &str, color: impl Fn(f64) -> [u8; 3]) {
        self.body.push_str(&color_bar(self.axes.plot(), self.theme, scale, label, color));
    }

    /// Names of lines by their colours.
    pub fn legend(&mut self, entries: &[(&str, &str)]) {
        for (name, color) in entries {
            self.name(name, Sample::Line((*color).to_owned()));
        }
    }

    /// Names of dots by their colours.
    pub fn legend_of_dots(&mut self, entries: &[(&str, &str)]) {
        for (name, color) in entries {
            self.name(name, Sample::Dot((*color).to_owned()));
        }
    }

    /// Names what is drawn, once.
    pub(super) fn name(&mut self, name: &str, sample: Sample) {
        if !self.legend.iter().any(|(known, _)| known == name) {
            self.legend.push((name.to_owned(), sample));
        }
    }

    /// Puts the legend into the plot's upper right corner, for plots that have nothing there.
    pub fn legend_in_corner(&mut self) {
        self.legend_in_corner = true;
    }

    /// The figure's size in pixels.
    pub(super) fn size(&self) -> [f64; 2] {
        let scale = self.axes.scale;
        let [_, plot] = self.axes.plot();
        let (_, below) = self.below();
        [self.axes.across()[0] * scale, (self.above() + plot + below) * scale].map(f64::round)
    }

    /// What is above the plot: whole pixels, so that the raster's pixels are the picture's.
    fn above(&self) -> f64 {
        let above = ABOVE[usize::from(!self.subtitle.is_empty())];
        (above * self.axes.scale).round() / self.axes.scale
    }

    /// The legend below the plot, and how much is below it.
    fn below(&self) -> (String, f64) {
        let [_, height] = self.axes.plot();
        if self.legend_in_corner {
            return (corner(&self.legend, self.axes.plot()[0], self.colors()), BELOW);
        }
        let [width, left] = self.axes.across();
        let (legend, rows) = rows(&self.legend, width - left - FOOT, height + BELOW + ROW / 2.0, self.colors());
        let deep = if rows == 0 { 0.0 } else { ROW * rows as f64 + FOOT };
        (legend, BELOW + deep)
    }

    /// The document ends here.
    pub fn finish(self) -> String {
        let ([pixels_wide, pixels_high], scale, colors) = (self.size(), self.axes.scale, self.colors());
        let ([wide, left], high, above) = (self.axes.across(), pixels_high / scale, self.above());
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{pixels_wide}\" height=\"{pixels_high}\" \
             viewBox=\"0 0 {wide:.4} {high:.4}\" font-family=\"{FONT}, sans-serif\" font-size=\"12\" fill=\"{}\">\n\
             <rect class=\"page\" width=\"100%\" height=\"100%\" fill=\"{}\"/>\n",
            colors.ink, colors.page
        );
        let from = LEFT.min(left);
        for (text, size, y, fill) in [(&self.title, 15.0, 23.0, colors.ink), (&self.subtitle, 11.0, 41.0, colors.faint)]
        {
            if !text.is_empty() {
                let text = escaped(&shortened(text, size, wide - from - FOOT));
                let _ =
                    writeln!(svg, "<text x=\"{from}\" y=\"{y}\" font-size=\"{size}\" fill=\"{fill}\">{text}</text>");
            }
        }
        let _ = writeln!(svg, "<g class=\"plot\" transform=\"translate({left:.4} {above:.4})\">");
        svg.push_str(&self.body);
        svg.push_str(&self.frame());
        svg.push_str(&self.below().0);
        svg.push_str("</g>\n</svg>\n");
        svg
    }

    /// The frame, ticks and labels, and the scale bar.
    fn frame(&self) -> String {
        let ([width, height], bounds, ink) = (self.axes.plot(), self.axes.bounds(), self.colors().ink);
        let mut svg = format!(
            "<rect class=\"frame\" width=\"{width:.4}\" height=\"{height:.4}\" fill=\"none\" stroke=\"{ink}\"/>\n"
        );
        for tick in ticks(bounds.min[0], bounds.max[0], (width / 70.0).clamp(2.0, 12.0)) {
            let (x, _) = self.axes.place(Vec2::new(tick, 0.0));
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {height:.2}v5\" stroke=\"{ink}\"/>\
                 <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                height + 18.0,
                number(tick)
            );
        }
        for tick in ticks(bounds.min[1], bounds.max[1], (height / 50.0).clamp(2.0, 12.0)) {
            let (_, y) = self.axes.place(Vec2::new(0.0, tick));
            let _ = writeln!(
                svg,
                "<path d=\"M0 {y:.1}h-5\" stroke=\"{ink}\"/>\
                 <text x=\"-8\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                y + 4.0,
                number(tick)
            );
        }
        let ([x_label, y_label], half, low) = (self.axes.labels, height / 2.0, height + 38.0);
        // A narrow plot's scale bar wants the room right of the label.
        let (middle, anchor) = if width < 240.0 { (0.0, "start") } else { (width / 2.0, "middle") };
        let _ = writeln!(
            svg,
            "<text x=\"{middle:.1}\" y=\"{low:.1}\" text-anchor=\"{anchor}\">{x_label}</text>\
             <text x=\"-48\" y=\"{half:.1}\" text-anchor=\"middle\" \
             transform=\"rotate(-90 -48 {half:.1})\">{y_label}</text>"
        );
        if let Some((metres, long)) = self.axes.scale_bar() {
            svg.push_str(&self.scale_bar(metres, long));
        }
        svg
    }

    /// So many metres, right below the plot's right end; half of it filled.
    fn scale_bar(&self, metres: f64, long: f64) -> String {
        let ([width, height], ink) = (self.axes.plot(), self.colors().ink);
        let (x, y) = (width - long, height + 30.0);
        format!(
            "<g class=\"scale-bar\"><rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{long:.2}\" height=\"5\" fill=\"{}\" \
             stroke=\"{ink}\" stroke-width=\"0.8\"/><rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{:.2}\" height=\"5\" \
             fill=\"{ink}\"/><text x=\"{:.2}\" y=\"{:.2}\" font-size=\"11\" text-anchor=\"end\">{} m</text></g>\n",
            self.colors().page,
            long / 2.0,
            x - 6.0,
            y + 7.0,
            number(metres)
        )
    }
}

//! Names of what is drawn, each beside a sample of it: in rows below the plot, or in a corner of it that is empty.

use std::fmt::Write;

use super::text::{escaped, width};
use super::theme::Colors;

/// How a sample looks.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Sample {
    Line(String),
    Patch(String),
    /// Colours beside each other.
    Stripes(Vec<String>),
    Dot(String),
    Dart(String),
}

pub(super) type Entry = (String, Sample);

const SIZE: f64 = 11.0;
const SAMPLE: f64 = 18.0;
const GAP: f64 = 18.0;
/// From one row to the next, points.
pub(super) const ROW: f64 = 18.0;

/// Entries in rows no wider than `room`, the first row's middle at `y`; and how many rows there are.
pub(super) fn rows(entries: &[Entry], room: f64, y: f64, colors: &Colors) -> (String, usize) {
    let (mut svg, mut x, mut row) = (String::new(), 0.0, 0);
    for entry in entries {
        let own = SAMPLE + 6.0 + width(&entry.0, SIZE);
        if x > 0.0 && x + own > room {
            (x, row) = (0.0, row + 1);
        }
        write_entry(&mut svg, entry, [x, y + ROW * row as f64], colors);
        x += own + GAP;
    }
    (group(&svg), if entries.is_empty() { 0 } else { row + 1 })
}

/// Entries below each other in the upper right corner of a plot.
pub(super) fn corner(entries: &[Entry], plot_width: f64, colors: &Colors) -> String {
    let widest = entries.iter().map(|(name, _)| width(name, SIZE)).fold(0.0, f64::max);
    let x = plot_width - 12.0 - SAMPLE - 6.0 - widest;
    let mut svg = String::new();
    for (k, entry) in entries.iter().enumerate() {
        write_entry(&mut svg, entry, [x, 18.0 + ROW * k as f64], colors);
    }
    group(&svg)
}

fn group(entries: &str) -> String {
    if entries.is_empty() {
        String::new()
    } else {
        format!("<g class=\"legend\" font-size=\"{SIZE}\">\n{entries}</g>\n")
    }
}

fn write_entry(svg: &mut String, (name, sample): &Entry, [x, y]: [f64; 2], colors: &Colors) {
    let middle = x + SAMPLE / 2.0;
    let _ = match sample {
        Sample::Line(color) => write!(svg, "<path d=\"M{x:.1} {y}h{SAMPLE}\" stroke=\"{color}\" stroke-width=\"2\"/>"),
        Sample::Patch(fill) => write!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{}\" width=\"{SAMPLE}\" height=\"10\" {fill} stroke=\"{}\" stroke-width=\"0.5\"/>",
            y - 5.0,
            colors.faint
        ),
        Sample::Stripes(colors) => {
            let wide = SAMPLE / colors.len() as f64;
            colors.iter().zip(0..).try_for_each(|(color, k)| {
                let (x, y) = (x + wide * f64::from(k), y - 5.0);
                write!(svg, "<rect x=\"{x:.2}\" y=\"{y}\" width=\"{wide:.2}\" height=\"10\" fill=\"{color}\"/>")
            })
        }
        Sample::Dot(color) => write!(svg, "<circle cx=\"{middle:.1}\" cy=\"{y}\" r=\"2.2\" fill=\"{color}\"/>"),
        Sample::Dart(style) => write!(svg, "<path d=\"{}\" {style}/>", dart([middle, y], 0.0)),
    };
    let _ = writeln!(svg, "<text x=\"{:.1}\" y=\"{}\">{}</text>", x + SAMPLE + 6.0, y + 4.0, escaped(name));
}

/// An arrow without a shaft, eleven points long, about a place, that looks along an angle (y down).
pub(super) fn dart([x, y]: [f64; 2], angle: f64) -> String {
    let (sin, cos) = angle.sin_cos();
    let corners = [[6.5, 0.0], [-4.5, 3.6], [-2.2, 0.0], [-4.5, -3.6]];
    let place = corners.map(|[a, b]| format!("{:.2} {:.2}", x + cos * a - sin * b, y + sin * a + cos * b));
    format!("M{}Z", place.join("L"))
}

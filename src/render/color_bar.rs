//! What the colours mean: a bar as tall as the map, with an arrow where values lie beyond its end.

use std::fmt::Write;

use super::text::{escaped, number, ticks, width};
use super::theme::{Theme, css};

/// Percentiles of what was seen at which a scale begins and ends: a few odd places do not take the colours of all.
const PERCENTILES: [usize; 2] = [2, 98];
/// A scale that begins so near to zero, for its end, begins there.
const NEAR_ZERO: f64 = 0.1;
/// Points: from the plot, the bar's width, an arrow's length.
const GAP: f64 = 14.0;
const THICK: f64 = 12.0;
const ARROW: f64 = 12.0;
const STEPS: usize = 128;

/// Where a scale of colours begins and ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorScale {
    pub low: f64,
    pub high: f64,
    /// Whether there are values below and above, which have the colours of the ends.
    pub beyond: [bool; 2],
}

impl ColorScale {
    /// From end to end, with nothing beyond.
    pub fn whole(low: f64, high: f64) -> Self {
        Self { low, high, beyond: [false; 2] }
    }

    /// Of values that are never negative, ascending. It spans `least` or more.
    pub(super) fn of(seen: &[f64], least: f64) -> Self {
        let [low, high] = PERCENTILES.map(|percent| percentile(seen, percent));
        let low = if low <= NEAR_ZERO * high { 0.0 } else { low };
        Self::around(low, high.max(low + least), seen)
    }

    /// Of values of both signs, ascending, as far to either side of zero.
    pub(super) fn symmetric(seen: &[f64], least: f64) -> Self {
        let reach = PERCENTILES.map(|percent| percentile(seen, percent).abs()).into_iter().fold(least, f64::max);
        Self::around(-reach, reach, seen)
    }

    fn around(low: f64, high: f64, seen: &[f64]) -> Self {
        let beyond = [seen.first().is_some_and(|v| *v < low), seen.last().is_some_and(|v| *v > high)];
        Self { low, high, beyond }
    }

    /// In another unit.
    pub(super) fn times(self, factor: f64) -> Self {
        Self { low: factor * self.low, high: factor * self.high, ..self }
    }

    /// From 0 where it begins to 1 where it ends.
    pub fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

fn percentile(ascending: &[f64], percent: usize) -> f64 {
    let last = ascending.len().saturating_sub(1);
    ascending.get((last * percent + 50) / 100).copied().unwrap_or(0.0)
}

/// The bar of a plot of that size, drawn from the plot's upper left corner.
pub(super) fn color_bar(
    [plot_width, height]: [f64; 2],
    theme: Theme,
    scale: &ColorScale,
    label: &str,
    color: impl Fn(f64) -> [u8; 3],
) -> String {
    let (x, right) = (plot_width + GAP, plot_width + GAP + THICK);
    let arrow = ARROW.min(height / 6.0);
    let [bottom, top] = [height - if scale.beyond[0] { arrow } else { 0.0 }, if scale.beyond[1] { arrow } else { 0.0 }];
    let tall = bottom - top;
    let mut svg = String::from("<g class=\"color-bar\">\n");
    for k in 0..STEPS {
        let share = |k: usize| k as f64 / STEPS as f64;
        let fill = css(color(scale.low + (scale.high - scale.low) * (share(k) + 0.5 / STEPS as f64)));
        // Each reaches under the one before, lest the page shine through between them.
        let y = bottom - tall * share(k + 1);
        let deep = (tall / STEPS as f64 + 1.5).min(bottom - y);
        let _ = writeln!(svg, "<rect x=\"{x}\" y=\"{y:.2}\" width=\"{THICK}\" height=\"{deep:.2}\" fill=\"{fill}\"/>");
    }
    let middle = x + THICK / 2.0;
    let mut arrow = |class: &str, from: f64, tip: f64, fill: String| {
        let _ =
            writeln!(svg, "<path class=\"{class}\" d=\"M{x} {from:.2}H{right}L{middle} {tip:.2}Z\" fill=\"{fill}\"/>");
    };
    if scale.beyond[1] {
        arrow("above", top, 0.0, css(color(scale.high)));
    }
    if scale.beyond[0] {
        arrow("below", bottom, height, css(color(scale.low)));
    }
    let ink = theme.colors().ink;
    let _ = writeln!(
        svg,
        "<path class=\"outline\" d=\"M{x} {top:.2}L{middle} 0L{right} {top:.2}V{bottom:.2}\
         L{middle} {height:.2}L{x} {bottom:.2}Z\" \
         fill=\"none\" stroke=\"{ink}\" stroke-width=\"0.8\"/>"
    );
    let mut widest: f64 = 0.0;
    for tick in ticks(scale.low, scale.high, (tall / 40.0).clamp(2.0, 8.0)) {
        let (y, text) = (bottom - tall * scale.share(tick), number(tick));
        widest = widest.max(width(&text, 11.0));
        let _ = writeln!(
            svg,
            "<path d=\"M{right} {y:.2}h4\" stroke=\"{ink}\" stroke-width=\"0.8\"/>\
             <text x=\"{}\" y=\"{:.2}\" font-size=\"11\">{text}</text>",
            right + 7.0,
            y + 4.0
        );
    }
    let (aside, half) = (right + 7.0 + widest + 12.0, height / 2.0);
    let _ = writeln!(
        svg,
        "<text x=\"{aside:.1}\" y=\"{half:.1}\" font-size=\"11\" text-anchor=\"middle\" \
         transform=\"rotate(-90 {aside:.1} {half:.1})\">{}</text>\n</g>",
        escaped(label)
    );
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_run_from_the_second_to_the_ninety_eighth_percentile() {
        let seen: Vec<f64> = (0..=100).map(|k| 1.0 + f64::from(k) / 100.0).collect();
        let scale = ColorScale::of(&seen, 1e-6);
        assert_eq!((scale.low, scale.high, scale.beyond), (1.02, 1.98, [true, true]));
        assert_eq!((scale.share(1.02), scale.share(1.98)), (0.0, 1.0));
    }

    #[test]
    fn a_scale_that_nearly_begins_at_zero_does_and_cuts_nothing_off_there() {
        let seen: Vec<f64> = (0..=100).map(|k| f64::from(k) / 100.0).collect();
        let scale = ColorScale::of(&seen, 1e-6);
        assert_eq!((scale.low, scale.high, scale.beyond), (0.0, 0.98, [false, true]));
    }

    #[test]
    fn signed_scales_are_as_long_to_either_side_and_nothing_seen_is_no_trouble() {
        let seen: Vec<f64> = (-100..=10).map(f64::from).collect();
        let scale = ColorScale::symmetric(&seen, 0.1);
        assert_eq!((scale.low, scale.high, scale.beyond), (-98.0, 98.0, [true, false]));
        assert_eq!(ColorScale::of(&[], 0.1), ColorScale::whole(0.0, 0.1));
        assert_eq!(ColorScale::symmetric(&[], 0.1), ColorScale::whole(-0.1, 0.1));
        let even = ColorScale::of(&[0.5; 9], 1e-3);
        assert_eq!((even.low, even.high, even.beyond), (0.5, 0.501, [false, false]));
    }
}

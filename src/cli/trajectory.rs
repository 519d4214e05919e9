//! The picture of located scans: the map's contour, where each scan was taken and where it looked, and its 95 % ellipse.
//!
//! Sigmas of a centimetre are not to be seen in a building of fifty metres, so ellipses are drawn larger by a round factor,
//! which the title states.

use serde_json::Value;

use crate::geometry::{Bounds, Cov2, Vec2};
use crate::render::{Axes, Figure};

/// The root of the chi squared quantile that holds 95 %, of two degrees of freedom.
const ELLIPSE: f64 = 2.448;
/// The picture's width in pixels, and metres around what it shows.
const WIDTH: usize = 1200;
const MARGIN: f64 = 1.0;
/// By what ellipses are enlarged, so that half of them are this share of the picture's longer side at least.
const FACTORS: [f64; 7] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];
const LEAST_SHARE: f64 = 0.006;
/// The length of a heading's stroke, as such a share.
const HEADING: f64 = 0.012;
const POSE: &str = "#1f77b4";

/// A located scan's pose and the covariance of its position.
pub struct Placed {
    at: Vec2,
    heading: Vec2,
    pub covariance: Cov2,
}

impl Placed {
    /// Of a scan as the service answers it; `None` where it fits nowhere.
    pub fn of(own: &Value) -> Option<Self> {
        let (c, pose) = (|k: usize| own["covariance"][k].as_f64(), |axis: &str| own["pose"][axis].as_f64());
        let theta = pose("theta")?;
        Some(Self {
            at: Vec2::new(pose("x")?, pose("y")?),
            heading: Vec2::new(theta.cos(), theta.sin()),
            covariance: Cov2::new(c(0)?, c(1)?, c(3)?, c(4)?),
        })
    }

    /// The 95 % ellipse's longer half-axis, metres.
    fn reach(&self) -> f64 {
        ELLIPSE * self.covariance.symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// The outline of the 95 % ellipse, so many times as large.
    fn ellipse(&self, factor: f64) -> Vec<Vec2> {
        let eigen = self.covariance.symmetric_eigen();
        let axes = eigen.eigenvectors * Cov2::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
        let turns = (0..=48).map(|k| f64::from(k) * std::f64::consts::TAU / 48.0);
        turns.map(|turn| self.at + axes * Vec2::new(turn.cos(), turn.sin()) * (factor * ELLIPSE)).collect()
    }
}

/// The picture, SVG. `contour` is the service's GeoJSON, `located` its answers, in the order of the way.
pub fn picture(contour: &Value, located: &[Value]) -> String {
    let lines = lines(contour);
    let placed: Vec<Placed> = located.iter().filter_map(Placed::of).collect();
    let way: Vec<Vec2> = placed.iter().map(|place| place.at).collect();
    let shown = lines.iter().flatten().chain(&way).copied();
    let bounds = Bounds::around(shown).unwrap_or(Bounds { min: [0.0, 0.0], max: [1.0, 1.0] }).grown(MARGIN);
    let [width, height] = bounds.size();
    let side = width.max(height);
    let factor = enlarged(&placed, LEAST_SHARE * side);
    let drawn = if factor > 1.0 { format!(", {factor:.0} times as large") } else { String::new() };
    let title = format!("{} of {} scans located; 95 % ellipses{drawn}", placed.len(), located.len());

    let mut figure = Figure::new(Axes::new(bounds, WIDTH), &title);
    figure.path(lines.iter().map(Vec::as_slice), false, "fill=\"none\" stroke=\"#555\" stroke-width=\"1\"");
    let style = format!("fill=\"none\" stroke=\"{POSE}\" stroke-width=\"1\" stroke-opacity=\"0.35\"");
    figure.path([way.as_slice()], false, &style);
    let style = "fill=\"#d62728\" fill-opacity=\"0.25\" stroke=\"#d62728\" stroke-width=\"0.8\"";
    placed.iter().for_each(|place| figure.path([place.ellipse(factor).as_slice()], true, style));
    let style = format!("fill=\"none\" stroke=\"{POSE}\" stroke-width=\"1.6\"");
    let strokes: Vec<[Vec2; 2]> = placed.iter().map(|own| [own.at, own.at + own.heading * (HEADING * side)]).collect();
    figure.path(strokes.iter().map(<[Vec2; 2]>::as_slice), false, &style);
    figure.dots(way, 2.2, POSE);
    figure.finish()
}

fn lines(contour: &Value) -> Vec<Vec<Vec2>> {
    let point = |p: &Value| Some(Vec2::new(p[0].as_f64()?, p[1].as_f64()?));
    let line = |line: &Value| line.as_array().map(|points| points.iter().filter_map(point).collect::<Vec<_>>());
    let lines = contour["features"][0]["geometry"]["coordinates"].as_array();
    lines.map(|lines| lines.iter().filter_map(line).collect()).unwrap_or_default()
}

/// The least factor that makes half of the ellipses as large as `least`, metres.
fn enlarged(placed: &[Placed], least: f64) -> f64 {
    let mut reaches: Vec<f64> = placed.iter().map(Placed::reach).collect();
    reaches.sort_by(f64::total_cmp);
    let median = reaches.get(reaches.len() / 2).copied().unwrap_or(least);
    FACTORS.into_iter().find(|factor| factor * median >= least).unwrap_or(FACTORS[FACTORS.len() - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_ellipses_are_enlarged_by_a_round_factor_and_large_ones_are_not() {
        let placed =
            |sigma: f64| Placed { at: Vec2::zeros(), heading: Vec2::x(), covariance: Cov2::identity() * sigma * sigma };
        let factor = |sigma: f64| enlarged(&[placed(sigma), placed(sigma), placed(10.0 * sigma)], 0.3);
        assert_eq!([factor(0.2), factor(0.01), factor(1e-6)], [1.0, 20.0, 100.0]);
        assert_eq!(enlarged(&[], 0.3), 1.0);
    }
}

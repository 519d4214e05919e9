//! Figure 4: the error of the direct least-squares spline of the true signed distance, at several spacings.

use super::{LARGEST_LATTICE, Plate, ReproduceError, compared, room};
use crate::fit::least_squares;
use crate::geometry::{Bounds, Vec2};
use crate::render::{Axes, ColorScale, Figure, Sheet, shade};
use crate::sim::Scenario;
use crate::sparse::{Cholesky, Pattern, Stencil};
use crate::spline::{Lattice, Surface};

const SPACINGS: [f64; 3] = [0.4, 0.2, 0.1];
const COLORS: [&str; 3] = ["#d95f02", "#7570b3", "#1b9e77"];
/// Distances from the cut locus, metres, by which the error is told apart.
const REACHES: [f64; 9] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8];
/// A panel's width in pixels, and the chart's height: that of the maps beside it.
const WIDTH: usize = 640;
const CHART: usize = 488;
/// The colour scale's ends, powers of ten of a metre.
const SCALE: [f64; 2] = [-5.0, -1.0];

pub fn errors_of_direct_splines(scenario: &Scenario) -> Result<Plate, ReproduceError> {
    let inside = samples(scenario);
    let apart: Vec<usize> = inside
        .iter()
        .map(|&p| REACHES.iter().rposition(|&reach| reach == 0.0 || scenario.world.is_smooth(p, reach)).unwrap_or(0))
        .collect();
    let mut sheet = Sheet::new("Figure 4: error of the least-squares spline of the exact signed distance");
    let (mut curves, mut totals) = (Vec::new(), Vec::new());
    for (k, h) in SPACINGS.into_iter().enumerate() {
        let surface = direct_spline(scenario, h)?;
        let error = |p: Vec2| surface.value(p).map_or(0.0, |u| u - scenario.world.signed_distance(p));
        let panel = error_map(scenario, h, error)?;
        // Three maps and the chart: two rows of two.
        sheet = if k == 2 { sheet.below(panel) } else { sheet.with(panel) };
        let squares: Vec<f64> = inside.iter().map(|&p| error(p).powi(2)).collect();
        curves.push(by_distance(&squares, &apart));
        totals.push((squares.iter().sum::<f64>() / squares.len() as f64).sqrt());
    }
    let sheet = sheet.with(chart(&curves));
    let last = REACHES.len() - 1;
    let measured =
        |curve: &[f64]| format!("{:.1} mm on it, {:.2} mm {} m off", 1e3 * curve[0], 1e3 * curve[last], REACHES[last]);
    Ok(Plate {
        name: "figure-04".into(),
        title: "What a spline can hold of the true distance".into(),
        caption: "Error of the least-squares spline of the exact signed distance, h = 0.4, 0.2 and 0.1 m: no noise, no fit, the limit of \
                  the basis. Last, rms error inside the room by distance from the cut locus (where two walls are equally near)."
            .into(),
        svg: sheet.finish(),
        compared: vec![
            compared(
                "The error grows towards the cut locus.",
                SPACINGS.iter().zip(&curves).map(|(h, curve)| format!("h = {h}: {}", measured(curve))).collect::<Vec<_>>().join("; ") + ".",
            ),
            compared(
                "The error falls with h.",
                format!("rms inside: {:.1}, {:.1} and {:.1} mm.", 1e3 * totals[0], 1e3 * totals[1], 1e3 * totals[2]),
            ),
        ],
    })
}

fn direct_spline(scenario: &Scenario, h: f64) -> Result<Surface, ReproduceError> {
    let lattice = Lattice::covering(&scenario.bounds, h, LARGEST_LATTICE)?;
    let mut cholesky = Cholesky::analyse(&Pattern::of_stencil(&Stencil::of(&lattice)))?;
    Ok(least_squares(&lattice, 0.0, &mut cholesky, |_, p| scenario.world.signed_distance(p))?)
}

/// Points inside the room, 5 cm apart.
fn samples(scenario: &Scenario) -> Vec<Vec2> {
    let bounds = scenario.world.bounds();
    let [width, height] = bounds.size().map(|side| (side / 0.05) as usize);
    (0..width * height)
        .map(|k| Vec2::new(0.025 + 0.05 * (k % width) as f64, 0.025 + 0.05 * (k / width) as f64))
        .map(|p| p + Vec2::from(bounds.min))
        .filter(|&p| scenario.world.is_free(p))
        .collect()
}

/// Rms of the points that are about so far from the cut locus.
fn by_distance(squares: &[f64], apart: &[usize]) -> Vec<f64> {
    let own = |k: usize| squares.iter().zip(apart).filter(move |(_, other)| **other == k).map(|(square, _)| *square);
    (0..REACHES.len()).map(|k| (own(k).sum::<f64>() / own(k).count().max(1) as f64).sqrt()).collect()
}

fn error_map(scenario: &Scenario, h: f64, error: impl Fn(Vec2) -> f64) -> Result<Figure, ReproduceError> {
    let axes = Axes::panel_with_bar(scenario.world.bounds().grown(0.2), WIDTH);
    let mut figure = Figure::new(axes, &format!("h = {h} m"));
    let scale = ColorScale::whole(SCALE[0], SCALE[1]);
    let color = |power: f64| shade(colorous::VIRIDIS, scale.share(power));
    figure.raster(|p| {
        if !scenario.world.is_free(p) {
            return [255; 4];
        }
        let [r, g, b] = color(error(p).abs().max(1e-9).log10());
        [r, g, b, 255]
    })?;
    figure.color_bar(&scale, "log10 of |error| (m)", color);
    room::draw_room(scenario, &mut figure);
    figure.legend_in_corner();
    Ok(figure)
}

fn chart(curves: &[Vec<f64>]) -> Figure {
    let top = curves.iter().flatten().copied().fold(0.0, f64::max) * 1e3 * 1.1;
    let bounds = Bounds { min: [0.0, 0.0], max: [REACHES[REACHES.len() - 1], top] };
    let axes = Axes::chart(bounds, [WIDTH, CHART], ["distance from the cut locus (m)", "rms error (mm)"]);
    let mut figure = Figure::new(axes, "By distance from the cut locus");
    for (curve, color) in curves.iter().zip(COLORS) {
        let line: Vec<Vec2> = REACHES.iter().zip(curve).map(|(&reach, &error)| Vec2::new(reach, 1e3 * error)).collect();
        figure.path([line.as_slice()], false, &format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"2\""));
    }
    let names = SPACINGS.map(|h| format!("h = {h}"));
    let entries: Vec<(&str, &str)> = names.iter().map(String::as_str).zip(COLORS).collect();
    figure.legend(&entries);
    figure.legend_in_corner();
    figure
}

//! Figures 5 to 8: the fitted room. Zero contour, signed distance, two-sigma bounds at the true boundary, contours by
//! spacing; with the published objective and with ours.

use super::{Plate, ReproduceError, SEED, compared, room};
use crate::fit::{FitOptions, Weighting};
use crate::geometry::{Bounds, Vec2, distance_to_segment};
use crate::map::{FittedMap, Survey};
use crate::render::{
    Axes, Contours, Figure, Layer, Overlay, Page, Picture, Sheet, contours, draw_contours, map_figure,
};
use crate::scan::returns_of;
use crate::sim::Scenario;
use crate::uncertainty::Kind;

/// Draws of the noise from which coverage is taken.
const DRAWS: u64 = 20;
const SPACINGS: [f64; 3] = [0.4, 0.2, 0.1];
const COLORS: [&str; 3] = ["#d95f02", "#7570b3", "#1b9e77"];
const WEIGHTINGS: [(Weighting, &str); 2] = [(Weighting::Paper, "published"), (Weighting::Calibrated, "calibrated")];
/// The boundary is asked every so many metres.
const STEP: f64 = 0.05;
/// The corner that figure 8 looks at closely.
const CORNER: Bounds = Bounds { min: [7.3, 3.3], max: [8.2, 4.2] };

/// One draw, fitted with both objectives.
pub struct Fits([FittedMap; 2]);

fn fitted(scenario: &Scenario, weighting: Weighting, seed: u64) -> Result<FittedMap, ReproduceError> {
    let options = FitOptions { weighting, ..Default::default() };
    let scans = scenario.scans(seed);
    let survey = Survey::new(&scans, scenario.noise).resolution(scenario.resolution).bounds(scenario.bounds);
    Ok(survey.options(options).map()?)
}

impl Fits {
    pub fn of(scenario: &Scenario) -> Result<Self, ReproduceError> {
        let [paper, own] = WEIGHTINGS.map(|(weighting, _)| fitted(scenario, weighting, SEED));
        Ok(Self([paper?, own?]))
    }

    pub fn contour(&self, scenario: &Scenario) -> Result<Plate, ReproduceError> {
        let (mut sheet, mut off) = (Sheet::new("Figure 5: zero contour, point cloud and true boundary"), Vec::new());
        let cloud: Vec<Vec2> = returns_of(&scenario.scans(SEED)).iter().map(|seen| seen.point).collect();
        for (map, (_, name)) in self.0.iter().zip(WEIGHTINGS) {
            let traced = contours(map, 0.0, Some(2.0), Kind::Propagated)?;
            let axes = Axes::panel(scenario.world.bounds().grown(0.4), 640);
            let mut figure = Figure::new(axes, &format!("{name} objective"));
            figure.dots(cloud.iter().copied(), 1.2, "#d95f02");
            figure.legend_of_dots(&[("returns", "#d95f02")]);
            figure.legend_in_corner();
            room::draw_room(scenario, &mut figure);
            draw_contours(&traced, &mut figure);
            off.push(distance_off(scenario, &traced));
            sheet = sheet.with(figure);
        }
        Ok(Plate {
            name: "figure-05".into(),
            title: "Zero contour, point cloud and true boundary".into(),
            caption: "The zero contour (black) with its two-sigma band (green), the returns as reported (orange), the true walls (grey). h = 0.2 m."
                .into(),
            svg: sheet.finish(),
            compared: vec![compared(
                "The zero contour follows the true boundary more closely than the cloud does.",
                both("rms distance of the contour from the nearest wall", off.iter().map(|rms| format!("{:.0} mm", 1e3 * rms))),
            )],
        })
    }

    pub fn distance(&self) -> Result<Plate, ReproduceError> {
        let mut sheet = Sheet::new("Figure 6: the signed distance");
        for (map, (_, name)) in self.0.iter().zip(WEIGHTINGS) {
            let page = Page { panel: true, ..Page::new(format!("{name} objective"), 640) };
            let picture = Picture { layer: Layer::Distance, overlays: vec![Overlay::Contour], cell: None, page };
            sheet = sheet.with(map_figure(map, &picture)?);
        }
        let steps = self.0.iter().map(|map| {
            let report = &map.report;
            let end = if report.converged { "stationary" } else { "not stationary" };
            format!("{} steps, {end}, relative gradient {:.0e}", report.iterations, report.relative_gradient)
        });
        Ok(Plate {
            name: "figure-06".into(),
            title: "The signed distance".into(),
            caption: "The fitted surface, negative (blue) in free space; washed out where nothing was seen.".into(),
            svg: sheet.finish(),
            compared: vec![compared(
                "One continuous surface, from which distance and direction can be read anywhere.",
                both("the fit", steps),
            )],
        })
    }

    /// `u` along the walls within its two-sigma bounds.
    pub fn bounds(&self, scenario: &Scenario) -> Result<Plate, ReproduceError> {
        let title = "Figure 7: the distance u at the true boundary";
        let (mut sheet, mut shares, mut seen_rms) = (Sheet::new(title), Vec::new(), Vec::new());
        for (map, (weighting, name)) in self.0.iter().zip(WEIGHTINGS) {
            sheet = sheet.below(bounds_chart(scenario, map, name));
            let (mut inside, mut squares, mut all) = (0.0, 0.0, 0.0);
            for seed in 0..DRAWS {
                let map = fitted(scenario, weighting, seed)?;
                for (u, sigma) in
                    scenario.seen_boundary(STEP).into_iter().filter_map(|p| map.distance(p, Kind::Propagated))
                {
                    inside += f64::from(u8::from(u.abs() <= 2.0 * sigma));
                    squares += u * u;
                    all += 1.0;
                }
            }
            shares.push(format!("{:.1} %", 100.0 * inside / all));
            seen_rms.push(format!("{:.0} mm", 1e3 * f64::sqrt(squares / all)));
        }
        Ok(Plate {
            name: "figure-07".into(),
            title: "Distance at the true boundary, with its two-sigma bounds".into(),
            caption: "u on the true walls, going once around the room from (0, 0) (thin verticals are corners), with plus and minus two \
                      sigma around it; where no scanner saw the wall there is a gap. True is zero."
                .into(),
            svg: sheet.finish(),
            compared: vec![
                compared(
                    "The true boundary lies within the two-sigma bounds.",
                    both(&format!("share of the seen boundary inside them, {DRAWS} draws (two sigma: 95.4 %)"), shares.into_iter()),
                ),
                compared("Small errors at the boundary.", both("rms of u there", seen_rms.into_iter())),
            ],
        })
    }
}

fn bounds_chart(scenario: &Scenario, map: &FittedMap, name: &str) -> Figure {
    let length: f64 = scenario.world.walls().map(|(a, b)| (b - a).norm()).sum();
    let limit = 0.12;
    let bounds = Bounds { min: [0.0, -limit], max: [length, limit] };
    let axes = Axes::chart(bounds, [1100, 220], ["along the walls (m)", "u (m)"]);
    let mut figure = Figure::new(axes, &format!("{name} objective"));
    let (mut from, mut corners) = (0.0, Vec::new());
    // Runs of seen boundary: (along, u, sigma).
    let mut runs: Vec<Vec<(f64, f64, f64)>> = vec![Vec::new()];
    for (a, b) in scenario.world.walls() {
        let wall = (b - a).norm();
        let pieces = (wall / STEP).round() as usize;
        for k in 0..pieces {
            let share = (k as f64 + 0.5) / pieces as f64;
            let p = a + (b - a) * share;
            match (scenario.sees_point(p), map.distance(p, Kind::Propagated), runs.last_mut()) {
                (true, Some((u, sigma)), Some(run)) => run.push((from + share * wall, u, sigma)),
                _ => runs.push(Vec::new()),
            }
        }
        from += wall;
        corners.push([Vec2::new(from, -limit), Vec2::new(from, limit)]);
    }
    let clipped = |x: f64, y: f64| Vec2::new(x, y.clamp(-limit, limit));
    let bands: Vec<Vec<Vec2>> = runs
        .iter()
        .map(|run| {
            let above = run.iter().map(|(x, u, sigma)| clipped(*x, u + 2.0 * sigma));
            above.chain(run.iter().rev().map(|(x, u, sigma)| clipped(*x, u - 2.0 * sigma))).collect()
        })
        .collect();
    let lines: Vec<Vec<Vec2>> = runs.iter().map(|run| run.iter().map(|(x, u, _)| clipped(*x, *u)).collect()).collect();
    figure.path(bands.iter().map(Vec::as_slice), true, "fill=\"#1b9e77\" fill-opacity=\"0.35\"");
    figure.path(corners.iter().map(|line| line.as_slice()), false, "fill=\"none\" stroke=\"#ccc\"");
    figure.path(
        [[Vec2::zeros(), Vec2::new(length, 0.0)].as_slice()],
        false,
        "fill=\"none\" stroke=\"#222\" stroke-dasharray=\"5 4\"",
    );
    figure.path(lines.iter().map(Vec::as_slice), false, "fill=\"none\" stroke=\"#d95f02\" stroke-width=\"1.4\"");
    figure.legend(&[("u", "#d95f02"), ("two sigma", "#a4d8c8"), ("truth", "#222")]);
    figure
}

/// Figure 8: the zero contour for several spacings, the room whole and one corner of it.
pub fn by_resolution(scenario: &Scenario) -> Result<Plate, ReproduceError> {
    let traced = |weighting| -> Result<Vec<Contours>, ReproduceError> {
        let one = |&resolution: &f64| {
            let map = fitted(&Scenario { resolution, ..scenario.clone() }, weighting, SEED)?;
            Ok(contours(&map, 0.0, None, Kind::Propagated)?)
        };
        SPACINGS.iter().map(one).collect()
    };
    let [published, own] = WEIGHTINGS.map(|(weighting, _)| traced(weighting));
    let (published, own) = (published?, own?);
    let panel = |traced: &[Contours], part: Bounds, title: &str| contours_by_spacing(scenario, traced, part, title);
    let mut whole = panel(&own, scenario.world.bounds().grown(0.4), "the room, calibrated objective");
    whole.legend_in_corner();
    let sheet = Sheet::new("Figure 8: zero contours by resolution")
        .with(whole)
        .with(panel(&published, CORNER, "the corner (8, 4), published objective"))
        .with(panel(&own, CORNER, "the corner (8, 4), calibrated objective"));
    let gaps = [published, own].map(|traced| {
        let gaps: Vec<String> = traced.iter().map(|own| format!("{:.0}", 1e3 * corner_gap(scenario, own))).collect();
        format!("{} mm", gaps.join(" / "))
    });
    Ok(Plate {
        name: "figure-08".into(),
        title: "Zero contours by resolution".into(),
        caption: "h = 0.4, 0.2 and 0.1 m, and one corner of the room closely, with the published objective and with ours.".into(),
        svg: sheet.finish(),
        compared: vec![
            compared(
                "Corners are rounded, the more the coarser the lattice.",
                both("mean distance of the seen corners from the contour at h = 0.4 / 0.2 / 0.1", gaps.into_iter()),
            ),
            compared(
                "Constants by trial and error, one set for every h.",
                "The published constants count the Eikonal term a quadrature point: the finer the lattice, the more of them, and the rounder \
                 its corners. Ours integrate it, and are chosen from the data."
                    .into(),
            ),
        ],
    })
}

fn contours_by_spacing(scenario: &Scenario, traced: &[Contours], part: Bounds, title: &str) -> Figure {
    let mut figure = Figure::new(Axes::panel(part, 520), title);
    let fine = |(a, b): (Vec2, Vec2)| (0..=800).map(|k| a + (b - a) * (f64::from(k) / 800.0)).collect::<Vec<_>>();
    let walls: Vec<Vec<Vec2>> = scenario.world.walls().flat_map(|wall| inside(&fine(wall), &part)).collect();
    figure.path(walls.iter().map(Vec::as_slice), false, room::WALL);
    figure.legend(&[("true walls", room::WALL_COLOR)]);
    for (own, color) in traced.iter().zip(COLORS) {
        let points = |line: &geo_types::LineString<f64>| line.0.iter().map(|c| Vec2::new(c.x, c.y)).collect::<Vec<_>>();
        let lines: Vec<Vec<Vec2>> = own.lines.iter().flat_map(|line| inside(&points(line), &part)).collect();
        let stroke = format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"");
        figure.path(lines.iter().map(Vec::as_slice), false, &stroke);
    }
    let names = SPACINGS.map(|h| format!("h = {h}"));
    let entries: Vec<(&str, &str)> = names.iter().map(String::as_str).zip(COLORS).collect();
    figure.legend(&entries);
    figure
}

/// The stretches of a line inside a rectangle.
fn inside(points: &[Vec2], part: &Bounds) -> Vec<Vec<Vec2>> {
    points.split(|p| !part.contains(*p)).filter(|run| run.len() > 1).map(<[Vec2]>::to_vec).collect()
}

/// Rms distance of a contour's vertices from the walls.
fn distance_off(scenario: &Scenario, traced: &Contours) -> f64 {
    let vertices: Vec<Vec2> = traced.lines.iter().flat_map(|line| &line.0).map(|c| Vec2::new(c.x, c.y)).collect();
    let squares = vertices.iter().map(|p| (scenario.world.nearest(*p) - p).norm_squared()).sum::<f64>();
    (squares / vertices.len().max(1) as f64).sqrt()
}

/// Mean distance of the corners some scanner saw from the contour.
fn corner_gap(scenario: &Scenario, traced: &Contours) -> f64 {
    let towards_inside = |corner: Vec2| {
        let turn = |k: u32| Vec2::new(f64::from(k).cos(), f64::from(k).sin()) * 0.01;
        (0..7).map(|k| corner + turn(k)).any(|p| scenario.world.is_free(p) && scenario.sees_point(p))
    };
    let gap = |corner: Vec2| {
        let edges = traced.lines.iter().flat_map(|line| line.lines());
        let away =
            edges.map(|e| distance_to_segment(corner, Vec2::new(e.start.x, e.start.y), Vec2::new(e.end.x, e.end.y)));
        away.fold(f64::INFINITY, f64::min)
    };
    let gaps: Vec<f64> = scenario.world.corners().filter(|&corner| towards_inside(corner)).map(gap).collect();
    gaps.iter().sum::<f64>() / gaps.len().max(1) as f64
}

/// A quantity as the published objective has it, and as ours.
fn both(quantity: &str, values: impl Iterator<Item = String>) -> String {
    let named: Vec<String> = values.zip(WEIGHTINGS).map(|(value, (_, name))| format!("{name} {value}")).collect();
    format!("{quantity}: {}.", named.join(", "))
}

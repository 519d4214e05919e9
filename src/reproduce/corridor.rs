//! Figures 9 and 10: experiment 2, a building as a vector distance map, h = 0.25 m, with Table II noise drawn on the
//! true poses.

use super::{Compared, GridJudgement, Plate, ReproduceError, SEED, Truth, compared};
use crate::fit::{Distance, FitOptions, Weighting};
use crate::geometry::{Bounds, Vec2};
use crate::map::FittedMap;
use crate::render::{Axes, Figure, Layer, OccupancyGrid, Overlay, Page, Picture, Sheet, draw_poses, map_figure};
use crate::scan::{LaserScan, Noise, returns_of};
use crate::sim::{Survey, misplaced};
use crate::uncertainty::Kind;

const RESOLUTION: f64 = 0.25;
const WIDTH: usize = 1100;
/// Of each of two beside each other.
const PANEL: usize = 700;
const OBJECTIVES: [&str; 2] = ["published", "calibrated"];

/// The two figures of one building; `suffix` tells their files from another's.
pub fn cloud_and_grid(survey: &Survey, suffix: &str, place: &str) -> Result<[Plate; 2], ReproduceError> {
    let scans = misplaced(&survey.scans, &Noise::EXPERIMENT_TWO, SEED);
    let maps = [fitted(&scans, Weighting::Paper)?, fitted(&scans, Weighting::Calibrated)?];
    Ok([cloud(survey, &scans, suffix, place), grid(survey, &maps, suffix, place)?])
}

fn fitted(scans: &[LaserScan], weighting: Weighting) -> Result<FittedMap, ReproduceError> {
    let survey = crate::map::Survey::new(scans, Noise::EXPERIMENT_TWO).distance(Distance::Vector);
    Ok(survey.resolution(RESOLUTION).options(FitOptions { weighting, ..FitOptions::default() }).map()?)
}

fn cloud(survey: &Survey, scans: &[LaserScan], suffix: &str, place: &str) -> Plate {
    let points: Vec<Vec2> = returns_of(scans).iter().map(|seen| seen.point).collect();
    let bounds = Bounds::around(points.iter().copied()).unwrap_or(Bounds { min: [0.0; 2], max: [1.0; 2] });
    let mut figure = Figure::new(Axes::new(bounds.grown(0.5), WIDTH), &format!("Figure 9: point cloud of {place}"));
    figure.dots(points.iter().copied(), 0.7, "#d95f02");
    figure.legend_of_dots(&[("returns", "#d95f02")]);
    draw_poses(&scans.iter().map(|scan| scan.pose).collect::<Vec<_>>(), &mut figure);
    let truth = returns_of(&survey.scans);
    let off = truth.iter().zip(&points).map(|(exact, p)| (exact.point - p).norm_squared()).sum::<f64>();
    Plate {
        name: format!("figure-09{suffix}"),
        title: format!("Point cloud of {place}"),
        caption: format!("{} scans, poses as reported: Table II noise drawn on the true ones.", scans.len()),
        svg: figure.finish(),
        compared: vec![compared(
            "A corridor's cloud with Table II noise: walls smeared and doubled.",
            format!(
                "{} returns, {:.0} mm rms from where true poses put them.",
                points.len(),
                1e3 * (off / points.len().max(1) as f64).sqrt()
            ),
        )],
    }
}

fn grid(survey: &Survey, maps: &[FittedMap; 2], suffix: &str, place: &str) -> Result<Plate, ReproduceError> {
    let picture = |layer, overlays, title: String| {
        let page = Page { panel: true, ..Page::new(title, PANEL) };
        Picture { layer, overlays, cell: Some(RESOLUTION), page }
    };
    let mut sheet = Sheet::new(&format!("Figure 10: {place}"));
    for (map, name) in maps.iter().zip(OBJECTIVES) {
        let mut ogm = map_figure(map, &picture(Layer::Occupancy, vec![], format!("occupancy grid, {name} objective")))?;
        let walls: Vec<[Vec2; 2]> = survey.plan.walls.iter().map(|&(a, b)| [a, b]).collect();
        let area = map.lattice().bounds();
        let within = |wall: &&[Vec2; 2]| wall.iter().all(|p| area.contains(*p));
        let thin = "fill=\"none\" stroke=\"#1b9e77\" stroke-width=\"0.8\"";
        ogm.path(walls.iter().filter(within).map(|wall| wall.as_slice()), false, thin);
        ogm.legend(&[("true walls", "#1b9e77")]);
        sheet = sheet.with(ogm);
    }
    let field = |map, name| {
        let title = format!("distance from the surfaces, {name} objective");
        map_figure(map, &picture(Layer::Distance, vec![Overlay::Contour], title))
    };
    let sheet = sheet.below(field(&maps[0], OBJECTIVES[0])?).with(field(&maps[1], OBJECTIVES[1])?);
    Ok(Plate {
        name: format!("figure-10{suffix}"),
        title: format!("Occupancy grid of {place}"),
        caption: "The occupancy grid at h = 0.25 m with the true walls (green): published objective, from the poses as \
                  reported, and ours, which refines them. Below, the distance from the surfaces on which V vanishes and \
                  means it, their contour and its two-sigma band."
            .into(),
        svg: sheet.finish(),
        compared: against_truth(survey, maps),
    })
}

fn against_truth(survey: &Survey, maps: &[FittedMap; 2]) -> Vec<Compared> {
    let truth = Truth::of(survey, RESOLUTION);
    let both = |what: &dyn Fn(&FittedMap) -> String| {
        let [published, own] = [what(&maps[0]), what(&maps[1])];
        format!("published: {published}; calibrated: {own}.")
    };
    let of_grid = |map: &FittedMap| {
        let GridJudgement { precision, recall, open, phantoms, .. } =
            truth.judge_grid(map, &OccupancyGrid::of(map, RESOLUTION, Kind::Propagated));
        format!(
            "precision {precision:.2}, recall {recall:.2} of occupied cells, {phantoms} of {open} open cells occupied"
        )
    };
    let of_field = |map: &FittedMap| {
        let own = truth.judge(map);
        format!("length of V there {:.0} mm rms, in space {:.0} mm off in the mean", 1e3 * own.walls, 1e3 * own.space)
    };
    vec![
        compared("The corridor is represented, with its doors and rooms.", both(&of_grid)),
        compared("The field vanishes on the walls.", both(&of_field)),
        compared(
            "Two-sigma bounds hold.",
            both(&|map| format!("{:.0} % of the seen walls within them", 100.0 * truth.judge(map).coverage)),
        ),
    ]
}

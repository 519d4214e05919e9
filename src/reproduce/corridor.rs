//! Figures 9 and 10: experiment 2, a building as a vector distance map, h = 0.25 m, with Table II noise drawn on the true poses.

use std::ops::ControlFlow;

use super::{Compared, GridJudgement, LARGEST_LATTICE, Plate, ReproduceError, SEED, Truth, compared};
use crate::fit::{FitError, FitOptions, fit_vector};
use crate::geometry::{Bounds, Vec2};
use crate::map::FittedMap;
use crate::render::{Axes, Figure, Layer, OccupancyGrid, Overlay, Picture, Sheet, draw_poses, map_figure};
use crate::scan::{LaserScan, Noise, returns_of};
use crate::sim::{Survey, misplaced};
use crate::spline::Lattice;
use crate::uncertainty::Kind;

const RESOLUTION: f64 = 0.25;
const WIDTH: usize = 1100;

/// The two figures of one building; `suffix` tells their files from another's.
pub fn cloud_and_grid(survey: &Survey, suffix: &str, place: &str) -> Result<[Plate; 2], ReproduceError> {
    let scans = misplaced(&survey.scans, &Noise::EXPERIMENT_TWO, SEED);
    let map = fitted(&scans)?;
    Ok([cloud(survey, &scans, suffix, place), grid(survey, &map, suffix, place)?])
}

fn fitted(scans: &[LaserScan]) -> Result<FittedMap, ReproduceError> {
    let around = Bounds::around(returns_of(scans).iter().map(|seen| seen.point)).ok_or(FitError::NoEvidence)?;
    let lattice = Lattice::covering(&around.grown(3.0 * RESOLUTION), RESOLUTION, LARGEST_LATTICE)?;
    let (noise, options) = (Noise::EXPERIMENT_TWO, FitOptions::default());
    let fit = fit_vector(scans, &noise, &lattice, &options, &mut |_| ControlFlow::Continue(()))?;
    Ok(FittedMap::finish_vector(fit, noise, || 0.0)?.0)
}

fn cloud(survey: &Survey, scans: &[LaserScan], suffix: &str, place: &str) -> Plate {
    let points: Vec<Vec2> = returns_of(scans).iter().map(|seen| seen.point).collect();
    let bounds = Bounds::around(points.iter().copied()).unwrap_or(Bounds { min: [0.0; 2], max: [1.0; 2] });
    let mut figure = Figure::new(Axes::new(bounds.grown(0.5), WIDTH), &format!("Figure 9: point cloud of {place}"));
    figure.dots(points.iter().copied(), 0.7, "#d95f02");
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

fn grid(survey: &Survey, map: &FittedMap, suffix: &str, place: &str) -> Result<Plate, ReproduceError> {
    let picture = |layer, overlays, title: &str| Picture {
        layer,
        overlays,
        width: WIDTH,
        kind: Kind::Propagated,
        title: title.into(),
    };
    let mut ogm = map_figure(
        map,
        &picture(Layer::Occupancy, vec![], &format!("Figure 10: occupancy grid of {place}, cells of h")),
    )?;
    let walls: Vec<[Vec2; 2]> = survey.plan.walls.iter().map(|&(a, b)| [a, b]).collect();
    let area = map.lattice().bounds();
    let within = |wall: &&[Vec2; 2]| wall.iter().all(|p| area.contains(*p));
    let thin = "fill=\"none\" stroke=\"#1b9e77\" stroke-width=\"0.8\"";
    ogm.path(walls.iter().filter(within).map(|wall| wall.as_slice()), false, thin);
    let field = picture(
        Layer::Distance,
        vec![Overlay::Contour],
        "The vector field's length, and where it vanishes and means it",
    );
    let sheet = Sheet::default().below(ogm).below(map_figure(map, &field)?);
    Ok(Plate {
        name: format!("figure-10{suffix}"),
        title: format!("Occupancy grid of {place}"),
        caption: "Above, the occupancy grid at h = 0.25 m with the true walls (green). Below, the length of V, its zero contour and the two-sigma band. \
                  The published objective leaves the field's turn open; this is ours."
            .into(),
        svg: sheet.finish(),
        compared: against_truth(survey, map),
    })
}

fn against_truth(survey: &Survey, map: &FittedMap) -> Vec<Compared> {
    let truth = Truth::of(survey, RESOLUTION);
    let own = truth.judge(map);
    let GridJudgement { precision, recall, open, phantoms, .. } =
        truth.judge_grid(map, &OccupancyGrid::of(map, RESOLUTION, Kind::Propagated));
    vec![
        compared(
            "The corridor is represented, with its doors and rooms.",
            format!(
                "precision {precision:.2}, recall {recall:.2} of occupied cells; {phantoms} of {open} open cells occupied."
            ),
        ),
        compared(
            "Two-sigma bounds hold.",
            format!(
                "{:.0} % of the seen walls within them; |V| there {:.0} mm rms, in space {:.0} mm off in the mean.",
                100.0 * own.coverage,
                1e3 * own.walls,
                1e3 * own.space
            ),
        ),
    ]
}

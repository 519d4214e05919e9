//! Experiment 2: the Willow Garage corridor as a vector distance map, h = 0.25 m, against its exact walls.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mapfit::fit::{FitOptions, fit_vector};
use mapfit::geometry::{Bounds, Vec2, distance_to_segment};
use mapfit::import::parse_corridor;
use mapfit::map::FittedMap;
use mapfit::render::{OccupancyGrid, contours};
use mapfit::reproduce::{Judgement, Truth};
use mapfit::scan::{LaserScan, Noise, returns_of};
use mapfit::sim::{Survey, misplaced};
use mapfit::spline::Lattice;
use mapfit::uncertainty::Kind;

const RESOLUTION: f64 = 0.25;

fn corridor() -> Option<Survey> {
    let Some(data) = std::env::var_os("MAPFIT_RECORDINGS") else {
        println!("skipped: MAPFIT_RECORDINGS is not set");
        return None;
    };
    let folder = PathBuf::from(data).join("willow-corridor");
    let packed = std::fs::File::open(folder.join("scans.json.gz")).unwrap();
    let scans = std::io::read_to_string(flate2::read::GzDecoder::new(packed)).unwrap();
    Some(parse_corridor(&std::fs::read_to_string(folder.join("walls.csv")).unwrap(), &scans).unwrap())
}

fn fitted(scans: &[LaserScan], noise: Noise) -> FittedMap {
    let bounds = Bounds::around(returns_of(scans).iter().map(|seen| seen.point)).unwrap().grown(0.75);
    let lattice = Lattice::covering(&bounds, RESOLUTION, 200_000).unwrap();
    let fit = fit_vector(scans, &noise, &lattice, &FitOptions::default(), &mut |_| ControlFlow::Continue(())).unwrap();
    assert!(fit.converged && fit.minimum.positive_definite);
    FittedMap::finish_vector(fit, noise, || 0.0).unwrap().0
}

/// Occupied cells against seen walls; no obstacle on the medial axis.
fn check_grid(map: &FittedMap, truth: &Truth<'_>) {
    let own = truth.judge_grid(map, &OccupancyGrid::of(map, RESOLUTION, Kind::Propagated));
    println!("{own:?}");
    assert!(own.precision >= 0.9 && own.recall >= 0.9 && own.phantoms as f64 <= 0.002 * own.open as f64);
    let traced = contours(map, 0.0, Some(2.0), Kind::Propagated).unwrap();
    let vertices: Vec<Vec2> = traced.lines.0.iter().flat_map(|line| &line.0).map(|c| Vec2::new(c.x, c.y)).collect();
    let off = vertices.iter().filter(|p| truth.is_off(**p, 0.5 * RESOLUTION)).count();
    println!("{off} of {} of the contour's vertices are off the walls", vertices.len());
    assert!(off as f64 <= 0.01 * vertices.len() as f64);
    let pieces: Vec<(Vec2, Vec2)> = traced
        .lines
        .iter()
        .flat_map(|line| line.lines())
        .map(|e| (Vec2::new(e.start.x, e.start.y), Vec2::new(e.end.x, e.end.y)))
        .collect();
    let drawn = |p: Vec2| pieces.iter().any(|(a, b)| distance_to_segment(p, *a, *b) < 0.75 * RESOLUTION);
    let shown = truth.walls.iter().filter(|(p, _)| drawn(*p)).count() as f64 / truth.walls.len() as f64;
    println!("{} lines show {shown:.3} of the seen walls", traced.lines.0.len());
    assert!(shown >= 0.95);
}

/// Five draws of Table II noise on a building; distances in space are held to a bar, metres.
fn check_draws(survey: &Survey, space_bar: f64) {
    let truth = Truth::of(survey, RESOLUTION);
    println!("{} wall points, {} points in space", truth.walls.len(), truth.space.len());
    let mut judged: Vec<Judgement> = Vec::new();
    for seed in 0..5 {
        let map = fitted(&misplaced(&survey.scans, &Noise::EXPERIMENT_TWO, seed), Noise::EXPERIMENT_TWO);
        judged.push(truth.judge(&map));
        println!("seed {seed}: {:?}, {} steps", judged[judged.len() - 1], map.report.iterations);
        println!("  distance everywhere {:?}", truth.judge_distance(&map));
        println!("  where it stood      {:?}", truth.judge_poses(&map));
        if seed == 0 {
            check_grid(&map, &truth);
        }
    }
    let median = |of: fn(&Judgement) -> f64| {
        let mut values: Vec<f64> = judged.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let [walls, space, coverage] = [median(|own| own.walls), median(|own| own.space), median(|own| own.coverage)];
    assert!(walls <= 0.04, "walls {walls}");
    assert!(space <= space_bar, "space {space}");
    assert!((0.90..=0.98).contains(&coverage), "coverage {coverage}");
}

#[test]
fn the_corridor_with_table_two_noise() {
    let Some(corridor) = corridor() else { return };
    check_draws(&corridor, 0.05);
}

/// Walls 0.15 m thick at h = 0.25 m, seen from both sides: neither face may pull the other's poses. In rooms this small
/// most of the space is near the cut locus, where a spline needs two cells to jump.
#[test]
fn an_office_of_our_own_making_with_table_two_noise() {
    check_draws(&Survey::office(Noise::EXPERIMENT_TWO.sigma_range, 7), 0.06);
}

#[test]
fn the_corridor_from_true_poses() {
    let Some(corridor) = corridor() else { return };
    let truth = Truth::of(&corridor, RESOLUTION);
    let still = Noise { sigma_x: 1e-4, sigma_y: 1e-4, sigma_theta: 1e-5, sigma_range: 0.02 };
    let map = fitted(&corridor.scans, still);
    let own = truth.judge(&map);
    println!("{own:?}");
    assert!(own.walls <= 0.03 && own.space <= 0.0305);
    check_grid(&map, &truth);
}

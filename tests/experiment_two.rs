//! Experiment 2: the Willow Garage corridor as a vector distance map, h = 0.25 m, against its exact walls.

mod support;

use mapfit::fit::Distance;
use mapfit::geometry::{Vec2, distance_to_segment};
use mapfit::import::parse_corridor;
use mapfit::map::{FittedMap, Survey};
use mapfit::render::{OccupancyGrid, contours};
use mapfit::reproduce::{DistanceJudgement, Judgement, Truth};
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};
use mapfit::uncertainty::Kind;
use support::{log_text, shared_data};

const RESOLUTION: f64 = 0.25;

fn corridor() -> Option<sim::Survey> {
    let folder = shared_data("the corridor")?.join("willow-corridor");
    let scans = log_text(&folder.join("scans.json.gz"));
    Some(parse_corridor(&std::fs::read_to_string(folder.join("walls.csv")).unwrap(), &scans).unwrap())
}

fn fitted(scans: &[LaserScan], noise: Noise) -> FittedMap {
    let map = Survey::new(scans, noise).distance(Distance::Vector).resolution(RESOLUTION).map().unwrap();
    assert!(map.report.converged && map.report.positive_definite, "{:?}", map.report);
    map
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

/// What a building's maps are held to, in the median of five draws.
struct Bars {
    /// Error of |V| off the cut locus, mean, metres.
    space: f64,
    /// Two-sigma coverage of the distance, and clearances too long by three sigma, over all seen space.
    coverage: std::ops::RangeInclusive<f64>,
    reckless: f64,
}

fn median(judged: &[f64]) -> f64 {
    let mut values = judged.to_vec();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Five draws of Table II noise on a building.
fn check_draws(survey: &sim::Survey, bars: &Bars) {
    let truth = Truth::of(survey, RESOLUTION);
    println!("{} wall points, {} points in space", truth.walls.len(), truth.space.len());
    let (mut judged, mut everywhere, mut stood) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..5 {
        let map = fitted(&misplaced(&survey.scans, &Noise::EXPERIMENT_TWO, seed), Noise::EXPERIMENT_TWO);
        judged.push(truth.judge(&map));
        everywhere.push(truth.judge_distance(&map));
        stood.push(truth.judge_poses(&map));
        println!("seed {seed}: {:?}, {} steps", judged[seed as usize], map.report.iterations);
        println!("  distance everywhere {:?}", everywhere[seed as usize]);
        println!("  where it stood      {:?}", stood[seed as usize]);
        if seed == 0 {
            check_grid(&map, &truth);
        }
    }
    let of = |one: fn(&Judgement) -> f64| median(&judged.iter().map(one).collect::<Vec<_>>());
    let [walls, space, coverage] = [of(|own| own.walls), of(|own| own.space), of(|own| own.coverage)];
    assert!(walls <= 0.04, "walls {walls}");
    assert!(space <= bars.space, "space {space}");
    assert!((0.90..=0.98).contains(&coverage), "coverage {coverage}");
    let of = |all: &[DistanceJudgement], one: fn(&DistanceJudgement) -> f64| {
        median(&all.iter().map(one).collect::<Vec<_>>())
    };
    let [mean, far, covered] =
        [of(&everywhere, |d| d.mean), of(&everywhere, |d| d.far), of(&everywhere, |d| d.coverage)];
    assert!(mean <= 0.05 && far <= 0.002, "mean {mean}, far {far}");
    assert!(bars.coverage.contains(&covered), "coverage of the distance {covered}");
    let reckless = of(&everywhere, |d| d.reckless);
    assert!(reckless <= bars.reckless, "clearances too long {reckless}");
    let [mean, covered] = [of(&stood, |d| d.mean), of(&stood, |d| d.coverage)];
    assert!(mean <= 0.06 && covered >= 0.90, "where it stood: mean {mean}, coverage {covered}");
}

#[test]
fn the_corridor_with_table_two_noise() {
    let Some(corridor) = corridor() else { return };
    check_draws(&corridor, &Bars { space: 0.05, coverage: 0.92..=0.98, reckless: 0.005 });
}

/// Walls 0.15 m thick at h = 0.25 m, seen from both sides: neither face may pull the other's poses. In rooms this small
/// most of the space is near the cut locus, where a spline needs two cells to jump.
#[test]
fn an_office_of_our_own_making_with_table_two_noise() {
    // Poses of scans on either side of a thin wall draw its faces together, by more than their sigma knows.
    let bars = Bars { space: 0.06, coverage: 0.88..=0.98, reckless: 0.04 };
    check_draws(&sim::Survey::office(Noise::EXPERIMENT_TWO.sigma_range, 7), &bars);
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

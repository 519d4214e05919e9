//! The method's experiment 1, held to the bars: accuracy on exact truth, convergence, and uncertainty by Monte Carlo.

use mapfit::fit::{FitOptions, Weighting};
use mapfit::geometry::{Vec2, distance_to_segment};
use mapfit::map::{FittedMap, Survey};
use mapfit::render::contours;
use mapfit::sim::Scenario;
use mapfit::uncertainty::Kind;

fn map_of(scenario: &Scenario, weighting: Weighting, seed: u64) -> FittedMap {
    let scans = scenario.scans(seed);
    let survey = Survey::new(&scans, scenario.noise).resolution(scenario.resolution).bounds(scenario.bounds);
    let map = survey.options(FitOptions { weighting, ..Default::default() }).map().unwrap();
    assert_eq!(map.lattice().len(), 2401);
    map
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(n)).sqrt()
}

fn boundary_rms(scenario: &Scenario, map: &FittedMap) -> f64 {
    rms(scenario.seen_boundary(0.05).into_iter().map(|p| map.field.value(p).unwrap()))
}

fn inside_rmse(scenario: &Scenario, map: &FittedMap) -> f64 {
    let points = (0..160 * 160).map(|k| Vec2::new(0.025 + 0.05 * (k % 160) as f64, 0.025 + 0.05 * (k / 160) as f64));
    let inside = points.filter(|&p| scenario.world.is_free(p));
    rms(inside.map(|p| map.field.value(p).unwrap() - scenario.world.signed_distance(p)))
}

/// The share of the zero contour's length within a distance of the true boundary.
fn contour_share_within(scenario: &Scenario, map: &FittedMap, reach: f64) -> f64 {
    let traced = contours(map, 0.0, None, Kind::Propagated).unwrap();
    let (mut near, mut total) = (0.0, 0.0);
    for line in &traced.lines {
        for edge in line.lines() {
            let (a, b) = (Vec2::new(edge.start.x, edge.start.y), Vec2::new(edge.end.x, edge.end.y));
            let middle = (a + b) / 2.0;
            let off = scenario.world.walls().map(|(p, q)| distance_to_segment(middle, p, q)).fold(f64::MAX, f64::min);
            total += (b - a).norm();
            near += if off <= reach { (b - a).norm() } else { 0.0 };
        }
    }
    let walls: f64 = scenario.world.walls().map(|(a, b)| (b - a).norm()).sum();
    assert!(total > 0.95 * walls, "the contour is {total:.1} m long, the walls {walls:.1} m");
    near / total
}

#[test]
fn calibrated_weighting_meets_its_bars() {
    let scenario = Scenario::experiment_one();
    let (mut boundary, mut inside, mut contour, mut factorisations) = (vec![], vec![], vec![], 0);
    for seed in 0..20 {
        let map = map_of(&scenario, Weighting::Calibrated, seed);
        assert!(map.report.converged && map.report.positive_definite, "seed {seed}: {:?}", map.report);
        factorisations = factorisations.max(map.report.factorisations);
        boundary.push(boundary_rms(&scenario, &map));
        inside.push(inside_rmse(&scenario, &map));
        contour.push(contour_share_within(&scenario, &map, 0.03));
    }
    let (boundary, inside, contour) = (median(boundary), median(inside), median(contour));
    println!(
        "calibrated: boundary rms {boundary:.4} m, inside rmse {inside:.4} m, contour within 3 cm {contour:.3}, at most {factorisations} factorisations"
    );
    assert!(boundary <= 0.011 && inside <= 0.014 && contour >= 0.95 && factorisations <= 60);
}

#[test]
fn published_weighting_is_stationary_and_meets_its_bar() {
    let scenario = Scenario::experiment_one();
    let (mut boundary, mut factorisations) = (vec![], 0);
    for seed in 0..20 {
        let map = map_of(&scenario, Weighting::Paper, seed);
        assert!(map.report.relative_gradient <= 1e-8 && map.report.positive_definite, "seed {seed}: {:?}", map.report);
        factorisations = factorisations.max(map.report.factorisations);
        boundary.push(boundary_rms(&scenario, &map));
    }
    let boundary = median(boundary);
    println!("paper: boundary rms {boundary:.4} m, at most {factorisations} factorisations");
    assert!(boundary <= 0.04 && factorisations <= 60);
}

#[test]
fn predicted_uncertainty_is_what_sixty_draws_of_the_noise_show() {
    let scenario = Scenario::experiment_one();
    let points = scenario.seen_boundary(0.25);
    let (mut values, mut variances) = (vec![vec![]; points.len()], vec![0.0; points.len()]);
    for seed in 100..160 {
        let map = map_of(&scenario, Weighting::Calibrated, seed);
        for (k, &p) in points.iter().enumerate() {
            let (u, sigma) = map.distance(p, Kind::Propagated).unwrap();
            values[k].push(u);
            variances[k] += sigma * sigma / 60.0;
        }
    }
    let ratios: Vec<f64> = values
        .iter()
        .zip(&variances)
        .map(|(values, predicted)| {
            let mean = values.iter().sum::<f64>() / 60.0;
            let empirical = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 59.0;
            (predicted / empirical).sqrt()
        })
        .collect();
    let inside = values.iter().zip(&variances).flat_map(|(v, s)| v.iter().map(move |v| v.abs() <= 2.0 * s.sqrt()));
    let coverage = inside.clone().filter(|&c| c).count() as f64 / inside.count() as f64;
    let ratio = median(ratios);
    println!("predicted over empirical sigma {ratio:.3}, two-sigma coverage of the true boundary {coverage:.3}");
    assert!((0.9..=1.1).contains(&ratio) && (0.93..=0.97).contains(&coverage));
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let scenario = Scenario::experiment_one();
    let bytes = || {
        let mut map = map_of(&scenario, Weighting::Calibrated, 7);
        // All but how long it took.
        (map.report.seconds, map.report.stages) = (0.0, Default::default());
        map.to_npz().unwrap()
    };
    assert!(bytes() == bytes());
}

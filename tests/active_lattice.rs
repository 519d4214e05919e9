//! Control points only where there is evidence: what is left out, and what that changes where something was seen.

use mapfit::fit::{self, Distance, FitOptions};
use mapfit::geometry::{Bounds, Vec2};
use mapfit::map::{FittedMap, Survey};
use mapfit::sim::Scenario;
use mapfit::spline::Lattice;
use mapfit::uncertainty::Kind;

/// Experiment 1's room in the corner of a square twice as wide, most of which nobody saw.
fn fitted(band: Option<f64>, vector: bool) -> FittedMap {
    let scenario = Scenario::experiment_one();
    let bounds = Bounds { min: [-4.0, -4.0], max: [12.0, 12.0] };
    let scans = scenario.scans(3);
    let survey = Survey::new(&scans, scenario.noise).resolution(scenario.resolution).bounds(bounds);
    let distance = if vector { Distance::Vector } else { Distance::Signed };
    survey.distance(distance).options(FitOptions { band, ..Default::default() }).map().unwrap()
}

/// The largest change of distance (metres) and of sigma (a share) at points a quarter of a metre apart that some beam
/// passed.
fn largest_changes(map: &FittedMap, whole: &FittedMap) -> [f64; 2] {
    let places = (0..64 * 64).map(|k| Vec2::new(-4.0 + 0.25 * (k % 64) as f64, -4.0 + 0.25 * (k / 64) as f64));
    let seen = places.filter(|&p| map.evidence.at(map.lattice(), p).free);
    seen.fold([0.0, 0.0], |[farthest, widest]: [f64; 2], p| {
        let (own, other) = (map.distance(p, Kind::Propagated).unwrap(), whole.distance(p, Kind::Propagated).unwrap());
        [farthest.max((own.0 - other.0).abs()), widest.max((own.1 / other.1 - 1.0).abs())]
    })
}

#[test]
fn a_signed_map_with_a_band_pays_for_what_was_seen_and_says_the_same_there() {
    let (map, whole) = (fitted(Some(3.0), false), fitted(None, false));
    assert!(map.report.converged && map.report.positive_definite);
    let (active, all) = (map.report.active_control_points.unwrap(), map.lattice().len());
    let [distance, sigma] = largest_changes(&map, &whole);
    println!("{active} of {all} control points; distance changes by {distance:.5} m at most, sigma by {sigma:.4}");
    assert!(active * 2 < all && whole.report.active_control_points.is_none());
    assert!(distance < 1e-3 && sigma < 0.05);

    let nobody_was_here = Vec2::new(11.0, 11.0);
    assert!(
        map.query(nobody_was_here, Kind::Posterior).is_none()
            && whole.query(nobody_was_here, Kind::Posterior).is_some()
    );
    let back = FittedMap::from_npz(&map.to_npz().unwrap()).unwrap();
    assert_eq!(
        back.field.variances(Kind::Posterior)[0].1[500].to_bits(),
        map.field.variances(Kind::Posterior)[0].1[500].to_bits()
    );
    assert_eq!(back.distance(Vec2::new(1.0, 1.0), Kind::Posterior), map.distance(Vec2::new(1.0, 1.0), Kind::Posterior));
}

#[test]
fn a_vector_map_has_a_band_of_its_own_and_a_wider_one_changes_little() {
    let (map, wide) = (fitted(None, true), fitted(Some(8.0), true));
    let [active, more] = [&map, &wide].map(|map| map.report.active_control_points.unwrap());
    let [distance, _] = largest_changes(&map, &wide);
    println!("{active} and {more} control points; distance changes by {distance:.5} m at most");
    assert!(active < more && distance < 0.02);
}

#[test]
fn control_points_in_use_are_counted_as_the_fit_has_them_and_cheaply_never_fewer() {
    let scenario = Scenario::experiment_one();
    for (half_width, seed) in [(12.0, 1), (40.0, 2), (3.0, 3)] {
        let bounds = Bounds { min: [-half_width; 2], max: [half_width; 2] };
        let lattice = Lattice::covering(&bounds, scenario.resolution, 1_000_000).unwrap();
        let (scans, options) = (scenario.scans(seed), FitOptions::default());
        let counted = |limit| fit::control_points(&scans, Distance::Vector, &lattice, &options, limit).total();
        let exact = fit::footprint(&scans, Distance::Vector, &lattice, &options, &|| true).unwrap().control_points;
        let cheap = counted(lattice.len() - 1);
        println!("{exact} in use, {cheap} in the scans' surroundings, {} in all", lattice.len());
        assert_eq!(counted(0), exact);
        assert!((exact..=lattice.len()).contains(&cheap));
        // A signed map without a band uses all of them.
        assert_eq!(fit::control_points(&scans, Distance::Signed, &lattice, &options, 0).total(), lattice.len());
    }
}

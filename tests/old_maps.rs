//! Maps of the first file format, as the versions before 0.2 stored them, are read, asked and stored anew.
//!
//! The fixtures are experiment 1's room at h = 0.5 m, seed 1, fitted by version 0.1: files without `format`, with f64
//! covariances over the whole stencil and without surfaces.

use mapfit::map::FittedMap;
use mapfit::render::contours;
use mapfit::{Distance, Kind, Vec2};

fn read(name: &str) -> FittedMap {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
    FittedMap::from_npz(&std::fs::read(file).unwrap()).unwrap()
}

#[test]
fn a_map_of_the_first_format_answers_and_is_stored_in_todays() {
    for (name, distance) in [("format-1-sdf.npz", Distance::Signed), ("format-1-vdf.npz", Distance::Vector)] {
        let old = read(name);
        assert_eq!(old.field.distance(), distance);
        assert_eq!((old.poses.len(), old.pose_covariance.propagated.len()), (3, 3));
        // A metre from the left wall.
        let p = Vec2::new(1.0, 3.0);
        let answer = old.query(p, Kind::Propagated).unwrap();
        assert!((answer.distance.abs() - 1.0).abs() < 0.05 && answer.sigma > 0.001, "{answer:?}");
        assert!((old.nearest(p).unwrap() - Vec2::new(0.0, 3.0)).norm() < 0.2);
        assert!(old.clearance(p).unwrap() < 1.05 && old.observed(p) == Some(true));
        assert!(!contours(&old, 0.0, Some(2.0), Kind::Propagated).unwrap().lines.0.is_empty());

        let bytes = old.to_npz().unwrap();
        let new = FittedMap::from_npz(&bytes).unwrap();
        assert_eq!(new.field.coefficients()[0].1.len(), old.field.coefficients()[0].1.len());
        let [before, after] = [&old, &new].map(|map| map.distance(p, Kind::Posterior).unwrap());
        assert!(before.0 == after.0 && (before.1 / after.1 - 1.0).abs() < 1e-6);
        assert!(new.to_npz().unwrap() == bytes, "what is read is what was written");
    }
}

#[test]
fn a_damaged_file_is_refused_in_words() {
    let bytes = read("format-1-sdf.npz").to_npz().unwrap();
    let damaged = FittedMap::from_npz(&bytes[..bytes.len() / 2]).unwrap_err();
    assert!(!damaged.to_string().is_empty());
}

//! How long a stored map takes to load and to answer: `cargo run --release --example query -- map.npz`, a file that `mapfit fit`
//! wrote. 100,000 points all over the map, row by row, with distance, sigma and nearest surface point; asked twice, for a
//! map remembers which surfaces are near where it was asked.

use std::time::Instant;

use mapfit::{FittedMap, Kind, Vec2};

const POINTS: usize = 100_000;

/// A raster of so many points over the map's bounds, of which those on the map stay.
fn raster(map: &FittedMap, points: f64) -> Vec<Vec2> {
    let bounds = map.lattice().bounds();
    let side = points.sqrt().ceil() as usize;
    let at = |k: usize, axis: usize| {
        bounds.min[axis] + (k as f64 + 0.5) / side as f64 * (bounds.max[axis] - bounds.min[axis])
    };
    let all = (0..side * side).map(|k| Vec2::new(at(k % side, 0), at(k / side, 1)));
    all.filter(|p| map.field.locate(*p).is_some()).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1).ok_or("which map.npz?")?;
    let bytes = std::fs::read(file)?;
    let began = Instant::now();
    let map = FittedMap::from_npz(&bytes)?;
    println!("loaded in {:.1?}", began.elapsed());
    let share = raster(&map, POINTS as f64).len() as f64 / POINTS as f64;
    let points = raster(&map, POINTS as f64 / share);
    for time in ["first", "second"] {
        let began = Instant::now();
        let answers = points.iter().filter_map(|p| map.query(*p, Kind::Propagated));
        let (count, sum) = answers.fold((0, 0.0), |(count, sum), answer| (count + 1, sum + answer.distance));
        let mean = sum / f64::from(count);
        println!("{time}: {count} of {} points, mean {mean:.3} m, in {:.1?}", points.len(), began.elapsed());
    }
    Ok(())
}

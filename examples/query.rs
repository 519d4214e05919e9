//! How long a stored map takes to load and to answer: `cargo run --release --example query -- map.npz`, a file that `mapfit fit`
//! wrote. 100,000 points spread over the map, with distance, sigma and nearest surface point.

use std::time::Instant;

use mapfit::{FittedMap, Kind, Vec2};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1).ok_or("which map.npz?")?;
    let bytes = std::fs::read(file)?;
    let began = Instant::now();
    let map = FittedMap::from_npz(&bytes)?;
    let loaded = began.elapsed();
    let area = map.lattice().bounds();
    let point = |k: usize| {
        let share = [(k % 317) as f64 / 317.0, (k / 317) as f64 / 316.0];
        let at = |axis: usize| area.min[axis] + share[axis] * (area.max[axis] - area.min[axis]);
        Vec2::new(at(0), at(1))
    };
    let began = Instant::now();
    let answers = (0..100_000).filter_map(|k| map.query(point(k), Kind::Propagated));
    let (count, mean) = answers.fold((0, 0.0), |(count, sum), answer| (count + 1, sum + answer.distance));
    let asked = began.elapsed();
    println!(
        "loaded in {loaded:.1?}; {count} of 100,000 points on the map, mean {:.3} m, in {asked:.1?}",
        mean / f64::from(count)
    );
    Ok(())
}

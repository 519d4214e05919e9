//! From scans to a map with the library alone: fit, ask, save.
//!
//! `cargo run --release --example survey` fits a simulated room and prints the distance, with its standard deviation, along a
//! line through it; `survey.npz` then holds the map.

use std::ops::ControlFlow;

use mapfit::sim::Scenario;
use mapfit::{Distance, Kind, Survey, Vec2};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let room = Scenario::experiment_one();
    let scans = room.scans(1);
    let survey = Survey::new(&scans, room.noise).distance(Distance::Vector).resolution(0.25);
    let map = survey.map_watched(&|step| {
        eprintln!("{:?}: {:.0} %", step.stage, 100.0 * step.share);
        ControlFlow::Continue(())
    })?;
    println!("    x     distance  sigma   clearance (m)");
    for k in 0..=8 {
        let p = Vec2::new(f64::from(k) * 0.5, 3.0);
        if let (Some((distance, sigma)), Some(clearance)) = (map.distance(p, Kind::Propagated), map.clearance(p)) {
            println!("{:8.2} {distance:8.3} {sigma:8.4} {clearance:8.3}", p.x);
        }
    }
    std::fs::write("survey.npz", map.to_npz()?)?;
    Ok(())
}

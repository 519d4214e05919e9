//! How cost grows with a building: halls of so many rooms a side as vector maps, poses refined.
//!
//! `cargo run --release --example halls -- 4 8 16` prints a line a building: rooms, control points in use, seconds of the
//! fit and of the covariance, peak memory, bytes stored. `THREADS=1` has one thread do it all; without it there is one a
//! core. `docs/performance.md` has the curve.

use mapfit::fit::Distance;
use mapfit::map::Survey;
use mapfit::scan::Noise;
use mapfit::sim::{self, misplaced};
use mapfit::sparse::Team;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("rooms,active,fit seconds,covariance seconds,peak MB,bytes,bytes per control point,converged");
    let team = match std::env::var("THREADS") {
        Ok(threads) => Team::of(threads.parse()?),
        Err(_) => Team::of_this_machine(),
    };
    for side in std::env::args().skip(1) {
        let side: usize = side.parse()?;
        let noise = Noise { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
        let building = sim::Survey::halls(side, noise.sigma_range, 1);
        let scans = misplaced(&building.scans, &noise, 2);
        let map = Survey::new(&scans, noise).distance(Distance::Vector).resolution(0.2).team(team.clone()).map()?;
        let (report, bytes) = (&map.report, map.to_npz()?.len());
        let active = report.active_control_points.unwrap_or(map.lattice().len());
        let status = std::fs::read_to_string("/proc/self/status")?;
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("0 kB");
        let peak: f64 = peak.trim().trim_end_matches(" kB").parse()?;
        println!(
            "{},{active},{:.2},{:.2},{:.0},{bytes},{},{}",
            side * side,
            report.stages.fitting,
            report.stages.covariance,
            peak / 1024.0,
            bytes / active,
            report.converged
        );
    }
    Ok(())
}

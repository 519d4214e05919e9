//! How many workers a fleet needs: the queue simulated over days of robots, with what jobs take as measured on a machine.
//!
//! `cargo bench --bench queue` reads `docs/scale/services.csv` (scripts/scale measures it) and prints, and writes to
//! `docs/scale/workers.csv`, the 95 % of the waits in the busiest hour for every number of workers around the one that holds
//! it under a minute. `tests/queue_model.rs` holds the simulation against theory and against the service.

mod fleet;
mod simulation;

use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

use fleet::{Fleets, day, worst_hour};
use simulation::{Arrival, Crew, mean, quantile, waits};

const ROBOTS: [usize; 3] = [1, 100, 10_000];
const JOBS_AN_HOUR: [f64; 2] = [1.0, 4.0];
const SEEDS: u64 = 5;
/// Seconds that 95 of 100 jobs may wait.
const BAR: f64 = 60.0;

/// 95 % of the waits in the busiest hour, the worst of the days.
fn p95(days: &[Vec<Arrival>], crew: Crew) -> f64 {
    let of = |day: &Vec<Arrival>| quantile(&worst_hour(day, &waits(day, crew)), 0.95);
    days.iter().map(of).fold(0.0, f64::max)
}

/// The fewest workers that keep within the bar.
fn fewest(days: &[Vec<Arrival>], crew: Crew) -> usize {
    let holds = |workers: usize| p95(days, Crew { workers, ..crew }) <= BAR;
    let mut enough = 1;
    while !holds(enough) {
        enough *= 2;
    }
    let mut too_few = enough / 2;
    while enough - too_few > 1 {
        let middle = (enough + too_few) / 2;
        if holds(middle) { enough = middle } else { too_few = middle }
    }
    enough
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/scale");
    let measured = std::fs::read_to_string(folder.join("services.csv")).expect("scripts/scale measures services.csv");
    let mut crew = Crew { workers: 1, between: 0.0, pickup: 0.0 };
    let mut services = Vec::new();
    for line in measured.lines() {
        match line.split_once(',') {
            Some(("between", seconds)) => crew.between = seconds.parse().expect("seconds"),
            Some(("pickup", seconds)) => crew.pickup = seconds.parse().expect("seconds"),
            Some(("service", seconds)) => services.push(seconds.parse().expect("seconds")),
            _ => {}
        }
    }
    println!("{} jobs measured, {:.2} s each in the mean", services.len(), mean(&services));
    let mut table = String::from("robots,jobs_an_hour,workers,p95_s,busy\n");
    let began = Instant::now();
    let mut simulated = 0;
    for robots in ROBOTS {
        for jobs_an_hour in JOBS_AN_HOUR {
            let fleets = Fleets { robots, jobs_an_hour, services: services.clone() };
            let days: Vec<Vec<Arrival>> = (0..SEEDS).map(|seed| day(&fleets, seed)).collect();
            let jobs = days[0].len();
            let work: f64 = days[0].iter().map(|job| job.service + crew.between).sum();
            let fewest = fewest(&days, crew);
            println!("{robots} robots, {jobs_an_hour} jobs an hour: {fewest} workers ({jobs} jobs a day)");
            let around =
                [fewest / 2, fewest * 3 / 4, fewest * 7 / 8, fewest, fewest * 9 / 8, fewest * 5 / 4, fewest * 2];
            let mut around: Vec<usize> = around.into_iter().map(|workers| workers.max(1)).collect();
            around.dedup();
            for workers in around {
                let wait = p95(&days, Crew { workers, ..crew });
                simulated += days.iter().map(Vec::len).sum::<usize>();
                // Of the sixteen hours of a shift.
                let busy = work / (16.0 * 3600.0 * workers as f64);
                writeln!(table, "{robots},{jobs_an_hour},{workers},{wait:.3},{busy:.4}").expect("into a string");
            }
        }
    }
    println!("{simulated} jobs in {:.1} s and the search beside", began.elapsed().as_secs_f64());
    std::fs::write(folder.join("workers.csv"), table).expect("docs/scale can be written");
}

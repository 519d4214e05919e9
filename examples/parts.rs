//! How many workers help one map: the tasks of its factorisation, scheduled on so many.
//!
//! `cargo run --release --example parts -- 4 8 16` lays halls of so many rooms a side out (4 m x 4 m, two scans a room, as
//! `halls` does), orders their control points and poses as a fit does, and schedules the tasks of one factorisation
//! ([`Task`]) on 1 to 64 workers: whoever is free takes the ready task with the most work on its way to the end. A worker
//! that needs an update of another waits for it to cross the network. Prints a line a building and number of workers.
//!
//! How fast a worker is, is measured on the first building, which is factorised on one thread; `NETWORK` is bytes a second.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::time::Instant;

use mapfit::geometry::Bounds;
use mapfit::scan::{Evidence, returns_of};
use mapfit::sim::Survey;
use mapfit::sparse::{Cholesky, Pattern, Stencil, SystemMatrix, Task, Views};
use mapfit::spline::{Lattice, SUPPORT};
use nalgebra::Matrix3;

const RESOLUTION: f64 = 0.2;
/// Cells around evidence that have control points, as a vector fit has them.
const BAND: f64 = 0.5;
const WORKERS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let network: f64 = std::env::var("NETWORK").map_or(Ok(1.25e8), |value| value.parse())?;
    let mut measured = None;
    println!("rooms,active,branches,tasks,workers,seconds,speedup,limit,sent MB,largest MB");
    for side in std::env::args().skip(1) {
        let side: usize = side.parse()?;
        let (active, mut cholesky) = analysed(side)?;
        let tasks = cholesky.tasks();
        let rate = match measured {
            Some(rate) => rate,
            None => *measured.insert(rate(&mut cholesky, &tasks)?),
        };
        let branches = tasks.iter().filter(|task| task.branch).count();
        let alone = tasks.iter().map(|task| task.work).sum::<f64>() / rate;
        let limit = alone * rate / longest_paths(&tasks).into_iter().fold(0.0, f64::max);
        for workers in WORKERS {
            let plan = schedule(&tasks, workers, rate, network);
            println!(
                "{},{active},{branches},{},{workers},{:.2},{:.2},{limit:.2},{:.0},{:.0}",
                side * side,
                tasks.len(),
                plan.seconds,
                alone / plan.seconds,
                plan.sent / 1e6,
                plan.largest / 1e6
            );
        }
    }
    Ok(())
}

/// Control points in use, and the factorisation of a vector map with refined poses, without values.
fn analysed(side: usize) -> Result<(usize, Cholesky), Box<dyn std::error::Error>> {
    let building = Survey::halls(side, 0.02, 1);
    let length = 4.0 * side as f64;
    let bounds = Bounds { min: [-0.6, -0.6], max: [length + 0.6, length + 0.6] };
    let lattice = Lattice::covering(&bounds, RESOLUTION, 100_000_000)?;
    let row = lattice.control_points()[0];
    let evidence = Evidence::gather(&lattice, &building.scans);
    let stencil = Stencil::of_cells(&lattice, &evidence.cells_within(&lattice, BAND));
    let seen: BTreeSet<(usize, usize)> = returns_of(&building.scans)
        .iter()
        .filter_map(|seen| Some((seen.scan, lattice.support(lattice.locate(seen.point)?.cell)[0])))
        .collect();
    let points = |(pose, first): (usize, usize)| (0..SUPPORT).map(move |k| (pose, first + k % 4 + k / 4 * row));
    let views = Views::of(building.poses.len(), seen.into_iter().flat_map(points));
    Ok((stencil.active_len(), Cholesky::analyse(&Pattern::new(stencil.clone(), 2, views))?))
}

/// Multiply-adds a second of one thread: zeros are as much work as anything else.
fn rate(cholesky: &mut Cholesky, tasks: &[Task]) -> Result<f64, Box<dyn std::error::Error>> {
    let mut matrix = SystemMatrix::zeros(cholesky.pattern().clone());
    matrix.shift_diagonal(|_, _| 1.0);
    (0..matrix.pattern().views().poses()).for_each(|pose| matrix.add_pose(pose, &Matrix3::identity()));
    cholesky.factorise(&matrix)?;
    let began = Instant::now();
    cholesky.factorise(&matrix)?;
    Ok(tasks.iter().map(|task| task.work).sum::<f64>() / began.elapsed().as_secs_f64())
}

/// The work from each task's beginning to the end, itself included.
fn longest_paths(tasks: &[Task]) -> Vec<f64> {
    let mut paths = vec![0.0; tasks.len()];
    for (k, task) in tasks.iter().enumerate().rev() {
        paths[k] = task.work + task.needed_by.iter().map(|&parent| paths[parent]).fold(0.0, f64::max);
    }
    paths
}

struct Plan {
    seconds: f64,
    /// Bytes that crossed the network.
    sent: f64,
    /// Bytes of the factor that the worker with the most holds.
    largest: f64,
}

/// List scheduling: the next task goes to the worker that can begin it first.
fn schedule(tasks: &[Task], workers: usize, rate: f64, network: f64) -> Plan {
    let urgency = longest_paths(tasks);
    let mut waits_for = vec![0; tasks.len()];
    tasks.iter().flat_map(|task| &task.needed_by).for_each(|&parent| waits_for[parent] += 1);
    let mut ready: Vec<usize> = (0..tasks.len()).filter(|&k| waits_for[k] == 0).collect();
    let mut handed: Vec<Vec<(usize, f64)>> = vec![Vec::new(); tasks.len()];
    let (mut free, mut held) = (vec![0.0f64; workers], vec![0.0f64; workers]);
    let mut plan = Plan { seconds: 0.0, sent: 0.0, largest: 0.0 };
    let mut owners: Vec<Option<usize>> = vec![None; tasks.len()];
    while let Some(at) = (0..ready.len()).max_by(|&a, &b| compare(urgency[ready[a]], urgency[ready[b]])) {
        let task = ready.swap_remove(at);
        // When a worker could begin it, and the bytes that it has to fetch before.
        let fetch = |w: usize| {
            handed[task].iter().fold((free[w], 0.0), |(at, bytes), &(child, done)| {
                let update = 8.0 * tasks[child].update as f64;
                match owners[child] == Some(w) {
                    true => (at.max(done), bytes),
                    false => (at.max(done + update / network), bytes + update),
                }
            })
        };
        let Some(w) = (0..workers).min_by(|&a, &b| compare(fetch(a).0, fetch(b).0)) else { break };
        let (begin, bytes) = fetch(w);
        let end = begin + tasks[task].work / rate;
        (free[w], owners[task]) = (end, Some(w));
        held[w] += 8.0 * tasks[task].entries as f64;
        plan.sent += bytes;
        plan.seconds = plan.seconds.max(end);
        for &parent in &tasks[task].needed_by {
            handed[parent].push((task, end));
            waits_for[parent] -= 1;
            if waits_for[parent] == 0 {
                ready.push(parent);
            }
        }
    }
    plan.largest = held.into_iter().fold(0.0, f64::max);
    plan
}

fn compare(a: f64, b: f64) -> Ordering {
    a.total_cmp(&b)
}

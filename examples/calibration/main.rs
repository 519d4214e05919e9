//! The calibration study: how often two sigma hold, over worlds, resolutions, noise and beams, by simulation.
//!
//! `scripts/calibration` runs this and draws `docs/calibration.md` from the table it prints (CSV, one line a case).
//! Every replicate is a new draw of all noise; truth is exact. `--help` lists what can be chosen.

mod cases;
mod grid;
mod replicate;
mod tally;

use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use clap::Parser;
use mapfit::fit::{FitOptions, Poses, Weighting};

use replicate::{Truth, replicate};
use tally::{HEADER, Tally};

#[derive(Parser)]
#[command(about = "Bias and coverage of fitted maps against exact worlds; CSV on standard output")]
struct Choice {
    /// Only the cases whose name contains one of these.
    only: Vec<String>,
    #[arg(long, default_value_t = 100)]
    replicates: u64,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Poses as reported, instead of refined.
    #[arg(long)]
    fixed: bool,
    #[arg(long)]
    eikonal_weight: Option<f64>,
    #[arg(long)]
    eikonal_scale: Option<f64>,
    #[arg(long)]
    smoothing: Option<f64>,
    #[arg(long)]
    model_sigma: Option<f64>,
    /// Instead of coverage: accuracy of the automatic weights and of a grid of hand-set ones.
    #[arg(long)]
    grid: bool,
    #[arg(long, env = "MAPFIT_RECORDINGS", default_value = "../shared/data")]
    data: std::path::PathBuf,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let choice = Choice::parse();
    let options = FitOptions {
        weighting: Weighting::Calibrated,
        poses: choice.fixed.then_some(Poses::Fixed),
        eikonal_weight: choice.eikonal_weight,
        eikonal_scale: choice.eikonal_scale,
        smoothing: choice.smoothing,
        model_sigma: choice.model_sigma,
        ..Default::default()
    };
    let mut cases = cases::all(&choice.data)?;
    cases.retain(|case| choice.only.is_empty() || choice.only.iter().any(|part| case.name.contains(part.as_str())));
    println!("{}", if choice.grid { grid::HEADER } else { HEADER });
    for case in &cases {
        let truth = Truth::of(&case.scenario);
        if choice.grid {
            for options in grid::choices(&options) {
                println!("{}", grid::line(case, &truth, &options, choice.replicates, choice.threads));
                std::io::stdout().flush()?;
            }
        } else {
            let draw = |seed| replicate(&case.scenario, &truth, &options, 1000 + seed);
            let tally = Tally::of(&truth, &in_parallel(choice.replicates, choice.threads, draw));
            println!("{}", tally.line(case));
            std::io::stdout().flush()?;
        }
    }
    Ok(())
}

/// What `draw` gives for each of the first `replicates` seeds, in their order, on a few threads.
fn in_parallel<T: Send>(replicates: u64, threads: usize, draw: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let (next, drawn) = (AtomicUsize::new(0), Mutex::new(Vec::<(u64, T)>::new()));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed) as u64;
                    if seed >= replicates {
                        break;
                    }
                    let own = draw(seed);
                    drawn.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((seed, own));
                }
            });
        }
    });
    let mut drawn = drawn.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    drawn.sort_by_key(|(seed, _)| *seed);
    drawn.into_iter().map(|(_, own)| own).collect()
}

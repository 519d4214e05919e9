//! mapfit's side of the comparison with other solvers: `scripts/peers` runs it and the peers of `benches/peers` in
//! turn.
//!
//! ```text
//! side_by_side write L|office10k|office40k|office160k DIR    the problem, as raw little-endian arrays any language reads
//! side_by_side solve L|office10k|...                         seconds and cost at every step, as CSV, then the marginals' time
//! side_by_side marginals L|office10k|...                     the marginals' time alone
//! side_by_side grow SIDE                                     a calibrated fit with covariance: time, memory, steps
//! ```
//!
//! The objective is the same for all: `rho h^2 / 4 sum (|grad u|^2 - 1)^2` at 2 x 2 Gauss points in every cell, with
//! `rho` = 300 / m^2, and `sum w u^2` at the returns with weights `w = 1 / (g C g)` frozen at the start; the start is
//! the signed nearest-return spline.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use mapfit::fit::{
    Curvature, EikonalLoss, Factor, FitOptions, Law, Minimum, Newton, Objective, Sightings, StoppingRule, System,
    Viewpoint, Weighing, signed_nearest_return,
};
use mapfit::geometry::psd_square_root;
use mapfit::map::Survey;
use mapfit::scan::{Evidence, ReturnNoise, returns_of};
use mapfit::sim::Scenario;
use mapfit::sparse::{Cholesky, Pattern, Stencil, selected_inverse, selected_sandwich};
use mapfit::spline::Lattice;

type Failure = Box<dyn std::error::Error>;

const RHO: f64 = 300.0;

fn main() -> Result<(), Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["write", world, folder] => write(&Problem::of(world)?, Path::new(folder)),
        ["solve", world] => solve(Problem::of(world)?),
        ["marginals", world] => at_the_start(Problem::of(world)?),
        ["grow", side] => grow(side.parse()?),
        _ => Err("write WORLD DIR | solve WORLD | marginals WORLD | grow SIDE".into()),
    }
}

struct Problem {
    objective: Objective,
    cholesky: Cholesky,
    start: Vec<f64>,
    scenario: Scenario,
}

impl Problem {
    fn of(world: &str) -> Result<Self, Failure> {
        let scenario = match world {
            "L" => Scenario::experiment_one(),
            "office10k" => Scenario::comb_office(19.0),
            "office40k" => Scenario::comb_office(39.0),
            "office160k" => Scenario::comb_office(79.0),
            other => return Err(format!("no world called {other}").into()),
        };
        let lattice = Lattice::covering(&scenario.bounds, scenario.resolution, 1_000_000)?;
        let scans = scenario.scans(0);
        let returns: Vec<_> = returns_of(&scans).into_iter().filter(|r| lattice.locate(r.point).is_some()).collect();
        let evidence = Evidence::gather(&lattice, &scans);
        let stencil = Stencil::of(&lattice);
        let mut cholesky = Cholesky::analyse(&Pattern::of_stencil(&stencil))?;
        let start = signed_nearest_return(&lattice, &returns, &evidence, 0.0, &mut cholesky)?;
        let viewpoints: Vec<Viewpoint> = scans
            .iter()
            .map(|scan| {
                let covariance = scan.pose_covariance(&scenario.noise);
                let root = psd_square_root(&covariance).ok_or("a pose covariance")?;
                let range_variance = scenario.noise.sigma_range.powi(2);
                let noise = ReturnNoise { pose: Some(covariance), range_variance, model_variance: 2.5e-5 };
                Ok(Viewpoint { position: scan.pose.position(), root, frame: 0, noise })
            })
            .collect::<Result<_, Failure>>()?;
        let weights = returns
            .iter()
            .map(|seen| {
                let g = start.jet_at(&lattice.locate_or_extend(seen.point)).gradient;
                let direction = g.try_normalize(1e-12).unwrap_or(seen.direction);
                1.0 / direction.dot(&(viewpoints[seen.scan].noise.covariance(seen) * direction))
            })
            .collect();
        let sightings = Sightings::new(&lattice, returns, viewpoints, Weighing::Frozen(weights));
        let loss = EikonalLoss { weight: RHO * scenario.resolution.powi(2), scale: None };
        let objective = Objective::new(lattice, stencil, sightings, loss, 0.0, None, 2);
        Ok(Self { objective, cholesky, start: start.coefficients, scenario })
    }
}

fn write(problem: &Problem, folder: &Path) -> Result<(), Failure> {
    let (lattice, sightings) = (&problem.objective.lattice, &problem.objective.sightings);
    let Weighing::Frozen(weights) = &sightings.weighing else { return Err("frozen weights".into()) };
    std::fs::create_dir_all(folder)?;
    let [nx, ny] = lattice.cells;
    let (mut cells, mut places) = (Vec::new(), Vec::new());
    for (cell, seen) in sightings.at(lattice, &[]).by_cell(lattice) {
        for sighting in seen {
            cells.extend((lattice.cell_index(cell) as i64).to_le_bytes());
            let [t, w] = sighting.located.local;
            [t, w, weights[sighting.source]].iter().for_each(|v| places.extend(v.to_le_bytes()));
        }
    }
    let start: Vec<u8> = problem.start.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.join("meta.txt"), format!("{nx} {ny} {} {RHO} {}\n", lattice.resolution, cells.len() / 8))?;
    std::fs::write(folder.join("cells.i64"), cells)?;
    std::fs::write(folder.join("returns.f64"), places)?;
    std::fs::write(folder.join("start.f64"), start)?;
    Ok(())
}

fn solve(mut problem: Problem) -> Result<(), Failure> {
    let mut unknowns = problem.start.clone();
    let rule = StoppingRule {
        max_iterations: 200,
        tolerance: 1e-8,
        first_gradient: None,
        certify: true,
        chords: 1,
        law: Law::Slopes,
    };
    println!("seconds,cost,relative_gradient");
    let begun = Instant::now();
    let mut newton = Newton::new(&problem.objective, &mut problem.cholesky, Minimum::default());
    let minimum = newton.minimise(&mut unknowns, &rule, &mut |progress| {
        println!("{:.6},{:.9},{:.3e}", begun.elapsed().as_secs_f64(), progress.objective, progress.relative_gradient);
        ControlFlow::Continue(())
    })?;
    let system = newton.system;
    println!("# factorisations {} positive definite {}", minimum.factorisations, minimum.positive_definite);
    println!(
        "# inside rmse at the start {:.4} at the end {:.4}",
        inside(&problem, &problem.start),
        inside(&problem, &unknowns)
    );
    marginals(&system, &mut problem.cholesky)
}

/// The marginals' time over a factorisation's, the best of three each, for the system at hand.
fn marginals(system: &System, cholesky: &mut Cholesky) -> Result<(), Failure> {
    let timed = |work: &mut dyn FnMut() -> Result<(), Failure>| -> Result<f64, Failure> {
        let mut best = f64::INFINITY;
        for _ in 0..3 {
            let begun = Instant::now();
            work()?;
            best = best.min(begun.elapsed().as_secs_f64());
        }
        Ok(best)
    };
    Factor::factorise(system, cholesky)?;
    let go_on = |_: f64| true;
    let factorisation = timed(&mut || Ok(cholesky.factorise(&system.hessian)?))?;
    let posterior = timed(&mut || selected_inverse(cholesky, &go_on).map(|_| ()).map_err(Into::into))?;
    let both = timed(&mut || selected_sandwich(cholesky, &system.hessian, &go_on).map(|_| ()).map_err(Into::into))?;
    println!("# marginals: factorisation {factorisation:.6} posterior {posterior:.6} both {both:.6}");
    Ok(())
}

/// The marginals where the fit starts, with the convex stand-in: their time depends on the pattern alone.
fn at_the_start(mut problem: Problem) -> Result<(), Failure> {
    let mut system = problem.objective.system(&[]);
    problem.objective.assemble(&problem.start, Curvature::CONVEX, &mut system);
    marginals(&system, &mut problem.cholesky)
}

/// The distance's error in free space, root mean square.
fn inside(problem: &Problem, coefficients: &[f64]) -> f64 {
    let surface =
        mapfit::spline::Surface { lattice: problem.objective.lattice.clone(), coefficients: coefficients.to_vec() };
    let (world, bounds) = (&problem.scenario.world, problem.scenario.bounds);
    let (mut sum, mut n) = (0.0, 0.0);
    let steps = [0, 1].map(|axis| ((bounds.max[axis] - bounds.min[axis]) / 0.25) as usize);
    for k in 0..steps[0] * steps[1] {
        let p = mapfit::geometry::Vec2::new(
            bounds.min[0] + 0.25 * (k % steps[0]) as f64,
            bounds.min[1] + 0.25 * (k / steps[0]) as f64,
        );
        if let Some(u) = surface.value(p).filter(|_| world.is_free(p)) {
            sum += (u - world.signed_distance(p)).powi(2);
            n += 1.0;
        }
    }
    f64::sqrt(sum / n)
}

fn grow(side: f64) -> Result<(), Failure> {
    let scenario = Scenario::comb_office(side);
    let options = FitOptions { poses: Some(mapfit::fit::Poses::Fixed), ..Default::default() };
    let scans = scenario.scans(0);
    let survey = Survey::new(&scans, scenario.noise).resolution(scenario.resolution).bounds(scenario.bounds);
    let map = survey.options(options).map()?;
    let (converged, steps) = (map.report.converged, map.report.factorisations);
    let (solved, seconds) = (map.report.stages.fitting, map.report.seconds);
    let peak = std::fs::read_to_string("/proc/self/status")?
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:").map(|rest| rest.trim().trim_end_matches(" kB").to_owned()))
        .ok_or("no VmHWM")?;
    println!("{},{},{solved:.3},{seconds:.3},{peak},{steps},{converged}", map.lattice().len(), map.returns.len());
    Ok(())
}

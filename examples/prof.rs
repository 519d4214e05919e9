use mapfit::fit;
use mapfit::jobs::*;
use std::ops::ControlFlow;
use std::time::Instant;
fn main() {
    let f = std::env::args().nth(1).unwrap();
    let json = std::fs::read(f).unwrap();
    let limits = Limits { control_points: 1_000_000, values: 100_000_000, ..Limits::default() };
    let r = JobRequest::parse(&json, &limits).unwrap();
    let t = Instant::now();
    let mut w = |p: &fit::Progress| {
        println!(
            "{:.2}s it {} f {:.6e} rel {:.4e}",
            t.elapsed().as_secs_f64(),
            p.iteration,
            p.objective,
            p.relative_gradient
        );
        ControlFlow::Continue(())
    };
    let e = {
        let mut o = r.options;
        o.max_iterations = std::env::var("IT").map(|v| v.parse().unwrap()).unwrap_or(100);
        fit::fit(&r.scans, &r.noise, r.distance, &r.lattice, &o, &mut w).unwrap()
    };
    println!(
        "fit {:.2}s active {} fill {} conv {}",
        t.elapsed().as_secs_f64(),
        e.system.hessian.pattern().stencil().active_len(),
        e.cholesky.fill(),
        e.converged
    );
    let t = Instant::now();
    let m = mapfit::map::FittedMap::of(e, r.noise, &|_| true);
    match m {
        Err(e) => println!("{e}"),
        Ok(m) => {
            println!("cov {:.2}s facets {}", t.elapsed().as_secs_f64(), m.surfaces.facets().len());
            println!("{} bytes", m.to_npz().unwrap().len());
        }
    }
}

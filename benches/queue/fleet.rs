//! Robots as a source of jobs: when they send what, over a day.
//!
//! A fleet (tenant) has robots; a robot sends a map's scans so many times an hour while its shift lasts, at times that know
//! nothing of each other (a Poisson process). At the shift's begin all robots of a fleet send one within some minutes, after
//! the charging: that is the hour that counts. One job in fifty is urgent, as an operator who waits for a map makes it.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp, LogNormal};

use crate::simulation::Arrival;

/// Who sends how much.
#[derive(Debug, Clone)]
pub struct Fleets {
    pub robots: usize,
    /// Jobs a robot sends in an hour of its shift.
    pub jobs_an_hour: f64,
    /// Seconds that jobs take, as measured: one is as likely as another.
    pub services: Vec<f64>,
}

/// Robots of a fleet, in the median, and how much fleets differ (the sigma of a lognormal).
const FLEET: (f64, f64) = (40.0, 1.0);
/// Hours of a shift, of which a fleet has one; it begins within these hours of the day.
const SHIFT: f64 = 16.0;
const BEGINS: (f64, f64) = (4.0, 8.0);
/// Seconds in which all robots of a fleet send their first.
const ROLL_CALL: f64 = 600.0;
const URGENT: f64 = 0.02;
const HOUR: f64 = 3600.0;
const DAY: f64 = 24.0 * HOUR;

/// A day's jobs, by time.
pub fn day(fleets: &Fleets, seed: u64) -> Vec<Arrival> {
    let mut draw = ChaCha8Rng::seed_from_u64(seed);
    let mut arrivals = Vec::new();
    // A lognormal's sigma and an exponential's rate are positive here, so neither is refused.
    let (Ok(size), Ok(pause)) = (LogNormal::new(FLEET.0.ln(), FLEET.1), Exp::new(fleets.jobs_an_hour / HOUR)) else {
        return arrivals;
    };
    let (mut robots, mut tenant) = (0, 0);
    while robots < fleets.robots {
        let own = (size.sample(&mut draw).ceil() as usize).min(fleets.robots - robots);
        let begins = HOUR * draw.random_range(BEGINS.0..BEGINS.1);
        for _ in 0..own {
            let mut at = begins + draw.random_range(0.0..ROLL_CALL);
            while at < (begins + SHIFT * HOUR).min(DAY) {
                arrivals.push(job(fleets, at, tenant, &mut draw));
                at += pause.sample(&mut draw);
            }
        }
        (robots, tenant) = (robots + own, tenant + 1);
    }
    arrivals.sort_by(|a, b| a.at.total_cmp(&b.at));
    arrivals
}

fn job(fleets: &Fleets, at: f64, tenant: u32, draw: &mut impl Rng) -> Arrival {
    let service = fleets.services[draw.random_range(0..fleets.services.len())];
    Arrival { at, tenant, priority: i32::from(draw.random_bool(URGENT)), service }
}

/// The waits of the hour in which they are longest, by their 95 %.
pub fn worst_hour(arrivals: &[Arrival], waits: &[f64]) -> Vec<f64> {
    let mut hours = vec![Vec::new(); 24];
    for (arrival, wait) in arrivals.iter().zip(waits) {
        hours[((arrival.at / HOUR) as usize).min(23)].push(*wait);
    }
    let p95 = |hour: &Vec<f64>| crate::simulation::quantile(hour, 0.95);
    hours.into_iter().max_by(|a, b| p95(a).total_cmp(&p95(b))).unwrap_or_default()
}

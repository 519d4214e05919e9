//! The queue's simulation (`benches/queue`) against theory, against its own rule, and against the service itself.

#[path = "../benches/queue/fleet.rs"]
mod fleet;
#[path = "../benches/queue/simulation.rs"]
mod simulation;
mod support;

use std::process::Command;
use std::time::{Duration, Instant};

use fleet::Fleets;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use simulation::{Arrival, Crew, mean, quantile, waits};
use support::{Server, experiment_one, small};

const IDEAL: Crew = Crew { workers: 1, between: 0.0, pickup: 0.0 };

/// Draws from an exponential distribution.
fn exponential(draw: &mut ChaCha8Rng, mean: f64) -> f64 {
    -mean * (1.0 - draw.random_range(0.0..1.0f64)).ln()
}

/// M/M/c: Erlang's C formula is exact.
#[test]
fn the_simulation_waits_as_theory_says() {
    for (workers, load) in [(1, 0.7), (4, 0.9)] {
        let mut draw = ChaCha8Rng::seed_from_u64(7);
        let mut at = 0.0;
        let arrivals: Vec<Arrival> = (0..400_000)
            .map(|_| {
                at += exponential(&mut draw, 1.0 / (load * workers as f64));
                Arrival { at, tenant: 0, priority: 0, service: exponential(&mut draw, 1.0) }
            })
            .collect();
        let offered = load * workers as f64;
        let mut term = 1.0;
        let mut sum = 1.0;
        for k in 1..workers {
            term *= offered / k as f64;
            sum += term;
        }
        let last = term * offered / workers as f64 / (1.0 - load);
        let expected = last / (sum + last) / (workers as f64 * (1.0 - load));
        let found = mean(&waits(&arrivals, Crew { workers, ..IDEAL }));
        println!("M/M/{workers} at {load}: {found:.3}, by Erlang {expected:.3}");
        assert!((found / expected - 1.0).abs() < 0.05);
    }
}

#[test]
fn the_simulation_claims_by_priority_then_fairness_then_age() {
    let job = |at: f64, tenant, priority| Arrival { at, tenant, priority, service: 10.0 };
    // The suite's own example: a, a, b, urgent a; here with one worker, then with four at once.
    let all = [job(0.0, 0, 0), job(0.1, 0, 0), job(0.2, 1, 0), job(0.3, 0, 5)];
    let starts = |crew: Crew| -> Vec<f64> {
        all.iter().zip(waits(&all, crew)).map(|(job, wait)| (10.0 * (job.at + wait)).round() / 10.0).collect()
    };
    assert_eq!(starts(IDEAL), [0.0, 30.0, 20.0, 10.0], "nobody runs when one worker claims; b was never served");
    assert_eq!(starts(Crew { workers: 2, ..IDEAL }), [0.0, 0.1, 10.1, 10.0]);
    assert_eq!(starts(Crew { workers: 4, ..IDEAL }), [0.0, 0.1, 0.2, 0.3]);
    // With one of a's jobs running b's turn comes first, though it is younger.
    let all = [job(0.0, 0, 0), job(0.1, 0, 0), job(0.2, 0, 0), job(0.3, 1, 0)];
    let found = waits(&all, Crew { workers: 2, ..IDEAL });
    assert!(found[3] + 0.3 < found[2] + 0.2, "{found:?}");
    // Nor does whoever fills the queue keep others out who come later, however few workers there are.
    let flood: Vec<Arrival> = (0..5).map(|_| job(0.0, 0, 0)).chain([job(15.0, 1, 0)]).collect();
    assert_eq!(waits(&flood, IDEAL)[5], 5.0);
    // What lies between two jobs of a worker, and before an idle one's first.
    let slow = Crew { workers: 1, between: 0.5, pickup: 0.01 };
    let found = waits(&all[..2], slow);
    assert!((found[0] - 0.01).abs() < 1e-12 && (found[1] - (10.51 - 0.1)).abs() < 1e-12, "{found:?}");
}

#[test]
fn a_fleets_day_is_what_was_asked_for_and_the_same_every_time() {
    let fleets = Fleets { robots: 1000, jobs_an_hour: 2.0, services: vec![1.0, 3.0] };
    let day = fleet::day(&fleets, 3);
    assert_eq!(day, fleet::day(&fleets, 3));
    assert_ne!(day, fleet::day(&fleets, 4));
    assert!(day.is_sorted_by(|a, b| a.at <= b.at));
    let a_robot = day.len() as f64 / 1000.0;
    assert!((31.0..34.5).contains(&a_robot), "a roll call and 16 hours of two an hour: {a_robot}");
    let urgent = day.iter().filter(|job| job.priority > 0).count() as f64 / day.len() as f64;
    assert!((0.015..0.025).contains(&urgent));
    let late = Arrival { at: 20.5 * 3600.0, tenant: 0, priority: 0, service: 1.0 };
    let early = Arrival { at: 1.0, ..late };
    assert_eq!(fleet::worst_hour(&[early, early, late], &[1.0, 2.0, 3.0]), [3.0]);
}

/// One job's times, seconds since the first was accepted.
#[derive(Debug, Clone, Copy)]
struct Seen {
    tenant: u32,
    priority: i32,
    created: f64,
    started: f64,
    finished: f64,
}

impl Seen {
    fn waited(&self) -> f64 {
        self.started - self.created
    }

    fn took(&self) -> f64 {
        self.finished - self.started
    }

    /// It as the simulation has it, had it taken so many seconds.
    fn arrival(&self, service: f64) -> Arrival {
        Arrival { at: self.created, tenant: self.tenant, priority: self.priority, service }
    }
}

const TENANTS: usize = 4;
const WORKERS: usize = 2;

/// A stream of jobs through the service: a burst of one tenant's, then others at times that know nothing of each other.
fn stream(seed: u64) -> Vec<Seen> {
    let folder = tempfile::tempdir().unwrap();
    let keys: Vec<String> = (0..TENANTS)
        .map(|tenant| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
            command.args(["keys", "create", "--scopes", "read,submit", "--tenant", &format!("t{tenant}"), "--data"]);
            let output = command.arg(folder.path()).output().unwrap();
            let text = String::from_utf8(output.stdout).unwrap();
            format!("Bearer {}", text.lines().last().unwrap())
        })
        .collect();
    let server = Server::start(folder.path(), WORKERS);
    let send = |tenant: usize, job: &Value| -> (usize, String) {
        let headers = [("content-type", "application/json"), ("authorization", &keys[tenant][..])];
        let answer = server.send("POST", "/v1/jobs", &headers, Some(job.to_string().as_bytes()));
        assert_eq!(answer.status, 202, "{}", answer.json());
        (tenant, answer.json()["id"].as_str().unwrap().to_owned())
    };
    let ended = |(tenant, id): &(usize, String)| -> Value {
        loop {
            let path = format!("/v1/jobs/{id}?wait=30");
            let job = server.send("GET", &path, &[("authorization", &keys[*tenant])], None).json();
            if !["accepted", "running"].contains(&job["status"].as_str().unwrap()) {
                assert_eq!(job["status"], "successful", "{job}");
                return job;
            }
        }
    };
    let at = |job: &Value, member: &str| {
        job[member].as_str().unwrap().parse::<jiff::Timestamp>().unwrap().as_millisecond() as f64 / 1000.0
    };
    // How long jobs take on this machine, now, both workers at it.
    let kinds = |k: usize| if k.is_multiple_of(3) { experiment_one(k as u64) } else { small(k as u64) };
    let first: Vec<_> = (0..12).map(|k| send(0, &kinds(k))).collect();
    let took: Vec<f64> = first.iter().map(ended).map(|job| at(&job, "finished") - at(&job, "started")).collect();
    let pause = mean(&took) / WORKERS as f64 / 0.8;
    let mut draw = ChaCha8Rng::seed_from_u64(seed);
    let (began, mut due, mut sent) = (Instant::now(), 0.0, Vec::new());
    for k in 0..160 {
        let mut job = kinds(k);
        let tenant = if k < 30 { 0 } else { draw.random_range(0..TENANTS) };
        job["priority"] = i32::from(draw.random_bool(0.1)).into();
        due += if k < 30 { 0.0 } else { exponential(&mut draw, pause) };
        std::thread::sleep(Duration::from_secs_f64(due).saturating_sub(began.elapsed()));
        sent.push(send(tenant, &job));
    }
    let mut seen: Vec<Seen> = sent
        .iter()
        .map(|one| {
            let job = ended(one);
            assert_eq!(job["attempt"], 1);
            let priority = job["priority"].as_i64().unwrap() as i32;
            let [created, started, finished] = ["created", "started", "finished"].map(|member| at(&job, member));
            Seen { tenant: one.0 as u32, priority, created, started, finished }
        })
        .collect();
    seen.sort_by(|a, b| a.created.total_cmp(&b.created));
    let first = seen[0].created;
    let since = |time: f64| time - first;
    seen.into_iter()
        .map(|job| Seen {
            created: since(job.created),
            started: since(job.started),
            finished: since(job.finished),
            ..job
        })
        .collect()
}

/// What lies between a job's end and its worker's next claim, and between an arrival and the claim of an idle worker, in the
/// mean and the median of what was seen.
fn crew_of(seen: &[Seen]) -> Crew {
    let mut ends: Vec<f64> = seen.iter().map(|job| job.finished).collect();
    ends.sort_by(f64::total_cmp);
    let mut by_start = seen.to_vec();
    by_start.sort_by(|a, b| a.started.total_cmp(&b.started));
    let (mut between, mut pickup) = (Vec::new(), Vec::new());
    for job in &by_start {
        let runs = |at: f64| seen.iter().filter(|other| other.started < at && other.finished > at).count();
        if runs(job.created) < WORKERS && job.started - job.created < 0.05 {
            pickup.push(job.started - job.created);
            continue;
        }
        // The end that made room: the latest before this start.
        let made_room = ends.iter().rposition(|end| *end <= job.started && *end > job.created);
        between.extend(made_room.map(|k| job.started - ends.remove(k)));
    }
    println!("between two jobs {:.4} s, to an idle worker {:.4} s", mean(&between), quantile(&pickup, 0.5));
    Crew { workers: WORKERS, between: mean(&between), pickup: quantile(&pickup, 0.5) }
}

/// The bar: 15 %, with what jobs took and what lies between them taken from the same run.
#[test]
fn the_simulation_waits_as_long_as_the_service_does() {
    let seen = stream(11);
    let arrivals: Vec<Arrival> = seen.iter().map(|job| job.arrival(job.took())).collect();
    let crew = crew_of(&seen);
    let simulated = waits(&arrivals, crew);
    let measured: Vec<f64> = seen.iter().map(Seen::waited).collect();
    let of = |values: &[f64], keep: &dyn Fn(&Seen) -> bool| -> Vec<f64> {
        seen.iter().zip(values).filter(|(job, _)| keep(job)).map(|(_, value)| *value).collect()
    };
    let agrees = |what: &str, keep: &dyn Fn(&Seen) -> bool, value: &dyn Fn(&[f64]) -> f64| {
        let (measured, simulated) = (value(&of(&measured, keep)), value(&of(&simulated, keep)));
        println!("{what}: measured {measured:.3} s, simulated {simulated:.3} s");
        // A short wait is as long as the clock is fine: times are milliseconds.
        assert!((simulated - measured).abs() <= 0.15 * measured + 0.01, "{what}");
    };
    let p95 = |values: &[f64]| quantile(values, 0.95);
    agrees("mean of all", &|_| true, &mean);
    agrees("95 % of all", &|_| true, &p95);
    agrees("mean of the tenant with the burst", &|job| job.tenant == 0, &mean);
    agrees("mean of the others", &|job| job.tenant != 0, &mean);
    let urgent = |job: &Seen| job.priority > 0;
    agrees("mean of the urgent", &urgent, &mean);
    // That rule and no other: first come, first served has the urgent wait like all.
    let plain: Vec<Arrival> = arrivals.iter().map(|job| Arrival { tenant: 0, priority: 0, ..*job }).collect();
    let plain = mean(&of(&waits(&plain, crew), &urgent));
    let measured = mean(&of(&measured, &urgent));
    assert!(plain > 1.3 * measured, "first come, first served would be {plain:.3} s, not {measured:.3} s");
}

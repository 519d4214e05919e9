//! How well scans are located: held-out scans of a real log, or simulated ones whose truth is known.
//!
//!     cargo run --release --example localization -- LOG.flaser.log[.gz] [sdf|vdf] [every] [--fixed] [--other LOG] [--write FILE]
//!     cargo run --release --example localization -- office [sdf|vdf] [maps]
//!
//! Of a log every fifth scan is held out and located on the map of the others, its pose in the log being the truth, from
//! starts that are off by 5 cm and 2 degrees, by 20 cm and 6 degrees, and from nowhere; another
//! building's scans should fit nowhere. Of the office every map is drawn
//! anew, and so are the scans. `--fixed` takes the poses of the map's scans as they are reported; `--write` writes the cases with what was
//! found, for `benches/localization/peers.py` to hold others against.

mod cases;
mod report;

use std::time::Instant;

use cases::{case, sighted, written};
use mapfit::fit::{Distance, FitOptions, Poses};
use mapfit::geometry::{Cov3, Pose, wrap_angle};
use mapfit::import::{Selection, parse_carmen};
use mapfit::localize::{Ground, Localizer, Located, Motion, Prior, Sighted};
use mapfit::map::{FittedMap, Survey};
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};
use mapfit::uncertainty::{Joint, Kind};
use rand::{RngExt, SeedableRng};
use report::{hypotheses, report};
use serde_json::{Value, json};

const NOISE: Noise = Noise { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };

struct House {
    map: FittedMap,
    ground: Ground,
    joint: Joint,
}

fn house(scans: &[LaserScan], noise: Noise, distance: Distance) -> House {
    let fixed = is_fixed().then_some(Poses::Fixed);
    let options = FitOptions { poses: fixed, ..FitOptions::default() };
    let survey = Survey::new(scans, noise).distance(distance).options(options);
    let map = survey.map().unwrap();
    let began = Instant::now();
    let ground = Ground::of(&map);
    let raster = began.elapsed().as_secs_f64();
    let joint = Joint::of(survey.resume(&map).unwrap(), &|_| true).unwrap();
    let both = began.elapsed().as_secs_f64();
    println!("map {:.1} s, raster {raster:.2} s, factor {:.2} s", map.report.seconds, both - raster);
    House { map, ground, joint }
}

fn locate(house: &House, scans: &[LaserScan], starts: Option<(f64, f64)>, seed: u64) -> (Vec<Located>, f64) {
    let sighted = sighted(scans, starts, seed);
    let began = Instant::now();
    let localizer = Localizer::new(&house.map, &house.ground, &house.joint, Kind::Propagated);
    let located = localizer.each(&sighted, 5, &|| true).unwrap();
    (located, began.elapsed().as_secs_f64())
}

/// Milliseconds a scan, each asked for by itself.
fn one_at_a_time(house: &House, scans: &[Sighted]) -> f64 {
    let localizer = Localizer::new(&house.map, &house.ground, &house.joint, Kind::Propagated);
    let began = Instant::now();
    for scan in scans {
        localizer.each(std::slice::from_ref(scan), 1, &|| true).unwrap();
    }
    1e3 * began.elapsed().as_secs_f64() / scans.len() as f64
}

/// What follows a name among the arguments.
fn named(name: &str) -> Option<String> {
    std::env::args().skip_while(|own| own != name).nth(1)
}

fn is_fixed() -> bool {
    std::env::args().any(|own| own == "--fixed")
}

fn scans_of(path: &str) -> Vec<LaserScan> {
    let bytes = std::fs::read(path).unwrap();
    let text = if path.ends_with(".gz") {
        let mut text = String::new();
        std::io::Read::read_to_string(&mut flate2::read::GzDecoder::new(&bytes[..]), &mut text).unwrap();
        text
    } else {
        String::from_utf8(bytes).unwrap()
    };
    parse_carmen(&text).unwrap()
}

fn log(path: &str, distance: Distance) {
    let every = std::env::args().nth(3).and_then(|every| every.parse().ok()).unwrap_or(1);
    let scans = Selection { every, ..Selection::default() }.of(scans_of(path));
    let (held, taken): (Vec<_>, Vec<_>) = scans.into_iter().enumerate().partition(|(k, _)| k % 5 == 4);
    let [held, taken] = [held, taken].map(|part| part.into_iter().map(|(_, scan)| scan).collect::<Vec<LaserScan>>());
    let house = house(&taken, NOISE, distance);
    let truths: Vec<Pose> = held.iter().map(|scan| scan.pose).collect();
    let log = std::path::Path::new(path).file_name().and_then(|name| name.to_str()).unwrap_or(path);
    let mut cases = Vec::new();
    for (metres, degrees) in [(0.05, 2.0), (0.2, 6.0)] {
        let starts = Some((metres, degrees));
        let (located, seconds) = locate(&house, &held, starts, 7);
        let name = format!("{}: off by {metres} m and {degrees} degrees", log.split('.').next().unwrap_or(log));
        report(&name, &located, &truths, seconds);
        println!("  one at a time {:.1} ms a scan", one_at_a_time(&house, &sighted(&held, starts, 7)));
        cases.push(case(&name, &sighted(&held, starts, 7), &located, seconds));
    }
    if let Some(file) = named("--write") {
        let method = if is_fixed() { "mapfit, poses fixed" } else { "mapfit" };
        let map: Vec<Value> = taken.iter().map(written).collect();
        let all = json!({"method": method, "sigma_range": NOISE.sigma_range, "map": map, "cases": cases});
        std::fs::write(file, all.to_string()).unwrap();
    }
    let some: Vec<LaserScan> = held.iter().step_by(held.len().div_ceil(60)).cloned().collect();
    let truths: Vec<Pose> = some.iter().map(|scan| scan.pose).collect();
    let (located, seconds) = locate(&house, &some, None, 7);
    report("from nowhere", &located, &truths, seconds);
    hypotheses(&located, &truths);
    if let Some(other) = named("--other") {
        let strangers = scans_of(&other);
        let some: Vec<LaserScan> = strangers.iter().step_by(strangers.len().div_ceil(40)).cloned().collect();
        let (located, seconds) = locate(&house, &some, None, 7);
        let believed = located.iter().filter(|own| own.pose.is_some()).count();
        println!(
            "{believed} of {} scans of {other} believed; {:.0} ms a scan",
            some.len(),
            1e3 * seconds / some.len() as f64
        );
    }
}

fn office(distance: Distance) {
    let maps: u64 = std::env::args().nth(3).map_or(5, |maps| maps.parse().unwrap());
    let (mut all, mut truths, mut seconds) = (Vec::new(), Vec::new(), 0.0);
    let (mut along, mut ends) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for seed in 0..maps {
        let survey = sim::Survey::office(NOISE.sigma_range, seed);
        let house = house(&misplaced(&survey.scans, &NOISE, 100 + seed), NOISE, distance);
        let mut draw = rand_chacha::ChaCha8Rng::seed_from_u64(500 + seed);
        let mut near = |pose: &Pose| {
            let mut by = |span: f64| draw.random_range(-span..span);
            Pose::new(pose.x + by(0.3), pose.y + by(0.3), pose.theta + by(0.5))
        };
        let poses: Vec<Pose> = survey.poses.iter().map(&mut near).collect();
        let still = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, ..NOISE };
        let scans = sim::simulate(&survey.plan, &survey.lidar, &poses, &still, 900 + seed);
        let (located, spent) = locate(&house, &scans, Some((0.05, 2.0)), seed);
        all.extend(located);
        truths.extend(poses);
        seconds += spent;
        // Along the corridor, in steps of odometry.
        for (k, steps) in [10usize, 100].into_iter().enumerate() {
            let path: Vec<Pose> = (0..steps)
                .map(|n| {
                    Pose::new(
                        1.2 + 17.0 * n as f64 / (steps - 1) as f64,
                        5.0 + 0.2 * (n as f64).sin(),
                        0.1 * (n as f64).cos(),
                    )
                })
                .collect();
            let scans = sim::simulate(&survey.plan, &survey.lidar, &path, &still, 1700 + seed);
            let (last, motions) = tracked(&house, &scans, &path, seed);
            let _ = motions;
            along[k].push(last);
            ends[k].push(path[steps - 1]);
        }
    }
    report("office, off by 0.05 m, 2 deg", &all, &truths, seconds);
    for (k, steps) in [10, 100].into_iter().enumerate() {
        report(&format!("the last of {steps} along the corridor"), &along[k], &ends[k], 0.0);
    }
}

fn tracked(house: &House, scans: &[LaserScan], path: &[Pose], seed: u64) -> (Located, Vec<Motion>) {
    let mut draw = rand_chacha::ChaCha8Rng::seed_from_u64(3000 + seed);
    let covariance = Cov3::from_diagonal(&[0.02f64.powi(2), 0.02f64.powi(2), 0.01f64.powi(2)].into());
    let mut normal = || (0..12).map(|_| draw.random_range(-0.5..0.5f64)).sum::<f64>();
    let motions: Vec<Motion> = path
        .windows(2)
        .map(|pair| {
            let (sin, cos) = pair[0].theta.sin_cos();
            let step = pair[1].position() - pair[0].position();
            let by = Pose::new(
                cos * step.x + sin * step.y + 0.02 * normal(),
                -sin * step.x + cos * step.y + 0.02 * normal(),
                wrap_angle(pair[1].theta - pair[0].theta) + 0.01 * normal(),
            );
            Motion { by, covariance }
        })
        .collect();
    let first = Prior::new(path[0], Cov3::from_diagonal(&[2.5e-3, 2.5e-3, 1.2e-3].into()));
    let sighted: Vec<Sighted> = scans
        .iter()
        .enumerate()
        .map(|(k, scan)| Sighted {
            scan: scan.clone(),
            prior: (k == 0).then_some(first),
            sigma_range: NOISE.sigma_range,
        })
        .collect();
    let localizer = Localizer::new(&house.map, &house.ground, &house.joint, Kind::Propagated);
    let mut located = localizer.along(&sighted, &motions, 1, &|| true).unwrap();
    (located.pop().unwrap(), motions)
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or_else(|| "office".into());
    let distance = if arguments.next().as_deref() == Some("sdf") { Distance::Signed } else { Distance::Vector };
    if what == "office" { office(distance) } else { log(&what, distance) }
}

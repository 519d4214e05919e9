//! How well scans are located: held-out scans of a real log, or simulated ones whose truth is known.
//!
//!     cargo run --release --example localization -- LOG.flaser.log[.gz] [sdf|vdf] [every] [ANOTHER.flaser.log.gz]
//!     cargo run --release --example localization -- office [sdf|vdf] [maps]
//!
//! Of a log every fifth scan is held out and located on the map of the others, its pose in the log being the truth, from
//! starts that are off by 5 cm and 2 degrees, by 20 cm and 6 degrees, and from nowhere; another
//! building's scans should fit nowhere. Of the office every map is drawn
//! anew, and so are the scans.

use std::time::Instant;

use mapfit::fit::{Distance, FitOptions, Poses};
use mapfit::geometry::{Cov3, Pose, wrap_angle};
use mapfit::import::{Selection, parse_carmen};
use mapfit::localize::{Ground, Localizer, Located, Motion, Prior, Sighted};
use mapfit::map::{FittedMap, Survey};
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};
use mapfit::uncertainty::{Joint, Kind};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};

const NOISE: Noise = Noise { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
/// The 95 % quantile of chi squared with three degrees of freedom.
const WITHIN: f64 = 7.815;

struct House {
    map: FittedMap,
    ground: Ground,
    joint: Joint,
}

fn house(scans: &[LaserScan], noise: Noise, distance: Distance) -> House {
    let fixed = std::env::args().any(|own| own == "--fixed").then_some(Poses::Fixed);
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

/// Errors of located scans against the truth, and how many truths lie within the 95 % ellipsoid.
fn report(title: &str, located: &[Located], truths: &[Pose], seconds: f64) {
    let mut errors = Vec::new();
    let (mut covered, mut failed, mut lost, mut narrow) = (0, 0, 0, 0);
    for (own, truth) in located.iter().zip(truths) {
        let (Some(pose), Some(covariance)) = (own.pose, own.covariance) else {
            lost += 1;
            continue;
        };
        let off = Vector3::new(pose.x - truth.x, pose.y - truth.y, wrap_angle(pose.theta - truth.theta));
        errors.push(off.xy().norm());
        failed += usize::from(off.xy().norm() > 0.5 || off.z.abs() > 10f64.to_radians());
        match covariance.try_inverse() {
            Some(inverse) => covered += usize::from(off.dot(&(inverse * off)) <= WITHIN),
            None => narrow += 1,
        }
    }
    errors.sort_by(f64::total_cmp);
    let at =
        |share: f64| errors.get(((errors.len() as f64 - 1.0) * share).round() as usize).map_or(f64::NAN, |e| 1e3 * e);
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt() * 1e3;
    println!(
        "{title}: {} scans, {lost} nowhere, {failed} wrong; median {:.0} rms {rms:.0} 95 % {:.0} mm; {:.0} % in the 95 % \
         ellipsoid ({narrow} singular); {:.1} ms a scan",
        truths.len(),
        at(0.5),
        at(0.95),
        100.0 * covered as f64 / errors.len().max(1) as f64,
        1e3 * seconds / truths.len() as f64,
    );
}

fn off_by(truth: &Pose, metres: f64, degrees: f64, draw: &mut rand_chacha::ChaCha8Rng) -> Pose {
    let angle: f64 = draw.random_range(0.0..std::f64::consts::TAU);
    let turn = if draw.random_bool(0.5) { degrees } else { -degrees };
    Pose::new(truth.x + metres * angle.cos(), truth.y + metres * angle.sin(), truth.theta + turn.to_radians())
}

fn locate(house: &House, scans: &[LaserScan], starts: Option<(f64, f64)>, seed: u64) -> (Vec<Located>, f64) {
    let mut draw = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let sighted: Vec<Sighted> = scans
        .iter()
        .map(|scan| {
            let prior = starts.map(|(metres, degrees)| {
                let (spread, turn) = (metres.powi(2), degrees.to_radians().powi(2));
                Prior::new(
                    off_by(&scan.pose, metres, degrees, &mut draw),
                    Cov3::from_diagonal(&[spread, spread, turn].into()),
                )
            });
            Sighted { scan: scan.clone(), prior, sigma_range: NOISE.sigma_range }
        })
        .collect();
    let began = Instant::now();
    let localizer = Localizer::new(&house.map, &house.ground, &house.joint, Kind::Propagated);
    let located = localizer.each(&sighted, 5, &|| true).unwrap();
    (located, began.elapsed().as_secs_f64())
}

fn hypotheses(located: &[Located], truths: &[Pose]) {
    let right = |pose: &Pose, truth: &Pose| {
        (pose.position() - truth.position()).norm() < 0.3
            && wrap_angle(pose.theta - truth.theta).abs() < 5f64.to_radians()
    };
    let first = |own: &Located, truth: &Pose| own.hypotheses.first().is_some_and(|best| right(&best.pose, truth));
    let five = |own: &Located, truth: &Pose| own.hypotheses.iter().any(|one| right(&one.pose, truth));
    let count = |test: &dyn Fn(&Located, &Pose) -> bool| {
        located.iter().zip(truths).filter(|(own, truth)| test(own, truth)).count()
    };
    println!("  right first {} and among five {} of {}", count(&first), count(&five), truths.len());
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
    let every = std::env::args().nth(3).map_or(1, |every| every.parse().unwrap());
    let scans = Selection { every, ..Selection::default() }.of(scans_of(path));
    let (held, taken): (Vec<_>, Vec<_>) = scans.into_iter().enumerate().partition(|(k, _)| k % 5 == 4);
    let [held, taken] = [held, taken].map(|part| part.into_iter().map(|(_, scan)| scan).collect::<Vec<LaserScan>>());
    let house = house(&taken, NOISE, distance);
    let truths: Vec<Pose> = held.iter().map(|scan| scan.pose).collect();
    for (metres, degrees) in [(0.05, 2.0), (0.2, 6.0)] {
        let (located, seconds) = locate(&house, &held, Some((metres, degrees)), 7);
        report(&format!("off by {metres} m, {degrees} deg"), &located, &truths, seconds);
    }
    let some: Vec<LaserScan> = held.iter().step_by(held.len().div_ceil(60)).cloned().collect();
    let truths: Vec<Pose> = some.iter().map(|scan| scan.pose).collect();
    let (located, seconds) = locate(&house, &some, None, 7);
    report("from nowhere", &located, &truths, seconds);
    hypotheses(&located, &truths);
    if let Some(other) = std::env::args().nth(4) {
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

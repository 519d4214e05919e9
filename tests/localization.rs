//! Where scans were taken: simulated ones whose truth is known, held-out scans of a real log over HTTP, and what fits nowhere.

mod support;

use std::process::Command;

use mapfit::fit::Distance;
use mapfit::geometry::{Cov3, Pose, wrap_angle};
use mapfit::import::{Selection, parse_carmen, to_request};
use mapfit::localize::{Ground, Localizer, Located, Motion, Prior, Sighted};
use mapfit::map::Survey;
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};
use mapfit::uncertainty::{Joint, Kind};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use serde_json::{Value, json};
use support::{Server, log_text, shared_data};

const NOISE: Noise = Noise { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
const STILL: Noise = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range: 0.02 };
/// The 95 % quantile of chi squared with three degrees of freedom.
const WITHIN: f64 = 7.815;

fn off(pose: &Pose, truth: &Pose) -> Vector3<f64> {
    Vector3::new(pose.x - truth.x, pose.y - truth.y, wrap_angle(pose.theta - truth.theta))
}

/// Whether the truth lies in the 95 % ellipsoid.
fn covers(located: &Located, truth: &Pose) -> bool {
    let off = off(&located.pose.expect("the scan fits"), truth);
    let inverse = located.covariance.unwrap().try_inverse().unwrap();
    off.dot(&(inverse * off)) <= WITHIN
}

fn beside(pose: &Pose, span: f64, turn: f64, draw: &mut impl rand::Rng) -> Pose {
    let mut by = |span: f64| draw.random_range(-span..span);
    Pose::new(pose.x + by(span), pose.y + by(span), pose.theta + by(turn))
}

/// Offices whose maps were fitted to misplaced scans; in each, scans from elsewhere, alone and along the corridor. The map's
/// error is every scan's: a trajectory of fifty scans must not be believed more than the map.
fn truth_is_where_it_is_said_to_be(distance: Distance) {
    let (mut covered, mut asked, mut nowhere, mut ends, mut farthest) = (0, 0, 0, 0, 0.0f64);
    for seed in 0..3 {
        let office = sim::Survey::office(NOISE.sigma_range, seed);
        let scans = misplaced(&office.scans, &NOISE, 100 + seed);
        let survey = Survey::new(&scans, NOISE).distance(distance);
        let map = survey.map().unwrap();
        let (ground, joint) = (Ground::of(&map), Joint::of(survey.resume(&map).unwrap(), &|_| true).unwrap());
        let localizer = Localizer::new(&map, &ground, &joint, Kind::Propagated);
        let mut draw = rand_chacha::ChaCha8Rng::seed_from_u64(500 + seed);

        let truths: Vec<Pose> = office.poses.iter().map(|pose| beside(pose, 0.3, 0.5, &mut draw)).collect();
        let prior = |truth: &Pose, draw: &mut _| {
            Prior::new(beside(truth, 0.05, 0.03, draw), Cov3::from_diagonal(&[2.5e-3, 2.5e-3, 1.2e-3].into()))
        };
        let seen = sim::simulate(&office.plan, &office.lidar, &truths, &STILL, 900 + seed);
        let sighted: Vec<Sighted> = seen
            .into_iter()
            .zip(&truths)
            .map(|(scan, truth)| Sighted { scan, prior: Some(prior(truth, &mut draw)), sigma_range: NOISE.sigma_range })
            .collect();
        for (located, truth) in localizer.each(&sighted, 1, &|| true).unwrap().iter().zip(&truths) {
            asked += 1;
            let Some(pose) = located.pose else {
                nowhere += 1;
                continue;
            };
            covered += usize::from(covers(located, truth));
            farthest = farthest.max(off(&pose, truth).xy().norm());
        }

        let path: Vec<Pose> =
            (0..50).map(|n| Pose::new(1.5 + 0.33 * f64::from(n), 5.0, 0.2 * f64::from(n).cos())).collect();
        let seen = sim::simulate(&office.plan, &office.lidar, &path, &STILL, 1700 + seed);
        let first = prior(&path[0], &mut draw);
        let sighted = seen.into_iter().enumerate().map(|(k, scan)| Sighted {
            scan,
            prior: (k == 0).then_some(first),
            sigma_range: NOISE.sigma_range,
        });
        let covariance = Cov3::from_diagonal(&[4e-4, 4e-4, 1e-4].into());
        let motions: Vec<Motion> = path
            .windows(2)
            .map(|pair| {
                let (sin, cos) = pair[0].theta.sin_cos();
                let step = pair[1].position() - pair[0].position();
                let by =
                    Pose::new(cos * step.x + sin * step.y, cos * step.y - sin * step.x, pair[1].theta - pair[0].theta);
                Motion { by: beside(&by, 0.03, 0.015, &mut draw), covariance }
            })
            .collect();
        let located = localizer.along(&sighted.collect::<Vec<_>>(), &motions, 1, &|| true).unwrap();
        let last = &located[49];
        ends += usize::from(covers(last, &path[49]));
        let sigma = last.covariance.unwrap()[(0, 0)].sqrt();
        assert!((1e-3..0.05).contains(&sigma), "sigma along the corridor {sigma}");
    }
    let share = f64::from(covered as u32) / f64::from((asked - nowhere) as u32);
    println!(
        "{distance:?}: {covered} of {asked} covered, {nowhere} nowhere, the farthest off by {farthest:.3} m; ends {ends} of 3"
    );
    assert!((0.88..=1.0).contains(&share), "{covered} of {asked} truths in their 95 % ellipsoids");
    // A signed map may have no wall where few beams met one: what saw little else is nowhere on it.
    assert!(nowhere <= 3, "{nowhere} of {asked} scans are nowhere");
    assert!(farthest < 0.1 && ends >= 2, "{farthest} {ends}");
}

#[test]
fn on_a_signed_map_the_truth_is_where_it_is_said_to_be() {
    truth_is_where_it_is_said_to_be(Distance::Signed);
}

#[test]
fn on_a_vector_map_the_truth_is_where_it_is_said_to_be() {
    truth_is_where_it_is_said_to_be(Distance::Vector);
}

fn log(name: &str, every: usize) -> Option<Vec<LaserScan>> {
    let folder = shared_data(name)?;
    let scans = parse_carmen(&log_text(&folder.join(format!("{name}.flaser.log.gz")))).unwrap();
    Some(Selection { every, ..Selection::default() }.of(scans))
}

/// Scans as JSON, from poses that are off, or from anywhere.
fn asked(scans: &[LaserScan], start: impl Fn(&Pose) -> Option<Pose>) -> Value {
    let mut body = to_request(scans, &NOISE, None, ("vdf", 0.2));
    for (scan, own) in body["scans"].as_array_mut().unwrap().iter_mut().zip(scans) {
        scan["pose"] = start(&own.pose).map_or(Value::Null, |pose| json!(pose));
        scan["pose_covariance"] = json!([2.5e-3, 0, 0, 0, 2.5e-3, 0, 0, 0, 1.2e-3]);
    }
    json!({"scans": body["scans"], "noise": body["noise"]})
}

fn error(answer: &Value, truth: &Pose) -> f64 {
    (answer["pose"]["x"].as_f64().unwrap() - truth.x).hypot(answer["pose"]["y"].as_f64().unwrap() - truth.y)
}

/// Seattle's every fifth scan, located on the map of the rest: with a prior, from nowhere, as a trajectory; and
/// Intel's scans, which were taken elsewhere.
#[test]
fn held_out_scans_of_a_real_log_are_located_over_http() {
    let (Some(scans), Some(elsewhere)) = (log("seattle", 1), log("intel", 90)) else { return };
    let (held, taken): (Vec<_>, Vec<_>) = scans.into_iter().enumerate().partition(|(k, _)| k % 5 == 4);
    let [held, taken] = [held, taken].map(|part| part.into_iter().map(|(_, scan)| scan).collect::<Vec<_>>());
    let held = &held[..held.len().min(40)];
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 2);
    let map = server.map_of(&to_request(&taken, &NOISE, Some("seattle"), ("vdf", 0.2)));
    let route = format!("/v1/maps/{map}/localize");

    let near = asked(held, |pose| Some(Pose::new(pose.x + 0.04, pose.y - 0.03, pose.theta + 0.03)));
    let answer = server.post(&route, &near);
    assert_eq!(answer.status, 200, "{}", answer.json());
    let poses = answer.json()["poses"].as_array().unwrap().clone();
    let errors: Vec<f64> = poses
        .iter()
        .zip(held)
        .filter(|(own, _)| own["converged"] == true)
        .map(|(own, at)| error(own, &at.pose))
        .collect();
    println!(
        "{} of {} located, the farthest off by {:.3} m",
        errors.len(),
        held.len(),
        errors.iter().copied().fold(0.0, f64::max)
    );
    assert!(errors.len() * 100 >= 92 * held.len(), "{} of {} located", errors.len(), held.len());
    assert!(errors.iter().all(|error| *error < 0.3), "{errors:?}");
    assert_eq!(server.post(&route, &near).json(), answer.json(), "the same question has the same answer");
    let covariance = support::numbers(&poses[0]["covariance"]);
    assert!(covariance.len() == 9 && covariance[1] == covariance[3] && covariance[0] > 0.0);

    let mut nowhere = asked(&held[..8], |_| None);
    nowhere["hypotheses"] = json!(5);
    let found = server.post(&route, &nowhere).json();
    let first = |own: &Value, truth: &Pose| own["converged"] == true && error(&own["hypotheses"][0], truth) < 0.3;
    let right = found["poses"].as_array().unwrap().iter().zip(held).filter(|(own, at)| first(own, &at.pose)).count();
    println!("{right} of 8 found from nowhere");
    assert!(right >= 6, "{right} of 8 found: {found}");
    for own in found["poses"].as_array().unwrap() {
        let sum: f64 =
            own["hypotheses"].as_array().unwrap().iter().map(|one| one["probability"].as_f64().unwrap()).sum();
        assert!(sum <= 1.0 + 1e-9, "{own}");
    }

    let strangers = server.post(&route, &asked(&elsewhere, |_| None)).json();
    let believed = strangers["poses"].as_array().unwrap().iter().filter(|own| own["converged"] == true).count();
    println!("{believed} of {} scans of another building believed", elsewhere.len());
    assert!(believed * 20 <= elsewhere.len(), "{believed} of {} scans of another building believed", elsewhere.len());
    let lost = strangers["poses"].as_array().unwrap().iter().find(|own| own["converged"] == false).unwrap();
    assert!(lost["pose"].is_null() && lost["covariance"].is_null());
}

/// `mapfit localize`: a line of JSON a scan, a plot beside, and an exit code that tells of scans that fit nowhere.
#[test]
fn the_command_line_locates_a_logs_scans_and_draws_them() {
    let Some(folder) = shared_data("the_command_line_locates_a_logs_scans_and_draws_them") else { return };
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 2);
    let taken = log("seattle", 3).unwrap();
    let map = server.map_of(&to_request(&taken, &NOISE, Some("seattle"), ("vdf", 0.25)));
    let plot = data.path().join("way.png");
    let localize = |map: &str, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(["localize", map]).arg(folder.join("seattle.flaser.log.gz")).args(["--url", &server.url]);
        command.args(["--every", "12", "--sigma-xy", "0.1"]).args(more).env_remove("MAPFIT_DATA").output().unwrap()
    };
    let output = localize(&map, &["--json", "--plot", plot.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stdout);
    let lines: Vec<Value> = said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let nowhere = lines.iter().filter(|line| line["converged"] == false).count();
    assert_eq!(output.status.code(), Some(i32::from(nowhere > 0)), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(lines.len() == taken.len().div_ceil(4) && nowhere <= 1, "{nowhere} of {} nowhere", lines.len());
    let mut picture = png::Decoder::new(std::io::Cursor::new(std::fs::read(&plot).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; picture.output_buffer_size().unwrap()];
    let (wide, size) = (picture.info().width, picture.next_frame(&mut pixels).unwrap().color_type.samples());
    let red = pixels.chunks(size).filter(|p| p[0] > 180 && p[1] < 190 && p[2] < 190).count();
    assert!(wide >= 1200 && red > 100, "no ellipse is drawn: {red} red pixels of {wide} columns");
    let table = localize(&map, &[]);
    assert!(String::from_utf8_lossy(&table.stdout).contains("agreeing"));
    assert_eq!(localize("none", &[]).status.code(), Some(1), "there is no such map");
}

#[test]
fn what_is_asked_wrongly_is_answered_with_pointers() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let map = server.map_of(&support::small(1));
    let route = format!("/v1/maps/{map}/localize");
    let scan = support::small(1)["scans"][0].clone();
    let noise = support::small(1)["noise"].clone();
    let one = json!({"scans": [scan], "noise": noise});
    assert_eq!(server.post(&route, &one).status, 200);
    server.post("/v1/maps/none/localize", &one).problem(404);
    let mut more = one.clone();
    more["motions"] = json!([{"x": 0, "y": 0, "theta": 0, "covariance": [1, 0, 0, 0, 1, 0, 0, 0, 1]}]);
    more["unknown"] = json!(1);
    let problem = server.post(&route, &more).problem(422);
    let pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|error| error["pointer"].as_str().unwrap()).collect();
    assert_eq!(pointers, ["/unknown", "/motions"]);
    server.post(&format!("{route}?what=1"), &one).problem(422);
    // A scan without a return tells nothing: it is nowhere, and that is no error.
    let mut blind = one.clone();
    blind["scans"][0]["ranges"] = json!([null, null]);
    let answer = server.post(&route, &blind).json();
    assert!(answer["poses"][0]["converged"] == false && answer["poses"][0]["pose"].is_null(), "{answer}");
}

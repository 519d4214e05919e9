//! What the tests of living maps share: an office, updates, and how two maps differ.

use mapfit::import::to_request;
use mapfit::scan::Noise;
use mapfit::sim::{self, misplaced};
use serde_json::{Value, json};

use crate::support::{Answer, Server};

pub const JSON: (&str, &str) = ("content-type", "application/json");

/// The first fit's body with some of the scans of a request, and an update's with others.
pub fn with_scans(request: &Value, scans: std::ops::Range<usize>) -> Value {
    let mut own = request.clone();
    own["scans"] = json!(request["scans"].as_array().unwrap()[scans]);
    own
}

pub fn update_of(request: &Value, scans: std::ops::Range<usize>) -> Value {
    let mut own = with_scans(request, scans);
    own.as_object_mut().unwrap().retain(|name, _| ["scans", "noise"].contains(&name.as_str()));
    own
}

pub fn update(server: &Server, map: &str, body: &Value) -> Answer {
    server.post(&format!("/v1/maps/{map}/updates"), body)
}

/// Updates, waits, and gives the map's id.
pub fn updated(server: &Server, map: &str, body: &Value) -> String {
    let answer = update(server, map, body);
    assert_eq!(answer.status, 202, "{}", answer.json());
    assert_eq!(answer.header("location"), format!("/v1/jobs/{}", answer.json()["id"].as_str().unwrap()));
    let job = server.wait(answer.json()["id"].as_str().unwrap());
    assert_eq!(job["status"], "successful", "{job}");
    job["map_id"].as_str().unwrap().to_owned()
}

/// An office, 0.25 m.
pub fn office() -> Value {
    let noise = Noise { sigma_x: 0.03, sigma_y: 0.03, sigma_theta: 0.004, sigma_range: 0.02 };
    let scans = misplaced(&sim::Survey::office(noise.sigma_range, 3).scans, &noise, 3);
    to_request(&scans, &noise, Some("office"), ("vdf", 0.25))
}

/// How the distances of two maps differ where both know something: in sigmas of the first in the median and at 99 %, and the
/// sigmas themselves in the median.
pub fn difference(server: &Server, one: &str, other: &str) -> [f64; 3] {
    let points: Vec<[f64; 2]> =
        (0..6400).map(|k| [0.13 + 0.25 * (k % 80) as f64, 0.11 + 0.125 * (k / 80) as f64]).collect();
    let ask = |map: &str| server.post(&format!("/v1/maps/{map}/query"), &json!({"points": points})).json();
    let (one, other) = (ask(one), ask(other));
    let (mut far, mut wide) = (Vec::new(), Vec::new());
    for k in (0..points.len()).filter(|k| one["observed"][*k] == true && other["observed"][*k] == true) {
        let of = |map: &Value, field: &str| map[field][k].as_f64().unwrap();
        let sigma = of(&one, "sigma");
        far.push((of(&one, "distance") - of(&other, "distance")).abs() / sigma);
        wide.push((of(&other, "sigma") / sigma - 1.0).abs());
    }
    far.sort_by(f64::total_cmp);
    wide.sort_by(f64::total_cmp);
    [far[far.len() / 2], far[far.len() * 99 / 100], wide[wide.len() / 2]]
}

/// Six scans of experiment 1's room, with a box in the middle of its left arm or without.
pub fn room(boxed: bool, seed: u64, distance: &str) -> Value {
    let mut world = sim::World::l_room();
    if boxed {
        let corner = |x: f64, y: f64| mapfit::geometry::Vec2::new(1.7 + 0.5 * x, 5.2 + 0.5 * y);
        world.pillars.push(vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]);
    }
    let noise = Noise::EXPERIMENT_ONE;
    let poses =
        [(1.5, 1.5, 0.8), (6.0, 2.0, 2.2), (2.0, 7.0, -1.2), (0.8, 4.0, 1.2), (3.2, 4.6, 2.4), (3.3, 6.8, -2.2)];
    let poses = poses.map(|(x, y, theta)| mapfit::geometry::Pose::new(x, y, theta));
    let exact = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, ..noise };
    let scans = sim::simulate(&world, &sim::Lidar::of_degrees(270, 269.0), &poses, &exact, seed);
    to_request(&misplaced(&scans, &noise, seed), &noise, None, (distance, 0.2))
}

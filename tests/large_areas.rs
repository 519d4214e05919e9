//! Areas of which little was seen: what counts is the control points in use, not the rectangle around them.

mod support;

use mapfit::jobs::{JobRequest, Limits, RequestError};
use serde_json::{Value, json};
use support::{Server, small};

/// A vector map of a room in a square of so many metres.
fn in_a_square(side: f64, resolution: f64) -> Value {
    let mut job = small(1);
    job["map"] = json!({
        "distance": "vdf",
        "resolution": resolution,
        "bounds": {"min": [-side / 2.0, -side / 2.0], "max": [side / 2.0, side / 2.0]},
        "tiling": "none",
    });
    job
}

#[test]
fn a_room_in_a_square_of_190_metres_is_a_small_map() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let job = in_a_square(190.0, 0.2);
    let tried = server.post("/v1/jobs?dry_run=true", &job).json();
    assert!(tried["control_points"].as_u64().unwrap() < 10_000, "{tried}");
    let id = server.map_of(&job);
    let map = server.get(&format!("/v1/maps/{id}")).json();
    assert_eq!(map["lattice"]["control_points"], json!([953, 953]));
    assert_eq!(server.get(&format!("/v1/jobs/{}", map["job_id"].as_str().unwrap())).json()["parts"], Value::Null);
    let near = server.map_of(&in_a_square(40.0, 0.2));
    let asked = json!({"points": [[1.0, 2.0], [90.0, 90.0]]});
    let [wide, near] =
        [id.as_str(), near.as_str()].map(|id| server.post(&format!("/v1/maps/{id}/query"), &asked).json());
    let distance = |answer: &Value| answer["distance"][0].as_f64().unwrap();
    assert!((distance(&wide) - distance(&near)).abs() < 1e-6, "{wide} {near}");
    assert_eq!(wide["observed"], json!([true, false]));
    let coefficients =
        server.send("GET", &format!("/v1/maps/{id}/coefficients"), &[("accept", "application/x-npz")], None);
    assert_eq!(coefficients.status, 200);
    assert_eq!(server.get(&format!("/v1/maps/{id}/covariance?form=sparse")).status, 200);
    assert_eq!(server.get(&format!("/v1/maps/{id}/contours")).status, 200);
    let (peak, estimate) = (server.peak_memory() as f64, tried["estimate"]["bytes"].as_f64().unwrap());
    println!("{:.0} MiB at the most, {:.0} MiB estimated", peak / 1048576.0, estimate / 1048576.0);
    assert!(peak < 1.2 * estimate + 1e8, "{peak} bytes, {estimate} estimated");
}

#[test]
fn where_no_parts_are_wanted_too_much_is_refused_with_a_resolution_that_fits() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--max-control-points", "900"]);
    let mut job = small(1);
    job["map"] = json!({"distance": "vdf", "resolution": 0.1, "tiling": "none"});
    let problem = server.post("/v1/jobs", &job).problem(422);
    let detail = problem["errors"][0]["detail"].as_str().unwrap();
    assert_eq!(problem["errors"][0]["pointer"], "/map/resolution");
    assert!(detail.contains("in use"), "{detail}");
    let finest = detail.split("; ").last().unwrap().trim_end_matches(" fits");
    job["map"]["resolution"] = json!(finest.parse::<f64>().unwrap());
    assert_eq!(server.post("/v1/jobs", &job).status, 202, "{detail}");
}

#[test]
fn parts_have_a_limit_too() {
    let mut job = small(1);
    job["map"] = json!({"distance": "vdf", "resolution": 0.1});
    let read = |in_parts: usize| {
        let limits = Limits { control_points: 300, in_parts, ..Limits::default() };
        JobRequest::parse(job.to_string().as_bytes(), &limits)
    };
    assert!(read(1_000_000).unwrap().parts > Some(1));
    let Err(RequestError::Faults(faults)) = read(900) else { panic!("more than 900 are in use") };
    assert_eq!(faults[0].pointer, "/map/resolution");
    assert!(faults[0].detail.contains("the limit is 900"), "{}", faults[0].detail);
}

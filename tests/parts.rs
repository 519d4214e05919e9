//! Maps with more control points in use than one fit may have: fitted in parts, by whichever solvers have time, and the
//! same maps to the last bit.

mod support;

use serde_json::{Value, json};
use support::{Server, small};

/// A room as a map of some thousand control points.
fn fine(distance: &str) -> Value {
    let mut job = small(1);
    job["map"] = json!({"distance": distance, "resolution": 0.14});
    job
}

/// The job at its end, and what is worth comparing of its map.
fn fitted(server: &Server, job: &Value) -> (Value, Vec<Vec<u8>>) {
    let accepted = server.post("/v1/jobs", job);
    assert_eq!(accepted.status, 202, "{}", accepted.json());
    let ended = server.wait(accepted.json()["id"].as_str().unwrap());
    assert_eq!(ended["status"], "successful", "{ended}");
    let map = format!("/v1/maps/{}", ended["map_id"].as_str().unwrap());
    let all = ["coefficients", "covariance?form=sparse", "covariance?form=sparse&kind=posterior"];
    let bytes =
        all.map(|what| server.send("GET", &format!("{map}/{what}"), &[("accept", "application/x-npz")], None).body);
    (ended, bytes.into())
}

#[test]
fn a_map_too_large_for_one_fit_is_fitted_in_parts_and_is_the_same() {
    let (whole_data, parts_data) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let whole = Server::start(whole_data.path(), 1);
    let in_parts = Server::start_with(parts_data.path(), 3, &["--max-control-points", "600"]);
    for distance in ["sdf", "vdf"] {
        let (undivided, expected) = fitted(&whole, &fine(distance));
        assert_eq!(undivided["parts"], Value::Null);
        let accepted = in_parts.post("/v1/jobs", &fine(distance)).json();
        let total = accepted["parts"]["total"].as_u64().unwrap();
        assert!(total > 1, "{accepted}");
        assert_eq!(accepted["parts"], json!({"total": total, "done": 0, "running": 0}));
        let (divided, bytes) = fitted(&in_parts, &fine(distance));
        let parts = &divided["parts"];
        assert!(parts["total"].as_u64().unwrap() > 1, "{divided}");
        assert_eq!((&parts["done"], &parts["running"]), (&parts["total"], &json!(0)), "{divided}");
        assert!(divided["progress"].get("parts").is_none(), "told once, beside the progress");
        assert!(bytes == expected, "the {distance} of parts differs from the undivided one");
    }
}

#[test]
fn updates_and_joins_of_large_maps_are_in_parts_too() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 1, &["--max-control-points", "600"]);
    let (first, _) = fitted(&server, &fine("vdf"));
    let id = first["map_id"].as_str().unwrap();
    let more = small(2);
    let update = json!({"scans": more["scans"], "noise": more["noise"]});
    let updated = server.post(&format!("/v1/maps/{id}/updates"), &update);
    assert_eq!(updated.status, 202, "{}", updated.json());
    assert!(updated.json()["parts"]["total"].as_u64().unwrap() > 1);
    let join = |tiling: &str| json!({"maps": [{"id": id}], "map": {"resolution": 0.14, "tiling": tiling}});
    let joined = server.post("/v1/joins", &join("auto"));
    assert_eq!(joined.status, 202, "{}", joined.json());
    assert!(joined.json()["parts"]["total"].as_u64().unwrap() > 1);
    let problem = server.post("/v1/joins", &join("none")).problem(422);
    assert_eq!(problem["errors"][0]["pointer"], "/map/resolution");
    for job in [updated, joined] {
        let ended = server.wait(job.json()["id"].as_str().unwrap());
        assert_eq!(ended["status"], "successful", "{ended}");
    }
}

#[test]
fn a_job_in_parts_survives_the_death_of_its_service() {
    let data = tempfile::tempdir().unwrap();
    let flags = ["--max-control-points", "600", "--lease-seconds", "1"];
    let server = Server::start_with(data.path(), 2, &flags);
    let (_, expected) = fitted(&server, &fine("sdf"));
    let id = server.post("/v1/jobs", &fine("sdf")).json()["id"].as_str().unwrap().to_owned();
    while server.get(&format!("/v1/jobs/{id}")).json()["status"] == "accepted" {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    drop(server);
    let server = Server::start_with(data.path(), 2, &flags);
    let ended = server.wait(&id);
    assert_eq!(ended["status"], "successful", "{ended}");
    let map = format!("/v1/maps/{}/coefficients", ended["map_id"].as_str().unwrap());
    let coefficients = server.send("GET", &map, &[("accept", "application/x-npz")], None).body;
    assert!(coefficients == expected[0]);
}

//! Joins: several maps, in frames of their own, as one.

use serde_json::{Value, json};

use crate::scenes::{difference, office, room, update_of, updated, with_scans};
use crate::support::{Server, numbers};

/// An office's scans in two maps: every other scan, the second map in a frame that lies at `frame`.
fn halves(frame: (f64, f64, f64), distance: &str) -> (Value, [Value; 2]) {
    let all = match distance {
        "vdf" => office(),
        _ => room(false, 4, "sdf"),
    };
    let mut halves = [all.clone(), all.clone()];
    for (k, half) in halves.iter_mut().enumerate() {
        let scans = all["scans"].as_array().unwrap().iter().skip(k).step_by(2).cloned();
        half["scans"] = scans.collect::<Vec<Value>>().into();
    }
    let (sin, cos) = frame.2.sin_cos();
    for scan in halves[1]["scans"].as_array_mut().unwrap() {
        let of = |name: &str| scan["pose"][name].as_f64().unwrap();
        let (dx, dy) = (of("x") - frame.0, of("y") - frame.1);
        let own = json!({"x": cos * dx + sin * dy, "y": cos * dy - sin * dx, "theta": of("theta") - frame.2});
        scan["pose"] = own;
    }
    halves.iter_mut().for_each(|half| drop(half["map"].as_object_mut().unwrap().remove("bounds")));
    (all, halves)
}

fn join(server: &Server, maps: Value, resolution: f64) -> Value {
    let answer = server.post("/v1/joins", &json!({"name": "joined", "maps": maps, "map": {"resolution": resolution}}));
    assert_eq!(answer.status, 202, "{}", answer.json());
    server.wait(answer.json()["id"].as_str().unwrap())
}

fn member(map: &str, (x, y, theta): (f64, f64, f64)) -> Value {
    json!({"id": map, "pose": {"x": x, "y": y, "theta": theta}})
}

#[test]
fn maps_are_joined_from_a_guess_and_the_join_knows_what_a_batch_knows() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    for (distance, resolution) in [("vdf", 0.25), ("sdf", 0.2)] {
        let frame = (2.0, -3.0, 0.7);
        let (all, halves) = halves(frame, distance);
        let batch = server.map_of(&all);
        let maps = halves.map(|half| server.map_of(&half));
        let guess = (frame.0 + 0.3, frame.1 - 0.2, frame.2 + 0.08);
        let job = join(&server, json!([member(&maps[0], (0.0, 0.0, 0.0)), member(&maps[1], guess)]), resolution);
        assert_eq!(job["status"], "successful", "{distance}: {job}");
        let joined = job["map_id"].as_str().unwrap().to_owned();
        let record = server.get(&format!("/v1/maps/{joined}")).json();
        assert_eq!(
            (&record["parent"], &record["version"], &record["name"]),
            (&Value::Null, &json!(1), &json!("joined"))
        );
        assert_eq!(record["fit"]["converged"], true, "{record}");
        let frames = server.get(&format!("/v1/maps/{joined}/frames")).json();
        let [first, second] = &frames["frames"].as_array().unwrap()[..] else { panic!("{frames}") };
        assert_eq!((&first["map_id"], &first["pose"]), (&json!(maps[0]), &json!({"x": 0.0, "y": 0.0, "theta": 0.0})));
        assert_eq!(numbers(&first["covariance"]), [0.0; 9], "it is held");
        assert_eq!(second["map_id"], json!(maps[1]));
        let sigma = |k: usize| numbers(&second["covariance"])[4 * k].sqrt();
        let off = |name: &str, truth: f64| (second["pose"][name].as_f64().unwrap() - truth).abs();
        eprintln!(
            "{distance}: off {:.4} {:.4} {:.5}, sigma {:.4} {:.4} {:.5}",
            off("x", frame.0),
            off("y", frame.1),
            off("theta", frame.2),
            sigma(0),
            sigma(1),
            sigma(2)
        );
        assert!(off("x", frame.0) < 4.0 * sigma(0) && off("y", frame.1) < 4.0 * sigma(1), "{distance}: {frames}");
        assert!(off("theta", frame.2) < 4.0 * sigma(2) && sigma(0) < 0.05 && sigma(2) < 0.01, "{distance}: {frames}");
        // The frames' own error moves the map by parts of its sigma.
        let [median, most, _] = difference(&server, &batch, &joined);
        eprintln!("{distance}: the join lies {median:.2} of the batch's sigmas from the batch, {most:.2} at 99 %");
        assert!(median < 1.0 && most < 4.0, "{distance}: {median} {most}");
        // What is not stored is formed from the stored requests of both.
        let block = server.get(&format!("/v1/maps/{joined}/covariance?form=block&i0=10&j0=10&ni=2&nj=2"));
        assert_eq!(block.status, 200, "{}", String::from_utf8_lossy(&block.body));
        // A joined map is updated as any other, and its frames stay told.
        let grown = updated(&server, &joined, &update_of(&all, 1..2));
        assert_eq!(server.get(&format!("/v1/maps/{grown}")).json()["version"], 2);
        assert_eq!(server.get(&format!("/v1/maps/{grown}/frames")).json()["frames"].as_array().unwrap().len(), 2);
    }
}

#[test]
fn every_scan_counts_once_however_often_its_map_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let all = room(false, 5, "vdf");
    let first = server.map_of(&with_scans(&all, 0..4));
    let grown = updated(&server, &first, &update_of(&all, 4..6));
    let maps =
        json!([member(&first, (1.0, 2.0, 0.3)), member(&first, (1.1, 2.0, 0.3)), member(&grown, (0.9, 2.1, 0.31))]);
    let job = join(&server, maps, 0.2);
    assert_eq!(job["status"], "successful", "{job}");
    let joined = job["map_id"].as_str().unwrap().to_owned();
    let count = |map: &str| server.get(&format!("/v1/maps/{map}")).json()["fit"]["observations"].as_u64().unwrap();
    assert_eq!(count(&joined), count(&grown));
    assert_eq!(server.get(&format!("/v1/maps/{joined}/poses")).json()["poses"].as_array().unwrap().len(), 6);
    // They share scans, so their frames are one, whatever was guessed.
    let frames = server.get(&format!("/v1/maps/{joined}/frames")).json();
    for frame in frames["frames"].as_array().unwrap() {
        let pose = ["x", "y", "theta"].map(|name| frame["pose"][name].as_f64().unwrap());
        assert!((0..3).all(|k| (pose[k] - [1.0, 2.0, 0.3][k]).abs() < 1e-9), "{frames}");
    }
    assert_eq!(server.get(&format!("/v1/maps/{first}/frames")).json(), json!({"frames": []}), "it is no join");
}

#[test]
fn a_wrong_guess_ends_without_a_map_and_what_is_wrong_with_a_join_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let (_, halves) = halves((2.0, -3.0, 0.7), "vdf");
    let maps = halves.map(|half| server.map_of(&half));
    for wrong in [(4.1, -1.7, 0.7), (2.0, -3.0, 2.2), (60.0, 0.0, 0.7)] {
        let job = join(&server, json!([member(&maps[0], (0.0, 0.0, 0.0)), member(&maps[1], wrong)]), 0.25);
        assert_eq!(job["status"], "failed", "{wrong:?}: {job}");
        let slug = job["problem"]["type"].as_str().unwrap();
        assert!(["/problems/maps-do-not-match", "/problems/frames-undetermined"].contains(&slug), "{job}");
        assert!(job["problem"]["detail"].as_str().unwrap().starts_with("/maps/1"), "{job}");
    }
    let faulty = json!({
        "maps": [member("no-such-map", (0.0, 0.0, 0.0)), member(&maps[1], (0.0, 0.0, 0.0))],
        "map": {"resolution": 0.25}
    });
    assert_eq!(server.post("/v1/joins", &faulty).problem(422)["errors"][0]["pointer"], "/maps/0/id");
    let faulty = json!({
        "maps": [{"id": maps[0]}, {"id": maps[1], "post": 1}],
        "map": {"resolution": -1, "colour": 1},
        "fit": {"poses": "fixed"},
        "scans": []
    });
    let problem = server.post("/v1/joins", &faulty).problem(422);
    let mut pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
    pointers.sort_unstable();
    assert_eq!(pointers, ["/fit/poses", "/map/colour", "/map/resolution", "/maps/1/pose", "/maps/1/post", "/scans"]);
    server.post("/v1/joins", &json!({"maps": [], "map": {"resolution": 0.2}})).problem(422);
    let tried = server.post(
        "/v1/joins?dry_run=true",
        &json!({"maps": [member(&maps[0], (0.0, 0.0, 0.0)), member(&maps[1], (2.0, -3.0, 0.7))], "map": {"resolution": 0.25}}),
    );
    assert_eq!((tried.status, &tried.json()["scans"]), (200, &json!(26)));
}

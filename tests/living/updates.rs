//! Updates: their map knows what one fit of all scans knows.

use mapfit::fit::Distance;
use serde_json::{Value, json};

use crate::scenes::{JSON, difference, office, room, update, update_of, updated, with_scans};
use crate::support::{Server, long, numbers, small};

#[test]
fn a_chain_of_updates_knows_what_one_fit_of_all_scans_knows() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    for distance in Distance::ALL {
        let all = if distance == Distance::Vector { office() } else { room(false, 4, "sdf") };
        let count = all["scans"].as_array().unwrap().len();
        // The last update has the fewest.
        let (some, last) = (count / 3, (count / 8).max(1));
        let batch = server.map_of(&all);
        let first = server.map_of(&with_scans(&all, 0..count - some));
        let second = updated(&server, &first, &update_of(&all, count - some..count - last));
        let third = updated(&server, &second, &update_of(&all, count - last..count));
        let record = |map: &str| server.get(&format!("/v1/maps/{map}")).json();
        for (map, parent, version) in
            [(&first, Value::Null, 1), (&second, json!(first), 2), (&third, json!(second), 3), (&batch, Value::Null, 1)]
        {
            let record = record(map);
            assert_eq!((&record["parent"], &record["version"]), (&parent, &json!(version)));
            assert_eq!(record["fit"]["converged"], true, "{record}");
        }
        assert_eq!(record(&third)["lattice"], record(&batch)["lattice"]);
        assert_eq!(record(&third)["fit"]["observations"], record(&batch)["fit"]["observations"]);
        assert_eq!(record(&third)["fit"]["weights"], record(&batch)["fit"]["weights"]);
        let [median, most, wide] = difference(&server, &batch, &third);
        assert_eq!([median, most, wide], [0.0; 3], "to the last bit");
        assert!(server.get(&format!("/v1/maps/{first}")).json()["fit"]["seconds"].as_f64().unwrap() > 0.0);
    }
}

#[test]
fn every_scan_keeps_the_noise_of_its_request_and_the_covariance_is_formed_from_all() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let all = small(4);
    let first = server.map_of(&with_scans(&all, 0..2));
    let mut body = update_of(&all, 2..3);
    body["noise"]["sigma_x"] = 0.04.into();
    let mixed = updated(&server, &first, &body);
    let mut batch = all.clone();
    batch["scans"][2]["pose_covariance"] = json!([0.0016, 0, 0, 0, 1e-4, 0, 0, 0, 2.5e-5]);
    let batch = server.map_of(&batch);
    let coefficients = |map: &str| numbers(&server.get(&format!("/v1/maps/{map}/coefficients")).json()["sdf"]);
    assert_eq!(coefficients(&mixed), coefficients(&batch), "poses' noise is theirs");
    // Ranges ten times as noisy move the map less than ranges as good as before: its walls keep to the first scans.
    body["noise"] = all["noise"].clone();
    body["noise"]["sigma_range"] = 0.2.into();
    let loose = updated(&server, &first, &body);
    let sigma = |map: &str| {
        let query = json!({"points": [[2.0, 7.9]], "fields": ["sigma"]});
        server.post(&format!("/v1/maps/{map}/query"), &query).json()["sigma"][0].as_f64().unwrap()
    };
    assert!(sigma(&loose) > 1.02 * sigma(&batch), "{} {}", sigma(&loose), sigma(&batch));
    // What is not stored is formed from the stored request of all scans.
    let block = server.get(&format!("/v1/maps/{loose}/covariance?form=block&i0=6&j0=6&ni=3&nj=3"));
    assert_eq!(block.status, 200, "{}", String::from_utf8_lossy(&block.body));
    let matrix = block.json()["matrix"].clone();
    let lattice = server.get(&format!("/v1/maps/{loose}")).json()["lattice"]["control_points"][0].as_u64().unwrap();
    let diagonal = numbers(&server.get(&format!("/v1/maps/{loose}/covariance")).json()["sdf"]);
    let (own, stored) = (matrix[4][4].as_f64().unwrap(), diagonal[7 + 7 * lattice as usize]);
    assert!((own / stored - 1.0).abs() < 1e-6, "{own} {stored}");
}

#[test]
fn a_map_without_bounds_grows_by_whole_cells_and_one_with_bounds_keeps_them() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let all = office();
    let record = |map: &str| server.get(&format!("/v1/maps/{map}")).json();
    // Scans 6 to 9 are those of the first room, at the left.
    let first = server.map_of(&with_scans(&all, 6..8));
    let grown = updated(&server, &first, &update_of(&all, 22..26));
    let (before, after) = (record(&first)["lattice"].clone(), record(&grown)["lattice"].clone());
    assert_eq!(before["resolution"], after["resolution"]);
    let cells = |k: usize| (before["origin"][k].as_f64().unwrap() - after["origin"][k].as_f64().unwrap()) / 0.25;
    assert!((0..2).all(|k| cells(k) >= 0.0 && cells(k).fract() == 0.0));
    assert!(after["cells"][0].as_u64() > before["cells"][0].as_u64());
    assert_eq!(record(&first)["lattice"], before, "maps never change");

    let bounded = server.map_of(&small(1));
    let within = updated(&server, &bounded, &update_of(&small(2), 0..1));
    assert_eq!(record(&within)["lattice"], record(&bounded)["lattice"]);
    let mut elsewhere = update_of(&small(2), 0..1);
    elsewhere["scans"][0]["pose"]["x"] = 500.0.into();
    let problem = update(&server, &bounded, &elsewhere).problem(422);
    assert_eq!(problem["errors"][0]["pointer"], "/scans");
}

#[test]
fn what_becomes_of_the_parent_while_the_job_waits_takes_nothing_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let all = small(5);
    let mut first = with_scans(&all, 0..2);
    first["map"]["distance"] = "vdf".into();
    let parent = server.map_of(&first);
    let parents_job = server.get(&format!("/v1/maps/{parent}")).json()["job_id"].as_str().unwrap().to_owned();
    let in_the_way = server.submit(&long(1));
    let waiting = update(&server, &parent, &update_of(&all, 2..3)).json()["id"].as_str().unwrap().to_owned();
    assert_eq!(server.delete(&format!("/v1/maps/{parent}")).status, 204);
    assert_eq!(server.delete(&format!("/v1/jobs/{parents_job}?purge=true")).status, 204);
    update(&server, &parent, &update_of(&all, 2..3)).problem(404);
    server.delete(&format!("/v1/jobs/{in_the_way}"));
    let job = server.wait(&waiting);
    assert_eq!(job["status"], "successful", "{job}");
    let record = server.get(&format!("/v1/maps/{}", job["map_id"].as_str().unwrap())).json();
    assert_eq!((&record["parent"], &record["version"]), (&json!(parent), &json!(2)), "it says where it grew from");
    // And goes on growing, and may be tried again.
    let again = server.post(&format!("/v1/jobs/{waiting}/retry"), &json!({})).json();
    assert_eq!(server.wait(again["id"].as_str().unwrap())["status"], "successful");
    let next = updated(&server, record["id"].as_str().unwrap(), &update_of(&small(6), 0..1));
    assert_eq!(server.get(&format!("/v1/maps/{next}")).json()["version"], 3);
}

#[test]
fn what_is_wrong_with_an_update_is_said_as_of_a_job() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let all = small(7);
    let map = server.map_of(&with_scans(&all, 0..2));
    update(&server, "no-such-map", &update_of(&all, 2..3)).problem(404);
    let mut body = update_of(&all, 2..3);
    body["map"] = all["map"].clone();
    body["scan"] = json!([]);
    body["scans"][0]["ranges"] = json!(["far"]);
    body["noise"].as_object_mut().unwrap().remove("sigma_range");
    let problem = update(&server, &map, &body).problem(422);
    let mut pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
    pointers.sort_unstable();
    assert_eq!(pointers, ["/map", "/noise/sigma_range", "/scan", "/scans/0/ranges/0"]);
    assert_eq!(update(&server, &map, &json!([1])).problem(422)["errors"][0]["pointer"], "");
    server.send("POST", &format!("/v1/maps/{map}/updates"), &[JSON], Some(b"{")).problem(400);
    server.send("POST", &format!("/v1/maps/{map}/updates?dry=1"), &[JSON], Some(b"{}")).problem(422);

    // A dry run counts all scans and keeps nothing.
    let jobs = || server.get("/v1/jobs").json()["items"].as_array().unwrap().len();
    let before = jobs();
    let tried = server.post(&format!("/v1/maps/{map}/updates?dry_run=true"), &update_of(&all, 2..3));
    assert_eq!((tried.status, tried.json()["scans"].as_u64()), (200, Some(3)), "{}", tried.json());
    assert_eq!(jobs(), before);

    // The same key and body for the same map is the same job; for another map it is another request.
    let body = update_of(&all, 2..3);
    let keyed = |map: &str, body: &Value| {
        let headers = [JSON, ("idempotency-key", "k")];
        server.send("POST", &format!("/v1/maps/{map}/updates"), &headers, Some(body.to_string().as_bytes()))
    };
    let first = keyed(&map, &body);
    assert_eq!(first.status, 202);
    let id = first.json()["id"].as_str().unwrap().to_owned();
    assert_eq!((keyed(&map, &body).status, keyed(&map, &body).json()["id"].as_str()), (200, Some(&*id)));
    let child = server.wait(&id)["map_id"].as_str().unwrap().to_owned();
    keyed(&child, &body).problem(422);
    keyed(&map, &update_of(&all, 1..3)).problem(422);
    assert_eq!(server.get(&format!("/v1/jobs/{id}/request")).json(), body, "the accepted request");
}

#[test]
fn all_scans_count_against_what_a_fit_may_take() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start_with(folder.path(), 1, &["--memory", "16", "--max-control-points", "800"]);
    let all = small(8);
    let map = server.map_of(&all);
    let many: Vec<Value> = (0..60).map(|k| all["scans"][k % 3].clone()).collect();
    let mut body = update_of(&all, 0..1);
    body["scans"] = json!(many);
    let problem = update(&server, &map, &body).problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("--memory"), "{problem}");
    // Where there are no bounds, new scans far off make a map too large; an update is in parts as its map may be.
    let mut free = with_scans(&all, 0..1);
    free["map"]["tiling"] = "none".into();
    free["map"].as_object_mut().unwrap().remove("bounds");
    let map = server.map_of(&free);
    let mut body = update_of(&all, 1..2);
    body["scans"][0]["pose"]["x"] = 60.0.into();
    let problem = update(&server, &map, &body).problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("control points"), "{problem}");
}

//! Living maps over HTTP: updates, each with the map it grew from.

mod support;

use mapfit::fit::Distance;
use mapfit::import::to_request;
use mapfit::scan::Noise;
use mapfit::sim::{self, misplaced};
use serde_json::{Value, json};
use support::{Answer, Server, long, numbers, small};

const JSON: (&str, &str) = ("content-type", "application/json");

/// The first fit's body with some of the scans of a request, and an update's with others.
fn with_scans(request: &Value, scans: std::ops::Range<usize>) -> Value {
    let mut own = request.clone();
    own["scans"] = json!(request["scans"].as_array().unwrap()[scans]);
    own
}

fn update_of(request: &Value, scans: std::ops::Range<usize>) -> Value {
    let mut own = with_scans(request, scans);
    own.as_object_mut().unwrap().retain(|name, _| ["scans", "noise"].contains(&name.as_str()));
    own
}

fn update(server: &Server, map: &str, body: &Value) -> Answer {
    server.post(&format!("/v1/maps/{map}/updates"), body)
}

/// Updates, waits, and gives the map's id.
fn updated(server: &Server, map: &str, body: &Value) -> String {
    let answer = update(server, map, body);
    assert_eq!(answer.status, 202, "{}", answer.json());
    assert_eq!(answer.header("location"), format!("/v1/jobs/{}", answer.json()["id"].as_str().unwrap()));
    let job = server.wait(answer.json()["id"].as_str().unwrap());
    assert_eq!(job["status"], "successful", "{job}");
    job["map_id"].as_str().unwrap().to_owned()
}

/// An office, 0.25 m.
fn office() -> Value {
    let noise = Noise { sigma_x: 0.03, sigma_y: 0.03, sigma_theta: 0.004, sigma_range: 0.02 };
    let scans = misplaced(&sim::Survey::office(noise.sigma_range, 3).scans, &noise, 3);
    to_request(&scans, &noise, Some("office"), ("vdf", 0.25))
}

/// How the distances of two maps differ where both know something: in sigmas of the first in the median and at 99 %, and the
/// sigmas themselves in the median.
fn difference(server: &Server, one: &str, other: &str) -> [f64; 3] {
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
    // Where there are no bounds, new scans far off make a map too large.
    let mut free = with_scans(&all, 0..1);
    free["map"].as_object_mut().unwrap().remove("bounds");
    let map = server.map_of(&free);
    let mut body = update_of(&all, 1..2);
    body["scans"][0]["pose"]["x"] = 60.0.into();
    let problem = update(&server, &map, &body).problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("control points"), "{problem}");
}

/// Six scans of experiment 1's room, with a box in the middle of its left arm or without.
fn room(boxed: bool, seed: u64, distance: &str) -> Value {
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

#[test]
fn what_changed_between_two_maps_is_drawn_and_what_did_not_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    for distance in ["sdf", "vdf"] {
        let (empty, again, boxed) = (
            server.map_of(&room(false, 1, distance)),
            server.map_of(&room(false, 2, distance)),
            server.map_of(&room(true, 3, distance)),
        );
        let ask = |new: &str, old: &str| server.get(&format!("/v1/maps/{new}/changes?since={old}"));
        let answer = ask(&boxed, &empty);
        assert_eq!((answer.status, answer.header("content-type")), (200, "application/geo+json"));
        let found = answer.json();
        assert_eq!((&found["type"], &found["frame"]["units"]), (&json!("FeatureCollection"), &json!("m")));
        let [one] = &found["features"].as_array().unwrap()[..] else { panic!("{distance}: {found}") };
        assert_eq!((&one["properties"]["role"], &one["geometry"]["type"]), (&json!("appeared"), &json!("Polygon")));
        let (probability, area) = (&one["properties"]["probability"], &one["properties"]["area"]);
        assert!((0.99..1.0).contains(&probability.as_f64().unwrap()));
        assert!((0.25..1.2).contains(&area.as_f64().unwrap()), "{area}");
        let ring = one["geometry"]["coordinates"][0].as_array().unwrap();
        assert_eq!(ring.first(), ring.last());
        for place in ring {
            let p = numbers(place);
            assert!((1.4..2.5).contains(&p[0]) && (4.9..6.0).contains(&p[1]), "{distance}: {p:?}");
        }
        let back = ask(&empty, &boxed).json();
        assert_eq!(back["features"][0]["properties"]["role"], "vanished", "{distance}: {back}");
        for (new, old) in [(&again, &empty), (&empty, &again), (&boxed, &boxed)] {
            assert_eq!(ask(new, old).json()["features"], json!([]), "{distance}");
        }
        // The same again, as a picture, and what is wrong with a question.
        let tag = answer.header("etag").to_owned();
        let path = format!("/v1/maps/{boxed}/changes?since={empty}");
        assert_eq!(server.send("GET", &path, &[("if-none-match", &tag)], None).status, 304);
        let picture = server.send("GET", &path, &[("accept", "image/png")], None);
        assert!(picture.body.starts_with(b"\x89PNG") && picture.header("etag") != tag);
        let svg = server.get(&format!("{path}&format=svg&width=400"));
        assert!(String::from_utf8_lossy(&svg.body).contains("#d7191c"));
    }
    let map = server.map_of(&small(1));
    for (query, parameter) in [
        ("", "since"),
        ("since=no-such-map", "since"),
        (&*format!("since={map}&probability=1"), "probability"),
        (&*format!("since={map}&probability=x"), "probability"),
        (&*format!("since={map}&colour=red"), "colour"),
    ] {
        let problem = server.get(&format!("/v1/maps/{map}/changes?{query}")).problem(422);
        assert_eq!(problem["errors"][0]["parameter"], parameter, "{query}");
    }
    server.get(&format!("/v1/maps/nowhere/changes?since={map}")).problem(404);
}

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

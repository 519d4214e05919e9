//! The contract, route by route, against a real process.

mod support;

use serde_json::{Value, json};
use support::{Server, experiment_one, numbers, small};

#[test]
fn a_job_becomes_a_map_with_uncertainty_contours_and_grids() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let mut request = experiment_one(1);
    request["labels"] = json!({"site": "hq", "floor": "2"});
    let answer = server.post("/v1/jobs", &request);
    assert_eq!(answer.status, 202);
    let job = answer.json();
    let id = job["id"].as_str().unwrap();
    assert_eq!(answer.header("location"), format!("/v1/jobs/{id}"));
    assert!(!answer.header("x-request-id").is_empty());
    for member in ["id", "name", "labels", "status", "progress", "message", "created", "started", "finished", "updated"]
    {
        assert!(job.as_object().unwrap().contains_key(member), "{member}");
    }
    for member in ["percent", "stage", "iteration", "max_iterations", "objective"] {
        assert!(job["progress"].as_object().unwrap().contains_key(member), "{member}");
    }
    let job = server.wait(id);
    assert_eq!(
        (&job["status"], &job["attempt"], &job["progress"]["percent"]),
        (&json!("successful"), &json!(1), &json!(100.0))
    );
    assert!(job["created"].as_str().unwrap().ends_with('Z'));
    assert!(server.get(&format!("/v1/jobs/{id}/request")).json() == request, "the request is kept to the last digit");

    let own = format!("/v1/maps/{}", job["map_id"].as_str().unwrap());
    let map = server.get(&own).json();
    assert_eq!(map["lattice"]["cells"], json!([46, 46]));
    assert_eq!(map["lattice"]["control_points"], json!([49, 49]));
    assert_eq!((&map["distance"], &map["job_id"], &map["labels"]["site"]), (&json!("sdf"), &json!(id), &json!("hq")));
    let fit = &map["fit"];
    assert_eq!((&fit["weighting"], &fit["converged"]), (&json!("calibrated"), &json!(true)));
    assert!(fit["relative_gradient"].as_f64().unwrap() <= 1e-8 && fit["observations"] == 543);

    check_arrays(&server, &own);
    check_query(&server, &own);
    check_contours(&server, &own);
    check_grid(&server, &own);
    check_images(&server, &own);
    check_caching(&server, &own);

    assert_eq!(server.get(&format!("{own}/poses")).json()["poses"].as_array().unwrap().len(), 3);
    assert_eq!(server.delete(&own).status, 204);
    server.get(&own).problem(404);
    server.delete(&own).problem(404);
    server.get(&format!("{own}/coefficients")).problem(404);
}

fn check_arrays(server: &Server, own: &str) {
    let coefficients = server.get(&format!("{own}/coefficients")).json();
    assert_eq!(numbers(&coefficients["sdf"]).len(), 2401);
    for kind in ["propagated", "posterior"] {
        let diagonal = server.get(&format!("{own}/covariance?kind={kind}")).json();
        let variances = numbers(&diagonal["sdf"]);
        assert!(variances.len() == 2401 && variances.iter().all(|v| *v >= 0.0));
        let block = server.get(&format!("{own}/covariance?kind={kind}&form=block&i0=10&j0=3&ni=4&nj=2")).json();
        let matrix: Vec<Vec<f64>> = block["matrix"].as_array().unwrap().iter().map(numbers).collect();
        assert_eq!((matrix.len(), matrix[0].len()), (8, 8));
        // x fastest: row 5 is control point (11, 4).
        let exact = variances[11 + 4 * 49];
        assert!((matrix[5][5] - exact).abs() < 1e-9 * exact, "{kind}: {} {exact}", matrix[5][5]);
        assert_eq!(matrix[2][7], matrix[7][2]);
    }
    for form in ["sparse", "full", "factors"] {
        let answer = server.get(&format!("{own}/covariance?form={form}"));
        assert_eq!((answer.status, answer.header("content-type")), (200, "application/x-npz"), "{form}");
    }
    let refused = server.send("GET", &format!("{own}/covariance?form=sparse"), &[("accept", "application/json")], None);
    refused.problem(406);
}

fn check_query(server: &Server, own: &str) {
    let answer =
        server.post(&format!("{own}/query"), &json!({"points": [[1.0, 3.0], [0.0, 3.0], [50.0, 3.0], [6.0, 6.0]]}));
    let answer = answer.json();
    assert!((answer["distance"][0].as_f64().unwrap() + 1.0).abs() < 0.05);
    assert!(answer["distance"][1].as_f64().unwrap().abs() < 0.05);
    assert!((answer["gradient"][0][0].as_f64().unwrap() + 1.0).abs() < 0.1);
    let sigma = answer["sigma"][1].as_f64().unwrap();
    assert!(sigma > 0.001 && sigma < 0.05);
    assert_eq!(
        (&answer["observed"][0], &answer["observed"][1], &answer["observed"][3]),
        (&json!(true), &json!(true), &json!(false))
    );
    for name in ["distance", "gradient", "sigma", "observed", "gradient_covariance", "distance_gradient_covariance"] {
        assert!(answer[name][2].is_null(), "{name} outside the lattice");
        assert_eq!(answer[name].as_array().unwrap().len(), 4);
    }
    let posterior = server.post(&format!("{own}/query"), &json!({"points": [[6.0, 7.0]], "kind": "posterior"})).json();
    let propagated = server.post(&format!("{own}/query"), &json!({"points": [[6.0, 7.0]]})).json();
    assert!(posterior["sigma"][0].as_f64() > propagated["sigma"][0].as_f64(), "unseen space is uncertain a posteriori");
    assert_eq!(server.post(&format!("{own}/query"), &json!({"points": []})).json()["distance"], json!([]));
}

fn check_contours(server: &Server, own: &str) {
    let answer = server.get(&format!("{own}/contours?level=0&sigma_band=2"));
    assert_eq!(answer.header("content-type"), "application/geo+json");
    let contours = answer.json();
    assert_eq!(
        (&contours["type"], &contours["frame"]),
        (&json!("FeatureCollection"), &json!({"frame_id": "map", "units": "m"}))
    );
    let roles: Vec<&str> =
        contours["features"].as_array().unwrap().iter().map(|f| f["properties"]["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["level", "band"]);
    let kinds: Vec<&str> =
        contours["features"].as_array().unwrap().iter().map(|f| f["geometry"]["type"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["MultiLineString", "MultiPolygon"]);
    assert_eq!(server.get(&format!("{own}/contours")).json()["features"].as_array().unwrap().len(), 1);
    let far = server.get(&format!("{own}/contours?level=100&sigma_band=2")).json();
    assert_eq!([0, 1].map(|k| far["features"][k]["geometry"]["coordinates"].clone()), [json!([]), json!([])]);
    let svg = server.send("GET", &format!("{own}/contours"), &[("accept", "image/svg+xml")], None);
    assert!(svg.body.starts_with(b"<svg"));
    assert!(server.get(&format!("{own}/contours?format=png")).body.starts_with(b"\x89PNG"));
}

fn check_grid(server: &Server, own: &str) {
    let grid = server.get(&format!("{own}/ogm")).json();
    let (width, height) =
        (grid["info"]["width"].as_u64().unwrap() as usize, grid["info"]["height"].as_u64().unwrap() as usize);
    let data: Vec<i64> = grid["data"].as_array().unwrap().iter().map(|v| v.as_i64().unwrap()).collect();
    assert_eq!((width, height, data.len()), (46, 46, 46 * 46));
    let position = &grid["info"]["origin"]["position"];
    assert!((position["x"].as_f64().unwrap() + 0.6).abs() < 1e-9);
    assert_eq!(grid["info"]["origin"]["orientation"]["w"], 1.0);
    let at = |x: f64, y: f64| data[((x + 0.6) / 0.2) as usize + ((y + 0.6) / 0.2) as usize * width];
    assert_eq!((at(1.1, 3.1), at(6.1, 6.1)), (0, -1), "free in the room, unknown behind the corner");
    assert!(at(0.05, 3.1).max(at(-0.05, 3.1)) >= 30 && data.iter().all(|v| (-1..=100).contains(v)));
    let fine = server.get(&format!("{own}/ogm?resolution=0.05")).json();
    assert_eq!(fine["info"]["width"], 184);
    assert_eq!(server.get(&format!("{own}/ogm?format=zip")).header("content-type"), "application/zip");
    let image = server.send("GET", &format!("{own}/ogm"), &[("accept", "image/png")], None);
    assert!(image.body.starts_with(b"\x89PNG"));
    server.get(&format!("{own}/ogm?resolution=0.0002")).problem(422);
}

fn check_images(server: &Server, own: &str) {
    for layer in ["distance", "sigma", "occupancy"] {
        let image = server.get(&format!("{own}/image?layer={layer}&overlay=contour,points,poses&width=500"));
        assert_eq!((image.status, image.header("content-type")), (200, "image/png"));
        let width = u32::from_be_bytes(image.body[16..20].try_into().unwrap());
        assert_eq!(width, 500);
    }
}

fn check_caching(server: &Server, own: &str) {
    for part in ["", "/coefficients", "/covariance", "/contours", "/ogm", "/image"] {
        let path = format!("{own}{part}");
        let first = server.get(&path);
        let tag = first.header("etag").to_owned();
        assert!(tag.starts_with('"'), "{part} has no strong ETag: {tag}");
        let again = server.send("GET", &path, &[("if-none-match", &tag)], None);
        assert_eq!((again.status, again.body.len()), (304, 0), "{part}");
        assert_eq!(server.send("GET", &path, &[("if-none-match", "\"other\"")], None).status, 200);
    }
    let (json, npz) = (format!("{own}/coefficients"), format!("{own}/coefficients?format=npz"));
    assert_ne!(server.get(&json).header("etag"), server.get(&npz).header("etag"));
}

#[test]
fn lists_are_newest_first_filtered_and_paged() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let ids: Vec<String> = (0..5)
        .map(|k| {
            let mut request = small(k);
            request["labels"] = json!({"parity": if k % 2 == 0 { "even" } else { "odd" }, "n": k.to_string()});
            server.submit(&request)
        })
        .collect();
    ids.iter().for_each(|id| assert_eq!(server.wait(id)["status"], "successful"));
    let listed = |path: &str| -> Vec<String> {
        let items = server.get(path).json()["items"].clone();
        items.as_array().unwrap().iter().map(|job| job["id"].as_str().unwrap().to_owned()).collect()
    };
    let newest: Vec<String> = ids.iter().rev().cloned().collect();
    assert_eq!(listed("/v1/jobs"), newest);
    assert_eq!(listed("/v1/jobs?label=parity:odd"), [ids[3].clone(), ids[1].clone()]);
    assert_eq!(listed("/v1/jobs?label=parity:odd&label=n:1"), [ids[1].clone()]);
    assert_eq!(listed("/v1/jobs?status=successful").len(), 5);
    assert!(listed("/v1/jobs?status=failed").is_empty());
    let (mut seen, mut cursor) = (vec![], String::new());
    loop {
        let page = server.get(&format!("/v1/jobs?limit=2{cursor}")).json();
        seen.extend(page["items"].as_array().unwrap().iter().map(|job| job["id"].as_str().unwrap().to_owned()));
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(seen, newest);
    assert_eq!(listed("/v1/maps").len(), 5);
    assert_eq!(listed("/v1/maps?bbox=-1,-1,0,0").len(), 5);
    assert!(listed("/v1/maps?bbox=100,100,101,101").is_empty());
    assert_eq!(listed("/v1/maps?label=n:3").len(), 1);
}

#[test]
fn a_key_makes_a_submission_idempotent() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    let headers = [("content-type", "application/json"), ("idempotency-key", "monday-7")];
    let body = small(1).to_string();
    let first = server.send("POST", "/v1/jobs", &headers, Some(body.as_bytes()));
    let again = server.send("POST", "/v1/jobs", &headers, Some(body.as_bytes()));
    assert_eq!((first.status, again.status), (202, 200));
    assert_eq!(first.json()["id"], again.json()["id"]);
    let other = server.send("POST", "/v1/jobs", &headers, Some(small(2).to_string().as_bytes()));
    assert!(other.problem(422)["type"].as_str().unwrap().ends_with("idempotency-key-reused"));
    assert_eq!(server.get("/v1/jobs").json()["items"].as_array().unwrap().len(), 1);
}

#[test]
fn compressed_bodies_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let body = small(1).to_string();
    let zstd = zstd::encode_all(body.as_bytes(), 3).unwrap();
    let mut gzip = flate2::write::GzEncoder::new(vec![], flate2::Compression::fast());
    std::io::Write::write_all(&mut gzip, body.as_bytes()).unwrap();
    for (encoding, packed) in [("zstd", zstd), ("gzip", gzip.finish().unwrap())] {
        let headers = [("content-type", "application/json"), ("content-encoding", encoding)];
        let answer = server.send("POST", "/v1/jobs", &headers, Some(&packed));
        assert_eq!(answer.status, 202, "{encoding}");
        let id = answer.json()["id"].as_str().unwrap().to_owned();
        assert_eq!(server.get(&format!("/v1/jobs/{id}/request")).body, body.as_bytes());
    }
}

/// The events of a finished stream, as (event, id, data).
fn events(body: &[u8]) -> Vec<(String, i64, Value)> {
    let text = String::from_utf8(body.to_vec()).unwrap();
    let field = |block: &str, name: &str| {
        let found =
            block.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_else(|| panic!("{name} in {block}"));
        found.trim().to_owned()
    };
    let blocks = text.split("\n\n").filter(|block| block.contains("data:"));
    blocks
        .map(|b| {
            (field(b, "event:"), field(b, "id:").parse().unwrap(), serde_json::from_str(&field(b, "data:")).unwrap())
        })
        .collect()
}

#[test]
fn events_tell_a_jobs_life_and_resume() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let id = server.submit(&experiment_one(3));
    let path = format!("/v1/jobs/{id}/events");
    let live = server.get(&path);
    assert_eq!(live.header("content-type"), "text/event-stream");
    let told = events(&live.body);
    let (last, before) = told.split_last().unwrap();
    assert_eq!((last.0.as_str(), &last.2["status"]), ("status", &json!("successful")));
    assert!(!before.is_empty() && before.iter().all(|(event, ..)| event == "progress"));
    assert!(told.windows(2).all(|pair| pair[0].1 < pair[1].1), "ids grow");
    // Afterwards: the end is told again, with its last progress; behind a known event only what follows.
    let replayed = events(&server.get(&path).body);
    assert_eq!(replayed.last(), Some(last));
    assert_eq!(replayed[0].0, "progress");
    let resumed = server.send("GET", &path, &[("last-event-id", &(last.1 - 1).to_string())], None);
    assert_eq!(events(&resumed.body), std::slice::from_ref(last));
    let over = server.send("GET", &path, &[("last-event-id", &last.1.to_string())], None);
    assert_eq!(over.status, 204);
}

#[test]
fn a_job_can_be_cancelled_before_and_while_it_runs_but_not_after() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let mut long = experiment_one(2);
    long["map"]["resolution"] = 0.03.into();
    let (running, waiting) = (server.submit(&long), server.submit(&small(1)));
    let begun = std::time::Instant::now();
    while server.get(&format!("/v1/jobs/{running}")).json()["status"] != "running" {
        assert!(begun.elapsed().as_secs() < 20);
    }
    let dismissed = server.delete(&format!("/v1/jobs/{running}")).json();
    assert_eq!(dismissed["status"], "dismissed");
    assert_eq!(server.wait(&waiting)["status"], "successful", "the solver is free for the next job at once");
    let job = server.get(&format!("/v1/jobs/{running}")).json();
    assert_eq!((&job["status"], &job["map_id"]), (&json!("dismissed"), &Value::Null));
    server.delete(&format!("/v1/jobs/{waiting}")).problem(409);
    server.delete(&format!("/v1/jobs/{running}")).problem(409);
}

#[test]
fn a_long_poll_answers_at_its_time_or_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    let id = server.submit(&small(1));
    let begun = std::time::Instant::now();
    assert_eq!(server.get(&format!("/v1/jobs/{id}?wait=1")).json()["status"], "accepted");
    assert!((0.9..3.0).contains(&begun.elapsed().as_secs_f64()));
    server.delete(&format!("/v1/jobs/{id}"));
    let begun = std::time::Instant::now();
    assert_eq!(server.get(&format!("/v1/jobs/{id}?wait=30")).json()["status"], "dismissed");
    assert!(begun.elapsed().as_secs_f64() < 1.0);
}

#[test]
fn a_scans_own_covariance_replaces_the_pose_noise() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let mut same = small(4);
    for scan in same["scans"].as_array_mut().unwrap() {
        scan["pose_covariance"] = json!([1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 2.5e-5]);
    }
    let mut worse = small(4);
    for scan in worse["scans"].as_array_mut().unwrap() {
        scan["pose_covariance"] = json!([4e-2, 0, 0, 0, 4e-2, 0, 0, 0, 1e-2]);
    }
    let sigma = |request: &Value| {
        let mut request = request.clone();
        request["fit"] = json!({"poses": "fixed"});
        let map = server.map_of(&request);
        let answer = server.post(&format!("/v1/maps/{map}/query"), &json!({"points": [[0.0, 3.0], [8.0, 2.0]]})).json();
        answer["sigma"][0].as_f64().unwrap() + answer["sigma"][1].as_f64().unwrap()
    };
    let (plain, same, worse) = (sigma(&small(4)), sigma(&same), sigma(&worse));
    assert!((plain - same).abs() < 1e-6 * plain, "the noise's own covariance changes nothing");
    assert!(worse > 1.5 * plain, "{worse} {plain}");
}

#[test]
fn the_service_describes_itself() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    assert_eq!(server.get("/livez").status, 200);
    assert_eq!(server.get("/readyz").status, 200);
    assert_eq!(server.get("/openapi.json").json()["openapi"], "3.1.0");
    let page = server.get("/docs/");
    assert!(page.status == 200 && String::from_utf8_lossy(&page.body).contains("swagger-ui"));
    assert!(server.get("/").header("content-type").starts_with("text/html"));
    let echoed = server.send("GET", "/livez", &[("x-request-id", "trace-42")], None);
    assert_eq!(echoed.header("x-request-id"), "trace-42");
}

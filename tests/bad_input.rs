//! Bad input, case by case: the right problem, with a pointer to the fault, within a second, in bounded memory.

mod support;

use std::io::Write;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use support::{Answer, Server, small};

/// A valid job with one member replaced (or removed, by `Null` at the top level of its parent).
fn with(pointer: &str, value: Value) -> String {
    let mut job = small(1);
    match job.pointer_mut(pointer) {
        Some(place) => *place = value,
        None => {
            let (parent, name) = pointer.rsplit_once('/').unwrap();
            job.pointer_mut(parent).unwrap()[name] = value;
        }
    }
    job.to_string()
}

/// A valid vector job with these fit options.
fn vector_with(fit: Value) -> String {
    let mut job = small(1);
    job["map"]["distance"] = json!("vdf");
    job["fit"] = fit;
    job.to_string()
}

fn without(pointer: &str) -> String {
    let mut job = small(1);
    let (parent, name) = pointer.rsplit_once('/').unwrap();
    job.pointer_mut(parent).unwrap().as_object_mut().unwrap().remove(name).unwrap();
    job.to_string()
}

/// A valid job with a piece of text that no JSON library would write.
fn raw(pointer: &str, text: &str) -> String {
    with(pointer, json!("@@")).replace("\"@@\"", text)
}

/// Jobs that are 422, with the pointer that must be among the errors.
fn invalid_jobs() -> Vec<(&'static str, String, &'static str)> {
    let nothing_seen = |value: Value| {
        let mut job = small(1);
        for scan in job["scans"].as_array_mut().unwrap() {
            let beams = scan["ranges"].as_array().unwrap().len();
            scan["ranges"] = vec![value.clone(); beams].into();
        }
        job.to_string()
    };
    vec![
        ("not an object", "[1, 2]".into(), ""),
        ("a bare number", "7".into(), ""),
        ("an empty object", "{}".into(), "/scans"),
        ("no noise", without("/noise"), "/noise"),
        ("no map", without("/map"), "/map"),
        ("no distance", without("/map/distance"), "/map/distance"),
        ("no resolution", without("/map/resolution"), "/map/resolution"),
        ("an unknown distance", with("/map/distance", json!("tsdf")), "/map/distance"),
        ("distance is a number", with("/map/distance", json!(1)), "/map/distance"),
        (
            "a published vector map that moves poses",
            vector_with(json!({"weighting": "paper", "poses": "refined"})),
            "/fit/poses",
        ),
        ("a band below nothing", vector_with(json!({"band": -1})), "/fit/band"),
        ("resolution zero", with("/map/resolution", json!(0)), "/map/resolution"),
        ("resolution negative", with("/map/resolution", json!(-0.2)), "/map/resolution"),
        ("resolution a string", with("/map/resolution", json!("0.2")), "/map/resolution"),
        ("resolution null", with("/map/resolution", json!(null)), "/map/resolution"),
        ("more control points than the limit", with("/map/resolution", json!(0.001)), "/map/resolution"),
        ("a tiling that is none", with("/map/tiling", json!("quad")), "/map/tiling"),
        ("resolution absurdly small", with("/map/resolution", json!(1e-300)), "/map/resolution"),
        ("bounds inverted along x", with("/map/bounds", json!({"min": [8, 0], "max": [0, 8]})), "/map/bounds/max/0"),
        ("bounds inverted along y", with("/map/bounds", json!({"min": [0, 8], "max": [8, 0]})), "/map/bounds/max/1"),
        ("bounds empty", with("/map/bounds", json!({"min": [1, 1], "max": [1, 1]})), "/map/bounds/max/0"),
        ("bounds without max", with("/map/bounds", json!({"min": [0, 0]})), "/map/bounds/max"),
        ("bounds with three numbers", with("/map/bounds", json!({"min": [0, 0, 0], "max": [8, 8]})), "/map/bounds/min"),
        ("bounds with a null", with("/map/bounds", json!({"min": [null, 0], "max": [8, 8]})), "/map/bounds/min/0"),
        ("bounds an array", with("/map/bounds", json!([0, 0, 8, 8])), "/map/bounds"),
        (
            "bounds beside every return",
            with("/map/bounds", json!({"min": [100, 100], "max": [108, 108]})),
            "/map/bounds",
        ),
        ("margin negative", with("/map/margin", json!(-1)), "/map/margin"),
        ("no scans", with("/scans", json!([])), "/scans"),
        ("scans an object", with("/scans", json!({})), "/scans"),
        ("scans of numbers", with("/scans", json!([1, 2])), "/scans"),
        ("a scan that is a string", with("/scans/1", json!("scan")), "/scans/1"),
        ("a scan without a pose", without("/scans/2/pose"), "/scans/2/pose"),
        ("a pose without theta", without("/scans/0/pose/theta"), "/scans/0/pose/theta"),
        ("a pose coordinate a string", with("/scans/0/pose/x", json!("1")), "/scans/0/pose/x"),
        ("a pose coordinate far away", with("/scans/0/pose/x", json!(1e12)), "/scans/0/pose/x"),
        ("a scan without ranges", without("/scans/0/ranges"), "/scans/0/ranges"),
        ("no beams", with("/scans/0/ranges", json!([])), "/scans/0/ranges"),
        ("ranges a string", with("/scans/0/ranges", json!("1 2 3")), "/scans/0/ranges"),
        ("a range that is a string", with("/scans/0/ranges/5", json!("2.0")), "/scans/0/ranges/5"),
        ("a range that is an object", with("/scans/2/ranges/0", json!({})), "/scans/2/ranges/0"),
        ("no return: all null", nothing_seen(json!(null)), "/scans"),
        ("no return: all beyond range_max", nothing_seen(json!(1000)), "/scans"),
        ("no return: all negative", nothing_seen(json!(-1)), "/scans"),
        ("angle_increment zero", with("/scans/0/angle_increment", json!(0)), "/scans/0/angle_increment"),
        ("more than one turn", with("/scans/0/angle_increment", json!(0.1)), "/scans/0/angle_increment"),
        ("angle_min missing", without("/scans/0/angle_min"), "/scans/0/angle_min"),
        ("range_min negative", with("/scans/0/range_min", json!(-0.1)), "/scans/0/range_min"),
        ("range_max below range_min", with("/scans/0/range_max", json!(0.01)), "/scans/0/range_max"),
        (
            "a covariance of 8 numbers",
            with("/scans/0/pose_covariance", json!([1, 0, 0, 0, 1, 0, 0, 0])),
            "/scans/0/pose_covariance",
        ),
        (
            "a covariance with a null",
            with("/scans/0/pose_covariance", json!([1, 0, 0, 0, null, 0, 0, 0, 1])),
            "/scans/0/pose_covariance/4",
        ),
        (
            "a covariance not symmetric",
            with("/scans/0/pose_covariance", json!([1, 0.5, 0, 0, 1, 0, 0, 0, 1])),
            "/scans/0/pose_covariance",
        ),
        (
            "a covariance not semi-definite",
            with("/scans/0/pose_covariance", json!([1, 2, 0, 2, 1, 0, 0, 0, 1])),
            "/scans/0/pose_covariance",
        ),
        (
            "a negative variance",
            with("/scans/0/pose_covariance", json!([-1e-4, 0, 0, 0, 1, 0, 0, 0, 1])),
            "/scans/0/pose_covariance",
        ),
        ("sigma_x zero", with("/noise/sigma_x", json!(0)), "/noise/sigma_x"),
        ("sigma_y negative", with("/noise/sigma_y", json!(-0.01)), "/noise/sigma_y"),
        ("sigma_theta missing", without("/noise/sigma_theta"), "/noise/sigma_theta"),
        ("sigma_range a boolean", with("/noise/sigma_range", json!(true)), "/noise/sigma_range"),
        ("sigma_range absurdly small", with("/noise/sigma_range", json!(1e-200)), "/noise/sigma_range"),
        ("noise an array", with("/noise", json!([0.01])), "/noise"),
        ("an unknown weighting", with("/fit", json!({"weighting": "magic"})), "/fit/weighting"),
        ("max_iterations zero", with("/fit", json!({"max_iterations": 0})), "/fit/max_iterations"),
        ("max_iterations a fraction", with("/fit", json!({"max_iterations": 1.5})), "/fit/max_iterations"),
        ("max_iterations huge", with("/fit", json!({"max_iterations": 1e9})), "/fit/max_iterations"),
        ("a weight of zero", with("/fit", json!({"eikonal_weight": 0})), "/fit/eikonal_weight"),
        ("fit a string", with("/fit", json!("paper")), "/fit"),
        ("name a number", with("/name", json!(7)), "/name"),
        ("name too long", with("/name", json!("n".repeat(300))), "/name"),
        ("labels an array", with("/labels", json!(["a"])), "/labels"),
        ("a label that is a number", with("/labels", json!({"floor": 2})), "/labels/floor"),
        ("a label with a slash, escaped", with("/labels", json!({"a/b": 2})), "/labels/a~1b"),
        ("priority a string", with("/priority", json!("high")), "/priority"),
    ]
}

/// Bodies that are not JSON: 400.
fn malformed_bodies() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("empty", vec![]),
        ("torn", small(1).to_string().into_bytes()[..400].to_vec()),
        ("trailing text", format!("{} x", small(1)).into_bytes()),
        ("NaN", raw("/noise/sigma_x", "NaN").into_bytes()),
        ("Infinity", raw("/map/resolution", "Infinity").into_bytes()),
        ("-Infinity in ranges", raw("/scans/0/ranges/3", "-Infinity").into_bytes()),
        ("1e400", raw("/scans/0/pose/x", "1e400").into_bytes()),
        ("-1e400 in ranges", raw("/scans/0/ranges/3", "-1e400").into_bytes()),
        ("not UTF-8", vec![b'"', 0xff, 0xfe, b'"']),
        ("deep nesting", "[".repeat(100_000).into_bytes()),
        (
            "deep nesting in a member",
            raw("/labels", &format!("{}1{}", "[".repeat(5_000), "]".repeat(5_000))).into_bytes(),
        ),
        ("a comment", b"/* job */ {}".to_vec()),
    ]
}

struct Clock(Instant);

impl Clock {
    fn check(name: &str, ask: impl FnOnce() -> Answer) -> Answer {
        let clock = Self(Instant::now());
        let answer = ask();
        assert!(clock.0.elapsed() < Duration::from_secs(1), "{name} took {:?}", clock.0.elapsed());
        answer
    }
}

const JSON: (&str, &str) = ("content-type", "application/json");

#[test]
fn every_bad_request_gets_its_problem() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let jobs = invalid_jobs();
    assert!(jobs.len() >= 60);
    for (name, body, pointer) in jobs {
        let answer = Clock::check(name, || server.send("POST", "/v1/jobs", &[JSON], Some(body.as_bytes())));
        assert_eq!(answer.status, 422, "{name}: {}", String::from_utf8_lossy(&answer.body));
        let problem = answer.problem(422);
        assert!(problem["type"].as_str().unwrap().ends_with("/problems/invalid-request"), "{name}: {problem}");
        let errors = problem["errors"].as_array().unwrap();
        let found = errors.iter().any(|e| e["pointer"] == pointer && !e["detail"].as_str().unwrap().is_empty());
        assert!(found, "{name}: {pointer} is not among {errors:?}");
    }
    for (name, body) in malformed_bodies() {
        let answer = Clock::check(name, || server.send("POST", "/v1/jobs", &[JSON], Some(&body)));
        assert_eq!(answer.status, 400, "{name}: {}", String::from_utf8_lossy(&answer.body));
        answer.problem(400);
    }
    assert_eq!(server.get("/v1/jobs").json()["items"], json!([]), "nothing bad was accepted");
    assert!(server.peak_memory() < 300 << 20, "{} MiB", server.peak_memory() >> 20);
}

#[test]
fn every_fault_is_listed_not_only_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    let mut job = small(1);
    job["noise"]["sigma_x"] = json!(-1);
    job["scans"][0]["ranges"][4] = json!("x");
    job["scans"][2]["pose"]["y"] = json!(null);
    job["map"] = json!({"distance": "sdf"});
    job["fit"] = json!({"weighting": 3});
    let problem = server.post("/v1/jobs", &job).problem(422);
    let pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
    for pointer in ["/noise/sigma_x", "/scans/0/ranges/4", "/scans/2/pose/y", "/map/resolution", "/fit/weighting"] {
        assert!(pointers.contains(&pointer), "{pointer} is not in {pointers:?}");
    }
}

#[test]
fn bombs_and_floods_are_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    let spaces = vec![b' '; 256 << 20];
    let mut gzip = flate2::write::GzEncoder::new(vec![], flate2::Compression::best());
    gzip.write_all(&spaces).unwrap();
    let zstd = zstd::encode_all(&spaces[..], 3).unwrap();
    for (encoding, bomb) in [("gzip", gzip.finish().unwrap()), ("zstd", zstd)] {
        assert!(bomb.len() < 1 << 20);
        let headers = [JSON, ("content-encoding", encoding)];
        let answer = Clock::check(encoding, || server.send("POST", "/v1/jobs", &headers, Some(&bomb)));
        answer.problem(413);
    }
    let flood = vec![b' '; 80 << 20];
    server.send("POST", "/v1/jobs", &[JSON], Some(&flood)).problem(413);
    let million_lists = format!("{{\"scans\": [{}]}}", "[],".repeat(9_000_000) + "[]");
    server.send("POST", "/v1/jobs", &[JSON], Some(million_lists.as_bytes())).problem(413);
    server.send("POST", "/v1/jobs", &[JSON, ("content-encoding", "gzip")], Some(b"not gzip at all")).problem(400);
    assert!(server.peak_memory() < 700 << 20, "{} MiB", server.peak_memory() >> 20);
    assert_eq!(server.get("/livez").status, 200);
}

#[test]
fn routes_methods_and_media_types_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    let body = small(1).to_string();
    let post = |headers: &[(&str, &str)]| server.send("POST", "/v1/jobs", headers, Some(body.as_bytes()));
    post(&[]).problem(415);
    post(&[("content-type", "text/plain")]).problem(415);
    post(&[("content-type", "application/x-www-form-urlencoded")]).problem(415);
    post(&[JSON, ("content-encoding", "br")]).problem(415);
    assert_eq!(post(&[("content-type", "application/json; charset=utf-8")]).status, 202);
    for (method, path) in
        [("PUT", "/v1/jobs"), ("DELETE", "/v1/jobs"), ("POST", "/v1/maps"), ("PUT", "/v1/maps/x"), ("POST", "/livez")]
    {
        let answer = server.send(method, path, &[], None);
        answer.problem(405);
        assert!(!answer.header("allow").is_empty(), "{method} {path} has no Allow");
    }
    for path in ["/v1", "/v1/job", "/v2/jobs", "/v1/maps/x/y", "/etc/passwd", "/v1/jobs/a/b/c"] {
        server.get(path).problem(404);
    }
}

#[test]
fn unknown_and_malformed_ids_are_404() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 0);
    for id in
        ["0190b5a0-0000-7000-8000-000000000000", "nope", "%00", "..%2f..", "' OR 1=1 --".replace(' ', "%20").as_str()]
    {
        for path in ["", "/events", "/request"] {
            server.get(&format!("/v1/jobs/{id}{path}")).problem(404);
        }
        server.delete(&format!("/v1/jobs/{id}")).problem(404);
        for path in ["", "/coefficients", "/covariance", "/contours", "/ogm", "/image", "/poses"] {
            server.get(&format!("/v1/maps/{id}{path}")).problem(404);
        }
        server.post(&format!("/v1/maps/{id}/query"), &json!({"points": []})).problem(404);
        server.delete(&format!("/v1/maps/{id}")).problem(404);
    }
}

#[test]
fn bad_query_parameters_are_422_with_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    let job = server.submit(&small(2));
    let cases = [
        ("/v1/jobs?cursor=garbage".to_owned(), "cursor"),
        ("/v1/jobs?cursor=%FF%FE".into(), "cursor"),
        ("/v1/maps?cursor=YmVmb3JlOg".into(), "cursor"),
        ("/v1/jobs?limit=0".into(), "limit"),
        ("/v1/jobs?limit=ten".into(), "limit"),
        ("/v1/jobs?limit=-1".into(), "limit"),
        ("/v1/jobs?limit=100000".into(), "limit"),
        ("/v1/jobs?status=done".into(), "status"),
        ("/v1/jobs?label=nocolon".into(), "label"),
        ("/v1/maps?bbox=1,2,3".into(), "bbox"),
        ("/v1/maps?bbox=3,3,1,1".into(), "bbox"),
        ("/v1/maps?bbox=a,b,c,d".into(), "bbox"),
        (format!("/v1/jobs/{job}?wait=61"), "wait"),
        (format!("/v1/jobs/{job}?wait=-1"), "wait"),
        (format!("/v1/jobs/{job}?wait=soon"), "wait"),
        (format!("{own}/covariance?kind=prior"), "kind"),
        (format!("{own}/covariance?form=dense"), "form"),
        (format!("{own}/covariance?form=block"), "i0"),
        (format!("{own}/covariance?form=block&i0=0&j0=0&ni=0&nj=1"), "ni"),
        (format!("{own}/covariance?form=block&i0=20&j0=0&ni=5&nj=1"), "ni"),
        (format!("{own}/covariance?form=block&i0=-1&j0=0&ni=1&nj=1"), "i0"),
        (format!("{own}/covariance?format=png"), "format"),
        (format!("{own}/contours?level=abc"), "level"),
        (format!("{own}/contours?level=NaN"), "level"),
        (format!("{own}/contours?level=inf"), "level"),
        (format!("{own}/contours?sigma_band=-2"), "sigma_band"),
        (format!("{own}/ogm?resolution=0"), "resolution"),
        (format!("{own}/ogm?resolution=1e-4"), "resolution"),
        (format!("{own}/ogm?resolution=x"), "resolution"),
        (format!("{own}/image?layer=height"), "layer"),
        (format!("{own}/image?overlay=contour,cats"), "overlay"),
        (format!("{own}/image?width=1"), "width"),
        (format!("{own}/image?width=1000000"), "width"),
    ];
    for (path, parameter) in cases {
        let problem = Clock::check(&path, || server.get(&path)).problem(422);
        let named = problem["errors"].as_array().unwrap().iter().any(|e| e["parameter"] == parameter);
        assert!(named, "{path}: {problem}");
    }
    let refused = server.send("GET", &format!("{own}/coefficients"), &[("accept", "text/csv")], None);
    refused.problem(406);
    for (body, pointer) in [
        (json!({}), "/points"),
        (json!({"points": 1}), "/points"),
        (json!({"points": [[1, 2], [3]]}), "/points/1"),
        (json!({"points": [[1, null]]}), "/points/0"),
        (json!({"points": [["1", 2]]}), "/points/0"),
        (json!({"points": [[1, 2]], "kind": "prior"}), "/kind"),
        (json!([1]), ""),
    ] {
        let problem = server.post(&format!("{own}/query"), &body).problem(422);
        assert!(problem["errors"].as_array().unwrap().iter().any(|e| e["pointer"] == pointer), "{body}: {problem}");
    }
}

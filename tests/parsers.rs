//! Whatever a parser is given, it answers: with something whole, or with an error. Some thousands of cases here,
//! `PROPTEST_CASES=100000 cargo test --release --test parsers` at night.

use bytes::Bytes;
use mapfit::access;
use mapfit::http::maps::query::question;
use mapfit::http::shared::multipart;
use mapfit::http::shared::page::{from_cursor, from_numbered_cursor, to_cursor};
use mapfit::import::{Ask, RecordingLimits, Selection, list_log, parse_carmen, read_log};
use mapfit::jobs::{JobRequest, Limits, RequestError, Sightings, join_body};
use mapfit::map::FittedMap;
use proptest::prelude::*;
use proptest::sample::Index;
use serde_json::{Value, json};

const LIMITS: Limits =
    Limits { control_points: 20_000, in_parts: 40_000, lattice: 40_000, scans: 50, beams_a_scan: 200, values: 10_000 };

/// As many cases as `PROPTEST_CASES` says, or the usual number.
fn config(usual: u32, max_shrink_iters: u32) -> ProptestConfig {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    ProptestConfig { max_shrink_iters, ..ProptestConfig::with_cases(asked.unwrap_or(usual)) }
}

fn job() -> Value {
    let pose = json!({"x": 1.0, "y": 1.0, "theta": 0.5});
    let scan = json!({"pose": pose, "angle_min": -1.0, "angle_increment": 0.1, "range_min": 0.05, "range_max": 20.0,
        "ranges": [2.0, 2.1, null, 2.2, 3.0], "pose_covariance": [1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-5]});
    json!({"name": "a", "labels": {"k": "v"}, "scans": [scan.clone(), scan], "priority": 3, "deadline_seconds": 9.5,
        "noise": {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.005, "sigma_range": 0.02},
        "map": {"distance": "vdf", "resolution": 0.2, "bounds": {"min": [0, 0], "max": [8, 8]}, "margin": 0.6},
        "fit": {"weighting": "calibrated", "max_iterations": 10, "poses": "refined", "band": 2.0}})
}

/// Every address in a document, as JSON Pointers.
fn pointers(value: &Value, at: &str, all: &mut Vec<String>) {
    all.push(at.to_owned());
    match value {
        Value::Array(items) => items.iter().enumerate().for_each(|(k, item)| pointers(item, &format!("{at}/{k}"), all)),
        Value::Object(members) => members.iter().for_each(|(key, item)| pointers(item, &format!("{at}/{key}"), all)),
        _ => {}
    }
}

/// What a client might put where something else belongs.
fn stranger() -> impl Strategy<Value = Value> {
    let number =
        prop_oneof![any::<f64>(), Just(0.0), Just(-1.0), Just(1e300), Just(1e-300), Just(f64::MAX), Just(5e-324)];
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        number.prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        ".{0,12}".prop_map(Value::from),
    ];
    leaf.prop_recursive(3, 24, 6, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            prop::collection::btree_map("[a-z_]{0,10}", inner, 0..4)
                .prop_map(|map| Value::Object(map.into_iter().collect())),
        ]
    })
}

/// Values to put into a document, and where.
fn edits() -> impl Strategy<Value = Vec<(Index, Value)>> {
    prop::collection::vec((any::<Index>(), stranger()), 1..4)
}

/// Bytes to put among others, and where.
fn bytes_in(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<(Index, u8)>> {
    prop::collection::vec((any::<Index>(), any::<u8>()), count)
}

/// A document with other values in some places.
fn edited(mut document: Value, edits: Vec<(Index, Value)>) -> Vec<u8> {
    for (place, value) in edits {
        let mut all = Vec::new();
        pointers(&document, "", &mut all);
        *document.pointer_mut(&all[place.index(all.len())]).unwrap() = value;
    }
    document.to_string().into_bytes()
}

/// Bytes with others in some places, and perhaps without their end.
fn damaged(mut bytes: Vec<u8>, edits: Vec<(Index, u8)>, (cut, of): (Index, usize)) -> Vec<u8> {
    for (place, byte) in edits {
        let at = place.index(bytes.len());
        bytes[at] = byte;
    }
    let cut = cut.index(of * bytes.len()).min(bytes.len());
    bytes.truncate(cut);
    bytes
}

/// A request that is accepted can be fitted: its numbers are finite, and no larger than the limits.
fn accepted_is_whole(parsed: &Result<JobRequest, RequestError>) -> Result<(), TestCaseError> {
    match parsed {
        Err(RequestError::Damaged(_)) => prop_assert!(false, "nothing is stored here"),
        Ok(request) => {
            prop_assert!(request.lattice.len() <= LIMITS.control_points && request.lattice.resolution > 0.0);
            prop_assert!(request.scans.len() <= LIMITS.scans);
            prop_assert!(request.scans.iter().all(|scan| scan.pose.x.is_finite() && scan.pose.theta.is_finite()));
            let most = request.most();
            prop_assert!(most.bytes.is_finite() && most.seconds.is_finite());
        }
        Err(RequestError::Faults(faults)) => prop_assert!(!faults.is_empty()),
        Err(RequestError::Document(_)) => {}
    }
    Ok(())
}

proptest! {
    #![proptest_config(config(3000, 2000))]

    #[test]
    fn a_job_with_something_else_in_it(edits in edits()) {
        accepted_is_whole(&JobRequest::parse(&edited(job(), edits), &LIMITS))?;
    }

    #[test]
    fn a_job_with_other_bytes_in_it(edits in bytes_in(1..12), cut in any::<Index>()) {
        let bytes = damaged(job().to_string().into_bytes(), edits, (cut, 2));
        accepted_is_whole(&JobRequest::parse(&bytes, &LIMITS))?;
        let _ = JobRequest::parse_labels(&bytes);
    }

    #[test]
    fn any_bytes_as_a_job(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        accepted_is_whole(&JobRequest::parse(&bytes, &LIMITS))?;
    }

    #[test]
    fn a_log_of_words(lines in prop::collection::vec(prop::collection::vec("(FLASER|ROBOTLASER1|ODOM|PARAM|#|-?[0-9]{1,4}(\\.[0-9]{1,3})?|nan|inf|1e400|.{0,6})", 0..20), 0..12)) {
        let text = lines.iter().map(|words| words.join(" ")).collect::<Vec<_>>().join("\n");
        if let Ok(scans) = parse_carmen(&text) {
            prop_assert!(scans.iter().all(|scan| scan.pose.x.is_finite() && scan.ranges.len() <= 100_000));
        }
    }

    #[test]
    fn cursors_come_back_or_are_refused(text in ".{0,60}", number in any::<i64>()) {
        let _ = (from_cursor(&text), from_numbered_cursor(&text));
        prop_assert_eq!(from_numbered_cursor(&to_cursor(&number.to_string())), Some(number));
        prop_assert_eq!(from_cursor(&to_cursor(&text)).is_some(), uuid::Uuid::parse_str(&text).is_ok());
    }

    #[test]
    fn what_is_no_key_has_no_id(text in ".{0,80}") {
        if let Some(id) = access::id_of(&text) {
            prop_assert!(text.starts_with("mapfit_") && id.len() == 16);
        }
    }
}

/// Bodies beside a job's, of which what is accepted is whole.
fn update() -> Value {
    let mut body = job();
    body.as_object_mut().unwrap().remove("map");
    body
}

fn join() -> Value {
    let pose = json!({"x": 1.0, "y": -2.0, "theta": 0.1});
    let covariance = [0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.01];
    json!({"name": "both", "labels": {"k": "v"}, "priority": 1, "deadline_seconds": 60,
        "maps": [{"id": "a"}, {"id": "b", "pose": pose, "pose_covariance": covariance}],
        "map": {"distance": "vdf", "resolution": 0.2, "margin": 1, "tiling": "none"}, "fit": {"max_iterations": 10}})
}

fn sightings() -> Value {
    let mut body = job();
    let kept = ["scans", "noise"].map(|name| (name.to_owned(), body[name].take()));
    let motion = json!({"x": 0.1, "y": 0.0, "theta": 0.01, "covariance": [1, 0, 0, 0, 1, 0, 0, 0, 1]});
    let own = json!({"kind": "posterior", "hypotheses": 3, "motions": [motion]});
    Value::Object(kept.into_iter().chain(own.as_object().unwrap().clone()).collect())
}

fn query() -> Value {
    json!({"points": [[0.5, 1.0], [2, -3.5]], "kind": "posterior", "fields": ["distance", "sigma"]})
}

fn npy(points: &[[f64; 2]]) -> Vec<u8> {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 2), }}\n", points.len());
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
    file.extend(header.as_bytes());
    file.extend(points.iter().flatten().flat_map(|value| value.to_le_bytes()));
    file
}

fn form(parts: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, content) in parts {
        body.extend(format!("--B\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\n").as_bytes());
        body.extend(content.iter().chain(b"\r\n"));
    }
    body.extend(b"--B--\r\n");
    body
}

fn points() -> impl Strategy<Value = Vec<[f64; 2]>> {
    prop::collection::vec(prop::array::uniform2(prop::num::f64::ANY), 0..6)
}

fn form_parts() -> impl Strategy<Value = Vec<(String, Vec<u8>)>> {
    prop::collection::vec(("[a-z]{1,8}", prop::collection::vec(any::<u8>(), 0..40)), 0..4)
}

#[test]
fn the_bodies_that_are_mutated_are_taken_as_they_are() {
    let bytes = |value: Value| value.to_string().into_bytes();
    let before = JobRequest::parse(&bytes(job()), &LIMITS).unwrap();
    assert_eq!(before.updated(&bytes(update()), &LIMITS).unwrap().scans.len(), 4);
    assert_eq!(join_body(&bytes(join()), &LIMITS).unwrap().members.len(), 2);
    assert_eq!(Sightings::parse(&bytes(sightings()), &LIMITS).unwrap().motions.unwrap().len(), 1);
    assert_eq!(question::parse(&bytes(query())).unwrap().points.len(), 2);
}

proptest! {
    #![proptest_config(config(3000, 2000))]

    #[test]
    fn an_update_with_something_else_in_it(edits in edits()) {
        let before = JobRequest::parse(job().to_string().as_bytes(), &LIMITS).unwrap();
        accepted_is_whole(&before.updated(&edited(update(), edits), &LIMITS))?;
    }

    #[test]
    fn a_join_with_something_else_in_it(edits in edits()) {
        match join_body(&edited(join(), edits), &LIMITS) {
            Ok(body) => for member in body.members {
                prop_assert!(member.guess.pose.x.is_finite() && member.guess.pose.theta.is_finite());
                prop_assert!(member.guess.covariance.iter().all(|value| value.is_finite()));
            },
            Err(RequestError::Faults(faults)) => prop_assert!(!faults.is_empty()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn sightings_with_something_else_in_them(edits in edits()) {
        match Sightings::parse(&edited(sightings(), edits), &LIMITS) {
            Ok(asked) => {
                prop_assert!(asked.scans.iter().all(|own| own.scan.pose.x.is_finite() && own.sigma_range > 0.0));
                prop_assert!(asked.motions.is_none_or(|motions| motions.len() + 1 == asked.scans.len()));
            }
            Err(RequestError::Faults(faults)) => prop_assert!(!faults.is_empty()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn a_query_with_something_else_in_it(edits in edits()) {
        match question::parse(&edited(query(), edits)) {
            Ok(asked) => prop_assert!(asked.points.iter().flatten().all(|value| value.is_finite())),
            Err(problem) => prop_assert!(problem.status.is_client_error()),
        }
    }

    #[test]
    fn points_with_other_bytes_in_them(points in points(), edits in bytes_in(0..6), cut in any::<Index>()) {
        let whole = question::points_of_npy(&npy(&points));
        match points.iter().flatten().all(|value| value.is_finite()) {
            true => prop_assert_eq!(whole.unwrap().iter().map(|p| [p.x, p.y]).collect::<Vec<_>>(), &points[..]),
            false => prop_assert!(whole.is_err()),
        }
        match question::points_of_npy(&damaged(npy(&points), edits, (cut, 4))) {
            Ok(read) => prop_assert!(read.iter().flatten().all(|value| value.is_finite())),
            Err(problem) => prop_assert!(problem.status.is_client_error()),
        }
    }

    #[test]
    fn a_form_with_other_bytes_in_it(parts in form_parts(), edits in bytes_in(0..6), cut in any::<Index>()) {
        let body = form(&parts);
        if parts.iter().all(|(_, content)| !content.windows(3).any(|window| window == b"--B")) {
            let read = multipart::parts(&Bytes::from(body.clone()), "B").unwrap();
            let read: Vec<_> = read.into_iter().map(|part| (part.name, part.content.to_vec())).collect();
            prop_assert_eq!(&read, &parts);
        }
        let body = damaged(body, edits, (cut, 4));
        match multipart::parts(&Bytes::from(body.clone()), "B") {
            Ok(read) => prop_assert!(read.iter().map(|part| part.content.len()).sum::<usize>() <= body.len()),
            Err(problem) => prop_assert!(problem.status.is_client_error()),
        }
    }
}

/// A small drive: two scans, the transforms that place them, in a compressed chunk or in none.
const DRIVES: [&[u8]; 2] = [include_bytes!("fixtures/drive-zstd.mcap"), include_bytes!("fixtures/drive-plain.mcap")];
const RECORDINGS: RecordingLimits =
    RecordingLimits { file: 1 << 20, record: 1 << 18, unpacked: 1 << 20, scans: 50, ranges: 10_000, poses: 1000 };

/// Whatever comes out can be a job's scans.
fn recording_is_whole(bytes: &[u8]) -> Result<(), TestCaseError> {
    let bytes = bytes.to_vec();
    let source = || Ok(Box::new(std::io::Cursor::new(bytes.clone())) as Box<dyn std::io::Read>);
    let (ask, all) = (Ask::default(), Selection::default());
    match read_log(&source, &ask, &all, &RECORDINGS, &|| true) {
        Ok(log) => {
            prop_assert!(!log.scans.is_empty() && log.scans.len() <= RECORDINGS.scans);
            for scan in &log.scans {
                prop_assert!(scan.pose.x.is_finite() && scan.pose.y.is_finite() && scan.pose.theta.is_finite());
                prop_assert!(scan.angle_min.is_finite() && scan.angle_increment.is_finite());
                prop_assert!(scan.range_min < scan.range_max && scan.ranges.len() <= RECORDINGS.ranges);
            }
        }
        Err(error) => prop_assert!(!error.to_string().is_empty()),
    }
    let _ = list_log(&source, &ask, &RECORDINGS);
    Ok(())
}

#[test]
fn the_drives_that_are_mutated_are_read_as_they_are() {
    for drive in DRIVES {
        let source = || Ok(Box::new(std::io::Cursor::new(drive)) as Box<dyn std::io::Read>);
        let log = read_log(&source, &Ask::default(), &Selection::default(), &RECORDINGS, &|| true).unwrap();
        assert_eq!((log.scans.len(), log.scans[1].ranges.len(), log.notes.len()), (2, 181, 0));
    }
}

proptest! {
    #![proptest_config(config(3000, 2000))]

    #[test]
    fn a_recording_with_other_bytes_in_it(drive in 0..2usize, edits in bytes_in(0..12), cut in any::<Index>()) {
        recording_is_whole(&damaged(DRIVES[drive].to_vec(), edits, (cut, 4)))?;
    }

    #[test]
    fn any_records_as_a_recording(records in prop::collection::vec((any::<u8>(), prop::option::of(any::<u64>()), prop::collection::vec(any::<u8>(), 0..80)), 0..8)) {
        let mut bytes = b"\x89MCAP0\r\n".to_vec();
        for (opcode, claimed, content) in records {
            bytes.push(opcode % 0x10);
            bytes.extend(claimed.unwrap_or(content.len() as u64).to_le_bytes());
            bytes.extend(content);
        }
        recording_is_whole(&bytes)?;
    }
}

proptest! {
    #![proptest_config(config(2000, 50))]

    /// A damaged map is an error, or still a map.
    #[test]
    fn a_map_with_other_bytes_in_it(edits in bytes_in(1..40), cut in any::<Index>(), vector in any::<bool>()) {
        let bytes: Vec<u8> = match vector {
            true => include_bytes!("fixtures/format-1-vdf.npz").to_vec(),
            false => include_bytes!("fixtures/format-1-sdf.npz").to_vec(),
        };
        let _ = FittedMap::from_npz(&damaged(bytes, edits, (cut, 2)));
    }
}

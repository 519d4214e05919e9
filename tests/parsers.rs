//! Whatever a parser is given, it answers: with something whole, or with an error. Some thousands of cases here,
//! `PROPTEST_CASES=100000 cargo test --release --test parsers` at night.

use mapfit::access;
use mapfit::http::shared::page::{from_cursor, from_numbered_cursor, to_cursor};
use mapfit::import::{Ask, RecordingLimits, Selection, list_log, parse_carmen, read_log};
use mapfit::jobs::{JobRequest, Limits, RequestError};
use mapfit::map::FittedMap;
use proptest::prelude::*;
use serde_json::{Value, json};

const LIMITS: Limits =
    Limits { control_points: 20_000, in_parts: 40_000, lattice: 40_000, scans: 50, beams_a_scan: 200, values: 10_000 };

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
    #![proptest_config(ProptestConfig { max_shrink_iters: 2000, ..ProptestConfig::with_cases(
        std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(3000)) })]

    #[test]
    fn a_job_with_something_else_in_it(edits in prop::collection::vec((any::<prop::sample::Index>(), stranger()), 1..4)) {
        let mut document = job();
        for (place, value) in edits {
            let mut all = Vec::new();
            pointers(&document, "", &mut all);
            *document.pointer_mut(&all[place.index(all.len())]).unwrap() = value;
        }
        accepted_is_whole(&JobRequest::parse(document.to_string().as_bytes(), &LIMITS))?;
    }

    #[test]
    fn a_job_with_other_bytes_in_it(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12), cut in any::<prop::sample::Index>()) {
        let mut bytes = job().to_string().into_bytes();
        for (place, byte) in edits {
            let at = place.index(bytes.len());
            bytes[at] = byte;
        }
        let cut = cut.index(2 * bytes.len()).min(bytes.len());
        accepted_is_whole(&JobRequest::parse(&bytes[..cut], &LIMITS))?;
        let _ = JobRequest::parse_labels(&bytes[..cut]);
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
    #![proptest_config(ProptestConfig { max_shrink_iters: 2000, ..ProptestConfig::with_cases(
        std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(3000)) })]

    #[test]
    fn a_recording_with_other_bytes_in_it(drive in 0..2usize, edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12), cut in any::<prop::sample::Index>()) {
        let mut bytes = DRIVES[drive].to_vec();
        for (place, byte) in edits {
            let at = place.index(bytes.len());
            bytes[at] = byte;
        }
        let cut = cut.index(4 * bytes.len()).min(bytes.len());
        recording_is_whole(&bytes[..cut])?;
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
    #![proptest_config(ProptestConfig { max_shrink_iters: 50, ..ProptestConfig::with_cases(
        std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse::<u32>().ok()).map_or(300, |cases| cases / 10)) })]

    /// A damaged map is an error, or still a map.
    #[test]
    fn a_map_with_other_bytes_in_it(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40), cut in any::<prop::sample::Index>(), vector in any::<bool>()) {
        let mut bytes: Vec<u8> = match vector {
            true => include_bytes!("fixtures/format-1-vdf.npz").to_vec(),
            false => include_bytes!("fixtures/format-1-sdf.npz").to_vec(),
        };
        for (place, byte) in edits {
            let at = place.index(bytes.len());
            bytes[at] = byte;
        }
        let cut = cut.index(2 * bytes.len()).min(bytes.len());
        let _ = FittedMap::from_npz(&bytes[..cut]);
    }
}

//! What is kept no longer goes, and nothing else.

use std::time::{Duration, Instant};

use serde_json::json;

use crate::put;
use crate::support::{Server, small};

#[test]
fn maps_are_kept_by_label_and_place() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let labelled = |seed: u64, kind: &str| {
        let mut request = small(seed);
        request["labels"] = json!({"kind": kind});
        server.map_of(&request)
    };
    let (plain, named, brief) = (server.map_of(&small(1)), labelled(2, "brief"), labelled(3, "brief"));
    assert_eq!(put(&server, "hall", &json!({"map_id": named}), &[]).status, 201);
    drop(server);
    std::thread::sleep(Duration::from_millis(1000));
    // A hundred-thousandth of a day is less than a second.
    let rules = "365,kind:brief=0.00001,kind:other=forever";
    let server = Server::start_with(data.path(), 0, &["--keep-maps", rules, "--sweep-seconds", "1"]);
    let begun = Instant::now();
    while server.get(&format!("/v1/maps/{brief}")).status == 200 {
        assert!(begun.elapsed() < Duration::from_secs(10), "it is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
    for kept in [&plain, &named] {
        assert_eq!(server.get(&format!("/v1/maps/{kept}/coefficients")).status, 200);
    }
    // It goes once no place names it.
    assert_eq!(server.delete("/v1/places/hall").status, 204);
    while server.get("/v1/maps").json()["items"].as_array().unwrap().len() > 1 {
        assert!(begun.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(50));
    }
    // Their files go with them, a moment after.
    while std::fs::read_dir(data.path().join("artifacts/attempts")).unwrap().count() > 1 {
        assert!(begun.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(50));
    }
    let text = String::from_utf8(server.get("/metrics").body).unwrap();
    assert!(text.contains("mapfit_swept_total{what=\"maps\"} 2"), "{text}");
}

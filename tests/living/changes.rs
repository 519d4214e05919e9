//! What differs between two maps.

use serde_json::json;

use crate::scenes::room;
use crate::support::{Server, numbers, small};

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

//! Metrics and tiles.

use std::io::{Read, Write};
use std::net::TcpListener;

use crate::support::{Server, small};

#[test]
fn what_the_service_does_shows_in_its_metrics() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    server.map_of(&small(1));
    server.get("/v1/maps/x").problem(404);
    (0..50).for_each(|k| assert_eq!(server.send(&format!("MADEUP{k}"), "/v1/maps/x", &[], None).status, 405));
    let answer = server.get("/metrics");
    assert!(answer.header("content-type").starts_with("text/plain; version=0.0.4"));
    let text = String::from_utf8(answer.body).unwrap();
    let value = |name: &str| -> f64 {
        let line = text.lines().find(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(' ')));
        line.unwrap_or_else(|| panic!("{name} in {text}")).rsplit(' ').next().unwrap().parse().unwrap()
    };
    assert_eq!(value("mapfit_attempts_total{outcome=\"successful\"}"), 1.0);
    assert_eq!((value("mapfit_maps"), value("mapfit_jobs{state=\"accepted\",tenant_class=\"light\"}")), (1.0, 0.0));
    assert_eq!(value("mapfit_queue_oldest_seconds{tenant_class=\"heavy\"}"), 0.0);
    assert!(value("mapfit_map_bytes") > 1000.0 && value("process_resident_memory_bytes") > 1e6);
    assert_eq!(value("mapfit_stage_seconds_count{distance=\"sdf\",stage=\"covariance\"}"), 1.0);
    let by_route = "mapfit_http_request_seconds_count{method=\"GET\",route=\"/v1/maps/{id}\",status=\"404\"}";
    assert!(!text.contains("MADEUP"), "a client makes no series of its own");
    assert_eq!(value(by_route), 1.0, "by the route's pattern, so that ids make no series");

    let apart = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let server = Server::start_with(&data.path().join("other"), 0, &["--metrics-listen", &apart]);
    server.get("/metrics").problem(404);
    let mut stream = std::net::TcpStream::connect(&apart).unwrap();
    write!(stream, "GET /metrics HTTP/1.1\r\nHost: {apart}\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    assert!(text.starts_with("HTTP/1.1 200") && text.contains("mapfit_queue_oldest_seconds"));
}

#[test]
fn tiles_fit_together_and_show_what_was_observed() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let map = server.map_of(&small(1));
    for layer in ["distance", "sigma", "clearance", "occupancy"] {
        let tile = server.get(&format!("/v1/maps/{map}/tiles/{layer}/7/0/0?theme=dark"));
        assert_eq!((tile.status, tile.header("content-type")), (200, "image/png"), "{layer}");
        assert_eq!(&tile.body[..8], b"\x89PNG\r\n\x1a\n");
        let known = [("if-none-match", tile.header("etag"))];
        let again = server.send("GET", &format!("/v1/maps/{map}/tiles/{layer}/7/0/0?theme=dark"), &known, None);
        assert_eq!(again.status, 304);
    }
    let pixels = |path: &str| {
        let tile = server.get(&format!("/v1/maps/{map}/tiles/{path}"));
        let mut reader = png::Decoder::new(std::io::Cursor::new(tile.body)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    };
    // A quarter of a tile is one of the next level: its lower left pixels show the same places, four to one.
    let (coarse, fine) = (pixels("sigma/7/0/0"), pixels("sigma/8/0/0"));
    let at = |pixels: &[u8], column: usize, row: usize| -> [u8; 4] {
        pixels[4 * (column + 256 * row)..][..4].try_into().unwrap()
    };
    let mut alike = 0;
    for (column, row) in (0..128).flat_map(|column| (0..128).map(move |row| (column, row))) {
        let (one, four) = (at(&coarse, column, row + 128), at(&fine, 2 * column, 2 * row + 1));
        alike += usize::from(one.iter().zip(four).all(|(a, b)| a.abs_diff(b) < 24));
    }
    assert!(alike > 128 * 128 * 95 / 100, "{alike}");
    assert!(pixels("distance/7/-9/40").iter().all(|value| *value == 0), "nothing was observed there");
    for path in ["sigma/15/0/0", "sigma/3/0/x", "other/3/0/0", "sigma/3/99999999999/0"] {
        server.get(&format!("/v1/maps/{map}/tiles/{path}")).problem(404);
    }
    server.get(&format!("/v1/maps/{map}/tiles/sigma/3/0/0?max=0")).problem(422);
}

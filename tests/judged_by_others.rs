//! Our files before their own readers: numpy and scipy for arrays, map_server's rules with PyYAML and Pillow for grids.
//!
//! `scripts/test` names the interpreter in `MAPFIT_PYTHON`; without it these tests say that they were skipped.

mod support;

use std::path::Path;
use std::process::Command;

use serde_json::json;
use support::{Server, experiment_one, small};

fn judge(script: &str, arguments: &[&str]) {
    let Some(python) = std::env::var_os("MAPFIT_PYTHON") else {
        assert!(std::env::var_os("CI").is_none(), "CI has the judges");
        eprintln!("SKIPPED {script}: MAPFIT_PYTHON is not set; run scripts/test");
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/judges").join(script);
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(output.status.success(), "{}", said.concat());
}

/// An answer, kept as a file for its judge.
fn saved(answer: support::Answer, file: &Path) -> support::Answer {
    assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
    std::fs::write(file, &answer.body).unwrap();
    answer
}

#[test]
fn scipy_reads_the_arrays_and_finds_them_consistent() {
    let data = tempfile::tempdir().unwrap();
    let files = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    for (distance, poses) in [("sdf", "refined"), ("sdf", "fixed"), ("vdf", "refined"), ("vdf", "fixed")] {
        let mut request = small(3);
        request["map"]["distance"] = json!(distance);
        request["fit"] = json!({"poses": poses});
        let own = format!("/v1/maps/{}", server.map_of(&request));
        let save = |name: &str, path: &str| saved(server.get(&format!("{own}/{path}")), &files.path().join(name));
        save("coefficients.npz", "coefficients?format=npz");
        save("coefficients.json", "coefficients");
        save("factors.npz", "covariance?form=factors");
        for kind in ["propagated", "posterior"] {
            save(&format!("{kind}-diagonal.npz"), &format!("covariance?kind={kind}&format=npz"));
            save(&format!("{kind}-sparse.npz"), &format!("covariance?kind={kind}&form=sparse"));
            save(&format!("{kind}-full.npz"), &format!("covariance?kind={kind}&form=full"));
        }
        let points = json!([[0.1, 3.0], [2.3, 2.2], [7.9, 0.3], [1.5, 6.5], [4.05, 4.1]]);
        let ask = |kind: &str| server.post(&format!("{own}/query"), &json!({"points": points, "kind": kind})).json();
        let query = json!({"points": points, "propagated": ask("propagated"), "posterior": ask("posterior")});
        std::fs::write(files.path().join("query.json"), query.to_string()).unwrap();
        let lattice = server.get(&own).json()["lattice"]["control_points"].clone();
        judge("arrays.py", &[files.path().to_str().unwrap(), &lattice[0].to_string(), &lattice[1].to_string()]);
    }
}

#[test]
fn map_server_reads_the_grid() {
    let data = tempfile::tempdir().unwrap();
    let files = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&experiment_one(1)));
    for resolution in ["0.05", "0.13", "0.2", "0.5"] {
        let save = |name: String, query: &str| {
            saved(server.get(&format!("{own}/ogm?resolution={resolution}&{query}")), &files.path().join(name))
        };
        save("ogm.json".into(), "format=json");
        save("ogm.png".into(), "format=png");
        for mode in ["trinary", "scale", "raw"] {
            save(format!("{mode}.zip"), &format!("format=zip&mode={mode}"));
        }
        judge("nav2.py", &[files.path().to_str().unwrap()]);
    }
    let plain = server.get(&format!("{own}/ogm?resolution=0.2&format=zip"));
    let named = server.get(&format!("{own}/ogm?resolution=0.2&format=zip&mode=trinary"));
    assert!(plain.body == named.body && !plain.header("etag").is_empty(), "trinary is the default");
    let fault = server.get(&format!("{own}/ogm?mode=gray")).problem(422);
    assert_eq!(fault["errors"][0]["parameter"], "mode");
}

/// Lines and bands as GeoJSON, and pictures as SVG, of either distance.
#[test]
fn shapely_and_svg_readers_find_the_contours() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    for distance in ["sdf", "vdf"] {
        let files = tempfile::tempdir().unwrap();
        let mut request = experiment_one(3);
        request["map"]["distance"] = json!(distance);
        let own = format!("/v1/maps/{}", server.map_of(&request));
        let save = |name: &str, answer: support::Answer| saved(answer, &files.path().join(name));
        let contours = save("contours.geojson", server.get(&format!("{own}/contours?sigma_band=2"))).json();
        let lines = contours["features"][0]["geometry"]["coordinates"].as_array().unwrap();
        let points: Vec<&serde_json::Value> = lines.iter().flat_map(|line| line.as_array().unwrap()).collect();
        save("sigma.json", server.post(&format!("{own}/query"), &json!({"points": points, "fields": ["sigma"]})));
        save("contours.svg", server.get(&format!("{own}/contours?sigma_band=2&format=svg&width=700")));
        save("image.svg", server.get(&format!("{own}/image?format=svg&width=700")));
        save("image.png", server.get(&format!("{own}/image?width=700")));
        judge("contours.py", &[files.path().to_str().unwrap(), "700"]);
    }
}

/// Rasters as arrays and as GeoTIFF, and a query by arrays, of either distance.
#[test]
fn rasterio_reads_the_rasters_and_a_query_says_the_same() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    for distance in ["sdf", "vdf"] {
        let files = tempfile::tempdir().unwrap();
        let mut request = experiment_one(3);
        request["map"]["distance"] = json!(distance);
        let own = format!("/v1/maps/{}", server.map_of(&request));
        let save = |name: &str, answer: support::Answer| saved(answer, &files.path().join(name));
        save("grid.npz", server.get(&format!("{own}/grid?resolution=0.13")));
        save("grid.tif", server.send("GET", &format!("{own}/grid?resolution=0.13"), &[("accept", "image/tiff")], None));
        let folder = files.path().to_str().unwrap();
        judge("grids.py", &[folder]);
        let Ok(centres) = std::fs::read(files.path().join("centres.npy")) else { return };
        let headers = [("content-type", "application/x-npy"), ("accept", "application/x-npz")];
        save("answer.npz", server.send("POST", &format!("{own}/query"), &headers, Some(&centres)));
        let [x, y] = [0, 1].map(|axis: usize| server.get(&own).json()["lattice"]["origin"][axis].as_f64().unwrap());
        let points: Vec<[f64; 2]> = (0..50).map(|k| [x + (f64::from(k) + 0.5) * 0.13, y + 0.5 * 0.13]).collect();
        save("answer.json", server.post(&format!("{own}/query"), &json!({"points": points})));
        judge("grids.py", &[folder]);
        server.get(&format!("{own}/grid?layers=distance,depth")).problem(422);
        server.get(&format!("{own}/grid?resolution=0.001")).problem(422);
        server.post(&format!("{own}/query"), &json!({"points": [[0, 0]], "fields": ["depth"]})).problem(422);
        let few = server.post(&format!("{own}/query"), &json!({"points": [[1, 1]], "fields": ["distance"]})).json();
        assert!(few["sigma"].is_null() && few["distance"][0].is_number());
    }
}

#[test]
fn the_readmes_numpy_lines_evaluate_a_map() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    for distance in ["sdf", "vdf"] {
        let files = tempfile::tempdir().unwrap();
        let mut request = small(3);
        request["map"]["distance"] = json!(distance);
        let own = format!("/v1/maps/{}", server.map_of(&request));
        let save = |name: &str, bytes: &[u8]| std::fs::write(files.path().join(name), bytes).unwrap();
        save("sdf.npz", &server.get(&format!("{own}/coefficients?format=npz")).body);
        save("covariance.npz", &server.get(&format!("{own}/covariance?form=sparse")).body);
        let points: Vec<[f64; 2]> = (0..30).map(|k| [0.31 + 0.23 * f64::from(k), 0.4 + 0.19 * f64::from(k)]).collect();
        let mut query = server.post(&format!("{own}/query"), &json!({"points": points})).json();
        query["points"] = json!(points);
        save("query.json", query.to_string().as_bytes());
        let readme = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
        judge("readme.py", &[readme, files.path().to_str().unwrap()]);
    }
}

/// The map as a recording: every cell of it, either distance; tagged and refused as its neighbours are.
#[test]
fn mcap_readers_find_every_cell_of_a_map() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    for distance in ["sdf", "vdf"] {
        let files = tempfile::tempdir().unwrap();
        let mut request = experiment_one(3);
        request["map"]["distance"] = json!(distance);
        let own = format!("/v1/maps/{}", server.map_of(&request));
        let save = |name: &str, path: &str| {
            let answer = server.get(&format!("{own}/{path}"));
            assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
            std::fs::write(files.path().join(name), &answer.body).unwrap();
            answer
        };
        save("ogm.json", "ogm?resolution=0.13");
        save("grid.npz", "grid?resolution=0.13");
        let file = save("map.mcap", "mcap?resolution=0.13");
        judge("recording_out.py", &[files.path().to_str().unwrap()]);
        assert_eq!(file.header("content-type"), "application/x-mcap");
        assert!(file.body == server.get(&format!("{own}/mcap?resolution=0.13")).body, "the same bytes");
        let known = [("if-none-match", file.header("etag")), ("accept", "application/x-mcap")];
        assert_eq!(server.send("GET", &format!("{own}/mcap?resolution=0.13"), &known, None).status, 304);
        server.send("GET", &format!("{own}/mcap"), &[("accept", "text/html")], None).problem(406);
        server.get(&format!("{own}/mcap?resolution=0.001")).problem(422);
    }
}

/// A robot's recordings as PyPI's mcap writes them, good and odd, over HTTP and on the command line.
#[test]
fn recordings_become_maps_or_say_what_to_do() {
    let Some(folder) = support::shared_data("recordings_become_maps_or_say_what_to_do") else { return };
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 2);
    let log = folder.join("seattle.flaser.log.gz");
    judge("recordings.py", &[&server.url, env!("CARGO_BIN_EXE_mapfit"), log.to_str().unwrap()]);
}

#[test]
fn a_validator_accepts_the_openapi_document() {
    let files = tempfile::tempdir().unwrap();
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let file = files.path().join("openapi.json");
    std::fs::write(&file, server.get("/openapi.json").body).unwrap();
    judge("openapi.py", &[file.to_str().unwrap()]);
}

#[test]
fn a_generated_client_carries_a_job_to_its_map() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    judge("client.py", &[&server.url]);
}

#[test]
fn schemathesis_finds_the_document_true() {
    let data = tempfile::tempdir().unwrap();
    // Its jobs are all sizes that the document allows; large ones would keep those who wait for small ones. What is too
    // large for one fit is too large for this memory, in parts or not.
    let server = Server::start_with(data.path(), 1, &["--max-control-points", "30000", "--memory", "400"]);
    let keys = ["keys", "create", "--scopes", "read,submit,admin", "--json", "--data", data.path().to_str().unwrap()];
    let made = std::process::Command::new(env!("CARGO_BIN_EXE_mapfit")).args(keys).output().unwrap();
    let key: serde_json::Value = serde_json::from_slice(&made.stdout).unwrap();
    judge("conformance.py", &[&server.url, key["key"].as_str().unwrap()]);
}

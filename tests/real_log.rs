//! A real log, submitted as a user would: `mapfit submit seattle.flaser.log.gz --wait`.

mod support;

use std::process::Command;

use support::{Server, shared_data};

#[test]
fn the_seattle_corridor_becomes_a_map_that_follows_its_walls() {
    let Some(folder) = shared_data("the_seattle_corridor_becomes_a_map") else { return };
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let output = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["submit", "--wait", "--resolution", "0.25", "--url", &server.url])
        .arg(folder.join("seattle.flaser.log.gz"))
        .env_remove("MAPFIT_DATA")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("/contours"));

    let map = server.get("/v1/maps").json()["items"][0].clone();
    let own = format!("/v1/maps/{}", map["id"].as_str().unwrap());
    let contours = server.get(&format!("{own}/contours")).json();
    let lines = contours["features"][0]["geometry"]["coordinates"].as_array().unwrap().clone();
    let vertices: Vec<[f64; 2]> = lines
        .iter()
        .flat_map(|line| line.as_array().unwrap())
        .map(|p| [p[0].as_f64().unwrap(), p[1].as_f64().unwrap()])
        .collect();
    let walls = rstar::RTree::bulk_load(vertices);
    // Walls are what many returns met: of all returns, most lie on the contour to within a wall's thickness.
    let log = support_log(&folder.join("seattle.flaser.log.gz"));
    let returns = mapfit::scan::returns_of(&mapfit::import::parse_carmen(&log).unwrap());
    let mut off: Vec<f64> = returns
        .iter()
        .map(|seen| walls.nearest_neighbor_with_distance_2([seen.point.x, seen.point.y]).unwrap().1.sqrt())
        .collect();
    off.sort_by(f64::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() * 9 / 10]);
    let peak = server.peak_memory() >> 20;
    println!(
        "{} returns: median {median:.3} m from the contour, 90 % within {most:.3} m; peak memory {peak} MiB",
        off.len()
    );
    println!("fit: {}", map["fit"]);
    assert!(median < 0.03 && most < 0.12 && peak < 1024);
}

fn support_log(file: &std::path::Path) -> String {
    let mut log = String::new();
    let mut reader = flate2::read::MultiGzDecoder::new(std::fs::File::open(file).unwrap());
    std::io::Read::read_to_string(&mut reader, &mut log).unwrap();
    log
}

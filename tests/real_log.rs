//! A real log, submitted as a user would: `mapfit submit seattle.flaser.log.gz --wait`.

mod support;

use std::process::Command;

use mapfit::fit::Distance;
use mapfit::map::Survey;
use mapfit::render::{OccupancyGrid, Trinary};
use mapfit::scan::{Noise, returns_of};
use mapfit::uncertainty::Kind;
use support::{Server, log_text, shared_data};

#[test]
fn the_seattle_corridor_becomes_a_map_that_follows_its_walls() {
    let Some(folder) = shared_data("the_seattle_corridor_becomes_a_map") else { return };
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let output = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["submit", "--wait", "--distance", "sdf", "--resolution", "0.25", "--url", &server.url])
        .arg(folder.join("seattle.flaser.log.gz"))
        .env_remove("MAPFIT_DATA")
        .output()
        .unwrap();
    // People in the way and glass keep this fit from its minimum: it says so, and so does the exit code.
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(i32::from(said.contains("  converged    NO: "))), "{said}");
    for told in ["  size  ", "  returns  ", "  left out  ", "  rms  ", "  seconds  ", "/contours", "/grid"] {
        assert!(said.contains(told), "{told} in {said}");
    }
    let nowhere = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["submit", "--url", "localhost:1"])
        .arg(folder.join("seattle.flaser.log.gz"))
        .output()
        .unwrap();
    assert_eq!(nowhere.status.code(), Some(3), "{}", String::from_utf8_lossy(&nowhere.stderr));

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
    let log = log_text(&folder.join("seattle.flaser.log.gz"));
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

/// The same corridor as a vector map at h = 0.2 m; every fifth scan is held out, and judges.
#[test]
fn the_seattle_corridor_as_a_vector_map_fits_the_scans_left_out() {
    let Some(folder) = shared_data("the_seattle_corridor_as_a_vector_map") else { return };
    let scans = mapfit::import::parse_carmen(&log_text(&folder.join("seattle.flaser.log.gz"))).unwrap();
    let (held, taken): (Vec<_>, Vec<_>) = scans.into_iter().enumerate().partition(|(k, _)| k % 5 == 4);
    let [held, taken] = [held, taken].map(|part| part.into_iter().map(|(_, scan)| scan).collect::<Vec<_>>());
    let noise = Noise { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
    let map = Survey::new(&taken, noise).distance(Distance::Vector).map().unwrap();
    let judges = returns_of(&held);
    let mut lengths: Vec<f64> = judges.iter().filter_map(|seen| map.field.value(seen.point)).collect();
    lengths.sort_by(f64::total_cmp);
    let grid = OccupancyGrid::of(&map, 0.2, Kind::Propagated);
    let half_way = |seen: &mapfit::scan::Return| {
        let p = seen.point - seen.direction * (seen.range / 2.0);
        let at = [0, 1].map(|axis: usize| ((p[axis] - grid.origin[axis]) / grid.resolution).floor());
        (at[0] >= 0.0 && at[0] < grid.width as f64 && at[1] >= 0.0 && at[1] < grid.height as f64)
            .then(|| Trinary::of(grid.data[at[0] as usize + at[1] as usize * grid.width]))
    };
    let crossed: Vec<Trinary> = judges.iter().filter_map(half_way).collect();
    let occupied = crossed.iter().filter(|cell| **cell == Trinary::Occupied).count() as f64 / crossed.len() as f64;
    let (median, most) = (lengths[lengths.len() / 2], lengths[lengths.len() * 9 / 10]);
    println!("held out: median {median:.4} m, 90 % within {most:.4} m; {occupied:.4} of the half-way points occupied");
    println!("{:?}", map.report);
    assert!(median <= 0.05 && most <= 0.1 && occupied <= 0.02);
}

//! The contract of vector maps (`"distance": "vdf"`), against a real process.

mod support;

use serde_json::{Value, json};
use support::{Server, experiment_one, numbers, small};

#[test]
fn a_vector_map_answers_like_a_signed_one_and_says_more() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let mut request = experiment_one(2);
    request["map"]["distance"] = json!("vdf");
    let own = format!("/v1/maps/{}", server.map_of(&request));
    let map = server.get(&own).json();
    assert_eq!((&map["distance"], &map["fit"]["converged"]), (&json!("vdf"), &json!(true)));
    assert_eq!((&map["fit"]["positive_definite"], &map["fit"]["weights"]["poses"]), (&json!(true), &json!("refined")));

    let coefficients = server.get(&format!("{own}/coefficients")).json();
    let diagonal = server.get(&format!("{own}/covariance")).json();
    for name in ["vdf_x", "vdf_y"] {
        let (values, variances) = (coefficients[name].as_array().unwrap(), diagonal[name].as_array().unwrap());
        assert_eq!((values.len(), variances.len()), (2401, 2401));
        assert!(values.iter().zip(variances).all(|(value, variance)| value.is_null() == variance.is_null()));
        assert!(values.iter().any(Value::is_null), "nobody saw the far corner");
    }
    let block = server.get(&format!("{own}/covariance?form=block&i0=10&j0=3&ni=4&nj=2")).json();
    let matrix: Vec<Vec<f64>> = block["matrix"].as_array().unwrap().iter().map(numbers).collect();
    assert_eq!((matrix.len(), matrix[0].len()), (16, 16), "the x set stands before the y set");
    let exact = diagonal["vdf_y"][11 + 4 * 49].as_f64().unwrap();
    assert!((matrix[13][13] - exact).abs() < 1e-9 * exact);

    // On a wall, a metre from it, in the middle of the arm, beyond the lattice, in the corner nobody saw.
    let points = json!({"points": [[0.0, 3.0], [1.0, 3.0], [2.0, 6.0], [50.0, 3.0], [8.0, 8.0]]});
    let answer = server.post(&format!("{own}/query"), &points).json();
    assert!(answer["distance"][0].as_f64().unwrap() < 0.05);
    let vector = numbers(&answer["vector"][1]);
    assert!((vector[0] - 1.0).abs() < 0.05 && vector[1].abs() < 0.05, "{vector:?}");
    assert!((answer["gradient"][1][0].as_f64().unwrap() - 1.0).abs() < 0.1);
    let (sigma, covariance) = (answer["sigma"][1].as_f64().unwrap(), numbers(&answer["vector_covariance"][1]));
    assert!(sigma > 0.001 && sigma < 0.05 && sigma >= covariance[0].sqrt() && sigma < covariance[0].sqrt() + 0.01);
    assert_eq!(
        (&answer["observed"][1], &answer["observed"][3], &answer["observed"][4]),
        (&json!(true), &json!(null), &json!(false))
    );
    for name in ["distance", "vector", "vector_covariance", "sigma"] {
        assert!(answer[name][3].is_null() && answer[name][4].is_null(), "{name}");
    }

    // Half-way between the walls of the arm the field jumps through zero: no contour and no obstacle there.
    let contours = server.get(&format!("{own}/contours?sigma_band=2")).json();
    let room = mapfit::sim::World::l_room();
    for feature in contours["features"].as_array().unwrap() {
        if feature["properties"]["role"] == "level" {
            for vertex in
                feature["geometry"]["coordinates"].as_array().unwrap().iter().flat_map(|l| l.as_array().unwrap())
            {
                let p = numbers(vertex);
                // Half a cell's diagonal: where the line turns about a corner of the room it runs behind it.
                assert!(
                    room.signed_distance(mapfit::geometry::Vec2::new(p[0], p[1])).abs() < 0.5 * f64::hypot(0.2, 0.2),
                    "{p:?}"
                );
            }
        }
    }
    // Farther than any place is from a wall, and as far as some are.
    let band = |level: f64| {
        let contours = server.get(&format!("{own}/contours?level={level}&sigma_band=2")).json();
        contours["features"][1]["geometry"]["coordinates"].as_array().unwrap().len()
    };
    assert!(band(100.0) == 0 && band(0.5) > 0);
    let grid = server.get(&format!("{own}/ogm")).json();
    let cell = |x: f64, y: f64| {
        let at = |v: f64| ((v + 0.6) / 0.2) as usize;
        grid["data"][at(x) + at(y) * grid["info"]["width"].as_u64().unwrap() as usize].as_i64().unwrap()
    };
    assert!(cell(2.0, 5.0) == 0 && cell(5.0, 2.0) == 0 && cell(7.0, 7.0) == -1);
    for layer in ["distance", "sigma", "occupancy"] {
        assert_eq!(
            server.get(&format!("{own}/image?layer={layer}&overlay=contour,points,poses")).status,
            200,
            "{layer}"
        );
    }
    for form in ["sparse", "factors"] {
        assert_eq!(server.get(&format!("{own}/covariance?form={form}")).header("content-type"), "application/x-npz");
    }
    server.get(&format!("{own}/covariance?form=full")).problem(422);
}

/// Little or degenerate evidence still makes a map whose answers are numbers.
#[test]
fn odd_vector_jobs_end_well() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let mut lone = small(1);
    lone["scans"].as_array_mut().unwrap().truncate(1);
    let mut single_beam = lone.clone();
    single_beam["scans"][0]["ranges"] = json!([1.0]);
    let mut known = small(1);
    known["scans"][0]["pose_covariance"] = json!([0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let mut exact = small(1);
    exact["noise"] = json!({"sigma_x": 1e-6, "sigma_y": 1e-6, "sigma_theta": 1e-6, "sigma_range": 1e-6});
    exact["fit"] = json!({"model_sigma": 0});
    let mut vague = small(1);
    vague["noise"] = json!({"sigma_x": 1.0, "sigma_y": 1.0, "sigma_theta": 0.5, "sigma_range": 0.5});
    let mut fixed = small(1);
    fixed["fit"] = json!({"poses": "fixed", "max_iterations": 1});
    let mut flat = small(1);
    flat["scans"][1]["ranges"] = json!(vec![0.5; flat["scans"][1]["ranges"].as_array().unwrap().len()]);
    // Ranges known to a micrometre on a lattice of half a metre: no f64 holds both, and the job says so.
    exact["map"]["distance"] = json!("vdf");
    let refused = server.wait(&server.submit(&exact));
    assert_eq!(
        (&refused["status"], &refused["problem"]["type"]),
        (&json!("failed"), &json!("/problems/ill-determined"))
    );
    for mut job in [lone, single_beam, known, vague, fixed, flat] {
        job["map"]["distance"] = json!("vdf");
        let own = format!("/v1/maps/{}", server.map_of(&job));
        let pose = &job["scans"][0]["pose"];
        let near = json!({"points": [[pose["x"].as_f64().unwrap() + 0.3, pose["y"]]]});
        let answer = server.post(&format!("{own}/query"), &near).json();
        assert!(
            answer["distance"][0].as_f64().is_some_and(|d| d.is_finite() && d >= 0.0),
            "{}: {answer}",
            job["noise"]
        );
        assert!(answer["sigma"][0].as_f64().is_some_and(f64::is_finite), "{answer}");
        for part in ["contours?sigma_band=2", "ogm", "image", "covariance?form=sparse", "covariance?kind=posterior"] {
            assert_eq!(server.get(&format!("{own}/{part}")).status, 200, "{part}");
        }
    }
}

#[test]
fn the_published_vector_objective_is_answered_honestly() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let mut request = experiment_one(2);
    request["map"]["distance"] = json!("vdf");
    request["fit"] = json!({"weighting": "paper"});
    let own = format!("/v1/maps/{}", server.map_of(&request));
    let fit = server.get(&own).json()["fit"].clone();
    // The field may turn as a whole: no minimum can be certified, and none is claimed.
    assert_eq!((&fit["weighting"], &fit["converged"]), (&json!("paper"), &json!(false)));
    assert_eq!((&fit["positive_definite"], &fit["weights"]["poses"]), (&json!(false), &json!("fixed")));
    println!("{fit}");

    let points = json!({"points": [[0.0, 3.0], [1.0, 3.0]]});
    let answer = server.post(&format!("{own}/query"), &points).json();
    assert!(answer["distance"][0].as_f64().unwrap() < 0.1, "{answer}");
    assert!((answer["distance"][1].as_f64().unwrap() - 1.0).abs() < 0.3, "{answer}");

    let diagonal = server.get(&format!("{own}/covariance")).json();
    let block = server.get(&format!("{own}/covariance?form=block&i0=3&j0=15&ni=4&nj=2")).json();
    let matrix: Vec<Vec<f64>> = block["matrix"].as_array().unwrap().iter().map(numbers).collect();
    let exact = diagonal["vdf_y"][4 + 16 * 49].as_f64().unwrap();
    assert!((matrix[13][13] - exact).abs() < 1e-8 * exact);
    for form in ["sparse", "factors"] {
        assert_eq!(server.get(&format!("{own}/covariance?form={form}")).status, 200);
    }
    assert_eq!(server.get(&format!("{own}/ogm")).status, 200);
}

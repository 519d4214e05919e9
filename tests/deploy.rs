//! What is deployed with: linted by others, its queries of metrics that there are, its images of this version.

mod support;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use support::{Server, small};

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/deploy"))
}

#[test]
fn others_accept_it_and_metrics_are_there() {
    let (data, files) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let server = Server::start(data.path(), 1);
    server.map_of(&small(1));
    let text = files.path().join("metrics.txt");
    std::fs::write(&text, server.get("/metrics").body).unwrap();
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv/bin/python");
    let python = std::env::var_os("MAPFIT_PYTHON").map_or(usual, Into::into);
    let judge = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/judges/deploy.py");
    let mut command = Command::new(python);
    command.arg(judge).arg(folder()).arg(text).arg(env!("CARGO_BIN_EXE_mapfit"));
    let output = command.output().expect("the judges are there: scripts/python makes them");
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(output.status.success(), "{said}");
    println!("{said}");
}

/// The names of a package's targets that are no tests, as cargo finds them in a folder.
fn targets(folder: &Path) -> BTreeSet<String> {
    let asked = ["metadata", "--no-deps", "--offline", "--locked", "--format-version", "1"];
    let output = Command::new(env!("CARGO")).args(asked).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let targets = found["packages"][0]["targets"].as_array().unwrap();
    let own = targets.iter().filter(|target| target["kind"][0] != "test");
    own.map(|target| format!("{} {}", target["kind"][0], target["name"])).collect()
}

/// Which targets a manifest names that are not there is for each version of cargo to forgive: what the image copies has
/// all of them, and what the program has compiled in.
#[test]
fn the_image_has_what_cargo_asks_for() {
    let (root, stage) = (Path::new(env!("CARGO_MANIFEST_DIR")), tempfile::tempdir().unwrap());
    let dockerfile = std::fs::read_to_string(root.join("Dockerfile")).unwrap();
    let copies =
        dockerfile.lines().filter_map(|line| line.strip_prefix("COPY ")).filter(|copy| !copy.starts_with("--"));
    for source in copies.flat_map(|copy| copy.rsplit_once(' ').unwrap().0.split(' ')) {
        std::os::unix::fs::symlink(root.join(source), stage.path().join(source)).unwrap();
    }
    assert_eq!(targets(stage.path()), targets(root));
    for folder in ["assets", "console/dist", "migrations"] {
        assert!(stage.path().join(folder).is_dir(), "{folder}");
    }
}

#[test]
fn images_are_of_this_version() {
    let version = env!("CARGO_PKG_VERSION");
    let text = |file: &str| std::fs::read_to_string(folder().join(file)).unwrap();
    assert!(text("compose.yaml").contains(&format!("image: mapfit:{version}\n")), "deploy/compose.yaml");
    let kustomization = text("kubernetes/kustomization.yaml");
    assert!(kustomization.contains(&format!("newTag: \"{version}\"\n")), "deploy/kubernetes/kustomization.yaml");
}

/// Workers have no port for clients: they say how they are on one of their own.
#[test]
fn a_worker_tells_how_it_is() {
    let data = tempfile::tempdir().unwrap();
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("127.0.0.1:{port}");
    let mut worker = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["worker", "--workers", "1", "--log", "error", "--metrics-listen", &address, "--data"])
        .arg(data.path())
        .spawn()
        .unwrap();
    let health = || Command::new(env!("CARGO_BIN_EXE_mapfit")).args(["health", "--url", &address]).output().unwrap();
    let begun = std::time::Instant::now();
    while !health().status.success() {
        assert!(begun.elapsed().as_secs() < 20, "{}", String::from_utf8_lossy(&health().stderr));
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    let url = format!("http://{address}/metrics");
    let text = ureq::get(&url).call().unwrap().body_mut().read_to_string().unwrap();
    assert!(text.contains("mapfit_attempts_total"), "{text}");
    let jobs = ureq::get(format!("http://{address}/v1/jobs")).call().unwrap_err();
    assert!(matches!(jobs, ureq::Error::StatusCode(404)), "{jobs}");
    worker.kill().unwrap();
    worker.wait().unwrap();
}

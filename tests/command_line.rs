//! The commands that speak to a server, as people and scripts use them.

mod support;

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};
use support::{Server, small};

fn mapfit(server: &Server, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    command.args(arguments).env("MAPFIT_URL", &server.url).env("MAPFIT_LOG", "warn");
    command.output().unwrap()
}

/// The same, and what it said on stderr, of a command that must end with this code.
fn refused(server: &Server, code: i32, arguments: &[&str]) -> String {
    let output = mapfit(server, arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    said
}

/// A job's request as a file.
fn file(folder: &Path, name: &str, request: &Value) -> String {
    let file = folder.join(name);
    std::fs::write(&file, request.to_string()).unwrap();
    file.to_str().unwrap().to_owned()
}

fn printed(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn line(output: &Output) -> Value {
    let text = printed(output);
    assert_eq!(text.lines().count(), 1, "{text}");
    serde_json::from_str(&text).unwrap()
}

#[test]
fn jobs_maps_and_places_are_listed_got_and_decided() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let file = data.path().join("room.json");
    std::fs::write(&file, small(1).to_string()).unwrap();
    let file = file.to_str().unwrap();
    let told = ["submit", file, "--wait", "--json", "--name", "hall", "--label", "site:hq", "--resolution", "0.6"];
    let both = line(&mapfit(&server, &told));
    assert_eq!((&both["job"]["status"], &both["map"]["name"]), (&json!("successful"), &json!("hall")));
    assert_eq!(both["map"]["lattice"]["resolution"], 0.6, "a flag overrides the file");
    let (job, map) = (both["job"]["id"].as_str().unwrap(), both["map"]["id"].as_str().unwrap());

    let table = printed(&mapfit(&server, &["jobs", "list", "--label", "site:hq", "--status", "successful"]));
    assert!(table.starts_with("id ") && table.lines().nth(1).unwrap().starts_with(job), "{table}");
    assert_eq!(printed(&mapfit(&server, &["jobs", "list", "--label", "site:lab", "--json"])), "");
    assert_eq!(line(&mapfit(&server, &["jobs", "get", job, "--json"]))["map_id"], map);
    assert_eq!(line(&mapfit(&server, &["maps", "list", "--json"]))["id"], map);
    let place = line(&mapfit(&server, &["places", "publish", "hall", map, "--note", "a", "--json"]));
    assert_eq!((&place["version"], &place["note"]), (&json!(1), &json!("a")));
    assert_eq!(line(&mapfit(&server, &["places", "rollback", "hall", "1", "--json"]))["version"], 2);
    assert_eq!(printed(&mapfit(&server, &["places", "versions", "hall"])).lines().count(), 3);
    let refused = mapfit(&server, &["maps", "delete", map]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("hall"));
    printed(&mapfit(&server, &["places", "delete", "hall"]));
    printed(&mapfit(&server, &["maps", "delete", map]));

    let long = server.submit(&support::long(1));
    assert_eq!(line(&mapfit(&server, &["cancel", &long, "--json"]))["status"], "dismissed");
    let again = line(&mapfit(&server, &["jobs", "retry", &long, "--json"]));
    assert_eq!(again["retry_of"], long);
    assert!(printed(&mapfit(&server, &["completions", "bash"])).contains("mapfit"));
    assert_eq!(mapfit(&server, &["jobs", "list", "--limit", "0"]).status.code(), Some(2));
    let away =
        Command::new(env!("CARGO_BIN_EXE_mapfit")).args(["jobs", "list", "--url", "127.0.0.1:1"]).output().unwrap();
    assert_eq!(away.status.code(), Some(3));
}

#[test]
fn maps_are_updated_and_joined() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 2);
    let all = small(3);
    let mut files = Vec::new();
    for (k, scan) in all["scans"].as_array().unwrap().iter().enumerate() {
        let mut own = all.clone();
        own["scans"] = json!([scan]);
        let file = data.path().join(format!("scan{k}.json"));
        std::fs::write(&file, own.to_string()).unwrap();
        files.push(file.to_str().unwrap().to_owned());
    }
    let first = line(&mapfit(&server, &["submit", &files[0], "--wait", "--json"]));
    let first = first["map"]["id"].as_str().unwrap();
    // One file after the other, each on the map that the one before it made.
    let told =
        printed(&mapfit(&server, &["update", first, &files[1], &files[2], "--wait", "--json", "--name", "grown"]));
    let versions: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let [second, third] = &versions[..] else { panic!("{told}") };
    assert_eq!((&second["map"]["parent"], &second["map"]["version"]), (&json!(first), &json!(2)));
    assert_eq!((&third["map"]["parent"], &third["map"]["version"]), (&second["map"]["id"], &json!(3)));
    assert_eq!(third["map"]["name"], "grown");
    let waits_not = line(&mapfit(&server, &["update", first, &files[1], "--json"]));
    assert_eq!((&waits_not["job"]["status"], &waits_not["map"]), (&json!("accepted"), &Value::Null));
    assert_eq!(mapfit(&server, &["update", first, &files[1], "--resolution", "0.1"]).status.code(), Some(2));
    assert_eq!(mapfit(&server, &["update", "no-such-map", &files[1]]).status.code(), Some(1));

    let third = third["map"]["id"].as_str().unwrap();
    let other = format!("{third}@0.1,-0.1,0.02");
    let joined = line(&mapfit(&server, &["join", first, &other, "--wait", "--json", "--label", "site:hq"]));
    assert_eq!(
        (&joined["map"]["labels"]["site"], &joined["map"]["lattice"]["resolution"]),
        (&json!("hq"), &json!(0.5))
    );
    let frames = server.get(&format!("/v1/maps/{}/frames", joined["map"]["id"].as_str().unwrap())).json();
    assert_eq!(frames["frames"].as_array().unwrap().len(), 2);
    assert_eq!(mapfit(&server, &["join", first, &format!("{third}@1,2")]).status.code(), Some(2));
}

#[test]
fn whoever_reads_no_further_hears_no_complaint() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    let mut child =
        command.args(["completions", "bash"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(String::from_utf8_lossy(&ended.stderr), "");
}

#[test]
fn whoever_waited_is_told_what_the_map_is() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let room = file(data.path(), "room.json", &small(1));
    let said = printed(&mapfit(&server, &["submit", &room, "--wait"]));
    let map = server.get("/v1/maps").json()["items"][0].clone();
    let [nx, ny] = [0, 1].map(|axis: usize| map["lattice"]["control_points"][axis].clone());
    for told in [
        format!("  size         {nx} x {ny} control points, 0.5 m apart: "),
        format!("  returns      {}\n", map["fit"]["observations"]),
        "  left out     ".into(),
        "  rms          ".into(),
        "  seconds      ".into(),
        format!("  converged    yes, after {} steps\n", map["fit"]["iterations"]),
        format!("  contours     {}/v1/maps/{}/contours\n", server.url, map["id"].as_str().unwrap()),
    ] {
        assert!(said.contains(&told), "{told} in {said}");
    }
    // Ranges are good to 2 cm.
    let rms = map["fit"]["rms"].as_f64().unwrap();
    assert!(rms > 0.005 && rms < 0.05, "{rms}");

    // The same of a job that was submitted before, and without a server.
    let job = map["job_id"].as_str().unwrap();
    assert!(
        printed(&mapfit(&server, &["jobs", "wait", job]))
            .contains(&format!("  returns      {}", map["fit"]["observations"]))
    );
    let out = data.path().join("fitted");
    let said = printed(&mapfit(&server, &["fit", &room, "--out", out.to_str().unwrap()]));
    for told in ["  size  ", "  returns  ", "  left out  ", "  rms  ", "  seconds  ", "  converged    yes"] {
        assert!(said.contains(told), "{told} in {said}");
    }
}

/// One step is never enough.
#[test]
fn a_map_that_did_not_converge_is_there_and_the_exit_code_is_1() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let mut hasty = small(1);
    hasty["fit"] = json!({"max_iterations": 1});
    let hasty = file(data.path(), "hasty.json", &hasty);
    let out = data.path().join("fitted");
    for arguments in [vec!["submit", &hasty, "--wait"], vec!["fit", &hasty, "--out", out.to_str().unwrap()]] {
        let output = mapfit(&server, &arguments);
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("  converged    NO: ") && said.contains("fit.max_iterations allows more"), "{said}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("did not converge"));
    }
    assert_eq!(server.get("/v1/maps").json()["items"][0]["fit"]["converged"], false);
    assert!(["map.npz", "fit.json", "distance.png"].iter().all(|name| out.join(name).is_file()));
}

#[test]
fn a_job_that_fails_says_why() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let room = file(data.path(), "room.json", &small(1));
    let late = ["submit", &room, "--wait", "--deadline-seconds", "0.5"];
    let said = refused(&server, 1, &late);
    assert!(said.contains(" failed: The job's deadline has passed: "), "{said}");
    let output = mapfit(&server, &[&late[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&told["job"]["status"], &told["map"]), (&json!("failed"), &Value::Null));
}

/// Ctrl-C ends the command and not the job.
#[test]
fn a_command_that_is_interrupted_says_that_the_job_goes_on_and_how_to_follow_it() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let long = file(data.path(), "long.json", &support::long(1));
    let mut child = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["submit", &long, "--wait", "--url", server.url.trim_start_matches("http://")])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let job = line.trim().rsplit('/').next().unwrap().to_owned();
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let ended = child.wait().unwrap();
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(ended.code(), Some(130), "{line}{said}");
    let follow = format!("`mapfit jobs wait {job} --url {}`", server.url);
    assert!(said.contains("goes on without this command") && said.contains(&follow), "{said}");
    let status = server.get(&format!("/v1/jobs/{job}")).json()["status"].clone();
    assert!(status == "accepted" || status == "running", "{status}");

    // One that is not there does not save the others.
    let said = refused(&server, 1, &["cancel", "no-such-job", &job]);
    assert!(said.contains("no-such-job"), "{said}");
    assert!(refused(&server, 1, &["jobs", "wait", &job]).contains("was cancelled"));
}

#[test]
fn what_the_caller_got_wrong_is_said_with_exit_code_2() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let room = file(data.path(), "room.json", &small(1));
    let out = data.path().join("out");
    let out = out.to_str().unwrap();
    for (arguments, word) in [
        (vec!["submit", "no-such-file.json"], "no-such-file.json cannot be read"),
        (vec!["submit", "no-such.log"], "no-such.log cannot be read"),
        (vec!["fit", "no-such-file.json", "--out", out], "no-such-file.json cannot be read"),
        (vec!["fit", &room, "--out", "/proc/self/no/such"], "--out"),
        (vec!["submit", &room, "--sigma-range", "-1"], "/noise/sigma_range"),
        (vec!["fit", &room, "--sigma-range", "-1", "--out", out], "/noise/sigma_range"),
        (vec!["submit", &room, "--resolution", "nan"], "must be a number"),
        (vec!["submit", &room, "--every", "0"], "--every"),
        (vec!["submit", &room, "--label", "site"], "key:value"),
        (vec!["submit", &room, "--list"], "is a job file"),
        (vec!["submit", &room, "--every", "2"], "--every is for logs"),
        (vec!["fit", &room, "--scan-topic", "/scan", "--out", out], "--scan-topic is for logs"),
        (vec!["jobs", "list", "--status", "lost"], "accepted, running"),
        (vec!["jobs", "list", "--url", "localhost:99999"], "must be a server's address"),
        (vec!["jobs", "list", "--log", "a=b=c"], "--log"),
    ] {
        let said = refused(&server, 2, &arguments);
        assert!(said.contains(word), "{arguments:?}: {said}");
    }
    assert!(!Path::new(out).join("map.npz").exists());
    // What is asked rightly and is not there is another matter.
    assert!(refused(&server, 1, &["jobs", "get", "no-such-job"]).contains("no-such-job"));
}

#[test]
fn a_resolution_that_is_too_fine_is_answered_with_one_that_fits() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--max-control-points", "900"]);
    let mut whole = small(1);
    whole["map"] = json!({"distance": "vdf", "resolution": 0.5, "tiling": "none"});
    let room = file(data.path(), "room.json", &whole);
    let advice = |said: &str| -> String {
        let advised = said.trim().strip_suffix(" fits").and_then(|said| said.rsplit("; ").next());
        advised.unwrap_or_else(|| panic!("{said}")).to_owned()
    };
    let said = refused(&server, 2, &["submit", &room, "--resolution", "0.1"]);
    line(&mapfit(&server, &["submit", &room, "--resolution", &advice(&said), "--json"]));
    // Without a server a fit may be larger, and takes as long as it likes: what is advised is not tried here.
    let said = refused(&server, 2, &["fit", &room, "--resolution", "0.001", "--out", data.path().to_str().unwrap()]);
    assert!(advice(&said).parse::<f64>().unwrap() > 0.001, "{said}");
}

#[test]
fn every_command_explains_itself() {
    let help = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_mapfit")).args(arguments).arg("--help").output().unwrap();
        printed(&output)
    };
    let all = help(&[]);
    let commands = all.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = commands.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names: Vec<&str> = names.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.len() > 15, "{names:?}");
    for name in names.iter().filter(|name| **name != "help") {
        let said = help(&[name]);
        assert!(said.contains("Usage: mapfit"), "{name}: {said}");
    }
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let output = Command::new(env!("CARGO_BIN_EXE_mapfit")).args(["completions", shell]).output().unwrap();
        assert!(printed(&output).contains("places"), "{shell}");
    }
}

//! The commands that speak to a server, as people and scripts use them.

mod support;

use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};
use support::{Server, small};

fn mapfit(server: &Server, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    command.args(arguments).env("MAPFIT_URL", &server.url).env("MAPFIT_LOG", "warn");
    command.output().unwrap()
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

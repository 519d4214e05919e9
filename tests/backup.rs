//! A backup: out of SQLite and a folder, into PostgreSQL and a bucket, and back; interrupted in the middle of either.

#[path = "support/postgres.rs"]
mod postgres_server;
#[path = "support/seaweed.rs"]
mod seaweed;
mod support;

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use seaweed::Seaweed;
use serde_json::{Value, json};
use support::{Answer, Server, long, small};

/// Where data lies: arguments and variables.
struct Stores {
    arguments: Vec<String>,
    variables: Vec<(String, String)>,
}

impl Stores {
    fn command(&self, what: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(what).args(&self.arguments).envs(self.variables.clone());
        command
    }

    fn run(&self, what: &[&str]) -> Output {
        self.command(what).output().unwrap()
    }

    fn spawn(&self, what: &[&str]) -> Child {
        self.command(what).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    }

    fn serve(&self, data: &Path, workers: usize, more: &[&str]) -> Server {
        let arguments: Vec<&str> = self.arguments.iter().map(String::as_str).chain(more.iter().copied()).collect();
        // `--data` comes last, from the server.
        let own = arguments.iter().position(|argument| *argument == "--data").map(|k| k..k + 2);
        let kept = arguments.iter().enumerate().filter(|(k, _)| !own.clone().is_some_and(|own| own.contains(k)));
        let kept: Vec<&str> = kept.map(|(_, argument)| *argument).collect();
        Server::start_among(data, workers, &kept, &self.variables)
    }
}

/// A server with the key that it wants.
struct Keyed<'a>(&'a Server, &'a str);

impl Keyed<'_> {
    fn send(&self, method: &str, path: &str, body: Option<&Value>, headers: &[(&str, &str)]) -> Answer {
        let bearer = format!("Bearer {}", self.1);
        let own = [("authorization", &bearer[..]), ("content-type", "application/json")];
        let headers: Vec<_> = own.into_iter().chain(headers.iter().copied()).collect();
        self.0.send(method, path, &headers, body.map(Value::to_string).as_deref().map(str::as_bytes))
    }

    fn get(&self, path: &str) -> Answer {
        let answer = self.send("GET", path, None, &[]);
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        answer
    }

    fn submit(&self, request: &Value, key: &str) -> String {
        let answer = self.send("POST", "/v1/jobs", Some(request), &[("idempotency-key", key)]);
        assert!([200, 202].contains(&answer.status), "{}", String::from_utf8_lossy(&answer.body));
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    fn wait(&self, id: &str) -> Value {
        let begun = Instant::now();
        loop {
            let job = self.get(&format!("/v1/jobs/{id}?wait=20")).json();
            if !["accepted", "running"].contains(&job["status"].as_str().unwrap()) {
                return job;
            }
            assert!(begun.elapsed() < Duration::from_secs(120), "{job}");
        }
    }

    /// A list's pages: their addresses and what is there.
    fn pages(&self, list: &str) -> Vec<(String, Vec<u8>)> {
        let (mut pages, mut path) = (Vec::new(), format!("{list}?limit=1000"));
        loop {
            let answer = self.get(&path);
            let next = answer.json()["next_cursor"].as_str().map(|cursor| format!("{list}?limit=1000&cursor={cursor}"));
            pages.push((path, answer.body));
            let Some(next) = next else { return pages };
            path = next;
        }
    }

    fn ids(&self, list: &str) -> Vec<String> {
        let pages = self.pages(list).into_iter().map(|(_, page)| serde_json::from_slice::<Value>(&page).unwrap());
        let ids =
            |page: Value| page["items"].as_array().unwrap().iter().map(|item| item["id"].clone()).collect::<Vec<_>>();
        pages.flat_map(ids).map(|id| id.as_str().unwrap().to_owned()).collect()
    }
}

/// Everything that clients see, byte for byte.
fn seen(server: &Keyed<'_>) -> Vec<(String, Vec<u8>)> {
    let mut seen: Vec<_> =
        ["jobs", "maps", "webhooks"].iter().flat_map(|list| server.pages(&format!("/v1/{list}"))).collect();
    let mut paths = Vec::new();
    for job in server.ids("/v1/jobs") {
        paths.extend([format!("/v1/jobs/{job}"), format!("/v1/jobs/{job}/request")]);
    }
    for map in server.ids("/v1/maps") {
        paths.extend(
            ["", "/coefficients?format=npz", "/covariance?form=sparse", "/poses"]
                .map(|what| format!("/v1/maps/{map}{what}")),
        );
    }
    paths.extend(["/v1/places", "/v1/places/hall/versions", "/v1/places/lab/versions", "/v1/usage"].map(str::to_owned));
    seen.extend(paths.into_iter().map(|path| (path.clone(), server.get(&path).body)));
    seen
}

fn assert_same(one: &[(String, Vec<u8>)], other: &[(String, Vec<u8>)]) {
    assert_eq!(one.len(), other.len());
    for ((path, one), (other_path, other)) in one.iter().zip(other) {
        assert!(path == other_path && one == other, "{path} differs: {:.600}", String::from_utf8_lossy(other));
    }
}

/// A service with so many maps, ended jobs of every kind, waiting ones, places, a webhook and a key, which is returned
/// with those that wait.
fn furnish(stores: &Stores, data: &Path, maps: usize) -> (String, [String; 2]) {
    let made = stores.run(&["keys", "create", "--scopes", "read,submit,admin"].map(|word| word));
    let key = String::from_utf8(made.stdout).unwrap().lines().last().unwrap().to_owned();
    let server = stores.serve(data, 2, &[]);
    let keyed = Keyed(&server, &key);
    let jobs: Vec<String> = (0..maps).map(|k| keyed.submit(&small(k as u64), &format!("k{k}"))).collect();
    let maps: Vec<Value> = jobs.iter().map(|job| keyed.wait(job)["map_id"].clone()).collect();
    let cancelled = keyed.submit(&long(1), "cancelled");
    assert_eq!(keyed.send("DELETE", &format!("/v1/jobs/{cancelled}"), None, &[]).status, 200);
    for (place, map) in [("hall", 3), ("lab", 1), ("hall", 5)] {
        let body = json!({"map_id": maps[map], "note": "ein Flur, 走廊"});
        let answer = keyed.send("PUT", &format!("/v1/places/{place}"), Some(&body), &[]);
        assert!(answer.status < 300, "{}", String::from_utf8_lossy(&answer.body));
    }
    let hook = json!({"url": "https://robots.example/hook", "events": ["job.failed", "place.published"]});
    assert_eq!(keyed.send("POST", "/v1/webhooks", Some(&hook), &[]).status, 201);
    drop(server);
    let server = stores.serve(data, 0, &[]);
    let waiting = ["waits", "waits, too"].map(|name| Keyed(&server, &key).submit(&small(1), name));
    (key, waiting)
}

#[test]
fn everything_goes_from_one_kind_of_store_into_the_other_and_back() {
    there_and_back(36);
}

#[test]
#[ignore = "nightly: a thousand maps take minutes"]
fn a_thousand_maps_go_from_one_kind_of_store_into_the_other_and_back() {
    there_and_back(1000);
}

fn there_and_back(maps: usize) {
    let (data, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let source = Stores { arguments: vec!["--data".into(), text(data.path())], variables: Vec::new() };
    let (key, waiting) = furnish(&source, data.path(), maps);
    let server = source.serve(data.path(), 0, &[]);
    let expected = seen(&Keyed(&server, &key));

    // An export that is killed in the middle is no export, and is made whole by another.
    let export = text(&folder.path().join("export"));
    let artifacts = folder.path().join("export/artifacts");
    let manifest = folder.path().join("export/manifest.json");
    let copied = || std::fs::read_dir(&artifacts).map_or(0, |entries| entries.count());
    loop {
        let _ = std::fs::remove_dir_all(folder.path().join("export"));
        let mut half = source.spawn(&["export", &export]);
        while copied() < 5 && half.try_wait().unwrap().is_none() {}
        half.kill().unwrap();
        half.wait().unwrap();
        if !manifest.exists() {
            break;
        }
    }
    println!("killed after {} files", copied());
    let store = Seaweed::start();
    let url = postgres_server::database();
    let target = Stores {
        arguments: ["--database-url", &url, "--artifacts", "s3://backups/restored"].map(str::to_owned).to_vec(),
        variables: store.variables(),
    };
    let refused = target.run(&["import", &export]);
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("no finished export"));
    let exported = source.run(&["export", &export, "--json"]);
    assert!(exported.status.success(), "{}", String::from_utf8_lossy(&exported.stderr));
    let said: Value = serde_json::from_slice(&exported.stdout).unwrap();
    assert_eq!((&said["records"]["maps.jsonl"]["lines"], &said["gaps"]), (&json!(maps), &json!([])));
    assert_eq!(copied(), maps);

    // Into a service that runs, and sweeps; killed in the middle, and begun again.
    let nothing = tempfile::tempdir().unwrap();
    let restored = target.serve(nothing.path(), 0, &["--sweep-seconds", "1"]);
    let count = || store.names("backups").iter().filter(|name| name.contains("/imports/")).count();
    let mut half = target.spawn(&["import", &export]);
    while count() < 10 {
        assert!(half.try_wait().unwrap().is_none(), "it was to be killed in the middle");
    }
    half.kill().unwrap();
    half.wait().unwrap();
    let keyed = Keyed(&restored, &key);
    let there = keyed.ids("/v1/maps").len();
    println!("killed after {there} maps");
    assert!(there < maps);
    let begun = Instant::now();
    let imported = target.run(&["import", &export, "--json"]);
    assert!(imported.status.success(), "{}", String::from_utf8_lossy(&imported.stderr));
    println!("the rest took {:?}", begun.elapsed());
    assert_same(&expected, &seen(&keyed));
    let again = target.run(&["import", &export, "--json"]);
    let again: Value = serde_json::from_slice(&again.stdout).unwrap();
    // Jobs that ended, one that was cancelled, two that wait; maps; two places, a key, a webhook.
    assert_eq!(again, json!({"added": 0, "there": 2 * maps + 3 + 4}), "nothing is there twice");
    assert_eq!(count(), maps, "and none was swept");

    // What was promised to clients there is kept here.
    assert_eq!(keyed.submit(&small(1), "waits"), waiting[0], "the idempotency key is known");
    let place = keyed.send("POST", "/v1/places/hall/rollback", Some(&json!({"version": 1})), &[]);
    assert_eq!(place.json()["version"], 3, "{}", String::from_utf8_lossy(&place.body));

    // And back into a folder, where the jobs that wait are done.
    let back = tempfile::tempdir().unwrap();
    let third = Stores { arguments: vec!["--data".into(), text(back.path())], variables: Vec::new() };
    let second_export = text(&folder.path().join("second"));
    assert!(target.run(&["export", &second_export]).status.success());
    let imported = third.run(&["import", &second_export]);
    assert!(imported.status.success(), "{}", String::from_utf8_lossy(&imported.stderr));
    let last = third.serve(back.path(), 1, &[]);
    let keyed = Keyed(&last, &key);
    for id in &waiting {
        assert_eq!(keyed.wait(id)["status"], "successful");
    }
    let restored = seen(&keyed).into_iter().filter(|(path, _)| path.contains("/coefficients"));
    let same = restored.filter(|(path, body)| expected.iter().any(|(known, before)| known == path && before == body));
    assert_eq!(same.count(), maps);
}

/// What is damaged in an export is not restored; what is damaged in a store is said, and the rest is exported.
#[test]
fn damage_is_found_out() {
    let (data, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let source =
        Stores { arguments: vec!["--data".into(), data.path().to_str().unwrap().into()], variables: Vec::new() };
    let server = source.serve(data.path(), 1, &[]);
    let maps = [1, 2].map(|seed| server.map_of(&small(seed)));
    drop(server);
    let export = folder.path().join("export");
    let path = export.to_str().unwrap();
    assert!(source.run(&["export", path]).status.success());
    let target = tempfile::tempdir().unwrap();
    let target =
        Stores { arguments: vec!["--data".into(), target.path().to_str().unwrap().into()], variables: Vec::new() };
    let flip = |file: &Path| {
        let mut bytes = std::fs::read(file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(file, bytes).unwrap();
    };
    for file in ["jobs.jsonl".to_owned(), format!("artifacts/{}.npz", maps[0])] {
        flip(&export.join(&file));
        let refused = target.run(&["import", path]);
        let why = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && why.contains("is damaged"), "{file}: {why}");
        flip(&export.join(&file));
    }
    assert!(target.run(&["import", path]).status.success());

    // In the store itself: the file of the second map.
    let own = std::fs::read(export.join(format!("artifacts/{}.npz", maps[1]))).unwrap();
    let mut folders = vec![data.path().join("artifacts")];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if std::fs::read(&path).unwrap() == own {
                flip(&path);
            }
        }
    }
    std::fs::remove_dir_all(&export).unwrap();
    let partly = source.run(&["export", path]);
    let why = String::from_utf8_lossy(&partly.stderr).into_owned();
    assert!(!partly.status.success() && why.contains(&maps[1]), "{why}");
    let target = tempfile::tempdir().unwrap();
    let target =
        Stores { arguments: vec!["--data".into(), target.path().to_str().unwrap().into()], variables: Vec::new() };
    let imported = target.run(&["import", path, "--json"]);
    assert_eq!(serde_json::from_slice::<Value>(&imported.stdout).unwrap(), json!({"added": 3, "there": 0}));
}

/// While jobs end and places change, an export has each job's end with its map, or neither; on either database.
#[test]
fn an_export_of_a_service_at_work_is_of_one_moment() {
    let url = postgres_server::database();
    for database in [None, Some(url)] {
        let (data, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let mut arguments = vec!["--data".to_owned(), data.path().to_str().unwrap().to_owned()];
        arguments.extend(database.into_iter().flat_map(|url| ["--database-url".to_owned(), url]));
        let stores = Stores { arguments, variables: Vec::new() };
        let server = stores.serve(data.path(), 1, &[]);
        let jobs: Vec<String> = (0..60).map(|seed| server.submit(&small(seed))).collect();
        let path = folder.path().join("export");
        let lines = |name: &str| -> Vec<Value> {
            let text = std::fs::read_to_string(path.join(name)).unwrap();
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
        };
        let mut between = 0;
        loop {
            let output = stores.run(&["export", path.to_str().unwrap()]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let (saved, maps) = (lines("jobs.jsonl"), lines("maps.jsonl"));
            assert_eq!(saved.len(), jobs.len());
            let mut ended: Vec<&Value> = Vec::new();
            for job in saved.iter().map(|line| &line["job"]["job"]) {
                match job["status"].as_str().unwrap() {
                    "successful" => ended.push(&job["map_id"]),
                    status => assert_eq!(status, "accepted", "one that runs waits for whoever restores it"),
                }
            }
            let mut kept: Vec<&Value> = maps.iter().map(|line| &line["map"]["map"]["id"]).collect();
            ended.sort_by_key(|id| id.as_str());
            kept.sort_by_key(|id| id.as_str());
            assert_eq!(ended, kept);
            assert_eq!(std::fs::read_dir(path.join("artifacts")).unwrap().count(), kept.len());
            if kept.len() == jobs.len() {
                break;
            }
            between += usize::from(!kept.is_empty());
        }
        println!("{between} exports while jobs ended");
        assert!(between > 0);
    }
}

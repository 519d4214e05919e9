//! What is kept, for whom, and whether it can be.

use std::os::unix::fs::{FileExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::support::{Server, small};

#[test]
fn pages_have_a_policy_and_data_is_private() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("kept");
    let server = Server::start(&data, 0);
    for page in ["/", "/docs/"] {
        let answer = server.get(page);
        let policy = answer.header("content-security-policy");
        assert!(answer.status == 200 && policy.contains("frame-ancestors 'none'") && !policy.contains('*'), "{policy}");
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
    }
    assert_eq!(std::fs::metadata(&data).unwrap().permissions().mode() & 0o077, 0);
}

#[test]
fn readiness_is_a_write_that_succeeds() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    assert_eq!(server.get("/readyz").status, 200);
    // Another process holds the writer's lock, and lets it go again.
    let database = data.path().join("mapfit.sqlite");
    let (held, hold) = std::sync::mpsc::channel();
    let (release, released) = std::sync::mpsc::channel::<()>();
    let holder = std::thread::spawn(move || {
        tokio::runtime::Runtime::new().unwrap().block_on(async {
            use sqlx::Connection;
            let mut other =
                sqlx::sqlite::SqliteConnection::connect(&format!("sqlite://{}", database.display())).await.unwrap();
            let tx = other.begin_with("BEGIN IMMEDIATE").await.unwrap();
            held.send(()).unwrap();
            released.recv().unwrap();
            tx.rollback().await.unwrap();
        });
    });
    hold.recv().unwrap();
    std::thread::sleep(Duration::from_millis(1100));
    server.get("/readyz").problem(503);
    release.send(()).unwrap();
    holder.join().unwrap();
    let begun = Instant::now();
    while server.get("/readyz").status != 200 {
        assert!(begun.elapsed() < Duration::from_secs(20), "it is ready again without a restart");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn texts_are_compressed_where_the_client_says_so_and_files_are_not() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    server.send("GET", "/v1/jobs", &[("accept-encoding", "identity;q=0")], None).problem(406);
    for (path, encoding) in
        [("coefficients", "zstd"), ("contours", "zstd"), ("coefficients?format=npz", ""), ("image", "")]
    {
        let headers = [("accept-encoding", "zstd")];
        let answer = server.send("GET", &format!("{own}/{path}"), &headers, None);
        assert_eq!((answer.status, answer.header("content-encoding")), (200, encoding), "{path}");
        if encoding == "zstd" {
            assert_eq!(zstd::decode_all(&answer.body[..]).unwrap(), server.get(&format!("{own}/{path}")).body);
        }
    }
}

#[test]
fn what_a_crash_left_half_written_is_swept_and_an_ended_job_can_be_removed() {
    let data = tempfile::tempdir().unwrap();
    let left = data.path().join("artifacts/attempts/01900000-0000-7000-8000-000000000000/1");
    std::fs::create_dir_all(&left).unwrap();
    std::fs::write(left.join("map.npz#1"), b"half").unwrap();
    let probes = data.path().join("artifacts/probes");
    std::fs::create_dir_all(&probes).unwrap();
    // Of a process that died an hour ago, on whatever machine.
    let probe = std::fs::File::create(probes.join("01900000-0000-7000-8000-000000000000#1")).unwrap();
    probe.set_modified(std::time::SystemTime::now() - Duration::from_secs(3600)).unwrap();
    std::fs::create_dir_all(data.path().join("artifacts/attempts/empty")).unwrap();
    let server = Server::start(data.path(), 1);
    let begun = Instant::now();
    let names = |folder: &std::path::Path| std::fs::read_dir(folder).unwrap().count();
    while left.exists() || names(&probes) + names(&data.path().join("artifacts/attempts")) > 0 {
        assert!(begun.elapsed() < Duration::from_secs(10), "it is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
    let map = server.map_of(&small(1));
    let job = server.get(&format!("/v1/maps/{map}")).json()["job_id"].as_str().unwrap().to_owned();
    server.delete(&format!("/v1/jobs/{job}?purge=true")).problem(409);
    assert_eq!(server.delete(&format!("/v1/maps/{map}")).status, 204);
    assert_eq!(server.delete(&format!("/v1/jobs/{job}?purge=true")).status, 204);
    server.get(&format!("/v1/jobs/{job}")).problem(404);
}

/// Whether others may read a file: they must be able to get there.
fn is_open_to_others(data: &Path, file: &Path) -> bool {
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    let mut folders = file.ancestors().skip(1).take_while(|folder| folder.starts_with(data));
    mode(file) & 0o077 != 0 && folders.all(|folder| mode(folder) & 0o011 != 0)
}

fn files_under(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|entry| if entry.is_dir() { files_under(&entry) } else { vec![entry] }).collect()
}

/// Whether the service made the folder, or it was there before and open to all.
#[test]
fn what_robots_saw_is_nobody_elses() {
    let folder = tempfile::tempdir().unwrap();
    let (made, found) = (folder.path().join("made"), folder.path().join("found"));
    std::fs::create_dir(&found).unwrap();
    std::fs::set_permissions(&found, std::fs::Permissions::from_mode(0o755)).unwrap();
    for data in [made, found] {
        let server = Server::start(&data, 1);
        server.map_of(&small(1));
        let files = files_under(&data);
        for name in ["mapfit.sqlite", "mapfit.sqlite-wal", "map.npz"] {
            assert!(files.iter().any(|file| file.ends_with(name)), "{name} is not in {files:?}");
        }
        for file in files {
            assert!(!is_open_to_others(&data, &file), "{}", file.display());
        }
    }
}

/// Takes what is still in the write-ahead log into the database.
fn everything_into(database: &Path) {
    tokio::runtime::Runtime::new().unwrap().block_on(async {
        use sqlx::Connection;
        let url = format!("sqlite://{}", database.display());
        let mut own = sqlx::sqlite::SqliteConnection::connect(&url).await.unwrap();
        sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").execute(&mut own).await.unwrap();
        own.close().await.unwrap();
    });
}

/// Pages of the database that are not what was written there: whoever would take work could not keep it.
#[test]
fn a_damaged_database_is_not_ready() {
    let data = tempfile::tempdir().unwrap();
    let mut first = Server::start(data.path(), 1);
    first.map_of(&small(1));
    first.signal("-TERM");
    first.child.wait().unwrap();
    let database = data.path().join("mapfit.sqlite");
    everything_into(&database);
    let server = Server::start(data.path(), 0);
    assert_eq!(server.get("/readyz").status, 200);
    let database = std::fs::OpenOptions::new().write(true).open(database).unwrap();
    let length = database.metadata().unwrap().len() as usize;
    database.write_all_at(&vec![0x5a; length - 4096], 4096).unwrap();
    let begun = Instant::now();
    while server.get("/readyz").status != 503 {
        assert!(begun.elapsed() < Duration::from_secs(10), "it says that it takes work");
        std::thread::sleep(Duration::from_millis(200));
    }
    server.get("/readyz").problem(503);
}

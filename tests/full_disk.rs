//! A disk that is full, or cannot be written any more: what is refused says so, nothing accepted is lost, and work goes on when there is space again,
//! without a restart. The disk is a real one of a few megabytes, mounted for the server alone.

mod support;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;
use support::{Server, long, small};

fn is_root() -> bool {
    std::fs::metadata("/proc/self").is_ok_and(|own| std::os::unix::fs::MetadataExt::uid(&own) == 0)
}

/// The disk's size.
const MEGABYTES: usize = 24;

/// A server whose data lie on a small disk of its own, and a way to that disk.
struct Cramped {
    server: Server,
    disk: PathBuf,
}

impl Cramped {
    fn start(mounted: &Path) -> Self {
        // A mount namespace of its own: the disk goes with the server, whatever becomes of the test. Who may mount already
        // needs no user namespace, which some machines forbid.
        let mut command = Command::new("unshare");
        let script = format!(
            "mount -t tmpfs -o size={MEGABYTES}m tmpfs '{0}' && exec '{1}' serve --listen 127.0.0.1:0 --workers 1 --data '{0}/data'",
            mounted.display(),
            env!("CARGO_BIN_EXE_mapfit"),
        );
        let user: &[&str] = if is_root() { &[] } else { &["--user", "--map-root-user"] };
        command.args(user).args(["--mount", "sh", "-c", &script]);
        let server = Server::start_command(command);
        let disk = PathBuf::from(format!("/proc/{}/root{}", server.child.id(), mounted.display()));
        Self { server, disk }
    }

    /// Fills what is left of the disk, to the last byte.
    fn fill(&self) {
        let mut ballast = File::options().append(true).create(true).open(self.disk.join("ballast")).unwrap();
        for size in [1 << 20, 4096, 1] {
            while ballast.write_all(&vec![0; size]).is_ok() {}
        }
    }

    fn clear(&self) {
        std::fs::remove_file(self.disk.join("ballast")).unwrap();
    }

    /// Does something where the server sees its disk.
    fn within(&self, script: &str) {
        let id = self.server.child.id().to_string();
        let user: &[&str] = if is_root() { &[] } else { &["--user", "--preserve-credentials"] };
        let mut command = Command::new("nsenter");
        command.args(["--target", &id, "--mount"]).args(user).args(["sh", "-c", script]);
        assert!(command.status().unwrap().success(), "{script}");
    }

    fn is_ready(&self) -> bool {
        self.server.get("/readyz").status == 200
    }

    fn until(&self, what: &str, holds: impl Fn() -> bool) {
        let begun = Instant::now();
        while !holds() {
            assert!(begun.elapsed() < Duration::from_secs(40), "{what}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

#[test]
fn a_full_disk_refuses_loses_nothing_and_is_worked_on_again() {
    let mounted = tempfile::tempdir().unwrap();
    let cramped = Cramped::start(mounted.path());
    let server = &cramped.server;
    let before = server.map_of(&small(1));
    // One job is at work, and its map has nowhere to go.
    let caught = server.submit(&long(2));
    cramped.until("the job is not begun", || server.get(&format!("/v1/jobs/{caught}")).json()["status"] == "running");

    cramped.fill();
    cramped.until("a full disk is ready for work", || !cramped.is_ready());
    let mut accepted: Vec<Value> = Vec::new();
    let mut refused = 0;
    for seed in 0..20 {
        let answer = server.post("/v1/jobs", &small(seed));
        match answer.status {
            202 => accepted.push(answer.json()),
            503 | 507 => refused += usize::from(answer.json()["detail"].is_string()),
            other => panic!("{other}: {}", answer.json()),
        }
    }
    assert!(refused > 0, "a full disk took {} jobs", accepted.len());
    assert_eq!(server.get(&format!("/v1/maps/{before}/coefficients")).status, 200, "reading goes on");
    assert_eq!(server.get("/livez").status, 200);

    cramped.clear();
    cramped.until("space is back, and the service is not", || cramped.is_ready());
    let after = server.map_of(&small(50));
    assert_ne!(before, after);
    assert_eq!(server.wait(&caught)["status"], "successful", "the job that was caught");
    for job in &accepted {
        let ended = server.wait(job["id"].as_str().unwrap());
        assert_eq!(ended["status"], "successful", "{ended}");
    }
    let all = server.get("/v1/jobs?limit=100").json();
    let known = all["items"].as_array().unwrap().len();
    assert_eq!(known, accepted.len() + 3, "what was refused is not there, what was accepted is");
    println!("{} accepted, {refused} refused while full", accepted.len());
}

/// What maps lie on turns read-only, as a disk does that has had errors: jobs are accepted, fits wait with what they have, and
/// go on when it can be written again.
#[test]
fn maps_wait_for_a_read_only_disk() {
    let mounted = tempfile::tempdir().unwrap();
    let cramped = Cramped::start(mounted.path());
    let server = &cramped.server;
    let before = server.map_of(&small(1));
    let artifacts = format!("{}/data/artifacts", mounted.path().display());
    cramped.within(&format!("mount --bind {artifacts} {artifacts} && mount -o remount,bind,ro {artifacts}"));
    cramped.until("a read-only disk is ready for work", || !cramped.is_ready());
    let job = server.submit(&small(2));
    let state = || server.get(&format!("/v1/jobs/{job}")).json();
    cramped.until("the map is not formed", || state()["progress"]["stage"] == "storing");
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(state()["status"], "running");
    assert_eq!(server.get(&format!("/v1/maps/{before}/coefficients")).status, 200, "reading goes on");
    cramped.within(&format!("umount {artifacts}"));
    let ended = server.wait(&job);
    assert_eq!((&ended["status"], &ended["attempt"]), (&"successful".into(), &1.into()), "{ended}");
    assert!(cramped.is_ready());
}

#[test]
fn a_server_does_not_start_on_a_disk_it_cannot_write() {
    let mounted = tempfile::tempdir().unwrap();
    let mut command = Command::new("unshare");
    let script = format!(
        "mount -t tmpfs -o ro tmpfs '{0}' && exec '{1}' serve --listen 127.0.0.1:0 --data '{0}/data'",
        mounted.path().display(),
        env!("CARGO_BIN_EXE_mapfit"),
    );
    let user: &[&str] = if is_root() { &[] } else { &["--user", "--map-root-user"] };
    let output = command.args(user).args(["--mount", "sh", "-c", &script]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && output.stdout.is_empty());
    assert!(said.contains("Read-only") && said.contains("data") && !said.contains("panicked"), "{said}");
}

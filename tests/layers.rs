//! The house's rule: a room uses only the rooms above it, and the pure rooms know no runtime, database or file.

use std::path::{Path, PathBuf};

/// From the ground up: each may use those before it.
const ROOMS: [&str; 16] = [
    "geometry",
    "spline",
    "sparse",
    "scan",
    "fit",
    "uncertainty",
    "map",
    "render",
    "sim",
    "reproduce",
    "import",
    "jobs",
    "store",
    "worker",
    "http",
    "cli",
];
/// The rooms that build with `--no-default-features`.
const PURE: usize = 10;
const IMPURE: [&str; 10] =
    ["tokio", "axum", "sqlx", "object_store", "std::fs", "std::net", "std::thread", "std::env", "ureq", "tracing"];

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    if folder.is_file() {
        return vec![folder.to_owned()];
    }
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| rust_files(&path)).filter(|path| path.extension().is_some_and(|e| e == "rs")).collect()
}

fn files_of(room: &str) -> Vec<PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let file = source.join(format!("{room}.rs"));
    rust_files(if file.is_file() { &file } else { Box::leak(source.join(room).into_boxed_path()) })
}

/// A file's code: without comments, and without the tests at its end, which may use anything.
fn code(file: &Path) -> String {
    let text = std::fs::read_to_string(file).unwrap();
    let text = text.split("#[cfg(test)]\n").next().unwrap();
    text.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

fn is_test(file: &Path) -> bool {
    file.file_name().is_some_and(|name| name == "tests.rs")
}

#[test]
fn a_room_uses_only_the_rooms_above_it() {
    let mut faults = Vec::new();
    for (level, room) in ROOMS.iter().enumerate() {
        for file in files_of(room).iter().filter(|file| !is_test(file)) {
            let code = code(file);
            for lower in &ROOMS[level + 1..] {
                if code.contains(&format!("crate::{lower}::")) || code.contains(&format!("crate::{lower};")) {
                    faults.push(format!("{} uses {lower}", file.display()));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn the_pure_rooms_know_no_runtime_database_or_file() {
    let mut faults = Vec::new();
    for room in &ROOMS[..PURE] {
        for file in files_of(room) {
            for name in IMPURE.iter().filter(|name| code(&file).contains(*name)) {
                faults.push(format!("{} uses {name}", file.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn every_room_is_on_the_list() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for entry in std::fs::read_dir(source).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        assert!(["lib", "main"].contains(&&*name) || ROOMS.contains(&&*name), "{name} is in no layer");
    }
}

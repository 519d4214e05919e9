//! The house's rule: a room uses only the rooms above it, and the pure rooms know no runtime, database or file.

use std::path::{Path, PathBuf};

/// From the ground up: each may use those before it.
const ROOMS: [&str; 21] = [
    "geometry",
    "spline",
    "sparse",
    "scan",
    "fit",
    "uncertainty",
    "map",
    "render",
    "localize",
    "living",
    "sim",
    "reproduce",
    "import",
    "jobs",
    "store",
    "backup",
    "access",
    "traces",
    "worker",
    "http",
    "cli",
];
/// The rooms that build with `--no-default-features`.
const PURE: usize = 12;
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

/// The one file of theirs that may start threads.
const TEAM: &str = "sparse/team.rs";

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
            let may = |name: &str| name == "std::thread" && file.ends_with(TEAM);
            for name in IMPURE.iter().filter(|name| code(&file).contains(*name) && !may(name)) {
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

/// What a file's `use` names, as a path from `crate`; `super` is resolved. Groups are opened.
fn used(file: &Path) -> Vec<String> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let module = module_of(file.strip_prefix(&source).unwrap());
    let code = code(file);
    let uses = code.split(';').filter_map(|statement| {
        let line =
            statement.lines().skip_while(|line| !line.trim_start().starts_with("use ") && !line.contains("pub use "));
        let text: String = line.collect::<Vec<_>>().join(" ");
        text.split_once("use ").map(|(_, path)| path.split_whitespace().collect::<String>())
    });
    let flat = uses.flat_map(|path| match path.split_once("::{") {
        Some((head, group)) => {
            group.trim_end_matches('}').split(',').map(|name| format!("{head}::{name}")).collect::<Vec<_>>()
        }
        None => vec![path],
    });
    flat.filter_map(|path| {
        let mut at: Vec<&str> = module.iter().map(String::as_str).collect();
        let mut parts = path.split("::").peekable();
        match parts.next()? {
            "crate" => at.clear(),
            "self" => {}
            "super" => {
                at.pop();
                while parts.next_if_eq(&"super").is_some() {
                    at.pop();
                }
            }
            _ => return None,
        }
        at.extend(parts);
        Some(at.join("::"))
    })
    .collect()
}

fn module_of(file: &Path) -> Vec<String> {
    let mut parts: Vec<String> =
        file.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if parts.last().is_some_and(|last| last == "mod") {
        parts.pop();
    }
    parts
}

/// A folder's `mod.rs` hands names on, so it counts with what defines them: only other files are held to this.
#[test]
fn no_two_files_use_each_other_in_a_circle() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files: Vec<PathBuf> = rust_files(&source).into_iter().filter(|file| !is_test(file)).collect();
    let leaf =
        |file: &&PathBuf| !["mod.rs", "lib.rs", "main.rs"].contains(&&*file.file_name().unwrap().to_string_lossy());
    let modules: Vec<(String, Vec<String>)> = files
        .iter()
        .filter(leaf)
        .map(|file| (module_of(file.strip_prefix(&source).unwrap()).join("::"), used(file)))
        .collect();
    let mut next: std::collections::BTreeMap<&str, Vec<&str>> = modules
        .iter()
        .map(|(module, used)| {
            let others = modules.iter().map(|(other, _)| other.as_str()).filter(|other| *other != module);
            let named = |other: &&str| used.iter().any(|path| path == other || path.starts_with(&format!("{other}::")));
            (module.as_str(), others.filter(named).collect())
        })
        .collect();
    assert!(next.values().map(Vec::len).sum::<usize>() > 150, "uses are read");
    // What uses nothing that is left is in no circle.
    while let Some(done) = next.iter().find(|(_, used)| used.iter().all(|other| !next.contains_key(other))) {
        let done = *done.0;
        next.remove(done);
    }
    assert!(next.is_empty(), "in a circle, or above one: {:#?}", next.keys());
}

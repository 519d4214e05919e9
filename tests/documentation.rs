//! The documentation's pages know what the service says: every problem's name is explained, and none that nobody says.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let within = |path: PathBuf| if path.is_dir() { rust_files(&path) } else { vec![path] };
    entries.flat_map(within).filter(|path| path.extension().is_some_and(|e| e == "rs")).collect()
}

/// What may be a problem's name: small words with hyphens between them.
fn is_slug(text: &str) -> bool {
    !text.is_empty() && text.split('-').all(|word| !word.is_empty() && word.bytes().all(|b| b.is_ascii_lowercase()))
}

/// The names of problems in a file: what stands before a title, after `slug: `, or in an address.
fn slugs(code: &str) -> Vec<String> {
    // Literals are at the odd places.
    let parts: Vec<&str> = code.split('"').collect();
    let mut found = Vec::new();
    for (k, literal) in parts.iter().enumerate().skip(1).step_by(2) {
        let (before, after) = (parts[k - 1], parts.get(k + 1).map_or("", |text| text.trim()));
        let title = parts.get(k + 2).and_then(|text| text.chars().next()).is_some_and(|c| c.is_ascii_uppercase());
        let named = after == "," && title || before.trim_end().ends_with("slug:");
        if named && is_slug(literal) {
            found.push((*literal).to_owned());
        }
        found.extend(literal.strip_prefix("/problems/").filter(|slug| is_slug(slug)).map(str::to_owned));
    }
    found
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn every_problem_has_its_place_in_the_page_of_errors() {
    let mut said = BTreeSet::new();
    for room in ["http", "jobs", "worker"] {
        for file in rust_files(&root().join("src").join(room)) {
            let text = std::fs::read_to_string(&file).unwrap();
            let text = text.split("#[cfg(test)]\n").next().unwrap();
            let code: Vec<&str> = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
            said.extend(slugs(&code.join("\n").replace("\\\"", "").replace("'\"'", "")));
        }
    }
    let page = std::fs::read_to_string(root().join("docs/errors.md")).unwrap();
    let told: BTreeSet<String> = page.lines().filter_map(|line| line.strip_prefix("### ")).map(str::to_owned).collect();
    assert!(said.len() > 30, "{said:?}");
    assert_eq!(said, told);
}

#[test]
fn every_page_is_in_the_table_of_contents() {
    let contents = std::fs::read_to_string(root().join("docs/SUMMARY.md")).unwrap();
    for folder in ["docs", "docs/howto"] {
        for entry in std::fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root().join("docs")).unwrap().to_str().unwrap().to_owned();
            if name.ends_with(".md") && name != "SUMMARY.md" {
                assert!(contents.contains(&format!("]({name})")), "{name} is in no table of contents");
            }
        }
    }
}

/// Pages that scripts and tests write, whose sentences stand in those.
const WRITTEN: [&str; 3] = ["docs/api.md", "docs/reproduction.md", "docs/scale.md"];

#[test]
fn prose_is_wrapped_at_120_columns() {
    let of = |folder: &str| {
        let entries = std::fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.extension().is_some_and(|e| e == "md")).collect::<Vec<_>>()
    };
    let folders = ["", "docs", "docs/howto", "console", "clients/python", "scripts/nightly"];
    let pages = folders.into_iter().flat_map(of).filter(|path| !WRITTEN.iter().any(|own| path.ends_with(own)));
    let mut long = Vec::new();
    for page in pages {
        let (text, mut code) = (std::fs::read_to_string(&page).unwrap(), false);
        for (k, line) in text.lines().enumerate() {
            code ^= line.trim_start().starts_with("```");
            if !code && !line.trim_start().starts_with('|') && line.chars().count() > 120 {
                long.push(format!("{}:{}", page.display(), k + 1));
            }
        }
    }
    assert!(long.is_empty(), "{long:#?}");
}

//! `mapfit reproduce`: every figure and table of the method's two experiments, on a machine without any data.

use std::process::Command;

#[test]
fn every_figure_and_both_tables_are_drawn_and_shown_on_one_page() {
    let folder = tempfile::tempdir().unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["reproduce", "--out"])
        .arg(folder.path())
        .env_remove("MAPFIT_RECORDINGS")
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let read =
        |name: String| std::fs::read(folder.path().join(&name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let page = String::from_utf8(read("reproduction.md".into())).unwrap();
    for figure in 1..=10 {
        let png = read(format!("figure-{figure:02}.png"));
        assert!(png.starts_with(b"\x89PNG") && png.len() > 5_000, "figure {figure}");
        let svg = String::from_utf8(read(format!("figure-{figure:02}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "figure {figure}");
        assert!(page.contains(&format!("## Figure {figure}:")) && page.contains(&format!("(figure-{figure:02}.png)")));
    }
    let table = String::from_utf8(read("table-2.csv".into())).unwrap();
    assert!(table.contains("sigma_theta,0.005 rad") && page.contains("| sigma_range | 0.02 m |"));
    assert!(page.matches("| published | measured here |").count() == 10, "every figure says what it is held against");
}

/// The page in docs/ is this command's: same headings, and its pictures are there.
#[test]
fn the_page_in_docs_shows_the_same_figures() {
    let docs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let page = std::fs::read_to_string(docs.join("reproduction.md")).unwrap();
    for name in (1..=10).map(|k| format!("figure-{k:02}.png")).chain(["figure-10-willow.png".into()]) {
        assert!(page.contains(&format!("(reproduction/{name})")) && docs.join("reproduction").join(&name).is_file());
    }
}

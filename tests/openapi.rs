//! `openapi/openapi.json` is what the service says of itself. `MAPFIT_BLESS=1 cargo test --test openapi` renews it.

#[test]
fn the_committed_document_is_current() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi/openapi.json");
    let current = mapfit::http::document();
    if std::env::var_os("MAPFIT_BLESS").is_some() {
        std::fs::create_dir_all(std::path::Path::new(file).parent().unwrap()).unwrap();
        std::fs::write(file, &current).unwrap();
    }
    let committed = std::fs::read_to_string(file).unwrap_or_default();
    assert!(committed == current, "openapi/openapi.json has drifted; MAPFIT_BLESS=1 renews it");
}

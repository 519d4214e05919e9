//! Living maps over HTTP: updates, each with the map it grew from; what changed between two maps; joins.

mod changes;
mod joins;
mod scenes;
#[path = "../support/mod.rs"]
mod support;
mod updates;

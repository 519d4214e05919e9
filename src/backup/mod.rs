//! A backup of a whole service: out of either kind of store, into either kind.
//!
//! An export is a folder:
//!
//! ```text
//! keys.jsonl jobs.jsonl maps.jsonl places.jsonl webhooks.jsonl    a record a line, see `store::Saved`
//! artifacts/MAP.npz                                               the maps' files
//! manifest.json                                                   what is in it; written last
//! ```
//!
//! The records are of one moment, taken while the service runs; the maps' files never change, so they are copied afterwards, and
//! those that an earlier export into the same folder brought stay. A folder without a manifest is half an export: made
//! whole by the same command, and refused by an import.
//!
//! An import adds what is not there, so one that was interrupted is begun again. A map's file is there before its record.

mod export;
mod import;
mod manifest;

use thiserror::Error;

pub use export::export;
pub use import::import;
pub use manifest::{Gap, Manifest};

use crate::store::{ArtifactsError, StoreError};

#[derive(Debug, Error)]
pub enum BackupError {
    #[error("{path}: {source}")]
    File { path: String, source: std::io::Error },
    #[error(
        "{0} is no finished export: it has no manifest.json. The same `mapfit export` into it again makes it whole"
    )]
    Unfinished(String),
    #[error("{path} is damaged: {why}")]
    Damaged { path: String, why: String },
    #[error("the export is of format {0}, which this version does not know")]
    Format(u32),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Artifacts(#[from] ArtifactsError),
}

impl BackupError {
    fn file(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.display().to_string();
        move |source| Self::File { path, source }
    }
}

/// What an import did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Restored {
    /// Records that were not there.
    pub added: usize,
    /// Those that were, and stay as they are.
    pub there: usize,
}

//! What is in an export, and that it is whole.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::BackupError;

/// Raised where an older version could not read it.
pub const FORMAT: u32 = 1;
const NAME: &str = "manifest.json";
/// No manifest is larger.
const LARGEST: u64 = 64 << 20;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    pub format: u32,
    /// The version that wrote it.
    pub mapfit: String,
    /// When the records were taken, RFC 3339.
    pub taken: String,
    /// The files of records.
    pub records: BTreeMap<String, Records>,
    /// Maps whose file is not here.
    pub gaps: Vec<Gap>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Records {
    pub lines: u64,
    pub sha256: String,
}

/// A map that has a record and no file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    pub map_id: String,
    /// Whether it was deleted while the export ran; else its file is missing or damaged where it should be.
    pub deleted: bool,
    pub why: String,
}

impl Manifest {
    /// Takes away the sign that a folder is whole.
    pub fn withdraw(folder: &Path) -> Result<(), BackupError> {
        let path = folder.join(NAME);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(BackupError::file(&path)(error)),
            _ => Ok(()),
        }
    }

    /// Says that a folder is whole: everything else in it is on disk.
    pub fn write(&self, folder: &Path) -> Result<(), BackupError> {
        let text = serde_json::to_vec_pretty(self).map_err(std::io::Error::from);
        let text = text.map_err(BackupError::file(folder))?;
        put_down(&folder.join(NAME), &text)
    }

    pub fn read(folder: &Path) -> Result<Self, BackupError> {
        let path = folder.join(NAME);
        let size = match std::fs::metadata(&path) {
            Ok(own) => own.len(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(BackupError::Unfinished(folder.display().to_string()));
            }
            Err(error) => return Err(BackupError::file(&path)(error)),
        };
        let damaged = |why: String| BackupError::Damaged { path: path.display().to_string(), why };
        if size > LARGEST {
            return Err(damaged(format!("it has {size} bytes")));
        }
        let text = std::fs::read(&path).map_err(BackupError::file(&path))?;
        let manifest: Self = serde_json::from_slice(&text).map_err(|error| damaged(error.to_string()))?;
        if manifest.format == FORMAT { Ok(manifest) } else { Err(BackupError::Format(manifest.format)) }
    }
}

/// A file that is there whole and on disk, or not at all.
pub fn put_down(path: &Path, bytes: &[u8]) -> Result<(), BackupError> {
    let beside = path.with_extension("part");
    let write = || {
        let mut file = File::create(&beside)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&beside, path)?;
        path.parent().map_or(Ok(()), |folder| File::open(folder)?.sync_all())
    };
    write().map_err(BackupError::file(path))
}

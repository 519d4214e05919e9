//! Everything out of an export's folder, into the stores.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use bytes::Bytes;
use sha2::{Digest, Sha256};

use super::export::{ARTIFACTS, FILES};
use super::{BackupError, Manifest, Restored};
use crate::store::{Artifacts, MAP_FILE, Records, Row, Saved};

/// Records in one transaction. Maps go one by one, each with its file.
const AT_ONCE: usize = 64;
/// No record is larger, with its request.
const LINE: u64 = 512 << 20;

/// Adds what an export has and the stores have not. What they have stays as it is. The service may run.
pub async fn import(records: &dyn Records, artifacts: &Artifacts, folder: &Path) -> Result<Restored, BackupError> {
    let manifest = Manifest::read(folder)?;
    // Before anything is written.
    for name in FILES {
        check(folder, name, &manifest)?;
    }
    let gone: BTreeSet<&str> = manifest.gaps.iter().map(|gap| &gap.map_id[..]).collect();
    let mut restored = Restored::default();
    for name in FILES {
        let mut batch = Vec::new();
        let path = folder.join(name);
        let mut lines = Lines::of(&path)?;
        while let Some(saved) = lines.next()? {
            let Some(saved) = without(saved, &gone) else { continue };
            match saved {
                Saved::Map { map } => restored += restore_map(records, artifacts, map, folder).await?,
                saved => batch.push(saved),
            }
            if batch.len() == AT_ONCE {
                restored += put(records, std::mem::take(&mut batch)).await?;
            }
        }
        restored += put(records, batch).await?;
    }
    Ok(restored)
}

async fn put(records: &dyn Records, batch: Vec<Saved>) -> Result<Restored, BackupError> {
    let added = records.restore(&batch).await?;
    Ok(Restored { added, there: batch.len() - added })
}

/// A record without maps that have no file: they are no maps, and no place has them.
fn without(saved: Saved, gone: &BTreeSet<&str>) -> Option<Saved> {
    let is_gone = |row: &Row, column: &str| row[column].as_str().is_some_and(|id| gone.contains(id));
    match saved {
        Saved::Map { map } if is_gone(&map, "id") => None,
        Saved::Place { place, mut versions } => {
            versions.retain(|version| !is_gone(version, "map_id"));
            let is_published = versions.iter().any(|version| version["version"] == place["version"]);
            is_published.then_some(Saved::Place { place, versions })
        }
        other => Some(other),
    }
}

/// A map's file first: whoever sees the record can read it. Where the record is there, so is a file.
async fn restore_map(
    records: &dyn Records,
    artifacts: &Artifacts,
    mut map: Row,
    folder: &Path,
) -> Result<Restored, BackupError> {
    let text = |column: &str| map.get(column).and_then(|value| value.as_str()).unwrap_or_default().to_owned();
    let (id, tenant, sha256) = (text("id"), text("tenant"), text("sha256"));
    // The id becomes a name of files.
    if id.is_empty() || !id.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-') {
        return Err(BackupError::Damaged { path: "maps.jsonl".into(), why: format!("{id:?} is no map's id") });
    }
    if records.map(&tenant, &id).await?.is_some() {
        return Ok(Restored { added: 0, there: 1 });
    }
    let path = folder.join(ARTIFACTS).join(format!("{id}.npz"));
    let bytes = std::fs::read(&path).map_err(BackupError::file(&path))?;
    if !sha256.is_empty() && hex::encode(Sha256::digest(&bytes)) != sha256 {
        let why = "it is not the file that its map's record names".into();
        return Err(BackupError::Damaged { path: path.display().to_string(), why });
    }
    let prefix = Artifacts::of_import(&id);
    artifacts.put(&prefix, MAP_FILE, Bytes::from(bytes)).await?;
    map.insert("prefix".into(), prefix.into());
    put(records, vec![Saved::Map { map }]).await
}

/// Whether a file of records is the one that the manifest names.
fn check(folder: &Path, name: &str, manifest: &Manifest) -> Result<(), BackupError> {
    let path = folder.join(name);
    let mut file = File::open(&path).map_err(BackupError::file(&path))?;
    let mut digest = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(BackupError::file(&path))? {
            0 => break,
            read => digest.update(&buffer[..read]),
        }
    }
    match manifest.records.get(name) {
        Some(known) if known.sha256 == hex::encode(digest.finalize()) => Ok(()),
        _ => Err(BackupError::Damaged {
            path: path.display().to_string(),
            why: "its SHA-256 is not the manifest's".into(),
        }),
    }
}

struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    line: u64,
}

impl<'a> Lines<'a> {
    fn of(path: &'a Path) -> Result<Self, BackupError> {
        Ok(Self { path, reader: BufReader::new(File::open(path).map_err(BackupError::file(path))?), line: 0 })
    }

    fn next(&mut self) -> Result<Option<Saved>, BackupError> {
        let mut line = Vec::new();
        let read = (&mut self.reader).take(LINE).read_until(b'\n', &mut line).map_err(BackupError::file(self.path))?;
        self.line += 1;
        if read == 0 {
            return Ok(None);
        }
        serde_json::from_slice(&line).map(Some).map_err(|error| BackupError::Damaged {
            path: self.path.display().to_string(),
            why: format!("line {}: {error}", self.line),
        })
    }
}

impl std::ops::AddAssign for Restored {
    fn add_assign(&mut self, other: Self) {
        self.added += other.added;
        self.there += other.there;
    }
}

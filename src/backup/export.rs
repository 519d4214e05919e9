//! Everything out of the stores, into a folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::manifest::{FORMAT, Records as RecordsFile, put_down};
use super::{BackupError, Gap, Manifest};
use crate::store::{Artifacts, ArtifactsError, MAP_FILE, Records, Saved};

pub(super) const ARTIFACTS: &str = "artifacts";
/// Of records, in the order in which an import takes them: each needs those before it.
pub(super) const FILES: [&str; 5] = ["keys.jsonl", "jobs.jsonl", "maps.jsonl", "places.jsonl", "webhooks.jsonl"];

/// Exports all records as they are at one moment, and the maps' files, into a folder, which is made where it is missing.
/// The service may run. An export into a folder that has one, or half of one, copies only what is new.
pub async fn export(records: &dyn Records, artifacts: &Artifacts, folder: &Path) -> Result<Manifest, BackupError> {
    let mut private = std::fs::DirBuilder::new();
    // Jobs, maps and webhooks' secrets are nobody else's on this machine.
    std::os::unix::fs::DirBuilderExt::mode(private.recursive(true), 0o700);
    let files = folder.join(ARTIFACTS);
    private.create(&files).map_err(BackupError::file(&files))?;
    Manifest::withdraw(folder)?;
    let taken = jiff::Timestamp::now().to_string();
    let mut lines = Lines::into(folder)?;
    records.save(&mut |saved| lines.take(&saved)).await?;
    let Lines { maps, .. } = &lines;
    let (maps, written) = (maps.clone(), lines.finish()?);
    let (mut gaps, mut named) = (Vec::new(), BTreeSet::new());
    for map in &maps {
        match copy(artifacts, map, &files).await {
            Ok(name) => {
                named.insert(name);
            }
            Err(BackupError::Artifacts(
                error @ (ArtifactsError::Damaged(_) | ArtifactsError::Store(object_store::Error::NotFound { .. })),
            )) => {
                let deleted = records.map(&map.tenant, &map.id).await?.is_none();
                gaps.push(Gap { map_id: map.id.clone(), deleted, why: error.to_string() });
            }
            Err(error) => return Err(error),
        }
    }
    let manifest = Manifest { format: FORMAT, mapfit: env!("CARGO_PKG_VERSION").into(), taken, records: written, gaps };
    manifest.write(folder)?;
    forget(&files, &named)?;
    Ok(manifest)
}

/// Of a map's record, what its file needs.
#[derive(Debug, Clone)]
struct Named {
    id: String,
    tenant: String,
    prefix: String,
    sha256: Option<String>,
}

/// Copies a map's file, where it is not there; its name.
async fn copy(artifacts: &Artifacts, map: &Named, files: &Path) -> Result<String, BackupError> {
    let name = format!("{}.npz", map.id);
    let path = files.join(&name);
    if let (Some(expected), Ok(bytes)) = (&map.sha256, std::fs::read(&path))
        && hex::encode(Sha256::digest(&bytes)) == *expected
    {
        return Ok(name);
    }
    let bytes = artifacts.get(&map.prefix, MAP_FILE, map.sha256.as_deref()).await?;
    put_down(&path, &bytes)?;
    Ok(name)
}

/// Removes files of maps that an earlier export had.
fn forget(files: &Path, named: &BTreeSet<String>) -> Result<(), BackupError> {
    for entry in std::fs::read_dir(files).map_err(BackupError::file(files))? {
        let entry = entry.map_err(BackupError::file(files))?;
        if !named.contains(&*entry.file_name().to_string_lossy()) {
            std::fs::remove_file(entry.path()).map_err(BackupError::file(&entry.path()))?;
        }
    }
    Ok(())
}

/// The files of records as they are written.
struct Lines {
    files: [(PathBuf, BufWriter<File>, Sha256, u64); 5],
    maps: Vec<Named>,
}

impl Lines {
    fn into(folder: &Path) -> Result<Self, BackupError> {
        let open = |name: &str| {
            let path = folder.join(name);
            let file = File::create(&path).map_err(BackupError::file(&path))?;
            Ok::<_, BackupError>((path, BufWriter::new(file), Sha256::new(), 0))
        };
        let [keys, jobs, maps, places, webhooks] = FILES;
        Ok(Self { files: [open(keys)?, open(jobs)?, open(maps)?, open(places)?, open(webhooks)?], maps: Vec::new() })
    }

    fn take(&mut self, saved: &Saved) -> std::io::Result<()> {
        let file = match saved {
            Saved::Key { .. } => 0,
            Saved::Job { .. } => 1,
            Saved::Map { map } => {
                let text = |column: &str| map[column].as_str().map(str::to_owned);
                self.maps.push(Named {
                    id: text("id").unwrap_or_default(),
                    tenant: text("tenant").unwrap_or_default(),
                    prefix: text("prefix").unwrap_or_default(),
                    sha256: text("sha256"),
                });
                2
            }
            Saved::Place { .. } => 3,
            Saved::Webhook { .. } => 4,
        };
        let mut line = serde_json::to_vec(saved)?;
        line.push(b'\n');
        let (_, writer, digest, lines) = &mut self.files[file];
        digest.update(&line);
        *lines += 1;
        writer.write_all(&line)
    }

    /// Everything is on disk.
    fn finish(self) -> Result<BTreeMap<String, RecordsFile>, BackupError> {
        let mut written = BTreeMap::new();
        for ((path, writer, digest, lines), name) in self.files.into_iter().zip(FILES) {
            let file = writer.into_inner().map_err(|error| BackupError::file(&path)(error.into_error()))?;
            file.sync_all().map_err(BackupError::file(&path))?;
            written.insert(name.to_owned(), RecordsFile { lines, sha256: hex::encode(digest.finalize()) });
        }
        Ok(written)
    }
}

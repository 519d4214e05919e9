//! A folder as an object store: what is durable there, and what a crash leaves that no list of objects shows.
//!
//! A file is written beside its place, synced and renamed, so it is whole or not there. A write that a crash cut short
//! leaves its staging file: object_store does not list it, so the sweep looks at the folders themselves.

use std::io::Write;
use std::path::{Path as FilePath, PathBuf};
use std::time::SystemTime;

use async_trait::async_trait;
use bytes::Bytes;
use futures::TryStreamExt;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutPayload};

use super::prefix::{ATTEMPTS, IMPORTS, PROBES};
use super::{ArtifactsError, Backend, Leftover, PROBE_BYTES};

pub(super) struct Folder {
    files: LocalFileSystem,
    /// The same files, not synced.
    unsynced: LocalFileSystem,
    folder: PathBuf,
}

impl Folder {
    /// A folder, which is made where it is missing. Files are synced to disk before a write returns.
    pub fn open(folder: &FilePath) -> Result<Self, ArtifactsError> {
        std::fs::create_dir_all(folder)?;
        let files = LocalFileSystem::new_with_prefix(folder)?.with_automatic_cleanup(true);
        Ok(Self { files: files.clone().with_fsync(true), unsynced: files, folder: folder.to_owned() })
    }

    async fn names(&self, path: &str) -> Result<Vec<String>, std::io::Error> {
        let mut entries = match tokio::fs::read_dir(self.folder.join(path)).await {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let mut names = Vec::new();
        while let Some(entry) = entries.next_entry().await? {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
        Ok(names)
    }

    async fn left(&self, prefix: String) -> Leftover {
        let modified: Option<SystemTime> =
            tokio::fs::metadata(self.folder.join(&prefix)).await.and_then(|own| own.modified()).ok();
        Leftover { prefix, modified }
    }
}

#[async_trait]
impl Backend for Folder {
    fn objects(&self) -> &dyn ObjectStore {
        &self.files
    }

    async fn put(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError> {
        self.files.put(path, PutPayload::from(bytes)).await?;
        Ok(())
    }

    async fn put_for_now(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError> {
        self.unsynced.put(path, PutPayload::from(bytes)).await?;
        Ok(())
    }

    /// A file without a name: of a process that is killed meanwhile nothing is left.
    async fn probe(&self) -> Result<(), ArtifactsError> {
        let folder = self.folder.clone();
        let write = move || {
            let mut file = tempfile::tempfile_in(folder)?;
            file.write_all(&[0; PROBE_BYTES])?;
            file.sync_all()
        };
        Ok(tokio::task::spawn_blocking(write).await.map_err(std::io::Error::other)??)
    }

    async fn remove(&self, prefix: &str) -> Result<(), ArtifactsError> {
        let own = Path::from(prefix);
        let paths: Vec<Path> = self.files.list(Some(&own)).map_ok(|meta| meta.location).try_collect().await?;
        for path in paths {
            match self.files.delete(&path).await {
                Ok(()) | Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        let folder = self.folder.join(prefix);
        let gone = match tokio::fs::metadata(&folder).await {
            Ok(own) if own.is_file() => tokio::fs::remove_file(&folder).await,
            _ => tokio::fs::remove_dir_all(&folder).await,
        };
        match gone {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        if let Some(job) = folder.parent().filter(|_| prefix.starts_with(ATTEMPTS)) {
            // The job's, where this was its only attempt; it fails where another is there.
            let _ = tokio::fs::remove_dir(job).await;
        }
        Ok(())
    }

    async fn leftovers(&self) -> Result<Vec<Leftover>, ArtifactsError> {
        let mut prefixes = Vec::new();
        for job in self.names(ATTEMPTS).await? {
            let own = self.names(&format!("{ATTEMPTS}/{job}")).await?;
            prefixes.extend(own.into_iter().map(|attempt| format!("{ATTEMPTS}/{job}/{attempt}")));
        }
        for root in [IMPORTS, PROBES] {
            prefixes.extend(self.names(root).await?.into_iter().map(|name| format!("{root}/{name}")));
        }
        let mut leftovers = Vec::with_capacity(prefixes.len());
        for prefix in prefixes {
            leftovers.push(self.left(prefix).await);
        }
        Ok(leftovers)
    }

    /// Removes folders of jobs without an attempt. One that an attempt is being written to is not empty, and one that is
    /// made anew meanwhile is made by the write itself.
    async fn tidy(&self) -> Result<(), ArtifactsError> {
        for job in self.names(ATTEMPTS).await? {
            // Fails where there is something in it.
            let _ = tokio::fs::remove_dir(self.folder.join(ATTEMPTS).join(job)).await;
        }
        Ok(())
    }
}

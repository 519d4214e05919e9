//! The arrays of finished maps, as files in an object store.
//!
//! An attempt writes under a prefix of its own, `attempts/JOB/ATTEMPT/`; the fenced finish names that prefix in the
//! map's row. What no row names was written by an attempt that lost its lease or died, and is swept.

use std::collections::BTreeSet;
use std::path::{Path as FilePath, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures::TryStreamExt;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutPayload};
use thiserror::Error;
use uuid::Uuid;

use super::{Records, StoreError};

#[derive(Debug, Error)]
pub enum ArtifactsError {
    #[error("the artifact store did not answer: {0}")]
    Store(#[from] object_store::Error),
    #[error("the artifact folder cannot be used: {0}")]
    Folder(#[from] std::io::Error),
    #[error(transparent)]
    Records(#[from] StoreError),
}

const ROOT: &str = "attempts";
const PROBES: &str = "probes";
/// No probe takes this long.
const PROBED: Duration = Duration::from_secs(600);

/// An object store of artifacts.
#[derive(Clone)]
pub struct Artifacts {
    store: Arc<dyn ObjectStore>,
    /// Where it is a folder. A write that a crash cut short leaves a file there that no list of objects shows.
    folder: Option<PathBuf>,
}

impl Artifacts {
    /// Artifacts as files under a folder, synced to disk before a write returns.
    pub fn in_folder(folder: &FilePath) -> Result<Self, ArtifactsError> {
        std::fs::create_dir_all(folder)?;
        let files = LocalFileSystem::new_with_prefix(folder)?.with_fsync(true).with_automatic_cleanup(true);
        Ok(Self { store: Arc::new(files), folder: Some(folder.to_owned()) })
    }

    /// The prefix of one attempt's artifacts.
    pub fn prefix(job_id: &str, attempt: i64) -> String {
        format!("{ROOT}/{job_id}/{attempt}")
    }

    pub async fn put(&self, prefix: &str, name: &str, bytes: Vec<u8>) -> Result<(), ArtifactsError> {
        self.store.put(&Path::from(format!("{prefix}/{name}")), PutPayload::from(bytes)).await?;
        Ok(())
    }

    pub async fn get(&self, prefix: &str, name: &str) -> Result<Bytes, ArtifactsError> {
        Ok(self.store.get(&Path::from(format!("{prefix}/{name}"))).await?.bytes().await?)
    }

    /// Removes everything under a prefix; what is gone already is no error.
    pub async fn remove(&self, prefix: &str) -> Result<(), ArtifactsError> {
        let paths: Vec<Path> =
            self.store.list(Some(&Path::from(prefix))).map_ok(|meta| meta.location).try_collect().await?;
        for path in paths {
            match self.store.delete(&path).await {
                Ok(()) | Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        if let Some(folder) = &self.folder {
            let folder = folder.join(prefix);
            match tokio::fs::remove_dir_all(&folder).await {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
                _ => {}
            }
            if let Some(job) = folder.parent() {
                // The job's, where this was its only attempt; it fails where another is there.
                let _ = tokio::fs::remove_dir(job).await;
            }
        }
        Ok(())
    }

    /// The attempts that left something behind, as (job, attempt).
    async fn attempts(&self) -> Result<BTreeSet<(String, i64)>, ArtifactsError> {
        let Some(folder) = &self.folder else {
            let paths: Vec<Path> =
                self.store.list(Some(&Path::from(ROOT))).map_ok(|meta| meta.location).try_collect().await?;
            let attempt = |path: &Path| {
                let parts: Vec<_> = path.parts().map(|part| part.as_ref().to_owned()).collect();
                Some((parts.get(1)?.clone(), parts.get(2)?.parse().ok()?))
            };
            return Ok(paths.iter().filter_map(attempt).collect());
        };
        let mut attempts = BTreeSet::new();
        for job in names(&folder.join(ROOT)).await? {
            let own = names(&folder.join(ROOT).join(&job)).await?;
            attempts.extend(own.iter().filter_map(|attempt| Some((job.clone(), attempt.parse().ok()?))));
        }
        Ok(attempts)
    }

    /// Removes folders of jobs without an attempt, and what probes left whose process died. A folder that an attempt
    /// is being written to is not empty, and one that is made anew meanwhile is made by the write itself.
    async fn tidy(&self) -> Result<(), ArtifactsError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        for job in names(&folder.join(ROOT)).await? {
            // Fails where there is something in it.
            let _ = tokio::fs::remove_dir(folder.join(ROOT).join(job)).await;
        }
        for name in names(&folder.join(PROBES)).await? {
            let probe = folder.join(PROBES).join(name);
            // One that ended is gone by itself meanwhile.
            let modified = tokio::fs::metadata(&probe).await.and_then(|own| own.modified());
            if modified.is_ok_and(|at| at.elapsed().is_ok_and(|age| age > PROBED)) {
                let _ = tokio::fs::remove_file(probe).await;
            }
        }
        Ok(())
    }

    /// Whether an artifact can be written: one of a few pages, and away again.
    pub async fn probe(&self) -> Result<(), ArtifactsError> {
        // A name of its own: processes of other machines, or in other containers, probe the same folder.
        let path = Path::from(format!("{PROBES}/{}", Uuid::now_v7()));
        self.store.put(&path, PutPayload::from(vec![0; 1 << 16])).await?;
        Ok(self.store.delete(&path).await?)
    }

    /// Removes what no map and no running attempt owns; how many prefixes that were.
    pub async fn sweep(&self, records: &dyn Records) -> Result<usize, ArtifactsError> {
        let mut swept = 0;
        for (job_id, attempt) in self.attempts().await? {
            let prefix = Self::prefix(&job_id, attempt);
            if !records.owns_prefix(&prefix, &job_id, attempt).await? {
                self.remove(&prefix).await?;
                swept += 1;
            }
        }
        self.tidy().await?;
        Ok(swept)
    }
}

/// The names in a folder; none where it is missing.
async fn names(folder: &FilePath) -> Result<Vec<String>, std::io::Error> {
    let mut entries = match tokio::fs::read_dir(folder).await {
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

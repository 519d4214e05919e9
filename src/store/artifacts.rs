//! The arrays of finished maps, as files in an object store.
//!
//! An attempt writes under a prefix of its own, `attempts/JOB/ATTEMPT/`; the fenced finish names that prefix in the
//! map's row. What no row names was written by an attempt that lost its lease or died, and is swept.

use std::path::Path as FilePath;
use std::sync::Arc;

use bytes::Bytes;
use futures::TryStreamExt;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutPayload};
use thiserror::Error;

use super::{JobStore, StoreError};

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

/// An object store of artifacts.
#[derive(Clone)]
pub struct Artifacts {
    store: Arc<dyn ObjectStore>,
}

impl Artifacts {
    /// Artifacts as files under a folder, synced to disk before a write returns.
    pub fn in_folder(folder: &FilePath) -> Result<Self, ArtifactsError> {
        std::fs::create_dir_all(folder)?;
        let files = LocalFileSystem::new_with_prefix(folder)?.with_fsync(true).with_automatic_cleanup(true);
        Ok(Self { store: Arc::new(files) })
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
        Ok(())
    }

    /// Removes what no map and no running attempt owns; how many prefixes that were.
    pub async fn sweep(&self, records: &dyn JobStore) -> Result<usize, ArtifactsError> {
        let paths: Vec<Path> =
            self.store.list(Some(&Path::from(ROOT))).map_ok(|meta| meta.location).try_collect().await?;
        let prefixes: std::collections::BTreeSet<(String, i64)> = paths
            .iter()
            .filter_map(|path| {
                let parts: Vec<_> = path.parts().map(|part| part.as_ref().to_owned()).collect();
                Some((parts.get(1)?.clone(), parts.get(2)?.parse().ok()?))
            })
            .collect();
        let mut swept = 0;
        for (job_id, attempt) in prefixes {
            let prefix = Self::prefix(&job_id, attempt);
            if !records.owns_prefix(&prefix, &job_id, attempt).await? {
                self.remove(&prefix).await?;
                swept += 1;
            }
        }
        Ok(swept)
    }
}

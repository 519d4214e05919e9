//! The arrays of finished maps, as files in an object store: a folder, or a bucket of S3 and its kin.
//!
//! What either promises, and who relies on it:
//!
//! - What was put is durable and whole before `put` returns; nothing is ever half there, and nothing changes afterwards.
//! - An attempt writes under a prefix of its own, `attempts/JOB/ATTEMPT-SUFFIX/`. No two claims share one, also where a job
//!   was handed back and claimed again under the same number. The fenced finish names the prefix in the map's row. What no
//!   row names was written by an attempt that lost its lease or died, and is swept.
//! - What is read is what was written: its SHA-256 is in the map's row, and is compared before anyone sees a byte. A file that
//!   differs is an error that says so.
//! - A store that is away makes errors, in bounded time. Whoever can wait tries again (an attempt that holds a finished fit);
//!   whoever asks over HTTP is told.

mod bucket;
mod folder;
mod prefix;
mod sweep;
mod uploads;

use std::path::Path as FilePath;
use std::sync::Arc;
use std::time::SystemTime;

use async_trait::async_trait;
use bytes::Bytes;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt};
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::StoreError;
use bucket::Bucket;
use folder::Folder;

/// The name of a map's file under its prefix.
pub const MAP_FILE: &str = "map.npz";

#[derive(Debug, Error)]
pub enum ArtifactsError {
    #[error("the artifact store did not answer: {0}")]
    Store(#[from] object_store::Error),
    #[error("the artifact folder cannot be used: {0}")]
    Folder(#[from] std::io::Error),
    #[error("the uploads that were begun cannot be listed: {0}")]
    Uploads(String),
    #[error("the artifact {0} is damaged: it is not what was written")]
    Damaged(String),
    #[error("{0}")]
    Address(String),
    #[error(transparent)]
    Records(#[from] StoreError),
}

/// What is peculiar to a kind of object store.
#[async_trait]
trait Backend: Send + Sync {
    fn objects(&self) -> &dyn ObjectStore;
    /// Durable and whole when it returns.
    async fn put(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError>;
    /// Whole when it returns; what a power cut takes is no loss.
    async fn put_for_now(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError> {
        self.put(path, bytes).await
    }
    /// Removes everything under a prefix; what is gone already is no error.
    async fn remove(&self, prefix: &str) -> Result<(), ArtifactsError>;
    /// What was left anywhere, finished or not.
    async fn leftovers(&self) -> Result<Vec<Leftover>, ArtifactsError>;
    /// Writes in parts that were begun and did not end.
    async fn unfinished(&self) -> Result<Vec<Unfinished>, ArtifactsError> {
        Ok(Vec::new())
    }
    async fn abort(&self, _: &Unfinished) -> Result<(), ArtifactsError> {
        Ok(())
    }
    /// Writes a few pages, to see whether it can be done, and takes them away again.
    async fn probe(&self) -> Result<(), ArtifactsError>;
    /// Removes what is of no use to anyone and under no prefix.
    async fn tidy(&self) -> Result<(), ArtifactsError> {
        Ok(())
    }
}

/// What a probe writes: a few pages.
const PROBE_BYTES: usize = 1 << 16;

/// A prefix under which something lies.
#[derive(Debug, Clone, PartialEq)]
struct Leftover {
    prefix: String,
    /// The last change of anything under it.
    modified: Option<SystemTime>,
}

/// A write in parts that was begun.
#[derive(Debug, Clone, PartialEq)]
struct Unfinished {
    prefix: String,
    begun: Option<SystemTime>,
    /// What the store knows it by.
    key: Path,
    id: String,
}

/// An object store of artifacts.
#[derive(Clone)]
pub struct Artifacts(Arc<dyn Backend>);

impl Artifacts {
    /// Artifacts as files under a folder.
    pub fn in_folder(folder: &FilePath) -> Result<Self, ArtifactsError> {
        Ok(Self(Arc::new(Folder::open(folder)?)))
    }

    /// Artifacts in a bucket, `s3://BUCKET/PREFIX`; who may do so and where it is say the usual `AWS_*` variables, which are
    /// looked for among these.
    pub fn in_bucket(url: &str, variables: impl Iterator<Item = (String, String)>) -> Result<Self, ArtifactsError> {
        Ok(Self(Arc::new(Bucket::open(url, variables)?)))
    }

    /// A new prefix for the artifacts of one attempt.
    pub fn of_attempt(job_id: &str, attempt: i64) -> String {
        prefix::of_attempt(job_id, attempt)
    }

    /// The prefix of a map's artifacts that come from a backup.
    pub fn of_import(map_id: &str) -> String {
        prefix::of_import(map_id)
    }

    pub async fn put(&self, prefix: &str, name: &str, bytes: impl Into<Bytes>) -> Result<(), ArtifactsError> {
        self.0.put(&Path::from(format!("{prefix}/{name}")), bytes.into()).await
    }

    /// Puts what is of use for as long as whoever waits for it, and need not outlive the machine.
    pub async fn put_for_now(&self, prefix: &str, name: &str, bytes: impl Into<Bytes>) -> Result<(), ArtifactsError> {
        self.0.put_for_now(&Path::from(format!("{prefix}/{name}")), bytes.into()).await
    }

    /// An artifact whose SHA-256 (hex) is this, where that is known.
    pub async fn get(&self, prefix: &str, name: &str, sha256: Option<&str>) -> Result<Bytes, ArtifactsError> {
        let path = Path::from(format!("{prefix}/{name}"));
        let bytes = self.0.objects().get(&path).await?.bytes().await?;
        let Some(expected) = sha256.map(str::to_owned) else { return Ok(bytes) };
        let digest = {
            let bytes = bytes.clone();
            tokio::task::spawn_blocking(move || hex::encode(Sha256::digest(&bytes)))
        };
        match digest.await {
            Ok(found) if found == expected => Ok(bytes),
            _ => Err(ArtifactsError::Damaged(path.to_string())),
        }
    }

    /// Removes everything under a prefix; what is gone already is no error.
    pub async fn remove(&self, prefix: &str) -> Result<(), ArtifactsError> {
        self.0.remove(prefix).await
    }

    /// Whether an artifact can be written.
    pub async fn probe(&self) -> Result<(), ArtifactsError> {
        self.0.probe().await
    }
}

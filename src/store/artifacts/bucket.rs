//! A bucket of S3 or its kin as an object store.
//!
//! A small object is put on the condition that there is none of its name: the prefix is the attempt's own, so one that is there
//! is this very one, of a try whose answer was lost, or somebody else's, which is not written over. A large one goes up in
//! parts, and is there once the last is. Everything is sent with its SHA-256, which the server holds against what arrives.
//!
//! Every request is bounded: a server that is gone, or says nothing, is an error within seconds.

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use bytes::Bytes;
use futures::{StreamExt, TryStreamExt, stream};
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey, Checksum};
use object_store::multipart::MultipartStore;
use object_store::path::Path;
use object_store::prefix::PrefixStore;
use object_store::{
    BackoffConfig, ClientConfigKey, Error, MultipartUpload, ObjectStore, ObjectStoreExt, PutMode, PutPayload,
    RetryConfig,
};
use uuid::Uuid;

use super::prefix::{self, ROOTS};
use super::uploads::{Upload, Uploads};
use super::{ArtifactsError, Backend, Leftover, PROBE_BYTES, Unfinished};

/// What is larger goes up in parts of this size, so many at once.
const PART: usize = 16 << 20;
const PARTS_AT_ONCE: usize = 4;
/// How long connecting may take, and how long a server may say nothing.
const CONNECTED_WITHIN: &str = "2s";
const HEARD_WITHIN: &str = "10s";
/// Of one request with its body. The largest is a map that is read whole.
const DONE_WITHIN: &str = "300s";
/// A request is tried again so often, and no more after this time.
const TRIES_AGAIN: usize = 3;
const TRIED_FOR: Duration = Duration::from_secs(10);

pub(super) struct Bucket {
    bucket: AmazonS3,
    /// The same, under the prefix that is ours.
    objects: PrefixStore<AmazonS3>,
    prefix: Path,
    uploads: Uploads,
}

impl Bucket {
    /// A bucket by its address, `s3://BUCKET/PREFIX`. Nothing is asked of it yet.
    pub fn open(url: &str, variables: impl Iterator<Item = (String, String)>) -> Result<Self, ArtifactsError> {
        let (bucket, prefix) = address(url)?;
        let mut builder = AmazonS3Builder::new();
        for (name, value) in variables.filter(|(name, _)| name.starts_with("AWS_")) {
            // Others mean other programs.
            if let Ok(key) = name.to_ascii_lowercase().parse() {
                builder = builder.with_config(key, value);
            }
        }
        builder = builder.with_bucket_name(bucket).with_retry(RetryConfig {
            max_retries: TRIES_AGAIN,
            retry_timeout: TRIED_FOR,
            backoff: BackoffConfig {
                init_backoff: Duration::from_millis(100),
                max_backoff: Duration::from_secs(1),
                base: 2.0,
            },
        });
        for (key, usual) in [
            (ClientConfigKey::ConnectTimeout, CONNECTED_WITHIN),
            (ClientConfigKey::ReadTimeout, HEARD_WITHIN),
            (ClientConfigKey::Timeout, DONE_WITHIN),
        ] {
            builder = builder.with_config(AmazonS3ConfigKey::Client(key), usual);
        }
        if builder.get_config_value(&AmazonS3ConfigKey::Checksum).is_none() {
            builder = builder.with_checksum_algorithm(Checksum::SHA256);
        }
        // Of the process, once; another's that is there already is as good.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let bucket = builder.build()?;
        let objects = PrefixStore::new(bucket.clone(), prefix.clone());
        Ok(Self { uploads: Uploads::of(bucket.clone())?, bucket, objects, prefix })
    }

    async fn put_once(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError> {
        let payload = PutPayload::from(bytes.clone());
        match self.objects.put_opts(path, payload.clone(), PutMode::Create.into()).await {
            Ok(_) => Ok(()),
            Err(error @ Error::AlreadyExists { .. }) => {
                let there = self.objects.get(path).await?.bytes().await?;
                if there == bytes { Ok(()) } else { Err(error.into()) }
            }
            // AWS_CONDITIONAL_PUT=disabled, for servers that know no conditions.
            Err(Error::NotImplemented { .. }) => {
                self.objects.put(path, payload).await?;
                Ok(())
            }
            Err(error) => Err(error.into()),
        }
    }

    async fn put_in_parts(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError> {
        let mut upload = self.objects.put_multipart(path).await?;
        match send(&mut *upload, bytes).await {
            Ok(()) => Ok(()),
            Err(error) => {
                // Where this fails, too, it is swept.
                let _ = upload.abort().await;
                Err(error.into())
            }
        }
    }
}

async fn send(upload: &mut dyn MultipartUpload, bytes: Bytes) -> Result<(), Error> {
    let starts = (0..bytes.len()).step_by(PART);
    // In order, for that is how parts are numbered; a part is not sent before it is polled.
    let parts: Vec<_> = starts
        .map(|start| upload.put_part(PutPayload::from(bytes.slice(start..bytes.len().min(start + PART)))))
        .collect();
    stream::iter(parts).buffer_unordered(PARTS_AT_ONCE).try_collect::<()>().await?;
    upload.complete().await?;
    Ok(())
}

/// The bucket and the prefix of an address.
fn address(url: &str) -> Result<(&str, Path), ArtifactsError> {
    let rest = url.strip_prefix("s3://").unwrap_or_default();
    let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
    let prefix = Path::parse(prefix.trim_end_matches('/')).ok().filter(|_| bucket.len() >= 3);
    let prefix = prefix.ok_or_else(|| ArtifactsError::Address(format!("{url} is not s3://BUCKET/PREFIX")))?;
    Ok((bucket, prefix))
}

#[async_trait]
impl Backend for Bucket {
    fn objects(&self) -> &dyn ObjectStore {
        &self.objects
    }

    async fn put(&self, path: &Path, bytes: Bytes) -> Result<(), ArtifactsError> {
        if bytes.len() <= PART { self.put_once(path, bytes).await } else { self.put_in_parts(path, bytes).await }
    }

    /// Under a name of its own: processes of other machines probe the same bucket.
    async fn probe(&self) -> Result<(), ArtifactsError> {
        let path = Path::from(prefix::of_probe(&Uuid::now_v7()));
        self.objects.put(&path, PutPayload::from(vec![0; PROBE_BYTES])).await?;
        Ok(self.objects.delete(&path).await?)
    }

    async fn remove(&self, prefix: &str) -> Result<(), ArtifactsError> {
        let own = Path::from(prefix);
        let mut paths: Vec<Path> = self.objects.list(Some(&own)).map_ok(|meta| meta.location).try_collect().await?;
        // A list is of what lies under a prefix; a probe is the prefix itself.
        if paths.is_empty() {
            paths.push(own);
        }
        for path in paths {
            match self.objects.delete(&path).await {
                Ok(()) | Err(Error::NotFound { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    async fn leftovers(&self) -> Result<Vec<Leftover>, ArtifactsError> {
        let mut found: BTreeMap<String, SystemTime> = BTreeMap::new();
        for root in ROOTS {
            let root = Path::from(root);
            let mut objects = self.objects.list(Some(&root));
            while let Some(object) = objects.try_next().await? {
                let Some(prefix) = prefix::of_path(object.location.as_ref()) else { continue };
                let modified = SystemTime::from(object.last_modified);
                found.entry(prefix).and_modify(|latest| *latest = modified.max(*latest)).or_insert(modified);
            }
        }
        let left = |(prefix, modified)| Leftover { prefix, modified: Some(modified) };
        Ok(found.into_iter().map(left).collect())
    }

    async fn unfinished(&self) -> Result<Vec<Unfinished>, ArtifactsError> {
        let ours = |upload: Upload| {
            let key = Path::from(upload.key);
            let own: Path = key.prefix_match(&self.prefix)?.collect();
            Some(Unfinished { prefix: prefix::of_path(own.as_ref())?, begun: upload.begun, key, id: upload.id })
        };
        Ok(self.uploads.begun(&self.prefix).await?.into_iter().filter_map(ours).collect())
    }

    async fn abort(&self, upload: &Unfinished) -> Result<(), ArtifactsError> {
        match self.bucket.abort_multipart(&upload.key, &upload.id).await {
            Ok(()) | Err(Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_bucket_and_a_prefix() {
        let parts = |url| address(url).map(|(bucket, prefix)| (bucket.to_owned(), prefix.to_string())).ok();
        let pair = |bucket: &str, prefix: &str| Some((bucket.to_owned(), prefix.to_owned()));
        assert_eq!(parts("s3://maps"), pair("maps", ""));
        assert_eq!(parts("s3://maps/a/b/"), pair("maps", "a/b"));
        for wrong in ["maps", "s3://", "s3://ab/x", "https://maps/x", "s3://maps/a//x", "s3://maps/../x"] {
            assert_eq!(parts(wrong), None, "{wrong}");
        }
    }
}

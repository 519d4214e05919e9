//! Uploads in parts that were begun and did not end: a process that dies in the middle of one leaves parts that take space,
//! and that no list of objects shows. S3 lists them (ListMultipartUploads), object_store does not: so the request is
//! signed by it, and made and read here.

use std::time::{Duration, SystemTime};

use object_store::aws::AmazonS3;
use object_store::path::Path;
use object_store::signer::{SignedUrlOptions, Signer};
use serde::Deserialize;

use super::ArtifactsError;

/// How long a signature holds, and an answer may take.
const WITHIN: Duration = Duration::from_secs(30);
const CONNECTED_WITHIN: Duration = Duration::from_secs(2);
/// Answers of a thousand uploads each that are asked for in one sweep.
const PAGES: usize = 100;

pub(super) struct Uploads {
    bucket: AmazonS3,
    client: reqwest::Client,
}

/// An upload that was begun.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Upload {
    /// From the bucket's root.
    pub key: String,
    pub id: String,
    pub begun: Option<SystemTime>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Page {
    #[serde(default)]
    upload: Vec<Listed>,
    #[serde(default)]
    is_truncated: bool,
    next_key_marker: Option<String>,
    next_upload_id_marker: Option<String>,
}

#[derive(Debug, Deserialize)]
struct Listed {
    #[serde(rename = "Key")]
    key: String,
    #[serde(rename = "UploadId")]
    id: String,
    #[serde(rename = "Initiated")]
    begun: Option<String>,
}

impl Uploads {
    pub fn of(bucket: AmazonS3) -> Result<Self, ArtifactsError> {
        let client = reqwest::Client::builder().connect_timeout(CONNECTED_WITHIN).timeout(WITHIN).build();
        Ok(Self { bucket, client: client.map_err(unlisted)? })
    }

    /// Those under a prefix.
    pub async fn begun(&self, prefix: &Path) -> Result<Vec<Upload>, ArtifactsError> {
        let mut uploads = Vec::new();
        let mut after: Vec<(&str, String)> = Vec::new();
        for _ in 0..PAGES {
            let own = [("uploads", String::new()), ("prefix", prefix.to_string())];
            let query = SignedUrlOptions::new().with_query(own.into_iter().chain(after));
            let url = self.bucket.signed_url_opts(reqwest::Method::GET, &Path::default(), WITHIN, &query).await?;
            let answer = self.client.get(url).send().await.and_then(reqwest::Response::error_for_status);
            let page = read(&answer.map_err(unlisted)?.text().await.map_err(unlisted)?)?;
            uploads.extend(page.upload.into_iter().map(|listed| Upload {
                begun: listed.begun.and_then(|at| at.parse::<jiff::Timestamp>().ok()).map(SystemTime::from),
                key: listed.key,
                id: listed.id,
            }));
            let next = page.next_key_marker.filter(|marker| page.is_truncated && !marker.is_empty());
            let Some(key) = next else { break };
            after = vec![("key-marker", key), ("upload-id-marker", page.next_upload_id_marker.unwrap_or_default())];
        }
        Ok(uploads)
    }
}

fn read(xml: &str) -> Result<Page, ArtifactsError> {
    quick_xml::de::from_str(xml).map_err(unlisted)
}

/// Without the address: it is signed.
fn unlisted(error: impl Into<Unlisted>) -> ArtifactsError {
    ArtifactsError::Uploads(error.into().0)
}

struct Unlisted(String);

impl From<reqwest::Error> for Unlisted {
    fn from(error: reqwest::Error) -> Self {
        Self(error.without_url().to_string())
    }
}

impl From<quick_xml::DeError> for Unlisted {
    fn from(error: quick_xml::DeError) -> Self {
        Self(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_read() {
        let page = read(
            r#"<?xml version="1.0" encoding="UTF-8"?>
            <ListMultipartUploadsResult xmlns="http://s3.amazonaws.com/doc/2006-03-01/"><Bucket>maps</Bucket>
            <KeyMarker></KeyMarker><NextKeyMarker>b</NextKeyMarker><IsTruncated>true</IsTruncated>
            <Upload><Key>a&amp;b</Key><UploadId>1</UploadId><Initiated>2026-11-26T10:00:00.000Z</Initiated></Upload>
            <Upload><Key>b</Key><UploadId>2</UploadId></Upload></ListMultipartUploadsResult>"#,
        )
        .unwrap();
        assert_eq!((page.upload.len(), &page.upload[0].key[..], page.is_truncated), (2, "a&b", true));
        assert_eq!(page.next_key_marker.as_deref(), Some("b"));
        assert!(read("<ListMultipartUploadsResult/>").unwrap().upload.is_empty());
        assert!(read("not found").is_err());
    }
}

//! What a submission brings, whichever way it came.

use bytes::Bytes;
use sha2::{Digest, Sha256};

/// A job's JSON, and what tells one submission from another.
pub struct Document {
    pub json: Bytes,
    /// Of what the client sent: a repeat with the same idempotency key has the same.
    pub digest: String,
    /// What the client should know of how the job came about.
    pub message: Option<String>,
}

impl Document {
    /// Of a body that is the job.
    pub fn of(json: Bytes) -> Self {
        Self { digest: hex::encode(Sha256::digest(&json)), json, message: None }
    }
}

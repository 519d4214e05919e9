//! What nobody owns goes.
//!
//! An attempt's artifacts are its own while it runs and its map's for good. Those of an import are there before their map's row,
//! so they are left alone for a day; what probes leave whose process died, for some minutes.

use std::time::{Duration, SystemTime};

use super::prefix::{Owner, owner};
use super::{Artifacts, ArtifactsError};
use crate::store::Records;

/// No import lies without its row for as long.
const IMPORTED: Duration = Duration::from_secs(24 * 3600);
/// No probe takes this long.
const PROBED: Duration = Duration::from_secs(600);

impl Artifacts {
    /// Removes what no map and no running attempt owns; how many prefixes that were.
    pub async fn sweep(&self, records: &dyn Records) -> Result<usize, ArtifactsError> {
        let mut swept = 0;
        for left in self.0.leftovers().await? {
            if is_abandoned(records, &left.prefix, left.modified).await? {
                self.0.remove(&left.prefix).await?;
                // A probe is no artifact.
                swept += usize::from(owner(&left.prefix) != Some(Owner::Probe));
            }
        }
        for upload in self.0.unfinished().await? {
            if is_abandoned(records, &upload.prefix, upload.begun).await? {
                self.0.abort(&upload).await?;
                swept += 1;
            }
        }
        self.0.tidy().await?;
        Ok(swept)
    }
}

/// Whether nobody needs what lies under a prefix.
async fn is_abandoned(
    records: &dyn Records,
    prefix: &str,
    modified: Option<SystemTime>,
) -> Result<bool, ArtifactsError> {
    let older = |age: Duration| modified.is_some_and(|at| at.elapsed().is_ok_and(|elapsed| elapsed > age));
    // No job is of no name, so that only a map's row counts.
    let (job_id, attempt) = match owner(prefix) {
        None => return Ok(false),
        Some(Owner::Probe) => return Ok(older(PROBED)),
        Some(Owner::Import) if !older(IMPORTED) => return Ok(false),
        Some(Owner::Import) => (String::new(), 0),
        Some(Owner::Attempt { job_id, attempt }) => (job_id, attempt),
    };
    Ok(!records.owns_prefix(prefix, &job_id, attempt).await?)
}

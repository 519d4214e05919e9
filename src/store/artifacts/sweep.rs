//! What nobody owns goes.
//!
//! An attempt's artifacts are its own while it runs and its map's for good. Those of an import are there before their map's row,
//! so they are left alone for a day; what probes leave whose process died, for some minutes.

use std::time::{Duration, SystemTime};

use super::prefix::{Owner, owner};
use super::{Artifacts, ArtifactsError};
use crate::store::{Records, Written};

/// No import lies without its row for as long.
const IMPORTED: Duration = Duration::from_secs(24 * 3600);
/// No probe takes this long.
const PROBED: Duration = Duration::from_secs(600);
/// Prefixes that the database is asked about at once.
const ASKED: usize = 500;

impl Artifacts {
    /// Removes what no map and no running attempt owns; how many prefixes that were.
    pub async fn sweep(&self, records: &dyn Records) -> Result<usize, ArtifactsError> {
        let mut swept = 0;
        for some in self.0.leftovers().await?.chunks(ASKED) {
            let left = some.iter().map(|left| (&left.prefix[..], left.modified));
            for (left, _) in some.iter().zip(abandoned(records, left).await?).filter(|(_, abandoned)| *abandoned) {
                self.0.remove(&left.prefix).await?;
                // A probe is no artifact.
                swept += usize::from(owner(&left.prefix) != Some(Owner::Probe));
            }
        }
        for some in self.0.unfinished().await?.chunks(ASKED) {
            let begun = some.iter().map(|upload| (&upload.prefix[..], upload.begun));
            for (upload, _) in some.iter().zip(abandoned(records, begun).await?).filter(|(_, abandoned)| *abandoned) {
                self.0.abort(upload).await?;
                swept += 1;
            }
        }
        self.0.tidy().await?;
        Ok(swept)
    }
}

/// What is known of a prefix without the database.
enum Known {
    Abandoned,
    Kept,
    /// Unless somebody owns it.
    Perhaps(Written),
}

fn known(prefix: &str, modified: Option<SystemTime>) -> Known {
    let older = |age: Duration| modified.is_some_and(|at| at.elapsed().is_ok_and(|elapsed| elapsed > age));
    let written = |job_id, attempt| Known::Perhaps(Written { prefix: prefix.to_owned(), job_id, attempt });
    match owner(prefix) {
        Some(Owner::Probe) if older(PROBED) => Known::Abandoned,
        // No job is of no name, so that only a map's row counts.
        Some(Owner::Import) if older(IMPORTED) => written(String::new(), 0),
        None | Some(Owner::Probe | Owner::Import) => Known::Kept,
        Some(Owner::Attempt { job_id, attempt }) => written(job_id, attempt),
    }
}

/// Of each prefix, with the last change under it, whether nobody needs what lies there.
async fn abandoned(
    records: &dyn Records,
    left: impl Iterator<Item = (&str, Option<SystemTime>)>,
) -> Result<Vec<bool>, ArtifactsError> {
    let known: Vec<Known> = left.map(|(prefix, modified)| known(prefix, modified)).collect();
    let perhaps = |known: &Known| match known {
        Known::Perhaps(written) => Some(written.clone()),
        _ => None,
    };
    let asked: Vec<Written> = known.iter().filter_map(perhaps).collect();
    let owned = if asked.is_empty() { Vec::new() } else { records.owned(&asked).await? };
    // Whatever had no answer is kept.
    let mut owned = owned.into_iter();
    let judged = known.iter().map(|known| match known {
        Known::Abandoned => true,
        Known::Kept => false,
        Known::Perhaps(_) => owned.next() == Some(false),
    });
    Ok(judged.collect())
}

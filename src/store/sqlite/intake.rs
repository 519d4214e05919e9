//! Submissions, committed together: whoever waits for the disk waits for it once.
//!
//! A commit ends when the disk has it, and takes as long for one row as for a hundred. So submissions that come while the
//! writer is busy, most often with the commit before, are gathered and committed as one transaction (group commit: DeWitt
//! et al., SIGMOD 1984); each is answered after that commit, not before. Whoever comes first begins a gathering, and does
//! not wait for others: a submission that comes alone is committed alone, at once.
//!
//! A group is one transaction for its quotas and its idempotency keys, too: each of its submissions sees those before it.
//! Where anything in it fails nothing of it is kept, and each is tried in a transaction of its own: one that cannot be kept
//! fails by itself, with its own error.

use std::sync::{Arc, Mutex, PoisonError};

use futures::future::join_all;
use sqlx::sqlite::SqlitePool;
use sqlx::{Sqlite, Transaction};
use tokio::sync::oneshot;

use super::board::enter;
use crate::store::{NewJob, StoreError, Submission};

/// Submissions in one transaction at most: others wait for the writer, too.
const MOST: usize = 256;

type Outcome = Result<Submission, StoreError>;

/// See the module.
pub(super) struct Intake {
    writer: SqlitePool,
    waiting: Mutex<Vec<Waiting>>,
}

struct Waiting {
    job: NewJob,
    tell: oneshot::Sender<Outcome>,
}

impl Intake {
    pub fn new(writer: SqlitePool) -> Arc<Self> {
        Arc::new(Self { writer, waiting: Mutex::default() })
    }

    /// Resolves once the job is committed, or will not be.
    pub async fn submit(self: &Arc<Self>, job: NewJob) -> Outcome {
        let (tell, told) = oneshot::channel();
        let is_first = {
            let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            waiting.push(Waiting { job, tell });
            waiting.len() == 1
        };
        if is_first {
            // A task, so that a client that leaves takes nobody else's submission with it.
            tokio::spawn(self.clone().gather());
        }
        told.await.unwrap_or_else(|_| Err(sqlx::Error::WorkerCrashed.into()))
    }

    /// Commits all who wait once the writer is free. Whoever comes after they were taken begins another gathering.
    async fn gather(self: Arc<Self>) {
        loop {
            let begun = self.writer.begin_with("BEGIN IMMEDIATE").await;
            let (group, is_last) = self.taken();
            let kept = match begun {
                Ok(tx) => together(tx, &group).await,
                Err(error) => Err(error.into()),
            };
            match kept {
                Ok(outcomes) => {
                    for (one, outcome) in group.into_iter().zip(outcomes) {
                        // Its client may have left: the job is accepted.
                        let _ = one.tell.send(Ok(outcome));
                    }
                }
                Err(error) => self.apart(group, error).await,
            }
            if is_last {
                return;
            }
        }
    }

    /// Those who wait, and whether nobody is left behind. Who has left is not kept.
    fn taken(&self) -> (Vec<Waiting>, bool) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let count = waiting.len().min(MOST);
        let group = waiting.drain(..count).filter(|one| !one.tell.is_closed()).collect();
        (group, waiting.is_empty())
    }

    /// Each by itself, after they failed together.
    async fn apart(&self, mut group: Vec<Waiting>, error: StoreError) {
        if group.len() == 1 {
            if let Some(one) = group.pop() {
                let _ = one.tell.send(Err(error));
            }
            return;
        }
        tracing::debug!(%error, count = group.len(), "submissions could not be committed together");
        let alone = |one: Waiting| async move {
            let outcome = self.alone(&one.job).await;
            let _ = one.tell.send(outcome);
        };
        join_all(group.into_iter().map(alone)).await;
    }

    async fn alone(&self, job: &NewJob) -> Outcome {
        let mut tx = self.writer.begin_with("BEGIN IMMEDIATE").await?;
        let outcome = enter(&mut tx, job).await?;
        tx.commit().await?;
        Ok(outcome)
    }
}

async fn together(mut tx: Transaction<'static, Sqlite>, group: &[Waiting]) -> Result<Vec<Submission>, StoreError> {
    let mut outcomes = Vec::with_capacity(group.len());
    for one in group {
        outcomes.push(enter(&mut tx, &one.job).await?);
    }
    tx.commit().await?;
    Ok(outcomes)
}

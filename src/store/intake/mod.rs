//! Submissions, committed together: whoever waits for the disk waits for it once.
//!
//! A commit ends when the disk has it, and takes as long for one row as for a hundred. So submissions that come while the
//! ledger is busy, most often with the commit before, are gathered and committed as one transaction (group commit: DeWitt
//! et al., SIGMOD 1984); each is answered after that commit, not before. Whoever comes first begins a gathering, and does
//! not wait for others: a submission that comes alone is committed alone, at once.
//!
//! A group is one transaction for its quotas and its idempotency keys, too: each of its submissions sees those before it
//! ([`group`]). Where anything in it fails nothing of it is kept, and each is tried in a transaction of its own: one that
//! cannot be kept fails by itself, with its own error. Each database is a [`Ledger`]; it writes a group in as many statements as
//! it takes for one submission.

pub mod group;

use std::slice::from_ref;
use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use futures::future::join_all;
use tokio::sync::oneshot;

use super::{NewJob, StoreError, Submission};

/// Submissions in one transaction at most: others wait for the ledger, too.
const MOST: usize = 128;

type Outcome = Result<Submission, StoreError>;

/// A database in which submissions are entered.
#[async_trait]
pub trait Ledger: Send + Sync + 'static {
    /// The right to write. Whoever waits for it is in the next group.
    type Turn: Send;

    async fn turn(&self) -> Result<Self::Turn, StoreError>;

    /// Enters all of a group, or none: what each comes to, in their order. They are committed when it returns.
    async fn enter(&self, turn: Self::Turn, group: &[NewJob]) -> Result<Vec<Submission>, StoreError>;
}

/// See the module.
pub struct Intake<L> {
    ledger: L,
    waiting: Mutex<Vec<Waiting>>,
}

struct Waiting {
    job: NewJob,
    tell: oneshot::Sender<Outcome>,
}

impl<L: Ledger> Intake<L> {
    pub fn new(ledger: L) -> Arc<Self> {
        Arc::new(Self { ledger, waiting: Mutex::default() })
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

    /// Commits all who wait once it is their turn. Whoever comes after they were taken begins another gathering.
    async fn gather(self: Arc<Self>) {
        loop {
            let turn = self.ledger.turn().await;
            let (jobs, tells, is_last) = self.taken();
            let kept = match turn {
                Ok(turn) => self.ledger.enter(turn, &jobs).await,
                Err(error) => Err(error),
            };
            match kept {
                Ok(outcomes) => {
                    for (tell, outcome) in tells.into_iter().zip(outcomes) {
                        // Its client may have left: the job is accepted.
                        let _ = tell.send(Ok(outcome));
                    }
                }
                Err(error) => self.apart(jobs, tells, error).await,
            }
            if is_last {
                return;
            }
        }
    }

    /// Those who wait, and whether nobody is left behind. Who has left is not kept.
    fn taken(&self) -> (Vec<NewJob>, Vec<oneshot::Sender<Outcome>>, bool) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let count = waiting.len().min(MOST);
        let group = waiting.drain(..count).filter(|one| !one.tell.is_closed()).map(|one| (one.job, one.tell));
        let (jobs, tells) = group.unzip();
        (jobs, tells, waiting.is_empty())
    }

    /// Each by itself, after they failed together.
    async fn apart(&self, jobs: Vec<NewJob>, mut tells: Vec<oneshot::Sender<Outcome>>, error: StoreError) {
        if jobs.len() == 1 {
            if let Some(tell) = tells.pop() {
                let _ = tell.send(Err(error));
            }
            return;
        }
        tracing::debug!(%error, count = jobs.len(), "submissions could not be committed together");
        let alone = jobs.iter().zip(tells).map(|(job, tell)| async move {
            let outcome = self.alone(job).await;
            let _ = tell.send(outcome);
        });
        join_all(alone).await;
    }

    async fn alone(&self, job: &NewJob) -> Outcome {
        let turn = self.ledger.turn().await?;
        let outcome = self.ledger.enter(turn, from_ref(job)).await?.pop();
        outcome.ok_or_else(|| sqlx::Error::RowNotFound.into())
    }
}

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
use tokio::sync::oneshot;

use super::{NewJob, StoreError, Submission};

/// Submissions in one transaction at most: others wait for the ledger, too.
const MOST: usize = 128;

type Outcome = Result<Submission, StoreError>;
type Tell = oneshot::Sender<Outcome>;

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
    tell: Tell,
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
            match turn {
                Ok(turn) => self.enter(turn, jobs, tells).await,
                Err(error) => refuse(tells, error),
            }
            if is_last {
                return;
            }
        }
    }

    async fn enter(&self, turn: L::Turn, jobs: Vec<NewJob>, tells: Vec<Tell>) {
        match self.ledger.enter(turn, &jobs).await {
            Ok(outcomes) => {
                for (tell, outcome) in tells.into_iter().zip(outcomes) {
                    // Its client may have left: the job is accepted.
                    let _ = tell.send(Ok(outcome));
                }
            }
            Err(error) if jobs.len() == 1 => refuse(tells, error),
            Err(error) => {
                tracing::debug!(%error, count = jobs.len(), "submissions could not be committed together");
                self.apart(jobs, tells).await;
            }
        }
    }

    /// Each by itself, after they failed together. Where there is no turn to be had there is none for those behind, either:
    /// nobody waits for a database once for everyone before him.
    async fn apart(&self, jobs: Vec<NewJob>, tells: Vec<Tell>) {
        let mut tells = tells.into_iter();
        for job in &jobs {
            let turn = match self.ledger.turn().await {
                Ok(turn) => turn,
                Err(error) => return refuse(tells, error),
            };
            let outcome = self.ledger.enter(turn, from_ref(job)).await;
            let outcome = outcome.and_then(|mut own| own.pop().ok_or_else(|| sqlx::Error::RowNotFound.into()));
            if let Some(tell) = tells.next() {
                let _ = tell.send(outcome);
            }
        }
    }

    /// Those who wait, and whether nobody is left behind. Who has left is not kept.
    fn taken(&self) -> (Vec<NewJob>, Vec<Tell>, bool) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let count = waiting.len().min(MOST);
        let group = waiting.drain(..count).filter(|one| !one.tell.is_closed()).map(|one| (one.job, one.tell));
        let (jobs, tells) = group.unzip();
        (jobs, tells, waiting.is_empty())
    }
}

/// Tells all of them that nothing of theirs was kept. An error is one's own; the others hear that the database did not answer.
fn refuse(tells: impl IntoIterator<Item = Tell>, error: StoreError) {
    let mut error = Some(error);
    for tell in tells {
        let _ = tell.send(Err(error.take().unwrap_or_else(|| sqlx::Error::PoolTimedOut.into())));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    use futures::future::join_all;

    use super::group::tests::new;
    use super::*;

    /// Takes nothing of a group in which somebody is called bad; with `closed` it gives no turns.
    #[derive(Default)]
    struct Fake {
        closed: bool,
        turns: AtomicUsize,
    }

    #[async_trait]
    impl Ledger for Arc<Fake> {
        type Turn = ();

        async fn turn(&self) -> Result<(), StoreError> {
            self.turns.fetch_add(1, Ordering::Relaxed);
            // Others come meanwhile.
            tokio::time::sleep(Duration::from_millis(20)).await;
            if self.closed { Err(sqlx::Error::PoolTimedOut.into()) } else { Ok(()) }
        }

        async fn enter(&self, _: (), group: &[NewJob]) -> Result<Vec<Submission>, StoreError> {
            match group.iter().any(|new| new.tenant == "bad") {
                true => Err(sqlx::Error::RowNotFound.into()),
                false => Ok(group.iter().map(|_| Submission::KeyReused).collect()),
            }
        }
    }

    async fn outcomes(ledger: &Arc<Fake>, tenants: &[&str]) -> Vec<bool> {
        let intake = Intake::new(ledger.clone());
        let submit = |tenant: &&str| {
            let (intake, job) = (intake.clone(), new(tenant, None, 9));
            async move { intake.submit(job).await.is_ok() }
        };
        join_all(tenants.iter().map(submit)).await
    }

    #[tokio::test]
    async fn who_comes_together_is_entered_together() {
        let ledger = Arc::new(Fake::default());
        assert_eq!(outcomes(&ledger, &["a"; 50]).await, [true; 50]);
        assert_eq!(ledger.turns.load(Ordering::Relaxed), 1);
    }

    #[tokio::test]
    async fn who_cannot_be_kept_fails_by_itself() {
        let ledger = Arc::new(Fake::default());
        assert_eq!(outcomes(&ledger, &["a", "bad", "a", "b"]).await, [true, false, true, true]);
    }

    #[tokio::test]
    async fn nobody_waits_for_a_database_that_is_away_once_for_each_before_him() {
        let ledger = Arc::new(Fake { closed: true, ..Fake::default() });
        assert_eq!(outcomes(&ledger, &["a"; 50]).await, [false; 50]);
        assert_eq!(ledger.turns.load(Ordering::Relaxed), 1);
    }
}

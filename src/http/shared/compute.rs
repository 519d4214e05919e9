//! Work that takes milliseconds or more: off the threads that answer, a bounded number at a time, and only while somebody
//! waits for it. What takes longer shares the cores with fits, and makes way for what does not.
//!
//! Whoever waits for a turn holds nothing large: maps and kept requests are read within it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};

use super::problem::Problem;
use crate::worker::in_background;

/// Which work waits for which: a submission never waits for a map's answers, nor a small answer for heavy ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Queue {
    /// Small requests being read, and small questions answered: milliseconds.
    Small,
    /// Requests being read that are large, or may be once they are unpacked.
    Requests,
    /// Maps being loaded: a store that is slow keeps nobody from maps that are there.
    Loading,
    /// Answers made from maps' arrays.
    Answers,
    /// Answers that form a fit's factors anew: seconds, and much memory, so one at a time.
    Heavy,
}

/// Bounds on how much is computed at once.
pub struct Compute {
    small: Arc<Semaphore>,
    requests: Arc<Semaphore>,
    loading: Arc<Semaphore>,
    answers: Arc<Semaphore>,
    heavy: Arc<Semaphore>,
    /// How long an answer may take, from the moment it is asked for.
    patience: Duration,
}

/// Whether work should go on: its client still waits, and its time is not up.
#[derive(Debug, Clone)]
pub struct Leash {
    left: Arc<AtomicBool>,
    until: Instant,
}

impl Leash {
    pub fn holds(&self) -> bool {
        !self.left.load(Ordering::Relaxed) && Instant::now() < self.until
    }

    /// Between two steps of an answer: whether to take the next.
    pub fn goes_on(&self) -> Result<(), Problem> {
        if self.holds() { Ok(()) } else { Err(Problem::too_slow()) }
    }
}

/// Work that tells what came of it.
type Task = Box<dyn FnOnce(&Leash) + Send>;

/// A place among those who compute. It is free again when this is dropped and all that was begun in it has ended: a
/// client that leaves does not make room for another while its work still runs.
pub struct Turn {
    queue: Queue,
    permit: Arc<OwnedSemaphorePermit>,
    leash: Leash,
    _waiting: Waiting,
}

/// Lives as long as the client waits.
struct Waiting(Arc<AtomicBool>);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Compute {
    /// Bounds for this machine. `patience` is how long an answer may take.
    pub fn new(patience: Duration) -> Self {
        let cores = std::thread::available_parallelism().map_or(2, |n| n.get());
        let permits = |count| Arc::new(Semaphore::new(count));
        let [small, requests, loading, answers] = [cores; 4].map(permits);
        Self { small, requests, loading, answers, heavy: permits(1), patience }
    }

    /// Runs work when its turn comes. It is told by a [`Leash`] whether to go on; past its time the answer is 503.
    pub async fn run<T: Send + 'static>(
        &self,
        queue: Queue,
        work: impl FnOnce(&Leash) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        self.turn(queue).await?.run(work).await
    }

    /// When the time of what is asked for now will be up.
    pub fn until(&self) -> Instant {
        Instant::now() + self.patience
    }

    /// A turn, when it comes; 503 where that takes longer than an answer may.
    pub async fn turn(&self, queue: Queue) -> Result<Turn, Problem> {
        self.turn_by(queue, self.until()).await
    }

    /// The same of a request whose time is counted already.
    pub async fn turn_by(&self, queue: Queue, until: Instant) -> Result<Turn, Problem> {
        let permits = match queue {
            Queue::Small => &self.small,
            Queue::Requests => &self.requests,
            Queue::Loading => &self.loading,
            Queue::Answers => &self.answers,
            Queue::Heavy => &self.heavy,
        };
        let leash = Leash { left: Arc::default(), until };
        let _waiting = Waiting(leash.left.clone());
        // The semaphores are never closed, so a permit always comes.
        let permit = tokio::time::timeout_at(leash.until.into(), permits.clone().acquire_owned()).await;
        let permit = permit.ok().and_then(Result::ok).ok_or_else(Problem::too_slow)?;
        Ok(Turn { queue, permit: Arc::new(permit), leash, _waiting })
    }
}

impl Turn {
    /// When its time is up.
    pub fn until(&self) -> Instant {
        self.leash.until
    }

    /// Waits for others as long as an answer may take.
    pub async fn within<T>(&self, others: impl Future<Output = T>) -> Result<T, Problem> {
        tokio::time::timeout_at(self.until().into(), others).await.map_err(|_| Problem::too_slow())
    }

    /// Runs work, as [`Compute::run`] does.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Leash) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let (tell, told) = oneshot::channel();
        // Whoever does not wait any more is not told.
        let task = move |leash: &Leash| drop(tell.send(work(leash)));
        self.does(Box::new(task)).await?;
        told.await.unwrap_or_else(|_| Err(Problem::too_slow()))
    }

    /// Does a task, of whatever kind its answer is: so all of this is compiled once.
    async fn does(&self, task: Task) -> Result<(), Problem> {
        let (queue, permit, leash) = (self.queue, self.permit.clone(), self.leash.clone());
        let work = move || {
            let _permit = permit;
            match (leash.holds(), queue) {
                (false, _) => Err(Problem::too_slow()),
                (true, Queue::Small) => {
                    task(&leash);
                    Ok(())
                }
                (true, _) => in_background(|| task(&leash)).map_err(|error| no_thread(&error)),
            }
        };
        let done = async { tokio::task::spawn_blocking(work).await? };
        match tokio::time::timeout_at(self.until().into(), done).await {
            // Work that stopped because its time was up comes back with an error of its own, at the same moment.
            Ok(answer) if Instant::now() < self.until() => answer,
            _ => Err(Problem::too_slow()),
        }
    }
}

fn no_thread(error: &std::io::Error) -> Problem {
    tracing::warn!(%error, "there is no thread to compute on");
    Problem { detail: "the service is busy; try again".into(), ..Problem::of_status(StatusCode::SERVICE_UNAVAILABLE) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn work_is_told_when_its_client_leaves_and_when_its_time_is_up() {
        let compute = Compute::new(Duration::from_millis(300));
        let (tell, told) = std::sync::mpsc::channel();
        let asked = compute.run(Queue::Answers, move |leash| {
            while leash.holds() {
                std::thread::sleep(Duration::from_millis(5));
            }
            tell.send(()).ok();
            Ok(())
        });
        drop(tokio::time::timeout(Duration::from_millis(50), asked).await);
        assert!(told.recv_timeout(Duration::from_millis(200)).is_ok(), "the client left");
        let slow = compute.run(Queue::Heavy, |leash| {
            while leash.holds() {
                std::thread::sleep(Duration::from_millis(5));
            }
            Ok(())
        });
        assert_eq!(slow.await.unwrap_err().status, StatusCode::SERVICE_UNAVAILABLE);
    }

    #[tokio::test]
    async fn a_turn_is_taken_until_what_was_begun_in_it_has_ended() {
        let compute = Compute::new(Duration::from_millis(400));
        let (end, ends) = std::sync::mpsc::channel::<()>();
        let deaf = compute.run(Queue::Heavy, move |_| Ok(ends.recv().is_ok()));
        drop(tokio::time::timeout(Duration::from_millis(50), deaf).await);
        let next = compute.turn(Queue::Heavy).await;
        assert_eq!(next.err().unwrap().status, StatusCode::SERVICE_UNAVAILABLE, "its client left, and it still runs");
        assert!(compute.turn(Queue::Answers).await.is_ok());
        end.send(()).unwrap();
        assert!(compute.turn(Queue::Heavy).await.is_ok());
    }
}

//! The solvers: threads of their own that claim jobs, fit them and store what comes out, under a lease.
//!
//! A fit is CPU-bound for seconds to minutes, so it never runs on the threads that answer HTTP. A solver thread claims
//! one job at a time. While it fits, a task on the async side keeps the lease by heartbeats and carries progress to the
//! store; where the store says the lease is lost (cancelled, or lapsed and taken by another), the task raises the fit's
//! flag, the fit stops within one step and writes nothing. Errors that would recur fail the job at once; only the
//! infrastructure's errors retry, with backoff.

mod allowance;
mod attempt;
mod background;
mod clock;
mod hands;
mod house;
mod memory;
mod metrics;
mod parts;
mod rules;
mod solver;
mod trail;
mod watch;
pub mod webhooks;

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use tokio::runtime::Handle;
use tokio::sync::Notify;

use crate::jobs::{Job, Limits};
use crate::store::{Artifacts, Claim, Part, Records, StoreError, Terms};
use crate::traces::Traces;

pub use background::in_background;
pub use memory::Reserved;
pub use metrics::Metrics;
pub use rules::Rules;
pub use solver::{Follower, Solver, fit_request};

use hands::Hands;
use memory::Memory;

/// How long an idle solver waits before it looks for work that nobody told it of.
const IDLE: Duration = Duration::from_millis(500);
/// One that has just done a part looks sooner, for so long: passes follow one another.
const SOON: Duration = Duration::from_millis(50);
const WHILE_HOT: Duration = Duration::from_secs(10);
/// How long solver threads may take to end once all fits were told to stop; a process ends without those that do not.
const ENDS_WITHIN: Duration = Duration::from_secs(15);
/// How long readiness is believed, and how long its probe may take.
const READY_FOR: Duration = Duration::from_secs(1);
const PROBE_WITHIN: Duration = Duration::from_secs(3);

/// What solvers and the HTTP side share.
pub struct Workshop {
    pub records: Arc<dyn Records>,
    pub artifacts: Artifacts,
    pub limits: Limits,
    pub rules: Rules,
    /// Told when a job was accepted.
    pub arrivals: Arc<Notify>,
    /// Told when a map was published at a place: in this process, or where the database tells of others, in any.
    pub published: Arc<Notify>,
    /// Told when there may be something to tell by a webhook.
    pub hooks: Notify,
    memory: Memory,
    hands: Arc<Hands>,
    solver: Box<dyn Solver>,
    pub metrics: Metrics,
    pub traces: Traces,
    /// Flags of the attempts that run in this process, by job, and of parts of others', by prefix and number.
    running: Mutex<HashMap<String, Arc<AtomicBool>>>,
    draining: tokio::sync::watch::Sender<bool>,
    followed: watch::Followed<watch::JobKey, Arc<Job>>,
    waited_for: watch::Followed<(String, String), ()>,
    /// The last probe of readiness, and when it ended. Locked while one is under way: who asks meanwhile gets its outcome.
    ready: tokio::sync::Mutex<Option<(Instant, Result<(), String>)>>,
}

impl Workshop {
    pub fn new(
        records: Arc<dyn Records>,
        artifacts: Artifacts,
        limits: Limits,
        rules: Rules,
        traces: Traces,
    ) -> Result<Arc<Self>, prometheus::Error> {
        Self::with_solver(records, artifacts, limits, rules, traces, Box::new(solver::Fit))
    }

    /// With another solver than the usual one.
    pub fn with_solver(
        records: Arc<dyn Records>,
        artifacts: Artifacts,
        limits: Limits,
        rules: Rules,
        traces: Traces,
        solver: Box<dyn Solver>,
    ) -> Result<Arc<Self>, prometheus::Error> {
        let draining = tokio::sync::watch::Sender::new(false);
        Ok(Arc::new(Self {
            records,
            artifacts,
            limits,
            memory: Memory::new(rules.memory),
            hands: Arc::new(Hands::none()),
            solver,
            metrics: Metrics::new()?,
            traces,
            rules,
            arrivals: Arc::default(),
            published: Arc::default(),
            hooks: Notify::new(),
            running: Mutex::default(),
            draining,
            followed: Default::default(),
            waited_for: Default::default(),
            ready: Default::default(),
        }))
    }

    /// Whether so many bytes of what fits share are ever free.
    pub fn allows(&self, bytes: u64) -> bool {
        self.memory.allows(bytes)
    }

    /// Waits for so many bytes of what fits share, while `goes_on` holds.
    pub fn reserve(&self, bytes: u64, goes_on: &dyn Fn() -> bool) -> Option<Reserved<'_>> {
        self.memory.reserve(bytes, goes_on)
    }

    /// Stops a job's attempt in this process within one step, if it runs here.
    pub fn stop(&self, job_id: &str) {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(flag) = running.get(job_id) {
            flag.store(true, Ordering::Relaxed);
        }
    }

    /// Whether no new work is taken.
    pub fn is_draining(&self) -> bool {
        *self.draining.borrow()
    }

    /// Whether work can be taken: a row and an artifact could just be written. Known for `READY_FOR`, so that whoever asks
    /// all day, or in bulk, writes little. The error says why not.
    pub async fn takes_work(&self) -> Result<(), String> {
        let mut lately = self.ready.lock().await;
        if let Some((at, outcome)) = &*lately
            && at.elapsed() < READY_FOR
        {
            return outcome.clone();
        }
        let probe = async {
            self.records.probe().await.map_err(|error| error.to_string())?;
            self.artifacts.probe().await.map_err(|error| error.to_string())
        };
        let outcome = tokio::time::timeout(PROBE_WITHIN, probe).await;
        let outcome = outcome.unwrap_or_else(|_| Err("the database or the artifact store does not answer".into()));
        *lately = Some((Instant::now(), outcome.clone()));
        outcome
    }

    /// Resolves once draining begins.
    pub async fn drained(&self) {
        let mut draining = self.draining.subscribe();
        // The sender lives as long as this workshop, so waiting cannot fail.
        let _ = draining.wait_for(|draining| *draining).await;
    }

    fn enter(&self, job_id: &str) -> Arc<AtomicBool> {
        let flag = Arc::new(AtomicBool::new(false));
        self.running.lock().unwrap_or_else(PoisonError::into_inner).insert(job_id.to_owned(), flag.clone());
        flag
    }

    fn leave(&self, job_id: &str) {
        self.running.lock().unwrap_or_else(PoisonError::into_inner).remove(job_id);
    }
}

/// Solver threads, and the tasks beside them.
pub struct Solvers {
    workshop: Arc<Workshop>,
    threads: Vec<JoinHandle<()>>,
}

impl Solvers {
    /// Starts `count` solver threads, and the task that reaps lapsed leases.
    pub fn start(workshop: Arc<Workshop>, count: usize, runtime: &Handle) -> std::io::Result<Self> {
        runtime.spawn(house::keep(workshop.clone()));
        let watched = workshop.clone();
        runtime.spawn(async move { watched.watch_jobs().await });
        let watched = workshop.clone();
        runtime.spawn(async move { watched.watch_places().await });
        runtime.spawn(webhooks::deliver(workshop.clone()));
        workshop.hands.arrive(count);
        let threads = (0..count)
            .map(|k| {
                let (workshop, runtime) = (workshop.clone(), runtime.clone());
                let name = format!("{}-{k}", std::process::id());
                std::thread::Builder::new().name(format!("solver-{k}")).spawn(move || solve(&workshop, &runtime, &name))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { workshop, threads })
    }

    /// Takes no new work, lets running fits end within `grace`, then hands back to the queue what still runs.
    pub fn drain(self, grace: Duration) {
        self.workshop.draining.send_replace(true);
        self.workshop.arrivals.notify_waiters();
        self.until_ended(grace);
        for flag in self.workshop.running.lock().unwrap_or_else(PoisonError::into_inner).values() {
            flag.store(true, Ordering::Relaxed);
        }
        self.until_ended(ENDS_WITHIN);
        for thread in self.threads {
            if !thread.is_finished() {
                tracing::error!("a fit does not stop; its job will be taken up when its lease has lapsed");
            } else if thread.join().is_err() {
                tracing::error!("a solver thread panicked");
            }
        }
    }

    fn until_ended(&self, within: Duration) {
        let deadline = Instant::now() + within;
        while Instant::now() < deadline && self.threads.iter().any(|thread| !thread.is_finished()) {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// What a solver does next.
enum Work {
    /// A claim, and when it was asked for.
    Job(Box<Claim>, SystemTime),
    Part(Part),
    Nothing,
}

fn solve(workshop: &Arc<Workshop>, runtime: &Handle, name: &str) {
    let mut helped: Option<Instant> = None;
    while !workshop.is_draining() {
        let is_hot = helped.is_some_and(|at| at.elapsed() < WHILE_HOT);
        match runtime.block_on(next_work(workshop, name, if is_hot { SOON } else { IDLE })) {
            Ok(Work::Job(claim, asked)) => {
                let (id, attempt) = (claim.job.id.clone(), claim.job.attempt);
                tracing::info!(job = %id, attempt, "attempt begins");
                let _own = workshop.hands.at_work();
                attempt::run(workshop, runtime, *claim, asked);
                tracing::info!(job = %id, attempt, "attempt ends");
            }
            Ok(Work::Part(part)) => {
                let _own = workshop.hands.at_work();
                match parts::help(workshop, runtime, &part) {
                    true => helped = Some(Instant::now()),
                    // Others, and the attempt itself, have a turn.
                    false => std::thread::sleep(IDLE),
                }
            }
            Ok(Work::Nothing) => {}
            Err(error) => {
                tracing::warn!(%error, "no claim could be made");
                std::thread::sleep(IDLE);
            }
        }
    }
}

/// A job before all; then a part of one that runs elsewhere; else waits for a while. Solvers of a process that has a job in
/// parts itself are lent to it.
async fn next_work(workshop: &Workshop, name: &str, idle: Duration) -> Result<Work, StoreError> {
    // Listening starts before looking, so that a job accepted in between is not missed.
    let arrival = workshop.arrivals.notified();
    let Rules { lease, running_a_tenant, .. } = workshop.rules;
    let terms = Terms { worker: name.to_owned(), lease, running_a_tenant };
    let asked = SystemTime::now();
    if let Some(claim) = workshop.records.claim(&terms).await? {
        return Ok(Work::Job(Box::new(claim), asked));
    }
    if !workshop.hands.divide()
        && let Some(part) = workshop.records.take_part(name, lease).await?
    {
        return Ok(Work::Part(part));
    }
    let _ = tokio::time::timeout(idle, arrival).await;
    Ok(Work::Nothing)
}

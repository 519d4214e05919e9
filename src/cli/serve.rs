//! `serve` and `worker`: the service in one process, or its workers alone.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;

use super::CliError;
use super::stores::{Database, Stores};
use crate::http::{Faces, HttpLimits, Tls, listener, router, router_of_worker};
use crate::jobs::{Limits, Retain, Retention};
use crate::store::Quota;
use crate::traces::{Endpoint, Traces, TracesError};
use crate::worker::webhooks::Allowed;
use crate::worker::{Rules, Solvers, Workshop};

/// How long running fits may go on after SIGTERM before they are handed back to the queue.
const GRACE: Duration = Duration::from_secs(5);
/// And what goes on after that, until the process ends without it.
const LAST_GRACE: Duration = Duration::from_secs(1);
/// Whoever scrapes is one, or a few.
const METRICS_CONNECTIONS: usize = 64;
/// Of `--memory`: one part in so many is kept of what blocks of covariances are formed from, within these bytes.
const SHARE_OF_JOINTS: u64 = 8;
const JOINTS: (u64, u64) = (32 << 20, 2 << 30);
/// The same of loaded maps. One that is not kept is read anew for every tile of a picture: 100,000 control points hold 0.2 GB.
const SHARE_OF_MAPS: u64 = 16;
const MAPS: (u64, u64) = (128 << 20, 1 << 30);

#[derive(Debug, Args)]
pub struct Serve {
    /// The address to listen on. Without API keys it must be a loopback address.
    #[arg(long, env = "MAPFIT_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// A certificate with its chain, PEM: clients speak TLS. It is read again when it was renewed.
    #[arg(long, env = "MAPFIT_TLS_CERT", value_name = "FILE", requires = "tls_key")]
    pub tls_cert: Option<PathBuf>,
    /// The certificate's private key, PEM.
    #[arg(long, env = "MAPFIT_TLS_KEY", value_name = "FILE", requires = "tls_cert")]
    pub tls_key: Option<PathBuf>,
    /// How long an answer may take; past it, it is 503.
    #[arg(long, env = "MAPFIT_REQUEST_SECONDS", default_value_t = 60)]
    pub request_seconds: u64,
    /// Connections open at once; more wait.
    #[arg(long, env = "MAPFIT_CONNECTIONS", default_value_t = HttpLimits::default().connections)]
    pub connections: usize,
    /// Where to serve /metrics (/livez and /readyz, too); without it, it is beside everything else.
    #[arg(long, env = "MAPFIT_METRICS_LISTEN")]
    pub metrics_listen: Option<SocketAddr>,
    /// Requests a second that a key may make; without it they are not counted.
    #[arg(long, env = "MAPFIT_RATE_LIMIT", value_parser = clap::value_parser!(u32).range(1..))]
    pub rate_limit: Option<u32>,
    /// Jobs of one tenant that may wait.
    #[arg(long, env = "MAPFIT_QUOTA_QUEUED", default_value_t = HttpLimits::default().quota.queued)]
    pub quota_queued: i64,
    /// Bytes that one tenant's maps may take.
    #[arg(long, env = "MAPFIT_QUOTA_BYTES")]
    pub quota_bytes: Option<i64>,
    #[command(flatten)]
    pub house: House,
}

#[derive(Debug, Args)]
pub struct Work {
    /// Where to serve /metrics, /livez and /readyz; without it, nowhere.
    #[arg(long, env = "MAPFIT_METRICS_LISTEN")]
    pub metrics_listen: Option<SocketAddr>,
    #[command(flatten)]
    pub house: House,
}

/// Where data lives and how much work is done at once.
#[derive(Debug, Clone, Args)]
pub struct House {
    #[command(flatten)]
    pub stores: Stores,
    /// Solver threads; 0 serves only. One a core by default.
    #[arg(long, env = "MAPFIT_WORKERS")]
    pub workers: Option<usize>,
    /// Control points in use that one fit may have. A larger map is fitted in parts, unless its `map.tiling` is `none`.
    #[arg(long, env = "MAPFIT_MAX_CONTROL_POINTS", default_value_t = Limits::default().control_points)]
    pub max_control_points: usize,
    /// Megabytes that fits may hold together; half of the machine's or the container's by default. A fit that needs more
    /// than is free waits, and one that needs more than this is refused.
    #[arg(long, env = "MAPFIT_MEMORY", value_parser = clap::value_parser!(u64).range(16..))]
    pub memory: Option<u64>,
    /// Seconds that one attempt at a job may take.
    #[arg(long, env = "MAPFIT_JOB_SECONDS", default_value_t = Rules::default().attempt_within.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    pub job_seconds: u64,
    /// Seconds that a worker holds a job without a sign of life.
    #[arg(long, env = "MAPFIT_LEASE_SECONDS", default_value_t = Rules::default().lease.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    pub lease_seconds: u64,
    /// Seconds between two searches for artifacts that no map names, and for what is kept no longer.
    #[arg(long, env = "MAPFIT_SWEEP_SECONDS", default_value_t = Rules::default().sweep_every.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    pub sweep_seconds: u64,
    /// Days that maps are kept: for all (30), for those with a label (site:hq=365), or `forever`; several with commas. What
    /// a place names is kept. Without it, all are.
    #[arg(long, env = "MAPFIT_KEEP_MAPS", value_delimiter = ',', value_name = "RULE")]
    pub keep_maps: Vec<Retain>,
    /// Days that a webhook's deliveries are listed once they have ended.
    #[arg(long, env = "MAPFIT_KEEP_DELIVERIES", default_value_t = 30, value_name = "DAYS", value_parser = clap::value_parser!(u64).range(..=36_500))]
    pub keep_deliveries: u64,
    /// Jobs of one tenant that may run at once.
    #[arg(long, env = "MAPFIT_QUOTA_RUNNING", value_parser = clap::value_parser!(i64).range(1..))]
    pub quota_running: Option<i64>,
    /// Where traces go: the address of an OTLP receiver over HTTP (http://127.0.0.1:4318). Without it what
    /// OTEL_EXPORTER_OTLP_ENDPOINT says; without that, nowhere.
    #[arg(long, env = "MAPFIT_OTLP_ENDPOINT", value_name = "URL")]
    pub otlp_endpoint: Option<String>,
    /// Networks that webhooks may reach beside public addresses (10.0.0.0/8,127.0.0.1/32).
    #[arg(long, env = "MAPFIT_WEBHOOK_ALLOW", value_delimiter = ',')]
    pub webhook_allow: Vec<ipnet::IpNet>,
}

impl House {
    /// The usual house, elsewhere.
    pub fn in_folder(data: PathBuf, max_control_points: usize) -> Self {
        let usual = Rules::default();
        Self {
            stores: Stores::in_folder(data),
            max_control_points,
            workers: None,
            memory: None,
            job_seconds: usual.attempt_within.as_secs(),
            lease_seconds: usual.lease.as_secs(),
            sweep_seconds: usual.sweep_every.as_secs(),
            quota_running: None,
            webhook_allow: Vec::new(),
            otlp_endpoint: None,
            keep_maps: Vec::new(),
            keep_deliveries: 30,
        }
    }

    fn rules(&self) -> Rules {
        let usual = Rules::default();
        Rules {
            lease: Duration::from_secs(self.lease_seconds),
            sweep_every: Duration::from_secs(self.sweep_seconds),
            attempt_within: Duration::from_secs(self.job_seconds),
            stops_within: usual.stops_within,
            memory: self.memory.map_or(usual.memory, |megabytes| megabytes.saturating_mul(1 << 20)),
            running_a_tenant: self.quota_running.unwrap_or(usual.running_a_tenant),
            webhooks: Allowed(self.webhook_allow.clone()),
            keep_maps: Retention(self.keep_maps.clone()),
            keep_deliveries: Duration::from_secs(self.keep_deliveries * 24 * 3600),
        }
    }

    fn worker_count(&self) -> usize {
        self.workers.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, |n| n.get()))
    }

    fn traces(&self, role: &'static str) -> Result<Traces, TracesError> {
        let endpoint = Endpoint::of(self.otlp_endpoint.as_deref(), |name| std::env::var(name).ok())?;
        endpoint.map_or_else(|| Ok(Traces::default()), |endpoint| Traces::to(&endpoint, role))
    }

    /// What servers and workers share. `role` is which of them this is.
    async fn open(&self, role: &'static str) -> Result<Arc<Workshop>, CliError> {
        let traces = self.traces(role)?;
        let records = self.stores.records().await?;
        let artifacts = self.stores.artifacts()?;
        let limits = Limits { control_points: self.max_control_points, ..Limits::default() };
        let workshop = Workshop::new(records.ports(), artifacts, limits, self.rules(), traces)?;
        if let Database::Postgres(store) = records {
            let (arrivals, published) = (workshop.arrivals.clone(), workshop.published.clone());
            let draining = workshop.clone();
            tokio::spawn(async move {
                tokio::select! {
                    () = store.listen(arrivals, published) => {}
                    () = draining.drained() => {}
                }
            });
        }
        Ok(workshop)
    }
}

impl Serve {
    fn limits(&self) -> HttpLimits {
        let patience = Duration::from_secs(self.request_seconds.max(1));
        HttpLimits {
            patience,
            connections: self.connections.max(1),
            requests_a_second: self.rate_limit,
            quota: Quota { queued: self.quota_queued, bytes: self.quota_bytes.unwrap_or(i64::MAX) },
            cache: (self.house.rules().memory / SHARE_OF_MAPS).clamp(MAPS.0, MAPS.1) as usize,
            joints: (self.house.rules().memory / SHARE_OF_JOINTS).clamp(JOINTS.0, JOINTS.1) as usize,
            ..HttpLimits::default()
        }
    }

    pub fn run(self) -> Result<(), CliError> {
        let runtime = runtime()?;
        let tls = self.tls_cert.as_deref().zip(self.tls_key.as_deref());
        let tls = tls.map(|(certificate, key)| Tls::from_files(certificate, key)).transpose();
        let tls = tls.map_err(|error| CliError::Usage(error.to_string()))?;
        let scheme = if tls.is_some() { "https" } else { "http" };
        let faces = (self.listen, self.metrics_listen);
        let service = runtime.block_on(Running::start(faces, tls, &self.house, self.limits()))?;
        println!("serving on {scheme}://{}", service.address);
        runtime.block_on(stop_signal());
        service.stop(runtime);
        Ok(())
    }
}

impl Work {
    pub fn run(self) -> Result<(), CliError> {
        let runtime = runtime()?;
        let workshop = runtime.block_on(self.house.open("worker"))?;
        if let Some(listen) = self.metrics_listen {
            runtime.block_on(serve_apart(listen, router_of_worker(workshop.clone()), &workshop))?;
        }
        let solvers = start_solvers(&workshop, self.house.worker_count().max(1), &runtime)?;
        tracing::info!("working");
        runtime.block_on(stop_signal());
        solvers.drain(GRACE);
        workshop.traces.end();
        drop(workshop);
        runtime.shutdown_timeout(LAST_GRACE);
        Ok(())
    }
}

/// A service under way.
pub(super) struct Running {
    pub address: SocketAddr,
    workshop: Arc<Workshop>,
    solvers: Option<Solvers>,
    server: tokio::task::JoinHandle<()>,
}

impl Running {
    /// Binds, opens the data, starts workers and the server.
    pub async fn start(
        (listen, metrics_listen): (SocketAddr, Option<SocketAddr>),
        tls: Option<Tls>,
        house: &House,
        limits: HttpLimits,
    ) -> Result<Self, CliError> {
        let workshop = house.open("serve").await?;
        let open = [Some(listen), metrics_listen].into_iter().flatten().find(|face| !face.ip().is_loopback());
        if let Some(face) = open
            && !workshop.records.has_keys().await?
        {
            return Err(CliError::Usage(format!(
                "{face} is not a loopback address, and there are no API keys: what it serves is not for whoever reaches it. \
                 Make one with `mapfit keys create --tenant T --scopes read,submit,admin`, or listen on 127.0.0.1"
            )));
        }
        let listener = bind(listen).await?;
        let address = listener.local_addr().map_err(CliError::io("the listener has no address"))?;
        let count = house.worker_count();
        let solvers = Solvers::start(workshop.clone(), count, &tokio::runtime::Handle::current());
        let solvers = solvers.map_err(CliError::io("a solver thread cannot be started"))?;
        let shutdown = workshop.clone();
        let connections = limits.connections;
        let Faces { public: app, metrics } = router(workshop.clone(), limits, metrics_listen.is_some());
        if let (Some(listen), Some(metrics)) = (metrics_listen, metrics) {
            serve_apart(listen, metrics, &workshop).await?;
        }
        let server = tokio::spawn(async move {
            listener::serve(listener, tls, app, connections, async move { shutdown.drained().await }).await;
        });
        Ok(Self { address, workshop, solvers: Some(solvers), server })
    }

    /// Takes no new requests or jobs, gives running fits their grace, hands back the rest.
    pub fn stop(mut self, runtime: Runtime) {
        tracing::info!("draining");
        if let Some(solvers) = self.solvers.take() {
            solvers.drain(GRACE);
        }
        debug_assert!(self.workshop.is_draining());
        let finished = runtime.block_on(async { tokio::time::timeout(GRACE, &mut self.server).await });
        if finished.is_err() {
            tracing::warn!("some connections did not end in time");
        }
        self.workshop.traces.end();
        // An answer that is being formed for nobody may take longer.
        runtime.shutdown_timeout(LAST_GRACE);
        tracing::info!("stopped");
    }
}

pub(super) fn runtime() -> Result<Runtime, CliError> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(CliError::io("the async runtime cannot be started"))
}

fn start_solvers(workshop: &Arc<Workshop>, count: usize, runtime: &Runtime) -> Result<Solvers, CliError> {
    Solvers::start(workshop.clone(), count, runtime.handle()).map_err(CliError::io("a solver thread cannot be started"))
}

/// Serves what those want who look after the service, until it drains.
async fn serve_apart(listen: SocketAddr, metrics: axum::Router, workshop: &Arc<Workshop>) -> Result<(), CliError> {
    let (own, shutdown) = (bind(listen).await?, workshop.clone());
    tokio::spawn(async move {
        listener::serve(own, None, metrics, METRICS_CONNECTIONS, async move { shutdown.drained().await }).await;
    });
    Ok(())
}

async fn bind(listen: SocketAddr) -> Result<TcpListener, CliError> {
    TcpListener::bind(listen).await.map_err(CliError::io(format!("{listen} cannot be listened on")))
}

/// SIGTERM or SIGINT.
pub(super) async fn stop_signal() {
    let interrupted = tokio::signal::ctrl_c();
    match tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate()) {
        Ok(mut terminated) => {
            tokio::select! {
                _ = interrupted => {}
                _ = terminated.recv() => {}
            }
        }
        Err(_) => {
            let _ = interrupted.await;
        }
    }
}

/// A folder for data, relative to a command's output.
pub(super) fn data_in(folder: &Path) -> PathBuf {
    folder.join("data")
}

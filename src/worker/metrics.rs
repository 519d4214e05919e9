//! What the process counts of itself, for Prometheus.
//!
//! Seconds and bytes are bare units, counters end in `_total` and durations are histograms, as Prometheus' own guide has
//! it. What only the store knows (the queue) is read when somebody asks.

use std::time::Duration;

use prometheus::process_collector::ProcessCollector;
use prometheus::{
    Encoder, GaugeVec, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry,
    TextEncoder,
};

use crate::map::FitReport;
use crate::store::{Total, Totals};

/// Of fits: a tenth of a second to an hour.
const LONG: [f64; 12] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0];
/// Of answers and factorisations.
const SHORT: [f64; 12] = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 120.0];

/// All counters of a process.
pub struct Metrics {
    registry: Registry,
    waiting: IntGaugeVec,
    oldest: GaugeVec,
    maps: IntGauge,
    map_bytes: IntGauge,
    /// Attempts, by how they ended.
    attempts: IntCounterVec,
    stages: HistogramVec,
    factorisations: HistogramVec,
    leases_lost: IntCounter,
    leases_reaped: IntCounter,
    /// Parts of fits of other processes, by how they ended.
    parts: IntCounterVec,
    deliveries: IntCounterVec,
    swept: IntCounterVec,
    requests: HistogramVec,
}

impl Metrics {
    /// Counters at zero. Fails where two have one name: never, as long as the names below differ.
    pub fn new() -> Result<Self, prometheus::Error> {
        let registry = Registry::new();
        let histogram = |name: &str, help: &str, labels: &[&str], buckets: &[f64]| {
            HistogramVec::new(HistogramOpts::new(name, help).buckets(buckets.to_vec()), labels)
        };
        let all = Self {
            waiting: IntGaugeVec::new(
                Opts::new(
                    "mapfit_jobs",
                    "Jobs that have not ended, by state, and by how many jobs of their tenant wait",
                ),
                &["state", "tenant_class"],
            )?,
            oldest: GaugeVec::new(
                Opts::new("mapfit_queue_oldest_seconds", "The age of the oldest job that waits; 0 without one"),
                &["tenant_class"],
            )?,
            maps: IntGauge::new("mapfit_maps", "Maps there are")?,
            map_bytes: IntGauge::new("mapfit_map_bytes", "Bytes of the maps' files")?,
            attempts: IntCounterVec::new(
                Opts::new("mapfit_attempts_total", "Attempts at jobs that ended in this process, by outcome"),
                &["outcome"],
            )?,
            stages: histogram(
                "mapfit_stage_seconds",
                "How long the stages of a fit took",
                &["stage", "distance"],
                &LONG,
            )?,
            factorisations: histogram(
                "mapfit_factorisation_seconds",
                "The mean time of a factorisation, an observation a fit",
                &["distance"],
                &SHORT,
            )?,
            leases_lost: IntCounter::new("mapfit_leases_lost_total", "Attempts of this process that lost their lease")?,
            leases_reaped: IntCounter::new(
                "mapfit_leases_reaped_total",
                "Lapsed leases and passed deadlines that this process found",
            )?,
            parts: IntCounterVec::new(
                Opts::new("mapfit_parts_total", "Parts of other processes' fits that this one took, by outcome"),
                &["outcome"],
            )?,
            deliveries: IntCounterVec::new(
                Opts::new("mapfit_webhook_deliveries_total", "Attempts at webhook deliveries, by outcome"),
                &["outcome"],
            )?,
            swept: IntCounterVec::new(
                Opts::new("mapfit_swept_total", "What this process removed because it is kept no longer, by kind"),
                &["what"],
            )?,
            requests: histogram(
                "mapfit_http_request_seconds",
                "From a request's header to its answer's, by route",
                &["method", "route", "status"],
                &SHORT,
            )?,
            registry,
        };
        all.registered()
    }

    fn registered(self) -> Result<Self, prometheus::Error> {
        let own = &self.registry;
        own.register(Box::new(self.waiting.clone()))?;
        own.register(Box::new(self.oldest.clone()))?;
        own.register(Box::new(self.maps.clone()))?;
        own.register(Box::new(self.map_bytes.clone()))?;
        own.register(Box::new(self.attempts.clone()))?;
        own.register(Box::new(self.stages.clone()))?;
        own.register(Box::new(self.factorisations.clone()))?;
        own.register(Box::new(self.leases_lost.clone()))?;
        own.register(Box::new(self.leases_reaped.clone()))?;
        own.register(Box::new(self.parts.clone()))?;
        own.register(Box::new(self.deliveries.clone()))?;
        own.register(Box::new(self.swept.clone()))?;
        own.register(Box::new(self.requests.clone()))?;
        own.register(Box::new(ProcessCollector::for_self()))?;
        for outcome in ["successful", "failed", "retried", "stopped"] {
            self.attempts.with_label_values(&[outcome]);
        }
        for outcome in ["done", "left"] {
            self.parts.with_label_values(&[outcome]);
        }
        for outcome in ["delivered", "retried", "failed"] {
            self.deliveries.with_label_values(&[outcome]);
        }
        for what in ["maps", "deliveries", "artifacts"] {
            self.swept.with_label_values(&[what]);
        }
        Ok(self)
    }

    pub fn attempt_ended(&self, outcome: &str) {
        self.attempts.with_label_values(&[outcome]).inc();
    }

    /// A fit that ended in a map.
    pub fn fitted(&self, distance: &str, fit: &FitReport, storing: Duration) {
        let stage = |stage: &str, seconds: f64| self.stages.with_label_values(&[stage, distance]).observe(seconds);
        stage("fitting", fit.stages.fitting);
        stage("covariance", fit.stages.covariance);
        stage("storing", storing.as_secs_f64());
        let mean = fit.stages.fitting / fit.factorisations.max(1) as f64;
        self.factorisations.with_label_values(&[distance]).observe(mean);
    }

    pub fn lease_lost(&self) {
        self.leases_lost.inc();
    }

    /// A part of another process's fit that ended here.
    pub fn helped(&self, outcome: &str) {
        self.parts.with_label_values(&[outcome]).inc();
    }

    pub fn reaped(&self, count: u64) {
        self.leases_reaped.inc_by(count);
    }

    pub fn delivered(&self, outcome: &str) {
        self.deliveries.with_label_values(&[outcome]).inc();
    }

    pub fn swept(&self, what: &str, count: u64) {
        self.swept.with_label_values(&[what]).inc_by(count);
    }

    /// A request that was answered. `route` is the pattern, not the path.
    pub fn answered(&self, method: &str, route: &str, status: u16, took: Duration) {
        self.requests.with_label_values(&[method, route, &status.to_string()]).observe(took.as_secs_f64());
    }

    /// Everything, in Prometheus' text format; with what the store says of the queue, where it answers.
    pub fn text(&self, totals: Option<Totals>) -> Result<Vec<u8>, prometheus::Error> {
        if let Some(Totals { light, heavy }) = totals {
            for (class, Total { held, oldest }) in [("light", light), ("heavy", heavy)] {
                self.waiting.with_label_values(&["accepted", class]).set(held.queued);
                self.waiting.with_label_values(&["running", class]).set(held.running);
                self.oldest.with_label_values(&[class]).set(oldest.unwrap_or(0).max(0) as f64 / 1000.0);
            }
            self.maps.set(light.held.maps + heavy.held.maps);
            self.map_bytes.set(light.held.bytes + heavy.held.bytes);
        }
        let mut text = Vec::new();
        TextEncoder::new().encode(&self.registry.gather(), &mut text)?;
        Ok(text)
    }
}

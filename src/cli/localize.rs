//! `localize`: where a log's scans were taken, on a server's map.

use std::path::PathBuf;

use clap::Args;
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::CliError;
use super::client::{Client, Remote};
use super::request::{JobOptions, LogOptions, ON_DISK, job_of};
use super::resources::encoded;
use crate::geometry::{Bounds, Cov2, Vec2};
use crate::render::{Axes, Figure, svg_to_png};

/// Scans in a request.
const AT_ONCE: usize = 50;
/// The ellipses drawn hold 95 %: the root of the chi squared quantile with two degrees of freedom.
const ELLIPSE: f64 = 2.448;
/// The plot's width in pixels, and metres around what it shows.
const WIDTH: usize = 1200;
const MARGIN: f64 = 1.0;

#[derive(Debug, Args)]
pub struct Localize {
    /// The map's id.
    map: String,
    /// A log (CARMEN, MCAP) or a job file, whose scans are located; their poses are what is known beforehand.
    file: PathBuf,
    #[command(flatten)]
    remote: Remote,
    /// Nothing is known beforehand: the scans may have been taken anywhere on the map.
    #[arg(long, env = "MAPFIT_ANYWHERE")]
    anywhere: bool,
    /// Distinct poses a scan, at most.
    #[arg(long, env = "MAPFIT_HYPOTHESES", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=50))]
    hypotheses: u32,
    /// JSON on stdout: what the server says of a scan, a line each.
    #[arg(long, env = "MAPFIT_JSON")]
    json: bool,
    /// Draw the map's contour, the poses and their 95 % ellipses into a file (.png or .svg).
    #[arg(long, env = "MAPFIT_PLOT")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    job: JobOptions,
    #[command(flatten)]
    log: LogOptions,
}

impl Localize {
    pub fn run(self) -> Result<(), CliError> {
        if self.log.list {
            return self.log.show(&self.file);
        }
        let client = self.remote.client();
        let job = job_of(&self.file, &self.job, &self.log, &ON_DISK)?;
        let job: Value = serde_json::from_slice(&job).map_err(|error| CliError::Usage(error.to_string()))?;
        let located = self.located(&client, &job)?;
        if let Some(file) = &self.plot {
            let contour = client.get_json(&format!("/v1/maps/{}/contours", encoded(&self.map)))?;
            let svg = plot(&contour, &located);
            let bytes = if file.extension().is_some_and(|e| e == "svg") { svg.into_bytes() } else { svg_to_png(&svg)? };
            std::fs::write(file, bytes).map_err(CliError::io(file.display().to_string()))?;
        }
        if self.json {
            located.iter().for_each(|own| println!("{own}"));
        } else {
            summary(&located);
        }
        match located.iter().filter(|own| own["converged"] != true).count() {
            0 => Ok(()),
            nowhere => Err(CliError::Nowhere { nowhere, all: located.len() }),
        }
    }

    fn located(&self, client: &Client, job: &Value) -> Result<Vec<Value>, CliError> {
        let mut scans = job["scans"].as_array().cloned().unwrap_or_default();
        if self.anywhere {
            scans.iter_mut().for_each(|scan| scan["pose"] = Value::Null);
        }
        let bar = ProgressBar::new(scans.len() as u64).with_message("scans located");
        let mut located = Vec::new();
        for some in scans.chunks(AT_ONCE) {
            let body = json!({"scans": some, "noise": job["noise"], "hypotheses": self.hypotheses});
            let answer = client.send_json("POST", &format!("/v1/maps/{}/localize", encoded(&self.map)), Some(&body))?;
            located.extend(answer["poses"].as_array().cloned().unwrap_or_default());
            bar.set_position(located.len() as u64);
        }
        bar.finish_and_clear();
        Ok(located)
    }
}

fn summary(located: &[Value]) {
    println!("{:>5} {:>9} {:>9} {:>8} {:>8} {:>8}  agreeing", "scan", "x", "y", "theta", "sigma xy", "sigma th");
    for (k, own) in located.iter().enumerate() {
        let Some(place) = Placed::of(own) else {
            println!("{k:>5} fits nowhere");
            continue;
        };
        let [x, y, theta] = ["x", "y", "theta"].map(|axis| own["pose"][axis].as_f64().unwrap_or(f64::NAN));
        let sigma = place.covariance.trace().max(0.0).sqrt();
        let turn = own["covariance"][8].as_f64().unwrap_or(f64::NAN).sqrt();
        let (used, left_out) = (own["used"].as_u64().unwrap_or(0), own["left_out"].as_u64().unwrap_or(0));
        println!("{k:>5} {x:>9.3} {y:>9.3} {theta:>8.4} {sigma:>8.4} {turn:>8.5}  {used} of {}", used + left_out);
    }
}

/// A located scan's position and its covariance.
struct Placed {
    at: Vec2,
    covariance: Cov2,
}

impl Placed {
    fn of(own: &Value) -> Option<Self> {
        let c = |k: usize| own["covariance"][k].as_f64();
        let at = Vec2::new(own["pose"]["x"].as_f64()?, own["pose"]["y"].as_f64()?);
        Some(Self { at, covariance: Cov2::new(c(0)?, c(1)?, c(3)?, c(4)?) })
    }

    /// The outline of the 95 % ellipse.
    fn ellipse(&self) -> Vec<Vec2> {
        let eigen = self.covariance.symmetric_eigen();
        let axes = eigen.eigenvectors * Cov2::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
        let turns = (0..=48).map(|k| f64::from(k) * std::f64::consts::TAU / 48.0);
        turns.map(|turn| self.at + axes * Vec2::new(turn.cos(), turn.sin()) * ELLIPSE).collect()
    }
}

/// The map's contour, the way between the poses, and their ellipses.
fn plot(contour: &Value, located: &[Value]) -> String {
    let point = |p: &Value| Some(Vec2::new(p[0].as_f64()?, p[1].as_f64()?));
    let line = |line: &Value| line.as_array().map(|points| points.iter().filter_map(point).collect::<Vec<_>>());
    let lines: Vec<Vec<Vec2>> = contour["features"][0]["geometry"]["coordinates"]
        .as_array()
        .map(|lines| lines.iter().filter_map(line).collect())
        .unwrap_or_default();
    let placed: Vec<Placed> = located.iter().filter_map(Placed::of).collect();
    let way: Vec<Vec2> = placed.iter().map(|place| place.at).collect();
    let shown = lines.iter().flatten().chain(&way).copied();
    let bounds = Bounds::around(shown).unwrap_or(Bounds { min: [0.0, 0.0], max: [1.0, 1.0] }).grown(MARGIN);
    let title = format!("{} of {} scans located, 95 % ellipses", placed.len(), located.len());
    let mut figure = Figure::new(Axes::new(bounds, WIDTH), &title);
    figure.path(lines.iter().map(Vec::as_slice), false, "fill=\"none\" stroke=\"#555\" stroke-width=\"1\"");
    figure.path([way.as_slice()], false, "fill=\"none\" stroke=\"#1f77b4\" stroke-width=\"1\" stroke-opacity=\"0.6\"");
    let ellipses: Vec<Vec<Vec2>> = placed.iter().map(Placed::ellipse).collect();
    let style = "fill=\"#d62728\" fill-opacity=\"0.2\" stroke=\"#d62728\" stroke-width=\"0.8\"";
    ellipses.iter().for_each(|outline| figure.path([outline.as_slice()], true, style));
    figure.finish()
}

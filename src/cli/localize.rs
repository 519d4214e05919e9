//! `localize`: where a log's scans were taken, on a server's map.

use std::path::PathBuf;

use clap::Args;
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::CliError;
use super::client::{Client, Remote};
use super::request::{JobOptions, LogOptions, ON_DISK, job_of};
use super::resources::encoded;
use super::trajectory::{Placed, picture};
use crate::render::svg_to_png;

/// Scans in a request.
const AT_ONCE: usize = 50;

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
        let asked = job_of(&self.file, &self.job, &self.log, &ON_DISK)?;
        let job: Value = serde_json::from_slice(&asked.json).map_err(|error| CliError::Usage(error.to_string()))?;
        let located = self.located(&client, &job)?;
        if let Some(file) = &self.plot {
            let contour = client.get_json(&format!("/v1/maps/{}/contours", encoded(&self.map)))?;
            let svg = picture(&contour, &located);
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

//! `submit`: job files, CARMEN logs and MCAP recordings to a server.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::CliError;
use super::client::{Client, Remote, text};
use super::request::{JobOptions, LogOptions, job_of};
use crate::import::RecordingLimits;
use crate::jobs::Limits;

#[derive(Debug, Args)]
pub struct Submit {
    /// Job files (.json), CARMEN logs (.log) or MCAP recordings (.mcap) of ROS 2; all may be gzipped (.gz).
    #[arg(required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    remote: Remote,
    /// Wait for the maps, with a progress bar.
    #[arg(long, env = "MAPFIT_WAIT")]
    wait: bool,
    /// With --wait: {"job": ..., "map": ...} on stdout, a line a file, and nothing else there.
    #[arg(long, env = "MAPFIT_JSON")]
    json: bool,
    #[command(flatten)]
    job: JobOptions,
    #[command(flatten)]
    log: LogOptions,
}

impl Submit {
    pub fn run(self) -> Result<(), CliError> {
        if self.log.list {
            return self.files.iter().try_for_each(|file| self.log.show(file));
        }
        let client = self.remote.client();
        // Beside values, a job has its scans' members.
        let Limits { scans, values, .. } = Limits::default();
        let limits = RecordingLimits { scans, ranges: values, ..super::request::ON_DISK };
        let mut unconverged = 0;
        for file in &self.files {
            let request = job_of(file, &self.job, &self.log, &limits)?;
            let job = client.submit(&request)?;
            if !self.json {
                println!("{}: job {}", file.display(), client.url(&text(&job["links"], "self")));
            }
            if let Some(message) = job["message"].as_str() {
                eprintln!("{}: {message}", file.display());
            }
            if !self.wait {
                if self.json {
                    println!("{}", json!({"job": job, "map": null}));
                }
                continue;
            }
            let job = client.wait(&job)?;
            let map = client.get_json(&text(&job["links"], "map"))?;
            unconverged += usize::from(map["fit"]["converged"] != true);
            match self.json {
                true => println!("{}", json!({"job": job, "map": map})),
                false => summary(&client, file, &map),
            }
        }
        if unconverged == 0 { Ok(()) } else { Err(CliError::Unconverged(unconverged)) }
    }
}

fn summary(client: &Client, file: &Path, map: &Value) {
    println!("{}: map {}", file.display(), client.url(&text(&map["links"], "self")));
    let fit = &map["fit"];
    println!(
        "  {} returns, {:.1} s, {}",
        fit["observations"],
        fit["seconds"].as_f64().unwrap_or_default(),
        if fit["converged"] == true { "converged" } else { "NOT converged" },
    );
    if let Some(why) = fit["unconverged"].as_str() {
        println!("  {why}");
    }
    for (relation, address) in map["links"].as_object().into_iter().flatten() {
        println!("  {relation:<13}{}", client.url(address.as_str().unwrap_or_default()));
    }
}

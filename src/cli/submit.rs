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
        let mut unconverged = 0;
        for file in &self.files {
            let job = client.submit(&self.request(file)?)?;
            let ended = outcome(&client, &file.display().to_string(), job, (self.wait, self.json))?;
            unconverged += usize::from(ended.is_some_and(|map| map["fit"]["converged"] != true));
        }
        if unconverged == 0 { Ok(()) } else { Err(CliError::Unconverged(unconverged)) }
    }

    /// The job of a file.
    fn request(&self, file: &Path) -> Result<Vec<u8>, CliError> {
        // Beside values, a job has its scans' members.
        let Limits { scans, values, .. } = Limits::default();
        job_of(file, &self.job, &self.log, &RecordingLimits { scans, ranges: values, ..super::request::ON_DISK })
    }

    /// Updates a map by the files, one after the other: each goes on from the map that the one before it made.
    pub(super) fn update(self, map: &str) -> Result<(), CliError> {
        if self.job.distance.is_some() || self.job.resolution.is_some() {
            return Err(CliError::Usage("an update has its map's --distance and --resolution".into()));
        }
        let client = self.remote.client();
        let (mut map, mut unconverged) = (map.to_owned(), 0);
        for (k, file) in self.files.iter().enumerate() {
            let unreadable = |error| CliError::Usage(format!("{} is no JSON: {error}", file.display()));
            let mut update: Value = serde_json::from_slice(&self.request(file)?).map_err(unreadable)?;
            if let Some(members) = update.as_object_mut() {
                members.remove("map");
            }
            let job = client.submit_to(&format!("/v1/maps/{map}/updates"), update.to_string().as_bytes())?;
            let wait = self.wait || k + 1 < self.files.len();
            if let Some(next) = outcome(&client, &file.display().to_string(), job, (wait, self.json))? {
                unconverged += usize::from(next["fit"]["converged"] != true);
                map = text(&next, "id");
            }
        }
        if unconverged == 0 { Ok(()) } else { Err(CliError::Unconverged(unconverged)) }
    }
}

/// Tells of a job by what it was made of, and of its map where that is waited for; the map then.
pub(super) fn outcome(
    client: &Client,
    what: &str,
    job: Value,
    (wait, as_json): (bool, bool),
) -> Result<Option<Value>, CliError> {
    if !as_json {
        println!("{what}: job {}", client.url(&text(&job["links"], "self")));
    }
    if let Some(message) = job["message"].as_str() {
        eprintln!("{what}: {message}");
    }
    if !wait {
        if as_json {
            println!("{}", json!({"job": job, "map": null}));
        }
        return Ok(None);
    }
    let job = client.wait(&job)?;
    let map = client.get_json(&text(&job["links"], "map"))?;
    match as_json {
        true => println!("{}", json!({"job": job, "map": map})),
        false => summary(client, what, &map),
    }
    Ok(Some(map))
}

fn summary(client: &Client, what: &str, map: &Value) {
    println!("{what}: map {}", client.url(&text(&map["links"], "self")));
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

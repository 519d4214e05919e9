//! `submit`: job files, CARMEN logs and MCAP recordings to a server.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use super::CliError;
use super::client::{Client, Remote, text};
use super::follow::Follow;
use super::request::{Asked, JobOptions, LogOptions, job_of};
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
    /// {"job": ..., "map": ...} on stdout, a line a file, and nothing else there; map is null without --wait.
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
            let asked = self.request(file)?;
            let job = client.submit(&asked.json)?;
            let map = self.follow(&client, self.wait).job(&file.display().to_string(), &asked.notes, job)?;
            unconverged += usize::from(map.is_some_and(|map| map["fit"]["converged"] != true));
        }
        CliError::of_unconverged(unconverged)
    }

    fn follow<'a>(&self, client: &'a Client, wait: bool) -> Follow<'a> {
        Follow { client, wait, json: self.json }
    }

    /// The job of a file.
    fn request(&self, file: &Path) -> Result<Asked, CliError> {
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
            let Asked { json, notes } = self.request(file)?;
            let mut update: Value = serde_json::from_slice(&json).map_err(unreadable)?;
            if let Some(members) = update.as_object_mut() {
                members.remove("map");
            }
            let job = client.submit_to(&format!("/v1/maps/{map}/updates"), update.to_string().as_bytes())?;
            let wait = self.wait || k + 1 < self.files.len();
            if let Some(next) = self.follow(&client, wait).job(&file.display().to_string(), &notes, job)? {
                unconverged += usize::from(next["fit"]["converged"] != true);
                map = text(&next, "id");
            }
        }
        CliError::of_unconverged(unconverged)
    }
}

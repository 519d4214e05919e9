//! `submit`: job files and CARMEN logs to a server.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::CliError;
use super::client::{Client, Remote, text};
use crate::import::{Odometry, Selection, parse_carmen, to_request};
use crate::scan::Noise;

#[derive(Debug, Args)]
pub struct Submit {
    /// Job files (.json) or CARMEN logs (.log); either may be gzipped (.gz).
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

/// What a log's noise is, and its map's resolution, unless flags say otherwise: metres and radians.
const SIGMA_XY: f64 = 0.02;
const SIGMA_THETA: f64 = 0.005;
const SIGMA_RANGE: f64 = 0.02;
const RESOLUTION: f64 = 0.25;

/// What a job asks for. Flags override what a job file says; a log says little itself.
#[derive(Debug, Args)]
struct JobOptions {
    /// vdf: the vector from the nearest surface, for buildings (logs: this one); sdf: signed, for rooms with an inside.
    #[arg(long, env = "MAPFIT_DISTANCE", value_parser = ["sdf", "vdf"])]
    distance: Option<String>,
    /// The spacing of control points, metres; 0.25 for logs.
    #[arg(long, env = "MAPFIT_RESOLUTION")]
    resolution: Option<f64>,
    /// Standard deviation of a pose's x and y, metres; 0.02 for logs.
    #[arg(long, env = "MAPFIT_SIGMA_XY")]
    sigma_xy: Option<f64>,
    /// Standard deviation of a pose's heading, radians; 0.005 for logs.
    #[arg(long, env = "MAPFIT_SIGMA_THETA")]
    sigma_theta: Option<f64>,
    /// Standard deviation of a range, metres; 0.02 for logs.
    #[arg(long, env = "MAPFIT_SIGMA_RANGE")]
    sigma_range: Option<f64>,
    /// What it is called; a log's file name.
    #[arg(long, env = "MAPFIT_NAME")]
    name: Option<String>,
    /// key:value; may be repeated.
    #[arg(long, env = "MAPFIT_LABEL", value_delimiter = ',')]
    label: Vec<String>,
    /// Higher runs first.
    #[arg(long, env = "MAPFIT_PRIORITY", allow_negative_numbers = true)]
    priority: Option<i32>,
    /// From submission; past it the job is failed.
    #[arg(long, env = "MAPFIT_DEADLINE_SECONDS")]
    deadline_seconds: Option<f64>,
}

impl JobOptions {
    /// Puts what was given in place of what a job says.
    fn override_in(&self, job: &mut Value) -> Result<(), CliError> {
        let mut put = |part: Option<&str>, member: &str, value: Option<Value>| {
            let Some(value) = value else { return };
            match part {
                Some(part) => job[part][member] = value,
                None => job[member] = value,
            }
        };
        put(Some("map"), "distance", self.distance.clone().map(Value::from));
        put(Some("map"), "resolution", self.resolution.map(Value::from));
        for member in ["sigma_x", "sigma_y"] {
            put(Some("noise"), member, self.sigma_xy.map(Value::from));
        }
        put(Some("noise"), "sigma_theta", self.sigma_theta.map(Value::from));
        put(Some("noise"), "sigma_range", self.sigma_range.map(Value::from));
        put(None, "name", self.name.clone().map(Value::from));
        put(None, "priority", self.priority.map(Value::from));
        put(None, "deadline_seconds", self.deadline_seconds.map(Value::from));
        for label in &self.label {
            let (key, value) = label
                .split_once(':')
                .ok_or_else(|| CliError::Usage(format!("--label takes key:value, not {label}")))?;
            job["labels"][key] = value.into();
        }
        Ok(())
    }

    /// Whether a job file stays as it is.
    fn is_empty(&self) -> bool {
        let numbers = [self.resolution, self.sigma_xy, self.sigma_theta, self.sigma_range, self.deadline_seconds];
        let texts = self.distance.is_none() && self.name.is_none() && self.label.is_empty();
        numbers.iter().all(Option::is_none) && texts && self.priority.is_none()
    }
}

/// Which scans of a log are taken, and what its poses are.
#[derive(Debug, Args)]
struct LogOptions {
    /// Take every so many scans (logs).
    #[arg(long, env = "MAPFIT_EVERY", default_value_t = 1)]
    every: usize,
    /// The first scan taken, counted from 0 (logs).
    #[arg(long, env = "MAPFIT_FROM", default_value_t = 0)]
    from: usize,
    /// One past the last scan taken (logs).
    #[arg(long, env = "MAPFIT_TO")]
    to: Option<usize>,
    /// For poses from wheel odometry: the motion model's alpha1,alpha2,alpha3,alpha4 as Nav2's AMCL has them (say
    /// 0.2,0.2,0.2,0.2). Poses' covariances grow along the way, from sigma-xy and sigma-theta at the first scan taken
    /// (logs).
    #[arg(long, env = "MAPFIT_ODOMETRY", value_delimiter = ',', num_args = 4)]
    odometry: Option<Vec<f64>>,
}

impl Submit {
    pub fn run(self) -> Result<(), CliError> {
        let client = self.remote.client();
        let mut unconverged = 0;
        for file in &self.files {
            let job = client.submit(&self.request(file)?)?;
            let ended = outcome(&client, &file.display().to_string(), job, (self.wait, self.json))?;
            unconverged += usize::from(ended.is_some_and(|map| map["fit"]["converged"] != true));
        }
        if unconverged == 0 { Ok(()) } else { Err(CliError::Unconverged(unconverged)) }
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

impl Submit {
    /// The job request of a file.
    fn request(&self, file: &Path) -> Result<Vec<u8>, CliError> {
        let bytes = read_unzipped(file)?;
        let shown = file.display();
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stem = name.trim_end_matches(".gz").to_owned();
        if stem.ends_with(".json") {
            if self.job.is_empty() {
                return Ok(bytes);
            }
            let unreadable = |error| CliError::Usage(format!("{shown} is no JSON: {error}"));
            let mut job: Value = serde_json::from_slice(&bytes).map_err(unreadable)?;
            if !job.is_object() {
                return Err(CliError::Usage(format!("{shown} is no job: a job is an object")));
            }
            self.job.override_in(&mut job)?;
            return Ok(job.to_string().into_bytes());
        }
        if stem.ends_with(".mcap") {
            return Err(CliError::Usage(format!("{shown}: MCAP recordings cannot be read in this version")));
        }
        let log = String::from_utf8_lossy(&bytes);
        let scans = parse_carmen(&log).map_err(|error| {
            CliError::Usage(format!("{shown}: {error}. A job file ends in .json, a CARMEN log has FLASER lines"))
        })?;
        let selection = Selection { every: self.log.every, from: self.log.from, to: self.log.to };
        let mut scans = selection.of(scans);
        if scans.is_empty() {
            return Err(CliError::Usage(format!("{shown}: --from, --to and --every leave no scan")));
        }
        let sigma_xy = self.job.sigma_xy.unwrap_or(SIGMA_XY);
        let noise = Noise {
            sigma_x: sigma_xy,
            sigma_y: sigma_xy,
            sigma_theta: self.job.sigma_theta.unwrap_or(SIGMA_THETA),
            sigma_range: self.job.sigma_range.unwrap_or(SIGMA_RANGE),
        };
        if let Some(alphas) = &self.log.odometry {
            let alphas =
                <[f64; 4]>::try_from(alphas.as_slice()).ok().filter(|a| a.iter().all(|a| *a >= 0.0 && *a <= 1e3));
            let alphas =
                alphas.ok_or_else(|| CliError::Usage("--odometry takes four numbers from 0 to 1000".into()))?;
            Odometry { alphas }.spread(&mut scans, &noise);
        }
        let map = (self.job.distance.as_deref().unwrap_or("vdf"), self.job.resolution.unwrap_or(RESOLUTION));
        let mut job = to_request(&scans, &noise, Some(stem.trim_end_matches(".log")), map);
        self.job.override_in(&mut job)?;
        Ok(job.to_string().into_bytes())
    }
}

/// A file's bytes; a gzipped one unpacked, to 1 GiB at most.
pub(super) fn read_unzipped(file: &Path) -> Result<Vec<u8>, CliError> {
    let shown = file.display().to_string();
    let bytes = std::fs::read(file).map_err(CliError::io(shown.clone()))?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut unzipped = Vec::new();
    let limit = 1 << 30;
    let mut reader = flate2::read::MultiGzDecoder::new(&bytes[..]).take(limit);
    reader.read_to_end(&mut unzipped).map_err(CliError::io(shown.clone()))?;
    if unzipped.len() as u64 == limit {
        return Err(CliError::Usage(format!("{shown} unpacks to more than 1 GiB")));
    }
    Ok(unzipped)
}

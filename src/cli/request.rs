//! A file as a job: a job's JSON as it is, a log's scans with what flags say, for every command that takes either.

use std::fs::File;
use std::io::{BufReader, Read};
use std::num::NonZeroUsize;
use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use super::CliError;
use crate::import::{Ask, LogError, Odometry, RecordingLimits, Selection, job_json, list_log, read_log};
use crate::scan::Noise;

/// What a log's noise is, and its map's resolution, unless flags say otherwise: metres and radians.
const SIGMA_XY: f64 = 0.02;
const SIGMA_THETA: f64 = 0.005;
const SIGMA_RANGE: f64 = 0.02;
const RESOLUTION: f64 = 0.25;

/// What a job asks for. Flags override what a job file says; a log says little itself.
#[derive(Debug, Args)]
#[command(next_help_heading = "The job")]
pub struct JobOptions {
    /// vdf: the vector from the nearest surface, for buildings (logs: this one); sdf: signed, for rooms with an inside.
    #[arg(long, env = "MAPFIT_DISTANCE", value_parser = ["sdf", "vdf"])]
    pub distance: Option<String>,
    /// The spacing of control points, metres; 0.25 for logs.
    #[arg(long, env = "MAPFIT_RESOLUTION", value_parser = finite, allow_negative_numbers = true)]
    pub resolution: Option<f64>,
    /// Standard deviation of a pose's x and y, metres; 0.02 for logs.
    #[arg(long, env = "MAPFIT_SIGMA_XY", value_parser = finite, allow_negative_numbers = true)]
    sigma_xy: Option<f64>,
    /// Standard deviation of a pose's heading, radians; 0.005 for logs.
    #[arg(long, env = "MAPFIT_SIGMA_THETA", value_parser = finite, allow_negative_numbers = true)]
    sigma_theta: Option<f64>,
    /// Standard deviation of a range, metres; 0.02 for logs.
    #[arg(long, env = "MAPFIT_SIGMA_RANGE", value_parser = finite, allow_negative_numbers = true)]
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
    #[arg(long, env = "MAPFIT_DEADLINE_SECONDS", value_parser = finite, allow_negative_numbers = true)]
    deadline_seconds: Option<f64>,
}

/// A number, as JSON has numbers.
fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|number: &f64| number.is_finite()).ok_or_else(|| "must be a number".into())
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

    /// The noise of a log's scans.
    fn noise(&self) -> Noise {
        let sigma_xy = self.sigma_xy.unwrap_or(SIGMA_XY);
        Noise {
            sigma_x: sigma_xy,
            sigma_y: sigma_xy,
            sigma_theta: self.sigma_theta.unwrap_or(SIGMA_THETA),
            sigma_range: self.sigma_range.unwrap_or(SIGMA_RANGE),
        }
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
#[command(next_help_heading = "Which scans of a log")]
pub struct LogOptions {
    /// Take every so many scans (logs).
    #[arg(long, env = "MAPFIT_EVERY", default_value = "1")]
    every: NonZeroUsize,
    /// The first scan taken, counted from 0 (logs).
    #[arg(long, env = "MAPFIT_FROM", default_value_t = 0)]
    from: usize,
    /// One past the last scan taken (logs).
    #[arg(long, env = "MAPFIT_TO")]
    to: Option<usize>,
    /// For poses from wheel odometry: the motion model's alpha1,alpha2,alpha3,alpha4 as Nav2's AMCL has them (say
    /// 0.2,0.2,0.2,0.2). Poses' covariances grow along the way, from sigma-xy and sigma-theta at the first scan taken
    /// (logs).
    #[arg(long, env = "MAPFIT_ODOMETRY", value_delimiter = ',')]
    odometry: Option<Vec<f64>>,
    /// The topic with the scans, where a recording has several (MCAP).
    #[arg(long, env = "MAPFIT_SCAN_TOPIC")]
    scan_topic: Option<String>,
    /// What says where the scans were taken, where a recording has several: a frame of /tf, an odometry or a pose topic
    /// (MCAP).
    #[arg(long, env = "MAPFIT_POSE_TOPIC")]
    pose_topic: Option<String>,
    /// Show what is in the files, and what a map would take of it; do nothing else (logs).
    #[arg(long)]
    pub list: bool,
}

impl LogOptions {
    /// Those that were given on the command line. What the environment says is for logs, whichever file is asked for.
    fn given(&self) -> impl Iterator<Item = &'static str> {
        let given = [
            ("every", self.every.get() > 1),
            ("from", self.from > 0),
            ("to", self.to.is_some()),
            ("odometry", self.odometry.is_some()),
            ("scan-topic", self.scan_topic.is_some()),
            ("pose-topic", self.pose_topic.is_some()),
        ];
        let variable = |name: &str| format!("MAPFIT_{}", name.to_uppercase().replace('-', "_"));
        let by_flag = move |(name, given): &(&'static str, bool)| *given && std::env::var_os(variable(name)).is_none();
        given.into_iter().filter(by_flag).map(|(name, _)| name)
    }

    fn ask(&self) -> Ask {
        Ask { scan_topic: self.scan_topic.clone(), pose_topic: self.pose_topic.clone() }
    }

    /// Prints what is in a log.
    pub fn show(&self, file: &Path) -> Result<(), CliError> {
        if is_job(file) {
            let shown = file.display();
            return Err(CliError::Usage(format!("{shown} is a job file; --list shows what is in logs and recordings")));
        }
        let listing = list_log(&opened(file), &self.ask(), &ON_DISK).map_err(complaint(file))?;
        print!("{}: {listing}", file.display());
        Ok(())
    }
}

/// What a recording on one's own disk may take: it is read piece by piece, however large it is.
pub const ON_DISK: RecordingLimits = RecordingLimits {
    file: 1 << 30,
    record: 1 << 30,
    unpacked: u64::MAX,
    scans: 20_000,
    ranges: 8_000_000,
    poses: 20_000_000,
};

/// What a file asks for.
pub struct Asked {
    /// The job's request.
    pub json: Vec<u8>,
    /// What there is to know of how it came about; said on stderr, too.
    pub notes: Vec<String>,
}

/// The job request of a file.
pub fn job_of(file: &Path, job: &JobOptions, log: &LogOptions, limits: &RecordingLimits) -> Result<Asked, CliError> {
    let shown = file.display();
    let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = name.trim_end_matches(".gz").to_owned();
    if is_job(file) {
        if let Some(flag) = log.given().next() {
            return Err(CliError::Usage(format!(
                "{shown} is a job file, taken as it is; --{flag} is for logs and recordings"
            )));
        }
        return Ok(Asked { json: job_file(file, job)?, notes: Vec::new() });
    }
    let selection = Selection { every: log.every.get(), from: log.from, to: log.to };
    let read = read_log(&opened(file), &log.ask(), &selection, limits, &|| true).map_err(complaint(file))?;
    let mut scans = read.scans;
    read.notes.iter().for_each(|note| eprintln!("{shown}: {note}"));
    if let Some(alphas) = &log.odometry {
        let alphas = <[f64; 4]>::try_from(alphas.as_slice()).ok().filter(|a| a.iter().all(|a| *a >= 0.0 && *a <= 1e3));
        let alphas = alphas.ok_or_else(|| CliError::Usage("--odometry takes four numbers from 0 to 1000".into()))?;
        Odometry { alphas }.spread(&mut scans, &job.noise());
    }
    let mut asked = json!({
        "name": stem.trim_end_matches(".log").trim_end_matches(".mcap"),
        "noise": {},
        "map": {"distance": "vdf", "resolution": RESOLUTION},
    });
    let Noise { sigma_x, sigma_y, sigma_theta, sigma_range } = job.noise();
    asked["noise"] =
        json!({"sigma_x": sigma_x, "sigma_y": sigma_y, "sigma_theta": sigma_theta, "sigma_range": sigma_range});
    job.override_in(&mut asked)?;
    let asked = asked.as_object().cloned().unwrap_or_default();
    let json = job_json(&asked, &scans, usize::MAX);
    let json = json.ok_or_else(|| CliError::Usage(format!("{shown} is too large")))?;
    Ok(Asked { json, notes: read.notes })
}

/// A job file with what flags override.
fn job_file(file: &Path, options: &JobOptions) -> Result<Vec<u8>, CliError> {
    let shown = file.display();
    let bytes = read_unzipped(file)?;
    if options.is_empty() {
        return Ok(bytes);
    }
    let unreadable = |error| CliError::Usage(format!("{shown} is no JSON: {error}"));
    let mut job: Value = serde_json::from_slice(&bytes).map_err(unreadable)?;
    if !job.is_object() {
        return Err(CliError::Usage(format!("{shown} is no job: a job is an object")));
    }
    options.override_in(&mut job)?;
    Ok(job.to_string().into_bytes())
}

/// Whether a file is a job's JSON, by its name.
fn is_job(file: &Path) -> bool {
    let name = file.to_string_lossy();
    name.strip_suffix(".gz").unwrap_or(&name).ends_with(".json")
}

/// A file, to be read as often as it takes.
fn opened(file: &Path) -> impl Fn() -> std::io::Result<Box<dyn Read>> + '_ {
    move || Ok(Box::new(BufReader::with_capacity(1 << 20, File::open(file)?)))
}

/// Why a log is none, in words for a terminal.
fn complaint(file: &Path) -> impl Fn(LogError) -> CliError + '_ {
    move |error| match error {
        LogError::Io(source) => unreadable(file)(source),
        LogError::Carmen(error) => CliError::Usage(format!("{}: {error}; a job file ends in .json", file.display())),
        error => CliError::Usage(format!("{}: {error}", file.display())),
    }
}

/// A file that cannot be read was named by whoever typed the command.
fn unreadable(file: &Path) -> impl Fn(std::io::Error) -> CliError + '_ {
    move |error| CliError::Usage(format!("{} cannot be read: {error}", file.display()))
}

/// A file's bytes; a gzipped one unpacked, to 1 GiB at most.
pub(super) fn read_unzipped(file: &Path) -> Result<Vec<u8>, CliError> {
    let shown = file.display();
    let bytes = std::fs::read(file).map_err(unreadable(file))?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut unzipped = Vec::new();
    let limit = 1 << 30;
    let mut reader = flate2::read::MultiGzDecoder::new(&bytes[..]).take(limit);
    reader.read_to_end(&mut unzipped).map_err(unreadable(file))?;
    if unzipped.len() as u64 == limit {
        return Err(CliError::Usage(format!("{shown} unpacks to more than 1 GiB")));
    }
    Ok(unzipped)
}

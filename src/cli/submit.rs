//! `submit`: job files and CARMEN logs to a server.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;

use super::CliError;
use super::client::{Client, text};
use crate::import::{Odometry, Selection, parse_carmen, to_request};
use crate::scan::Noise;

#[derive(Debug, Args)]
pub struct Submit {
    /// Job files (.json) or CARMEN logs (.log); either may be gzipped (.gz).
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// The server.
    #[arg(long, env = "MAPFIT_URL", default_value = "http://127.0.0.1:8080")]
    url: String,
    /// Wait for the maps, with a progress bar.
    #[arg(long, env = "MAPFIT_WAIT")]
    wait: bool,
    #[command(flatten)]
    log: LogOptions,
}

/// How a log becomes a job. A job file says all this itself.
#[derive(Debug, Args)]
struct LogOptions {
    /// vdf: the vector from the nearest surface, for buildings; sdf: signed, for rooms with an inside (logs).
    #[arg(long, env = "MAPFIT_DISTANCE", default_value = "vdf", value_parser = ["sdf", "vdf"])]
    distance: String,
    /// The spacing of control points, metres (logs).
    #[arg(long, env = "MAPFIT_RESOLUTION", default_value_t = 0.25)]
    resolution: f64,
    /// Take every so many scans (logs).
    #[arg(long, env = "MAPFIT_EVERY", default_value_t = 1)]
    every: usize,
    /// The first scan taken, counted from 0 (logs).
    #[arg(long, env = "MAPFIT_FROM", default_value_t = 0)]
    from: usize,
    /// One past the last scan taken (logs).
    #[arg(long, env = "MAPFIT_TO")]
    to: Option<usize>,
    /// Standard deviation of a pose's x and y, metres (logs).
    #[arg(long, env = "MAPFIT_SIGMA_XY", default_value_t = 0.02)]
    sigma_xy: f64,
    /// Standard deviation of a pose's heading, radians (logs).
    #[arg(long, env = "MAPFIT_SIGMA_THETA", default_value_t = 0.005)]
    sigma_theta: f64,
    /// For poses from wheel odometry: the motion model's alpha1,alpha2,alpha3,alpha4 as Nav2's AMCL has them (say
    /// 0.2,0.2,0.2,0.2). Poses' covariances grow along the way, from sigma-xy and sigma-theta at the first scan taken
    /// (logs).
    #[arg(long, env = "MAPFIT_ODOMETRY", value_delimiter = ',', num_args = 4)]
    odometry: Option<Vec<f64>>,
    /// Standard deviation of a range, metres (logs).
    #[arg(long, env = "MAPFIT_SIGMA_RANGE", default_value_t = 0.02)]
    sigma_range: f64,
}

impl Submit {
    pub fn run(self) -> Result<(), CliError> {
        let client = Client::new(&self.url);
        let mut unconverged = 0;
        for file in &self.files {
            let request = self.log.request(file)?;
            let job = client.submit(&request)?;
            println!("{}: job {}", file.display(), client.url(&text(&job["links"], "self")));
            if let Some(message) = job["message"].as_str() {
                eprintln!("{}: {message}", file.display());
            }
            if self.wait {
                let job = client.wait(&job)?;
                let map = client.get_json(&text(&job["links"], "map"))?;
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
                unconverged += usize::from(fit["converged"] != true);
                for (relation, address) in map["links"].as_object().into_iter().flatten() {
                    println!("  {relation:<13}{}", client.url(address.as_str().unwrap_or_default()));
                }
            }
        }
        if unconverged == 0 { Ok(()) } else { Err(CliError::Unconverged(unconverged)) }
    }
}

impl LogOptions {
    /// The job request of a file.
    fn request(&self, file: &Path) -> Result<Vec<u8>, CliError> {
        let bytes = read_unzipped(file)?;
        let shown = file.display();
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stem = name.trim_end_matches(".gz").to_owned();
        if stem.ends_with(".json") {
            return Ok(bytes);
        }
        if stem.ends_with(".mcap") {
            return Err(CliError::Usage(format!("{shown}: MCAP recordings cannot be read in this version")));
        }
        let log = String::from_utf8_lossy(&bytes);
        let scans = parse_carmen(&log).map_err(|error| {
            CliError::Usage(format!("{shown}: {error}. A job file ends in .json, a CARMEN log has FLASER lines"))
        })?;
        let selection = Selection { every: self.every, from: self.from, to: self.to };
        let mut scans = selection.of(scans);
        if scans.is_empty() {
            return Err(CliError::Usage(format!("{shown}: --from, --to and --every leave no scan")));
        }
        let noise = Noise {
            sigma_x: self.sigma_xy,
            sigma_y: self.sigma_xy,
            sigma_theta: self.sigma_theta,
            sigma_range: self.sigma_range,
        };
        if let Some(alphas) = &self.odometry {
            let alphas =
                <[f64; 4]>::try_from(alphas.as_slice()).ok().filter(|a| a.iter().all(|a| *a >= 0.0 && *a <= 1e3));
            let alphas =
                alphas.ok_or_else(|| CliError::Usage("--odometry takes four numbers from 0 to 1000".into()))?;
            Odometry { alphas }.spread(&mut scans, &noise);
        }
        let map = (self.distance.as_str(), self.resolution);
        Ok(to_request(&scans, &noise, Some(stem.trim_end_matches(".log")), map).to_string().into_bytes())
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

//! `fit`: a job file or a log into files, without a server.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;
use indicatif::ProgressBar;
use serde_json::json;

use super::CliError;
use super::request::{JobOptions, LogOptions, ON_DISK, job_of};
use crate::import::RecordingLimits;
use crate::jobs::{JobRequest, Limits, Progress, RequestError};
use crate::map::{ArchiveError, FittedMap, MapError, SurveyError, factors_npz, on_lattice_npz, scipy_sparse};
use crate::render::{
    Layer, Nav2Mode, OccupancyGrid, Overlay, Page, Picture, contours, map_picture, svg_to_png, to_geojson, to_nav2_zip,
};
use crate::sparse::Team;
use crate::uncertainty::{Factors, Kind};
use crate::worker::{Follower, fit_request};

#[derive(Debug, Args)]
pub struct FitCommand {
    /// The job file (.json: what POST /v1/jobs takes), a CARMEN log (.log) or an MCAP recording (.mcap); may be gzipped.
    file: PathBuf,
    /// The folder the files go to; it is made where it is missing.
    #[arg(long, env = "MAPFIT_OUT", required_unless_present = "list")]
    out: Option<PathBuf>,
    #[command(flatten)]
    job: JobOptions,
    #[command(flatten)]
    log: LogOptions,
}

impl FitCommand {
    pub fn run(self) -> Result<(), CliError> {
        let Some(out) = self.out.as_ref().filter(|_| !self.log.list) else { return self.log.show(&self.file) };
        let limits = Limits { control_points: 1_000_000, lattice: 4_000_000, values: 100_000_000, ..Limits::default() };
        let may = RecordingLimits { scans: limits.scans, ranges: limits.values, ..ON_DISK };
        let json = job_of(&self.file, &self.job, &self.log, &may)?;
        let request = JobRequest::parse(&json, &limits).map_err(|error| explain(&self.file, error))?;
        drop(json);
        let progress = Mutex::new(Progress::queued(request.options.max_iterations));
        let bar = ProgressBar::new_spinner().with_message("fitting");
        bar.enable_steady_tick(Duration::from_millis(100));
        let team = Team::of_this_machine();
        let follower = Follower { progress: &progress, stop: &AtomicBool::new(false), stage: &|_| (), team };
        let map = fit_request(&request, &follower)?;
        bar.finish_and_clear();
        std::fs::create_dir_all(out).map_err(CliError::io(out.display().to_string()))?;
        let factors =
            Factors::of(&mut request.resume(&map)?).map_err(|error| SurveyError::from(MapError::from(error)))?;
        write(out, "factors.npz", &factors_npz(&factors).map_err(ArchiveError::from)?)?;
        write_map(out, &map, request.name.as_deref().unwrap_or("map"))?;
        let report = &map.report;
        println!(
            "{} control points, {} returns, {} steps, {} in {:.2} s",
            map.lattice().len(),
            report.observations,
            report.iterations,
            if report.converged { "converged" } else { "not converged" },
            report.seconds,
        );
        println!("written to {}", out.display());
        Ok(())
    }
}

/// A map's files: arrays, contour, OGM, pictures.
fn write_map(out: &Path, map: &FittedMap, name: &str) -> Result<(), CliError> {
    write(out, "map.npz", &map.to_npz()?)?;
    let coefficients = on_lattice_npz(map.lattice(), &map.field.coefficients());
    write(out, "coefficients.npz", &coefficients.map_err(ArchiveError::from)?)?;
    let covariance = scipy_sparse(&map.field, Kind::Propagated);
    write(out, "covariance.npz", &covariance.map_err(ArchiveError::from)?)?;
    let report = serde_json::to_string_pretty(&json!({"lattice": map.lattice(), "fit": map.report}));
    let report = report.map_err(|error| CliError::Server(error.to_string()))?;
    write(out, "fit.json", report.as_bytes())?;
    let traced = contours(map, 0.0, Some(2.0), Kind::Propagated)?;
    write(out, "contours.geojson", to_geojson(&traced, "map").to_string().as_bytes())?;
    let grid = OccupancyGrid::of(map, map.lattice().resolution, Kind::Propagated);
    write(out, "ogm.zip", &to_nav2_zip(&grid, Nav2Mode::Trinary)?)?;
    for (file, layer) in [("distance", Layer::Distance), ("sigma", Layer::Sigma), ("occupancy", Layer::Occupancy)] {
        let overlays = match layer {
            Layer::Distance => vec![Overlay::Points, Overlay::Contour],
            Layer::Sigma => vec![Overlay::Contour],
            Layer::Occupancy => vec![],
        };
        let page = Page::new(format!("{name}: {file}"), 900);
        let picture = Picture { layer, overlays, cell: None, page };
        write(out, &format!("{file}.png"), &svg_to_png(&map_picture(map, &picture)?)?)?;
    }
    Ok(())
}

pub(super) fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), CliError> {
    let file = folder.join(name);
    std::fs::write(&file, bytes).map_err(CliError::io(file.display().to_string()))
}

fn explain(file: &Path, error: RequestError) -> CliError {
    let mut words = format!("{}: {error}", file.display());
    if let RequestError::Faults(faults) = &error {
        for fault in faults {
            words.push_str(&format!("\n  {} {}", fault.pointer, fault.detail));
        }
    }
    CliError::Usage(words)
}

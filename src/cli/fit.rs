//! `fit`: a job file or a log into files, without a server.

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::CliError;
use super::bar::{Bar, Standing};
use super::request::{Asked, JobOptions, LogOptions, ON_DISK, job_of};
use super::summary::summary;
use crate::import::RecordingLimits;
use crate::jobs::{JobRequest, Limits, RequestError};
use crate::map::{
    ArchiveError, FittedMap, MapError, Stage, Step, SurveyError, factors_npz, on_lattice_npz, scipy_sparse,
};
use crate::render::{
    Layer, Nav2Mode, OccupancyGrid, Overlay, Page, Picture, contours, map_picture, svg_to_png, to_geojson, to_nav2_zip,
};
use crate::sparse::Team;
use crate::uncertainty::{Factors, Kind};

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
        let Asked { json, notes } = job_of(&self.file, &self.job, &self.log, &may)?;
        let request = JobRequest::parse(&json, &limits).map_err(|error| explain(&self.file, error))?;
        drop(json);
        // Before the fit, which would be for nothing otherwise.
        let folder = out.display();
        let refused = |error| CliError::Usage(format!("the folder {folder} cannot be made: {error}; see --out"));
        std::fs::create_dir_all(out).map_err(refused)?;
        let bar = RefCell::new(Bar::new());
        let map = fitted(&request, &bar)?;
        bar.borrow_mut().says(FITTED, format!("writing to {folder}"));
        let factors = Factors::of(&mut request.resume(&map, &|| true)?)
            .map_err(|error| SurveyError::from(MapError::from(error)))?;
        write(out, "factors.npz", &factors_npz(&factors).map_err(ArchiveError::from)?)?;
        let told = json!({"lattice": map.lattice(), "fit": map.report});
        write_map(out, &map, &told, request.name.as_deref().unwrap_or("map"))?;
        drop(bar);
        println!("{}: written to {folder}", self.file.display());
        print!("{}", summary(&told, &notes));
        CliError::of_unconverged(usize::from(!map.report.converged))
    }
}

/// A fit's share of the whole, per cent: its files are written after it.
const FITTED: f64 = 80.0;

/// The map of a request, while the bar shows how far it is.
fn fitted(request: &JobRequest, bar: &RefCell<Bar>) -> Result<FittedMap, SurveyError> {
    let observer = |step: &Step| {
        let stage = match step.stage {
            Stage::Fitting => "fitting",
            Stage::Covariance => "covariance",
        };
        bar.borrow_mut().show(Standing { percent: FITTED * step.share, stage, step: step.fit.iteration as u64 });
        ControlFlow::Continue(())
    };
    request.survey().team(Team::of_this_machine()).map_watched(&observer)
}

/// A map's files: arrays, contour, OGM, pictures. `told` is what it says of itself.
fn write_map(out: &Path, map: &FittedMap, told: &Value, name: &str) -> Result<(), CliError> {
    write(out, "map.npz", &map.to_npz()?)?;
    let coefficients = on_lattice_npz(map.lattice(), &map.field.coefficients());
    write(out, "coefficients.npz", &coefficients.map_err(ArchiveError::from)?)?;
    let covariance = scipy_sparse(&map.field, Kind::Propagated);
    write(out, "covariance.npz", &covariance.map_err(ArchiveError::from)?)?;
    write(out, "fit.json", format!("{told:#}").as_bytes())?;
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

//! `reproduce`: every figure and table of the method's two experiments, from simulation.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::CliError;
use super::fit::write;
use super::request::read_unzipped;
use crate::import::parse_corridor;
use crate::render::svg_to_png;
use crate::reproduce::{STEPS, page, reproduce};
use crate::sim::Survey;

#[derive(Debug, Args)]
pub struct Reproduce {
    /// The folder the figures (PNG and SVG), tables (CSV) and the page go to; it is made where it is missing.
    #[arg(long, env = "MAPFIT_OUT")]
    out: PathBuf,
    /// A folder with `willow-corridor/`, for experiment 2 in the building of the publication; an office of our own
    /// making stands in without it.
    #[arg(long, env = "MAPFIT_RECORDINGS")]
    data: Option<PathBuf>,
}

impl Reproduce {
    pub fn run(self) -> Result<(), CliError> {
        let folder = self.out.display().to_string();
        std::fs::create_dir_all(&self.out).map_err(CliError::io(folder.clone()))?;
        let willow = self.data.map(|data| data.join("willow-corridor")).filter(|place| place.is_dir());
        let willow = willow.map(|place| read_survey(&place)).transpose()?;
        let bar = ProgressBar::new(STEPS as u64 + u64::from(willow.is_some()));
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(100));
        let began = |what: &str| {
            bar.inc(1);
            bar.set_message(what.to_owned());
        };
        let all = reproduce(willow.as_ref(), &mut { began })?;
        bar.set_message("writing");
        for table in &all.tables {
            let lines: Vec<String> = table.rows.iter().map(|row| csv_line(row)).collect();
            write(&self.out, &format!("{}.csv", table.name), (lines.join("\n") + "\n").as_bytes())?;
        }
        for plate in &all.plates {
            write(&self.out, &format!("{}.svg", plate.name), plate.svg.as_bytes())?;
            write(&self.out, &format!("{}.png", plate.name), &svg_to_png(&plate.svg)?)?;
        }
        write(&self.out, "reproduction.md", page(&all, "").as_bytes())?;
        bar.finish_and_clear();
        println!("{} figures and {} tables; the page: {folder}/reproduction.md", all.plates.len(), all.tables.len());
        Ok(())
    }
}

fn read_survey(place: &Path) -> Result<Survey, CliError> {
    let text = |name: &str| -> Result<String, CliError> {
        Ok(String::from_utf8_lossy(&read_unzipped(&place.join(name))?).into_owned())
    };
    parse_corridor(&text("walls.csv")?, &text("scans.json.gz")?)
        .map_err(|error| CliError::Usage(format!("{}: {error}", place.display())))
}

fn csv_line(cells: &[String]) -> String {
    let quoted = |cell: &String| match cell.contains([',', '"']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"")),
        false => cell.clone(),
    };
    cells.iter().map(quoted).collect::<Vec<_>>().join(",")
}

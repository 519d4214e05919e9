//! `export` and `import`: a backup of everything, out of the stores and into them.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::CliError;
use super::serve::runtime;
use super::stores::Stores;
use crate::backup::{export, import};

/// Which stores, and which folder.
#[derive(Debug, Args)]
pub struct Backup {
    /// The folder of the export. One that has an export takes only what is new.
    folder: PathBuf,
    #[command(flatten)]
    stores: Stores,
    /// JSON on stdout.
    #[arg(long, env = "MAPFIT_JSON")]
    json: bool,
}

impl Backup {
    pub fn export(self) -> Result<(), CliError> {
        runtime()?.block_on(async {
            let (records, artifacts) = (self.stores.records().await?, self.stores.artifacts()?);
            let manifest = export(&*records.ports(), &artifacts, &self.folder).await?;
            let lines = |name: &str| manifest.records.get(name).map_or(0, |file| file.lines);
            let lost: Vec<_> = manifest.gaps.iter().filter(|gap| !gap.deleted).collect();
            match self.json {
                true => println!("{}", json!(manifest)),
                false => println!(
                    "exported {} jobs, {} maps, {} places, {} keys, {} webhooks as of {} to {}",
                    lines("jobs.jsonl"),
                    lines("maps.jsonl") - manifest.gaps.len() as u64,
                    lines("places.jsonl"),
                    lines("keys.jsonl"),
                    lines("webhooks.jsonl"),
                    manifest.taken,
                    self.folder.display()
                ),
            }
            for gap in &lost {
                eprintln!("mapfit: the map {} is not in it: {}", gap.map_id, gap.why);
            }
            match lost.len() {
                0 => Ok(()),
                count => Err(CliError::Server(format!(
                    "the files of {count} maps are missing or damaged; all else is exported"
                ))),
            }
        })
    }

    pub fn import(self) -> Result<(), CliError> {
        runtime()?.block_on(async {
            let (records, artifacts) = (self.stores.records().await?, self.stores.artifacts()?);
            let restored = import(&*records.ports(), &artifacts, &self.folder).await?;
            match self.json {
                true => println!("{}", json!(restored)),
                false => println!("added {} records; {} were there already", restored.added, restored.there),
            }
            Ok(())
        })
    }
}

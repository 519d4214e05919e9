//! `jobs`, `maps`, `places`, `cancel`: what there is on a server, for people and for scripts.

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::CliError;
use super::client::{Client, Remote, text};
use super::follow::Follow;

/// How to show what a server answers.
#[derive(Debug, Args)]
pub struct Shown {
    #[command(flatten)]
    remote: Remote,
    /// JSON on stdout: an object a line.
    #[arg(long, env = "MAPFIT_JSON", global = true)]
    json: bool,
}

/// Which ones to list.
#[derive(Debug, Args)]
pub struct Listed {
    /// key:value; may be repeated, all must match.
    #[arg(long)]
    label: Vec<String>,
    /// Show so many at most, newest first.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..))]
    limit: u32,
}

#[derive(Debug, Args)]
pub struct Jobs {
    #[command(flatten)]
    shown: Shown,
    #[command(subcommand)]
    command: JobCommand,
}

#[derive(Debug, Subcommand)]
enum JobCommand {
    /// Newest first.
    List {
        /// accepted, running, successful, failed or dismissed.
        #[arg(long)]
        status: Option<String>,
        #[command(flatten)]
        listed: Listed,
    },
    /// One, whole.
    Get { id: String },
    /// Wait until jobs have ended, with a progress bar, and show their maps, as `submit --wait` does.
    Wait {
        #[arg(required = true)]
        ids: Vec<String>,
    },
    /// Submit an ended job's request once more.
    Retry { id: String },
}

#[derive(Debug, Args)]
pub struct Maps {
    #[command(flatten)]
    shown: Shown,
    #[command(subcommand)]
    command: MapCommand,
}

#[derive(Debug, Subcommand)]
enum MapCommand {
    /// Newest first.
    List {
        #[command(flatten)]
        listed: Listed,
    },
    /// One, whole.
    Get { id: String },
    /// Delete one and its arrays.
    Delete { id: String },
}

#[derive(Debug, Args)]
pub struct Places {
    #[command(flatten)]
    shown: Shown,
    #[command(subcommand)]
    command: PlaceCommand,
}

#[derive(Debug, Subcommand)]
enum PlaceCommand {
    /// Published last first.
    List,
    /// Which map a place has.
    Get { name: String },
    /// Every version it had.
    Versions { name: String },
    /// Publish a map there, as the next version.
    Publish {
        name: String,
        map_id: String,
        #[arg(long)]
        note: Option<String>,
    },
    /// Publish an older version's map again.
    Rollback { name: String, version: i64 },
    /// Remove the place and its history; maps stay.
    Delete { name: String },
}

#[derive(Debug, Args)]
pub struct Cancel {
    #[command(flatten)]
    shown: Shown,
    /// The jobs.
    #[arg(required = true)]
    ids: Vec<String>,
}

impl Jobs {
    pub fn run(self) -> Result<(), CliError> {
        let (client, shown) = self.shown.open();
        match self.command {
            JobCommand::List { status, listed } => {
                let status = status.map(|status| format!("status={}", encoded(&status)));
                let jobs = client.list("/v1/jobs", &listed.query(status), listed.limit as usize)?;
                shown.table(&jobs, &["id", "status", "created", "name"]);
            }
            JobCommand::Get { id } => shown.one(&client.get_json(&format!("/v1/jobs/{}", encoded(&id)))?),
            JobCommand::Wait { ids } => {
                let (mut unconverged, follow) = (0, Follow { client: &client, wait: true, json: shown.json });
                for id in &ids {
                    let job = client.get_json(&format!("/v1/jobs/{}", encoded(id)))?;
                    let map = follow.job(job["name"].as_str().unwrap_or("job"), &[], job.clone())?;
                    unconverged += usize::from(map.is_some_and(|map| map["fit"]["converged"] != true));
                }
                return CliError::of_unconverged(unconverged);
            }
            JobCommand::Retry { id } => {
                shown.one(&client.send_json("POST", &format!("/v1/jobs/{}/retry", encoded(&id)), None)?);
            }
        }
        Ok(())
    }
}

impl Maps {
    pub fn run(self) -> Result<(), CliError> {
        let (client, shown) = self.shown.open();
        match self.command {
            MapCommand::List { listed } => {
                let maps = client.list("/v1/maps", &listed.query(None), listed.limit as usize)?;
                shown.table(&maps, &["id", "distance", "created", "name"]);
            }
            MapCommand::Get { id } => shown.one(&client.get_json(&format!("/v1/maps/{}", encoded(&id)))?),
            MapCommand::Delete { id } => client.delete(&format!("/v1/maps/{}", encoded(&id)))?,
        }
        Ok(())
    }
}

impl Places {
    pub fn run(self) -> Result<(), CliError> {
        let (client, shown) = self.shown.open();
        const COLUMNS: [&str; 4] = ["name", "version", "map_id", "published"];
        let place = |name: &str| format!("/v1/places/{}", encoded(name));
        match self.command {
            PlaceCommand::List => shown.table(&client.list("/v1/places", "", usize::MAX)?, &COLUMNS),
            PlaceCommand::Get { name } => shown.one(&client.get_json(&place(&name))?),
            PlaceCommand::Versions { name } => {
                shown.table(&client.list(&format!("{}/versions", place(&name)), "", usize::MAX)?, &COLUMNS);
            }
            PlaceCommand::Publish { name, map_id, note } => {
                let body = json!({"map_id": map_id, "note": note});
                shown.one(&client.send_json("PUT", &place(&name), Some(&body))?);
            }
            PlaceCommand::Rollback { name, version } => {
                let body = json!({"version": version});
                shown.one(&client.send_json("POST", &format!("{}/rollback", place(&name)), Some(&body))?);
            }
            PlaceCommand::Delete { name } => client.delete(&place(&name))?,
        }
        Ok(())
    }
}

impl Cancel {
    pub fn run(self) -> Result<(), CliError> {
        let (client, shown) = self.shown.open();
        let mut refused = Ok(());
        // One that has ended already does not save the others.
        for id in &self.ids {
            match client.send_json("DELETE", &format!("/v1/jobs/{}", encoded(id)), None) {
                Ok(job) if shown.json => println!("{job}"),
                Ok(job) => println!("{id} {}", text(&job, "status")),
                Err(error @ CliError::Server(_)) => {
                    if let Err(before) = std::mem::replace(&mut refused, Err(error)) {
                        eprintln!("mapfit: {before}");
                    }
                }
                Err(other) => return Err(other),
            }
        }
        refused
    }
}

impl Listed {
    fn query(&self, more: Option<String>) -> String {
        let labels = self.label.iter().map(|label| format!("label={}", encoded(label)));
        labels.chain(more).collect::<Vec<_>>().join("&")
    }
}

/// How this command prints.
struct Printer {
    json: bool,
}

impl Shown {
    fn open(&self) -> (Client, Printer) {
        (self.remote.client(), Printer { json: self.json })
    }
}

impl Printer {
    fn one(&self, value: &Value) {
        match self.json {
            true => println!("{value}"),
            false => println!("{value:#}"),
        }
    }

    fn table(&self, rows: &[Value], columns: &[&str]) {
        if self.json {
            return rows.iter().for_each(|row| println!("{row}"));
        }
        let cell = |row: &Value, column: &&str| match &row[*column] {
            Value::Null => "-".to_owned(),
            Value::String(text) => text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect(),
            other => other.to_string(),
        };
        let header = columns.iter().map(|column| (*column).to_owned()).collect();
        let lines: Vec<Vec<String>> = std::iter::once(header)
            .chain(rows.iter().map(|row| columns.iter().map(|c| cell(row, c)).collect()))
            .collect();
        let width = |at: usize| lines.iter().map(|line| line[at].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns.len()).map(width).collect();
        for line in &lines {
            let padded: Vec<String> = line.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
            println!("{}", padded.join("  ").trim_end());
        }
    }
}

/// Part of an address.
pub(super) fn encoded(text: &str) -> String {
    form_urlencoded::byte_serialize(text.as_bytes()).collect::<String>().replace('+', "%20")
}

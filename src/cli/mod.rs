//! The command line: one binary, a file a command.

mod backup;
mod bar;
mod client;
mod demo;
mod fit;
mod follow;
mod health;
mod interrupt;
mod keys;
mod living;
mod localize;
mod reproduce;
mod request;
mod resources;
mod serve;
mod stores;
mod submit;
mod summary;
mod trajectory;

use std::io::IsTerminal;

use clap::{CommandFactory, Parser, Subcommand};
use thiserror::Error;
use tracing_subscriber::EnvFilter;

use crate::store::ArtifactsError;

/// Distance maps with their covariance, from laser scans.
#[derive(Debug, Parser)]
#[command(version, about)]
pub struct Cli {
    /// What to log: error, warn, info, debug, or tracing directives.
    #[arg(long, env = "MAPFIT_LOG", default_value = "info", global = true, help_heading = "Logging")]
    log: String,
    /// How to log: text, or an object of JSON a line.
    #[arg(long, env = "MAPFIT_LOG_FORMAT", default_value = "text", value_parser = ["text", "json"], global = true)]
    #[arg(help_heading = "Logging")]
    log_format: String,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve HTTP, with workers.
    Serve(serve::Serve),
    /// Work on jobs without serving, beside a `serve --workers 0` on the same data.
    Worker(serve::Work),
    /// Send job files, CARMEN logs or MCAP recordings to a server.
    Submit(submit::Submit),
    /// Update a map of a server with new scans.
    Update(living::Update),
    /// Join maps of a server into one.
    Join(living::Join),
    /// Where a log's scans were taken, on a map of a server.
    Localize(localize::Localize),
    /// Fit a job file, a CARMEN log or an MCAP recording without a server.
    Fit(fit::FitCommand),
    /// Serve, submit the bundled example, write its pictures, keep serving.
    Demo(demo::Demo),
    /// Draw every figure and table of the method's two experiments, from simulation.
    Reproduce(reproduce::Reproduce),
    /// List jobs of a server, get one, wait for one, try one again.
    Jobs(resources::Jobs),
    /// List maps of a server, get or delete one.
    Maps(resources::Maps),
    /// Places of a server: which maps they have, publication, roll back.
    Places(resources::Places),
    /// Cancel jobs.
    Cancel(resources::Cancel),
    /// A script for a shell that completes commands and flags: `mapfit completions bash > /etc/bash_completion.d/mapfit`.
    Completions { shell: clap_complete::Shell },
    /// Make, list and revoke API keys.
    Keys(keys::Keys),
    /// Back up all jobs, maps, places, keys and webhooks into a folder, while the service runs.
    Export(backup::Backup),
    /// Add what a folder of `export` has to the stores, of whichever kind.
    Import(backup::Backup),
    /// Ask whether a server is ready; the exit code tells.
    Health(health::Health),
}

/// Why a command failed, in words for a terminal.
#[derive(Debug, Error)]
pub enum CliError {
    #[error("{0}")]
    Usage(String),
    #[error("{context}: {source}")]
    Io { context: String, source: std::io::Error },
    #[error(transparent)]
    Store(#[from] crate::store::StoreError),
    #[error(transparent)]
    Artifacts(#[from] ArtifactsError),
    #[error(transparent)]
    Backup(#[from] crate::backup::BackupError),
    #[error(transparent)]
    Survey(#[from] crate::map::SurveyError),
    #[error(transparent)]
    Archive(#[from] crate::map::ArchiveError),
    #[error(transparent)]
    Render(#[from] crate::render::RenderError),
    #[error(transparent)]
    Reproduce(#[from] crate::reproduce::ReproduceError),
    #[error(transparent)]
    Traces(#[from] crate::traces::TracesError),
    #[error("the metrics could not be set up: {0}")]
    Metrics(#[from] prometheus::Error),
    #[error("{0}")]
    Server(String),
    #[error("{0}")]
    Unreachable(String),
    #[error("{0} of the maps did not converge: fit.unconverged says why, docs/deciding.md what helps")]
    Unconverged(usize),
    #[error("{nowhere} of {all} scans fit nowhere on the map")]
    Nowhere { nowhere: usize, all: usize },
}

impl CliError {
    /// The process's exit code, as the contract has them.
    fn code(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Traces(_) | Self::Artifacts(ArtifactsError::Address(_)) => 2,
            Self::Unreachable(_) => 3,
            _ => 1,
        }
    }

    /// Of so many fits that did not converge.
    fn of_unconverged(count: usize) -> Result<(), Self> {
        if count == 0 { Ok(()) } else { Err(Self::Unconverged(count)) }
    }

    fn io(context: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let context = context.into();
        move |source| Self::Io { context, source }
    }
}

impl Command {
    /// Whether others depend on the process: it must outlive whoever reads its output.
    fn serves(&self) -> bool {
        matches!(self, Self::Serve(_) | Self::Worker(_) | Self::Demo(_))
    }
}

/// Runs the command line of this process.
pub fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    let filter = match EnvFilter::try_new(&cli.log) {
        Ok(filter) => filter,
        Err(error) => return failed(&CliError::Usage(format!("--log takes error, warn, info or debug: {error}"))),
    };
    // Colours are for eyes: a file or a pipe gets none.
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    match cli.log_format.as_str() {
        "json" => log.json().flatten_event(true).init(),
        _ => log.with_ansi(std::io::stderr().is_terminal()).init(),
    }
    if !cli.command.serves() {
        // Whoever reads the first lines alone (`| head`) wants no more, and no complaint.
        sigpipe::reset();
    }
    let outcome = match cli.command {
        Command::Serve(command) => command.run(),
        Command::Worker(command) => command.run(),
        Command::Submit(command) => command.run(),
        Command::Update(command) => command.run(),
        Command::Localize(command) => command.run(),
        Command::Join(command) => command.run(),
        Command::Fit(command) => command.run(),
        Command::Demo(command) => command.run(),
        Command::Reproduce(command) => command.run(),
        Command::Jobs(command) => command.run(),
        Command::Maps(command) => command.run(),
        Command::Places(command) => command.run(),
        Command::Cancel(command) => command.run(),
        Command::Completions { shell } => {
            clap_complete::generate(shell, &mut Cli::command(), "mapfit", &mut std::io::stdout());
            Ok(())
        }
        Command::Keys(command) => command.run(),
        Command::Export(command) => command.export(),
        Command::Import(command) => command.import(),
        Command::Health(command) => command.run(),
    };
    match outcome {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => failed(&error),
    }
}

fn failed(error: &CliError) -> std::process::ExitCode {
    eprintln!("mapfit: {error}");
    std::process::ExitCode::from(error.code())
}

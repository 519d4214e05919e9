//! Where data lives: what every command takes that opens the stores itself.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use rustix::fs::Mode;
use rustix::process::umask;

use super::CliError;
use crate::store::{Artifacts, PostgresStore, Records, SqliteStore};

/// To a PostgreSQL server, a process.
const DATABASE_CONNECTIONS: u32 = 16;

/// The folder, the database, the artifact store.
#[derive(Debug, Clone, Args)]
pub struct Stores {
    /// The folder of the database and the maps; it is made where it is missing and needed.
    #[arg(long, env = "MAPFIT_DATA", default_value = "mapfit-data")]
    pub data: PathBuf,
    /// The database, for several servers and workers on one: postgres://USER@HOST/NAME. Without it, a file under the data
    /// folder.
    #[arg(long, env = "MAPFIT_DATABASE_URL", hide_env_values = true)]
    pub database_url: Option<String>,
    /// The artifact store: s3://BUCKET/PREFIX, with the usual AWS_* variables, or a folder. Without it, `artifacts` under the
    /// data folder.
    #[arg(long, env = "MAPFIT_ARTIFACTS")]
    pub artifacts: Option<String>,
}

impl Stores {
    /// Everything under one folder.
    pub fn in_folder(data: PathBuf) -> Self {
        Self { data, database_url: None, artifacts: None }
    }

    pub async fn records(&self) -> Result<Database, CliError> {
        open_records(&self.data, self.database_url.as_deref()).await
    }

    /// Within an async runtime.
    pub fn artifacts(&self) -> Result<Artifacts, CliError> {
        match self.artifacts.as_deref() {
            Some(url) if url.starts_with("s3://") => {
                let variables = std::env::vars_os();
                let readable =
                    variables.filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)));
                Ok(Artifacts::in_bucket(url, readable)?)
            }
            Some(url) if url.contains("://") => {
                Err(CliError::Usage(format!("--artifacts {url}: s3://BUCKET/PREFIX or a folder is known")))
            }
            Some(folder) => Ok(Artifacts::in_folder(Path::new(folder))?),
            None => {
                make_private(&self.data)?;
                Ok(Artifacts::in_folder(&self.data.join("artifacts"))?)
            }
        }
    }
}

/// Where the records are.
pub(super) enum Database {
    Sqlite(Arc<SqliteStore>),
    Postgres(Arc<PostgresStore>),
}

impl Database {
    pub fn ports(&self) -> Arc<dyn Records> {
        match self {
            Self::Sqlite(store) => store.clone(),
            Self::Postgres(store) => store.clone(),
        }
    }
}

/// The records in a database, or under a data folder, which is made where it is missing.
pub(super) async fn open_records(data: &Path, database_url: Option<&str>) -> Result<Database, CliError> {
    match database_url {
        None => {
            make_private(data)?;
            Ok(Database::Sqlite(Arc::new(SqliteStore::open(&data.join("mapfit.sqlite")).await?)))
        }
        Some(url) if url.starts_with("postgres://") || url.starts_with("postgresql://") => {
            Ok(Database::Postgres(Arc::new(PostgresStore::open(url, DATABASE_CONNECTIONS).await?)))
        }
        Some(_) => Err(CliError::Usage("--database-url must begin with postgres://".into())),
    }
}

/// What robots saw is nobody else's on this machine: neither the folder, nor files in one that was there before.
fn make_private(folder: &Path) -> Result<(), CliError> {
    umask(Mode::RWXG | Mode::RWXO);
    let mut private = std::fs::DirBuilder::new();
    std::os::unix::fs::DirBuilderExt::mode(private.recursive(true), 0o700);
    private.create(folder).map_err(CliError::io(format!("the data folder {} cannot be made", folder.display())))
}

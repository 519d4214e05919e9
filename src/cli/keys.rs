//! `keys`: make, list and revoke API keys, on the data folder or the database itself.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use serde_json::json;

use super::CliError;
use super::serve::runtime;
use super::stores::open_records;
use crate::access::new_key;
use crate::http::shared::Scope;
use crate::http::shared::page::timestamp;
use crate::store::{ApiKey, Records};

#[derive(Debug, Args)]
pub struct Keys {
    /// The folder of the database.
    #[arg(long, env = "MAPFIT_DATA", default_value = "mapfit-data", global = true)]
    data: PathBuf,
    /// The database, where it is not in that folder: postgres://USER@HOST/NAME.
    #[arg(long, env = "MAPFIT_DATABASE_URL", hide_env_values = true, global = true)]
    database_url: Option<String>,
    /// JSON on stdout, an object a line.
    #[arg(long, env = "MAPFIT_JSON", global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a key. It is shown once: the last line of stdout.
    Create {
        /// Whose jobs, maps and places it sees.
        #[arg(long, env = "MAPFIT_TENANT", default_value = "default", value_parser = name)]
        tenant: String,
        /// What it may do: read, submit, admin.
        #[arg(long, env = "MAPFIT_SCOPES", value_delimiter = ',', required = true)]
        scopes: Vec<ScopeName>,
        /// What it is for.
        #[arg(long, env = "MAPFIT_NAME", value_parser = name)]
        name: Option<String>,
    },
    /// All keys, without the keys themselves.
    List,
    /// A key opens nothing from now on.
    Revoke { id: String },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum ScopeName {
    Read,
    Submit,
    Admin,
}

impl ScopeName {
    fn scope(self) -> Scope {
        match self {
            Self::Read => Scope::Read,
            Self::Submit => Scope::Submit,
            Self::Admin => Scope::Admin,
        }
    }
}

fn name(text: &str) -> Result<String, String> {
    let fits = (1..=256).contains(&text.len()) && !text.chars().any(char::is_control);
    if fits { Ok(text.to_owned()) } else { Err("must have 1 to 256 bytes, and no control characters".into()) }
}

impl Keys {
    pub fn run(self) -> Result<(), CliError> {
        let runtime = runtime()?;
        let records = runtime.block_on(open_records(&self.data, self.database_url.as_deref()))?;
        runtime.block_on(self.command.run(&*records.ports(), self.json))
    }
}

impl Command {
    async fn run(self, records: &dyn Records, json: bool) -> Result<(), CliError> {
        match self {
            Self::Create { tenant, mut scopes, name } => {
                scopes.sort_unstable();
                scopes.dedup();
                let scopes: Vec<&str> = scopes.into_iter().map(|scope| scope.scope().name()).collect();
                let made = new_key(&tenant, name.as_deref(), &scopes);
                let (key, new) = made.map_err(|error| CliError::Server(format!("no random numbers: {error}")))?;
                let made = records.add_key(&new).await?;
                match json {
                    true => println!("{}", with(shown(&made), "key", &key)),
                    false => {
                        println!(
                            "key {} of tenant {tenant}, for {}; it is not shown again:",
                            made.id,
                            scopes.join(", ")
                        );
                        println!("{key}");
                    }
                }
            }
            Self::List => {
                let keys = records.keys().await?;
                if !json {
                    println!("{:<18}{:<16}{:<22}{:<26}{:<10}name", "id", "tenant", "scopes", "created", "state");
                }
                for key in keys {
                    match json {
                        true => println!("{}", shown(&key)),
                        false => {
                            let state = if key.revoked.is_some() { "revoked" } else { "active" };
                            let (scopes, created) = (key.scopes.join(","), timestamp(key.created).unwrap_or_default());
                            let name = key.name.unwrap_or_default();
                            println!("{:<18}{:<16}{scopes:<22}{created:<26}{state:<10}{name}", key.id, key.tenant);
                        }
                    }
                }
            }
            Self::Revoke { id } => {
                if !records.revoke_key(&id).await? {
                    return Err(CliError::Usage(format!(
                        "there is no key {id}; `mapfit keys list` shows those there are"
                    )));
                }
                match json {
                    true => println!("{}", json!({"id": id, "revoked": true})),
                    false => println!("key {id} is revoked"),
                }
            }
        }
        Ok(())
    }
}

fn shown(key: &ApiKey) -> serde_json::Value {
    json!({
        "id": key.id, "tenant": key.tenant, "scopes": key.scopes, "name": key.name,
        "created": timestamp(key.created), "revoked": key.revoked.and_then(timestamp),
    })
}

fn with(mut value: serde_json::Value, member: &str, text: &str) -> serde_json::Value {
    value[member] = text.into();
    value
}

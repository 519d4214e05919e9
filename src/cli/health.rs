//! `health`: whether a server is ready, as an exit code; for container health checks, which have no curl.

use clap::Args;

use super::CliError;
use super::client::Remote;

#[derive(Debug, Args)]
pub struct Health {
    #[command(flatten)]
    remote: Remote,
}

impl Health {
    pub fn run(self) -> Result<(), CliError> {
        let answer = self.remote.client().get_json("/readyz")?;
        println!("{}", answer["status"].as_str().unwrap_or("ready"));
        Ok(())
    }
}

//! `health`: whether a server is ready, as an exit code; for container health checks, which have no curl.

use clap::Args;

use super::CliError;
use super::client::Client;

#[derive(Debug, Args)]
pub struct Health {
    /// The server.
    #[arg(long, env = "MAPFIT_URL", default_value = "http://127.0.0.1:8080")]
    url: String,
}

impl Health {
    pub fn run(self) -> Result<(), CliError> {
        let answer = Client::new(&self.url).get_json("/readyz")?;
        println!("{}", answer["status"].as_str().unwrap_or("ready"));
        Ok(())
    }
}

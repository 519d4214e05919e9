//! `update` and `join`: maps that grow.

use clap::Args;
use serde_json::{Value, json};

use super::CliError;
use super::client::Remote;
use super::follow::Follow;
use super::submit::Submit;

#[derive(Debug, Args)]
pub struct Update {
    /// The map to update, by id.
    map: String,
    /// New scans, as for `submit`; a job file's `map` is left out. Several files are several updates, one after the other.
    #[command(flatten)]
    scans: Submit,
}

impl Update {
    pub fn run(self) -> Result<(), CliError> {
        self.scans.update(&self.map)
    }
}

#[derive(Debug, Args)]
pub struct Join {
    /// Maps, by id, each with a guess where its frame lies in the joined one: ID@X,Y,THETA (metres, radians). The first is
    /// held, at the origin where it says nothing.
    #[arg(required = true)]
    maps: Vec<String>,
    #[command(flatten)]
    remote: Remote,
    /// Wait for the map, with a progress bar.
    #[arg(long, env = "MAPFIT_WAIT")]
    wait: bool,
    /// {"job": ..., "map": ...} on stdout, one line, and nothing else there; map is null without --wait.
    #[arg(long, env = "MAPFIT_JSON")]
    json: bool,
    /// The spacing of control points, metres; the first map's.
    #[arg(long, env = "MAPFIT_RESOLUTION")]
    resolution: Option<f64>,
    /// Standard deviation of a guess's x and y, metres.
    #[arg(long, env = "MAPFIT_SIGMA_XY", default_value_t = 0.5)]
    sigma_xy: f64,
    /// Standard deviation of a guess's heading, radians.
    #[arg(long, env = "MAPFIT_SIGMA_THETA", default_value_t = 0.15)]
    sigma_theta: f64,
    /// What it is called.
    #[arg(long, env = "MAPFIT_NAME")]
    name: Option<String>,
    /// key:value; may be repeated.
    #[arg(long, env = "MAPFIT_LABEL", value_delimiter = ',')]
    label: Vec<String>,
}

impl Join {
    pub fn run(self) -> Result<(), CliError> {
        let client = self.remote.client();
        let maps = self.maps.iter().map(|map| self.member(map)).collect::<Result<Vec<Value>, CliError>>()?;
        let resolution = match self.resolution {
            Some(resolution) => json!(resolution),
            None => {
                let first = maps[0]["id"].as_str().unwrap_or_default();
                client.get_json(&format!("/v1/maps/{first}"))?["lattice"]["resolution"].clone()
            }
        };
        let mut body = json!({"maps": maps, "map": {"resolution": resolution}});
        if let Some(name) = &self.name {
            body["name"] = name.clone().into();
        }
        for label in &self.label {
            let (key, value) = label
                .split_once(':')
                .ok_or_else(|| CliError::Usage(format!("--label takes key:value, not {label}")))?;
            body["labels"][key] = value.into();
        }
        let job = client.submit_to("/v1/joins", body.to_string().as_bytes())?;
        let map = Follow { client: &client, wait: self.wait, json: self.json }.job("join", &[], job)?;
        CliError::of_unconverged(usize::from(map.is_some_and(|map| map["fit"]["converged"] != true)))
    }

    fn member(&self, map: &str) -> Result<Value, CliError> {
        let Some((id, pose)) = map.split_once('@') else { return Ok(json!({"id": map})) };
        let numbers: Option<Vec<f64>> = pose.split(',').map(|number| number.trim().parse().ok()).collect();
        let [x, y, theta] = numbers.unwrap_or_default()[..] else {
            return Err(CliError::Usage(format!("{map} is no ID@X,Y,THETA")));
        };
        let (xy, turn) = (self.sigma_xy.powi(2), self.sigma_theta.powi(2));
        Ok(json!({
            "id": id,
            "pose": {"x": x, "y": y, "theta": theta},
            "pose_covariance": [xy, 0, 0, 0, xy, 0, 0, 0, turn],
        }))
    }
}

//! `demo`: the whole way once, over HTTP: a simulated robot's scans in, pictures of the map out.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::CliError;
use super::client::{Client, text};
use super::fit::write;
use super::follow::{ended, failure};
use super::serve::{House, Running, data_in, runtime, stop_signal};
use crate::http::HttpLimits;
use crate::import::to_request;
use crate::jobs::Limits;
use crate::sim::Scenario;

#[derive(Debug, Args)]
pub struct Demo {
    /// The folder for the demo's data and pictures.
    #[arg(long, env = "MAPFIT_OUT", default_value = "mapfit-demo")]
    out: PathBuf,
    /// The address to serve on; port 0 takes a free one.
    #[arg(long, env = "MAPFIT_LISTEN", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// End once the pictures are written.
    #[arg(long, env = "MAPFIT_ONCE")]
    once: bool,
}

/// The pictures and files the demo writes, and where it gets them.
const FILES: [(&str, &str); 7] = [
    ("distance.png", "image?layer=distance&overlay=contour,points,poses"),
    ("sigma.png", "image?layer=sigma&overlay=contour"),
    ("occupancy.png", "image?layer=occupancy"),
    ("contours.geojson", "contours?sigma_band=2"),
    ("ogm.zip", "ogm?format=zip"),
    ("coefficients.npz", "coefficients?format=npz"),
    ("covariance.npz", "covariance?form=sparse"),
];

impl Demo {
    pub fn run(self) -> Result<(), CliError> {
        let runtime = runtime()?;
        let folder = self.out.display().to_string();
        std::fs::create_dir_all(&self.out).map_err(CliError::io(folder.clone()))?;
        let limits = Limits::default();
        let house = House::in_folder(data_in(&self.out), limits.control_points);
        let service = runtime.block_on(start(self.listen, &house))?;
        let url = format!("http://{}", service.address);
        println!("serving on {url}");

        let scenario = Scenario::experiment_one();
        let scans = scenario.scans(1);
        let request =
            to_request(&scans, &scenario.noise, Some("L-shaped room"), ("sdf", scenario.resolution)).to_string();
        write(&self.out, "job.json", request.as_bytes())?;
        println!("submitting {folder}/job.json: {} simulated scans of an L-shaped room", scans.len());
        let client = Client::new(&url, None);
        let job = ended(&client, client.submit(request.as_bytes())?)?;
        if let Some(error) = failure(&job) {
            return Err(error);
        }
        let own = text(&job["links"], "map");
        for (file, part) in FILES {
            write(&self.out, file, &client.get_bytes(&format!("{own}/{part}"))?)?;
            println!("  {folder}/{file}");
        }
        println!("the map: {url}{own}\nthe console: {url}/\nthe API: {url}/docs");
        if !self.once {
            println!("serving until Ctrl-C");
            runtime.block_on(stop_signal());
        }
        service.stop(runtime);
        Ok(())
    }
}

/// Serves at the wished address, or at a free port where that is taken.
async fn start(listen: SocketAddr, house: &House) -> Result<Running, CliError> {
    match Running::start((listen, None), None, house, HttpLimits::default()).await {
        Err(CliError::Io { source, .. }) if source.kind() == std::io::ErrorKind::AddrInUse => {
            Running::start((SocketAddr::new(listen.ip(), 0), None), None, house, HttpLimits::default()).await
        }
        other => other,
    }
}

//! Scans as the contract's JSON.

use std::io::Write;

use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::geometry::Pose;
use crate::scan::{LaserScan, Noise};

/// A scan as a job has it. NaN is written as null: no return.
#[derive(Serialize)]
struct ScanJson<'a> {
    pose: Pose,
    /// Symmetric, so that column-major is row-major.
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_covariance: Option<&'a [f64]>,
    angle_min: f64,
    angle_increment: f64,
    range_min: f64,
    range_max: f64,
    ranges: &'a [f64],
}

impl<'a> ScanJson<'a> {
    fn of(scan: &'a LaserScan) -> Self {
        Self {
            pose: scan.pose,
            pose_covariance: scan.pose_covariance.as_ref().map(|covariance| covariance.as_slice()),
            angle_min: scan.angle_min,
            angle_increment: scan.angle_increment,
            range_min: scan.range_min,
            range_max: scan.range_max,
            ranges: &scan.ranges,
        }
    }
}

/// A job request for scans; `distance` is `sdf` or `vdf`.
pub fn to_request(
    scans: &[LaserScan],
    noise: &Noise,
    name: Option<&str>,
    (distance, resolution): (&str, f64),
) -> Value {
    json!({
        "name": name,
        "scans": scans.iter().map(ScanJson::of).collect::<Vec<_>>(),
        "noise": {
            "sigma_x": noise.sigma_x,
            "sigma_y": noise.sigma_y,
            "sigma_theta": noise.sigma_theta,
            "sigma_range": noise.sigma_range,
        },
        "map": {"distance": distance, "resolution": resolution},
    })
}

/// A job's JSON, of all it asks for and its scans, written without a tree of it in memory; `None` where it would have more
/// than so many bytes.
pub fn job_json(job: &Map<String, Value>, scans: &[LaserScan], largest: usize) -> Option<Vec<u8>> {
    let mut json = Capped { bytes: Vec::new(), largest };
    write(&mut json, job, scans).ok().map(|()| json.bytes)
}

fn write(json: &mut Capped, job: &Map<String, Value>, scans: &[LaserScan]) -> std::io::Result<()> {
    json.write_all(b"{")?;
    for (name, value) in job {
        serde_json::to_writer(&mut *json, name)?;
        json.write_all(b":")?;
        serde_json::to_writer(&mut *json, value)?;
        json.write_all(b",")?;
    }
    json.write_all(b"\"scans\":[")?;
    for (k, scan) in scans.iter().enumerate() {
        if k > 0 {
            json.write_all(b",")?;
        }
        serde_json::to_writer(&mut *json, &ScanJson::of(scan))?;
    }
    json.write_all(b"]}")
}

/// Bytes that refuse to become too many.
struct Capped {
    bytes: Vec<u8>,
    largest: usize,
}

impl Write for Capped {
    fn write(&mut self, more: &[u8]) -> std::io::Result<usize> {
        if self.bytes.len() + more.len() > self.largest {
            return Err(std::io::ErrorKind::FileTooLarge.into());
        }
        self.bytes.extend_from_slice(more);
        Ok(more.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_written_piece_by_piece_is_the_job_and_stops_where_it_grows_too_large() {
        let scan = LaserScan {
            pose: Pose::new(1.0, -2.5, 0.1),
            pose_covariance: Some(nalgebra::Matrix3::identity() * 1e-4),
            angle_min: -0.1,
            angle_increment: 0.1,
            range_min: 0.05,
            range_max: 30.0,
            sigma_range: None,
            frame: 0,
            ranges: vec![2.0, f64::NAN, 0.1 + 0.2],
        };
        let scans = [scan.clone(), LaserScan { pose_covariance: None, ..scan }];
        let mut request = to_request(&scans, &Noise::EXPERIMENT_ONE, Some("a \"b\""), ("vdf", 0.25));
        assert_eq!(request["scans"][0]["ranges"], json!([2.0, null, 0.1 + 0.2]));
        let whole = request.clone();
        request.as_object_mut().unwrap().remove("scans");
        let written = job_json(request.as_object().unwrap(), &scans, 10_000).unwrap();
        assert_eq!(serde_json::from_slice::<Value>(&written).unwrap(), whole);
        assert_eq!(job_json(request.as_object().unwrap(), &scans, written.len() - 1), None);
    }
}

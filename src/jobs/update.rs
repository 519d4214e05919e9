//! An update: new scans for a map that is there.
//!
//! Its request is that of one fit of all scans, the map's own and the new ones, so its map knows what such a fit would
//! know, and is formed from its request alone, whatever becomes of the map it grew from. Every scan keeps the noise of the
//! request it came with. The lattice's cells are the same (a lattice's origin is a multiple of its spacing); where no
//! bounds were asked for, it grows to hold what the new scans met.

use super::document::Node;
use super::limits::Limits;
use super::reader::Reader;
use super::request::{Campaign, JobRequest, MapPart, RequestError};
use crate::scan::LaserScan;

impl JobRequest {
    /// Reads an update of this request's map, a job's body without `map`: the request of all scans. Without `fit` it is
    /// fitted as this one was.
    pub fn updated(&self, json: &[u8], limits: &Limits) -> Result<Self, RequestError> {
        let document = Node::parse(json, limits.values)?;
        let mut reader = Reader::new(limits);
        let request = reader.update(&document, self);
        reader.concluded(request)
    }
}

impl Reader<'_> {
    fn update(&mut self, document: &Node, before: &JobRequest) -> Option<JobRequest> {
        let known = ["name", "labels", "scans", "noise", "fit", "priority", "deadline_seconds"];
        let Campaign { name, labels, priority, scans, noise, options, deadline_seconds } =
            self.campaign(document, &known)?;
        let (scans, noise) = (scans?, noise?);
        let seen = self.returns(&scans)?;
        if let Some(bounds) = before.area.bounds
            && !seen.iter().any(|p| bounds.contains(*p))
        {
            return self.fault("/scans", "no return of any new scan lies inside the map's bounds");
        }
        // Where all have one noise, the request is a batch's to the last bit.
        let differs = noise != before.noise;
        let own = scans.into_iter().map(|scan| if differs { scan.with_noise(&noise) } else { scan });
        let scans: Vec<LaserScan> = before.scans.iter().cloned().chain(own).collect();
        self.all_count("/scans", &scans)?;
        let (distance, tiling) = (before.distance, before.tiling);
        let map = MapPart { distance, resolution: before.lattice.resolution, area: before.area, tiling };
        let seen = self.returns(&scans)?;
        let lattice = self.lattice(&scans, &seen, &map)?;
        self.within_limits(JobRequest {
            name: name?,
            labels: labels?.unwrap_or_default(),
            priority: priority?.unwrap_or(0) as i32,
            scans,
            noise: before.noise,
            distance: map.distance,
            lattice,
            area: map.area,
            tiling: before.tiling,
            parts: None,
            options: options?.unwrap_or(before.options),
            joined: before.joined.clone(),
            deadline_seconds: deadline_seconds?,
        })
    }

    /// Whether all scans together are within the limits of one request.
    pub(super) fn all_count(&mut self, at: &str, scans: &[LaserScan]) -> Option<()> {
        let beams: usize = scans.iter().map(|scan| scan.ranges.len()).sum();
        if scans.len() > self.limits.scans {
            let detail = format!("{} scans with those of before; the limit is {}", scans.len(), self.limits.scans);
            return self.fault(at, detail);
        }
        if beams > self.limits.values {
            let detail = format!("{beams} beams with those of before; the limit is {}", self.limits.values);
            return self.fault(at, detail);
        }
        Some(())
    }
}

//! What a job would be and cost, without submitting it.

use serde::Serialize;
use utoipa::ToSchema;

use crate::http::maps::record::LatticeBody;
use crate::jobs::JobRequest;

/// What a job's map would be, and what its fit would take.
#[derive(Debug, Serialize, ToSchema)]
pub struct DryRun {
    lattice: LatticeBody,
    /// In use, of each component.
    control_points: usize,
    scans: usize,
    returns: usize,
    estimate: CostEstimate,
}

/// On a machine like the one this version was measured on.
#[derive(Debug, Serialize, ToSchema)]
struct CostEstimate {
    seconds: f64,
    /// Of memory, at the most.
    bytes: u64,
}

impl DryRun {
    /// `None` where nobody waits for it any more.
    pub fn of(request: &JobRequest, wanted: &dyn Fn() -> bool) -> Option<Self> {
        let (footprint, cost) = request.cost(wanted)?;
        Some(Self {
            lattice: LatticeBody::of(&request.lattice),
            control_points: footprint.control_points,
            scans: footprint.scans,
            returns: footprint.returns,
            estimate: CostEstimate { seconds: cost.seconds, bytes: cost.bytes as u64 },
        })
    }
}

//! What a job would be and cost, without submitting it.

use serde::Serialize;
use utoipa::ToSchema;

use crate::geometry::Vec2;
use crate::http::maps::record::LatticeBody;
use crate::jobs::JobRequest;
use crate::scan::returns_of;

/// Of a recording so many returns and poses are shown.
const MOST_SHOWN: usize = 20_000;

/// What a job's map would be, and what its fit would take.
#[derive(Debug, Serialize, ToSchema)]
pub struct DryRun {
    lattice: LatticeBody,
    /// In use, of each component.
    control_points: usize,
    scans: usize,
    returns: usize,
    estimate: CostEstimate,
    /// Of a recording, whose scans only the service reads.
    #[serde(skip_serializing_if = "Option::is_none")]
    preview: Option<Preview>,
}

/// Where a recording's scans lie, to the millimetre: up to 20,000 points each, taken evenly.
#[derive(Debug, Serialize, ToSchema)]
struct Preview {
    /// [x, y], metres.
    returns: Vec<[f64; 2]>,
    /// Where they were taken: [x, y], metres.
    poses: Vec<[f64; 2]>,
}

impl Preview {
    fn of(request: &JobRequest) -> Self {
        let returns = returns_of(&request.scans);
        Self {
            returns: thinned(returns.iter().map(|seen| seen.point)),
            poses: thinned(request.scans.iter().map(|scan| scan.pose.position())),
        }
    }
}

/// Every so many of the points, so that few enough are left.
fn thinned(points: impl ExactSizeIterator<Item = Vec2>) -> Vec<[f64; 2]> {
    let millimetres = |value: f64| (1000.0 * value).round() / 1000.0;
    let every = points.len().div_ceil(MOST_SHOWN).max(1);
    points.step_by(every).map(|p| [millimetres(p.x), millimetres(p.y)]).collect()
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
            preview: None,
        })
    }

    /// With what a recording's scans saw.
    pub fn showing(self, request: &JobRequest) -> Self {
        Self { preview: Some(Preview::of(request)), ..self }
    }
}

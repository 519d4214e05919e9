//! What a map will cost, before it is fitted: from the size of its fit, by what fits of known size took.
//!
//! Nested dissection of a planar lattice of `n` unknowns fills `O(n log n)` and takes `O(n^1.5)` operations (George 1973).
//! The constants are from logs and simulated buildings of 700 to 60,000 control points on two cores of one machine; time
//! on another scales, memory does not.

use crate::fit::{Distance, Footprint};

/// What a map costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    pub seconds: f64,
    /// Held at once, at the most.
    pub bytes: f64,
}

/// By distance: seconds a control point, and a control point times its square root; seconds a return; bytes a control
/// point, and more for every doubling beyond [`SMALL`]; bytes a return.
struct Rates {
    linear: f64,
    steep: f64,
    a_return: f64,
    bytes: f64,
    bytes_a_doubling: f64,
    bytes_a_return: f64,
}

const SMALL: f64 = 7000.0;
const SIGNED: Rates = Rates {
    linear: 1.1e-4,
    steep: 4.8e-6,
    a_return: 4.6e-4,
    bytes: 10_500.0,
    bytes_a_doubling: 1_200.0,
    bytes_a_return: 400.0,
};
const VECTOR: Rates = Rates {
    linear: 1.5e-4,
    steep: 4e-6,
    a_return: 2e-5,
    bytes: 34_800.0,
    bytes_a_doubling: 4_600.0,
    bytes_a_return: 600.0,
};
/// What any process holds beside.
const BASE: f64 = 8e6;
/// Seconds and bytes a control point that is not in use: it has a row of its own in every vector of the solver, and in the
/// factor's symbols, and its place among the coefficients, variances and marks of evidence.
const SECONDS_UNUSED: f64 = 8e-6;
const BYTES_UNUSED: f64 = 2_000.0;
/// Bytes an entry of the factor between poses: the factor, the elimination's derivative, both selected inverses, and the
/// fronts that they are formed in.
const BYTES_A_POSE_ENTRY: f64 = 48.0;

/// Seconds for each of them, for scans that see one another's places: of Intel's 910, 20 of its 33 (from
/// `scripts/nightly/estimates.py`).
const SECONDS_A_POSE_ENTRY: f64 = 2.5e-5;

/// What a map of this footprint costs.
pub fn cost(distance: Distance, footprint: &Footprint) -> Cost {
    let rates = if distance == Distance::Vector { &VECTOR } else { &SIGNED };
    let (n, returns) = (footprint.control_points as f64, footprint.returns as f64);
    let unused = footprint.lattice.saturating_sub(footprint.control_points) as f64;
    let doublings = (n / SMALL).max(1.0).log2();
    Cost {
        seconds: rates.linear * n
            + rates.steep * n.powf(1.5)
            + rates.a_return * returns
            + SECONDS_UNUSED * unused
            + footprint.pose_entries as f64 * SECONDS_A_POSE_ENTRY,
        bytes: BASE
            + n * (rates.bytes + rates.bytes_a_doubling * doublings)
            + returns * rates.bytes_a_return
            + unused * BYTES_UNUSED
            + footprint.pose_entries as f64 * BYTES_A_POSE_ENTRY,
    }
}

//! What a request may ask for, and what is wrong with one that does not fit.

/// One fault of a request.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// RFC 6901, into the request body.
    pub pointer: String,
    pub detail: String,
}

/// What a request may ask for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Control points in use, of one fit.
    pub control_points: usize,
    /// Control points in use, of a map that is fitted in parts; memory is another limit.
    pub in_parts: usize,
    /// Control points of a map's whole rectangle, in use or not.
    pub lattice: usize,
    pub scans: usize,
    pub beams_a_scan: usize,
    /// Values in the whole document.
    pub values: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            control_points: 200_000,
            in_parts: 1_000_000,
            lattice: 1_000_000,
            scans: 20_000,
            beams_a_scan: 100_000,
            values: 10_000_000,
        }
    }
}

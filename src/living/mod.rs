//! Maps in time: what differs between two of them.
//!
//! Maps never change; what grows are versions. What an update is fitted from is in [`crate::jobs`]: its request is that of
//! all scans, so nothing here is needed for it.

mod changes;
mod shown;

pub use changes::{Change, ChangeRole, MOST_PROBABLE, changes};
pub use shown::{changes_geojson, changes_picture};

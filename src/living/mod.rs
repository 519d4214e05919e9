//! Maps in time: what differs between two of them, and where several lie in one frame.
//!
//! Maps never change; what grows are versions. What an update or a join is fitted from is in [`crate::jobs`]: its request is
//! that of all scans.

mod align;
mod changes;
mod cloud;
mod shown;

pub use align::{Guess, JoinError, aligned, moved};
pub use changes::{Change, ChangeRole, MOST_PROBABLE, changes};
pub use shown::{changes_geojson, changes_picture};

//! Others, elsewhere, who take branches of a pass: threads of other processes, on this machine or another.
//!
//! What the numerics know of them is this port. A pass offers its branches; whoever has time takes one, gets its parcel
//! and sends an answer. The pass itself takes what nobody has, one branch after another, and what others took and did not
//! bring back: so nothing depends on them but time.

use super::parcel::{Answer, Parcel};

/// Where branches may be offered.
pub trait Abroad: Send + Sync {
    /// Offers the branches of one pass, so many; `None` where nobody could be told.
    fn offer(&self, branches: usize) -> Option<Box<dyn Offer>>;
}

/// The branches of one pass, on offer until this is dropped.
pub trait Offer: Send + Sync {
    /// Takes a branch for the pass itself; `false` while another has it.
    fn keep(&self, branch: usize) -> bool;
    /// Branches that others have taken and wait for the parcels of.
    fn wanted(&self) -> Vec<usize>;
    fn send(&self, branch: usize, parcel: &Parcel);
    /// An answer that has come since this was last asked, if any.
    fn answer(&self) -> Option<(usize, Answer)>;
    /// Whether to go on: a pass that waits for others is asked by them, too.
    fn goes_on(&self) -> bool;
}

//! Maps in parts, by workers of many processes and machines.
//!
//! The attempt that fits puts the branches of a pass on offer ([`desk`]); a worker that has nothing else to do takes one
//! and works on it ([`help`]). Parcels and answers go as artifacts ([`letters`]), everything else through the store's
//! [`crate::store::PartBoard`]. A parcel is written when somebody has taken its part, so that an attempt that nobody helps
//! writes none.

mod desk;
mod help;
mod letters;

pub(super) use desk::Desk;
pub(super) use help::help;

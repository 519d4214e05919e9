//! What a robot saw: laser scans, how noisy they are, and what follows from them about the world.
//!
//! [`LaserScan`] and [`Noise`] are the input as it was measured; [`Return`] is a beam that met a surface, in the world,
//! with the derivatives that carry range and pose noise to it; [`Evidence`] says where beams passed and where
//! surfaces were met, which is what tells "free" and "occupied" from "unknown".

mod evidence;
mod laser;
mod noise;
mod returns;

pub(crate) use evidence::mark_center;
pub use evidence::{Evidence, SUBCELLS, Seen};
pub use laser::{LaserScan, Noise};
pub use noise::{CovarianceJet, ReturnNoise};
pub use returns::{Return, returns_of};

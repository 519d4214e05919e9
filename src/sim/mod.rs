//! Worlds whose truth is exact, and a laser scanner in them.
//!
//! A [`World`] is a room with pillars: polygons, so that its signed distance is exact; a [`Plan`] is a building's
//! walls. A [`Lidar`] stands at a true pose and measures ranges with noise; the pose it reports is noisy too.
//! Everything is drawn from a seeded ChaCha generator, so a simulated log is the same on every machine. The demo, the
//! reproduction, tests and benches all run on this.

mod lidar;
mod plan;
mod scenario;
mod survey;
mod world;

pub use lidar::{Lidar, Scene, misplaced, simulate};
pub use plan::Plan;
pub use scenario::Scenario;
pub use survey::Survey;
pub use world::World;

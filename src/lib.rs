//! Maps a robot fleet can trust: cubic B-spline distance maps, with their covariance, from laser scans.
//!
//! From scans to a map in a few lines:
//!
//! ```
//! use mapfit::{Distance, Kind, Survey, Vec2};
//! use mapfit::sim::Scenario;
//!
//! // Three noisy scans of an L-shaped room; yours are `mapfit::LaserScan`s.
//! let room = Scenario::experiment_one();
//! let scans = room.scans(1);
//! let map = Survey::new(&scans, room.noise).distance(Distance::Vector).resolution(0.25).map()?;
//!
//! let (distance, sigma) = map.distance(Vec2::new(1.0, 3.0), Kind::Propagated).expect("on the map");
//! assert!((distance - 1.0).abs() < 3.0 * sigma + 0.005, "{distance} +- {sigma} m");
//! println!("{distance:.3} m +- {sigma:.3} m; clear for {:.3} m", map.clearance(Vec2::new(1.0, 3.0)).unwrap_or(0.0));
//! # Ok::<(), mapfit::SurveyError>(())
//! ```
//!
//! [`Survey::map_watched`] reports every step to an observer, which may stop it.
//!
//! The rooms, each of which may use only those above it (a test holds this):
//!
//! | room | what it is |
//! | --- | --- |
//! | [`geometry`] | points, poses, small covariances |
//! | [`spline`] | the uniform cubic B-spline: basis, lattice, surface |
//! | [`sparse`] | linear algebra on a lattice with poses: pattern, nested dissection, Cholesky, selected inverse |
//! | [`scan`] | what a robot saw: scans, returns in the world, evidence |
//! | [`fit`] | the weighted non-linear least-squares fit; one way in, [`fit::fit`], one [`fit::Estimate`] out |
//! | [`uncertainty`] | propagated and posterior covariance at the minimum |
//! | [`map`] | a fitted map: surfaces, queries, files; [`Survey`] is the front door |
//! | [`render`] | contours, occupancy grids, rasters, pictures |
//! | [`localize`] | a pose from scans and a map that is itself uncertain |
//! | [`living`] | maps in time: what differs between two of them |
//! | [`sim`] | worlds with exact truth, a simulated LiDAR |
//! | [`reproduce`] | the method's experiments, figure by figure |
//! | `import` | CARMEN logs and MCAP recordings to job requests |
//! | `access` | API keys |
//! | `jobs` | requests, validation, states |
//! | `store` | records (SQLite, PostgreSQL), artifacts (a folder, S3) |
//! | `backup` | everything out of the stores, and in again |
//! | `traces` | spans of requests and attempts, across processes |
//! | `worker` | solver threads, leases |
//! | `http` | the service |
//! | `cli` | the command line |
//!
//! Everything down to `reproduce` is pure: data, an observer and a cancellation flag in, data or a typed error out. It
//! builds alone with `--no-default-features`.

// Nothing that comes in may end the process; tests may.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]

pub mod fit;
pub mod geometry;
pub mod living;
pub mod localize;
pub mod map;
pub mod render;
pub mod reproduce;
pub mod scan;
pub mod sim;
pub mod sparse;
pub mod spline;
pub mod uncertainty;

pub use fit::Distance;
pub use geometry::{Pose, Vec2};
pub use map::{FittedMap, Survey, SurveyError};
pub use scan::{LaserScan, Noise};
pub use uncertainty::Kind;

#[cfg(feature = "service")]
pub mod access;
#[cfg(feature = "service")]
pub mod backup;
#[cfg(feature = "service")]
pub mod cli;
#[cfg(feature = "service")]
pub mod http;
#[cfg(feature = "service")]
pub mod import;
#[cfg(feature = "service")]
pub mod jobs;
#[cfg(feature = "service")]
pub mod store;
#[cfg(feature = "service")]
pub mod traces;
#[cfg(feature = "service")]
pub mod worker;

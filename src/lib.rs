//! Maps a robot fleet can trust: cubic B-spline distance maps, with their covariance, from laser scans.
//!
//! The rooms, each of which may use only those above it (a test holds this):
//!
//! | room | what it is |
//! | --- | --- |
//! | [`geometry`] | points, poses, small covariances |
//! | [`spline`] | the uniform cubic B-spline: basis, lattice, surface |
//! | [`sparse`] | linear algebra on a lattice: stencil, nested dissection, Cholesky, selected inverse |
//! | [`scan`] | what a robot saw: scans, returns in the world, evidence |
//! | [`fit`] | the weighted non-linear least-squares fit; one way in, [`fit::fit`] |
//! | [`uncertainty`] | propagated and posterior covariance at the minimum |
//! | [`map`] | a fitted map: query, files |
//! | [`render`] | contours, occupancy grids, pictures |
//! | [`sim`] | worlds with exact truth, a simulated LiDAR |
//! | [`reproduce`] | the method's experiments, figure by figure |
//! | `import` | CARMEN logs to job requests |
//! | `jobs` | requests, validation, states |
//! | `store` | job records (SQLite), artifacts |
//! | `worker` | solver threads, leases |
//! | `http` | the service |
//! | `cli` | the command line |
//!
//! Everything down to `reproduce` is pure: data, an observer and a cancellation flag in, data or a typed error out. It
//! builds alone with `--no-default-features`.

pub mod fit;
pub mod geometry;
pub mod map;
pub mod render;
pub mod reproduce;
pub mod scan;
pub mod sim;
pub mod sparse;
pub mod spline;
pub mod uncertainty;

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
pub mod worker;

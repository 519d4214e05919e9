//! Maps: their records, arrays, covariance, points, pictures and grids.

pub mod arrays;
pub mod changes;
pub mod covariance;
pub mod frames;
pub mod localize;
pub mod pictures;
pub mod query;
pub mod record;
pub mod request;
mod resumed;
pub mod tiles;

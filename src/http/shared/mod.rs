//! What all routes share; nothing here knows a route.

pub mod body;
pub mod cache;
pub mod compute;
pub mod negotiate;
pub mod page;
pub mod params;
pub mod problem;
pub mod ration;
pub mod state;
pub mod tag;

pub use state::{AppState, Service};

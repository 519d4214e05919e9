//! What all routes share; nothing here knows a route.

pub mod body;
pub mod cache;
pub mod caller;
pub mod compute;
pub mod kept;
pub mod keyed;
pub mod members;
pub mod multipart;
pub mod negotiate;
pub mod page;
pub mod params;
pub mod problem;
pub mod rate;
pub mod ration;
pub mod relabel;
pub mod rules;
pub mod standing;
pub mod state;
pub mod tag;

pub use caller::{Caller, Scope};
pub use state::{AppState, Service};

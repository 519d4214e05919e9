//! A job's life: what is asked for, and what is known of it.
//!
//! [`request`] turns JSON into a validated [`JobRequest`], listing every fault; [`Stored`] is what is kept of it, and of the updates of its map; [`record`] has the states a job goes
//! through, [`lifecycle`] what it does where attempts fail. Records are kept by the [store](crate::store) and worked on by the [worker](crate::worker).

pub mod document;
mod frames;
mod join;
pub mod labels;
pub mod lifecycle;
mod limits;
mod reader;
pub mod record;
pub mod request;
mod retention;
mod scans;
mod sightings;
mod stored;
mod update;

pub use document::DocumentError;
pub use frames::{Joined, Named};
pub use join::{JoinBody, Member, join_body};
pub use limits::{Fault, Limits};
pub use record::{Job, JobStatus, MapRecord, Parts, ProblemReport, Progress};
pub use request::{Area, JobRequest, RequestError, Tiling};
pub use retention::{Retention, Rule as Retain};
pub use sightings::Sightings;
pub use stored::{Lineage, Stored};

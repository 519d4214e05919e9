//! A job's life: what is asked for, and what is known of it.
//!
//! [`request`] turns JSON into a validated [`JobRequest`], listing every fault; [`record`] has the states a job goes
//! through, [`lifecycle`] what it does where attempts fail. Records are kept by the [store](crate::store) and worked on by the [worker](crate::worker).

pub mod document;
pub mod lifecycle;
mod limits;
mod reader;
pub mod record;
pub mod request;
mod retention;
mod sightings;

pub use document::DocumentError;
pub use limits::{Fault, Limits};
pub use record::{Job, JobStatus, MapRecord, ProblemReport, Progress};
pub use request::{JobRequest, RequestError};
pub use retention::{Retention, Rule as Retain};
pub use sightings::Sightings;

//! Jobs: submission, states, lists, long poll, server-sent events, cancellation.

#[cfg(test)]
mod agreement;
pub mod change;
pub mod document;
pub mod dry_run;
pub mod events;
pub mod join;
pub mod record;
pub mod recording;
pub mod schema;
pub mod status;
pub mod submit;
pub mod update;

//! Places: names under which maps follow one another. Robots ask for the place, operators decide which map it has.

pub mod publish;
pub mod read;
pub mod record;

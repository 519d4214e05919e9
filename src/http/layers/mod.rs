//! What stands around every route: who may ask, and what holds for every answer.

pub mod compression;
pub mod conventions;
pub mod counted;
pub mod guard;
pub mod keys;
pub mod traced;

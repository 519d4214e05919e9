//! The HTTP service: the contract's routes over the store and the maps.
//!
//! | place | what it holds |
//! | --- | --- |
//! | [`mod@router`] | all routes, and the document made of them |
//! | [`jobs`], [`maps`], [`places`], [`webhooks`], [`about`] | a folder a resource |
//! | [`shared`] | what all routes share: problems, parameters, formats, bodies, budgets |
//! | [`layers`] | what stands around all routes: who may ask, request ids, compression |
//! | [`listener`], [`tls`] | connections: how many, for how long, and what they speak |
//! | `worded` | words for what never becomes a request |
//!
//! Domain errors know nothing of HTTP; they become problems here, at the border.

pub mod about;
pub mod jobs;
pub mod layers;
pub mod listener;
pub mod maps;
pub mod places;
pub mod router;
pub mod shared;
pub mod tls;
pub mod webhooks;
mod worded;

pub use router::{Faces, document, router, router_of_worker};
pub use shared::state::HttpLimits;
pub use tls::{Tls, TlsError};

//! Who asks: a key belongs to a tenant and has scopes; without any key everybody is the one tenant there is.

use std::convert::Infallible;
use std::sync::Arc;

use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::problem::Problem;

/// What a key may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// Every GET, and questions that are asked by POST.
    Read,
    /// Jobs, updates, joins, and their cancellation.
    Submit,
    /// Places, deletion, webhooks.
    Admin,
}

impl Scope {
    pub const ALL: [Self; 3] = [Self::Read, Self::Submit, Self::Admin];

    pub fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Admin => "admin",
        }
    }

    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scope| scope.name() == name)
    }
}

/// Who asks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caller {
    pub tenant: Arc<str>,
    /// `None` without keys: then everything is allowed.
    scopes: Option<Vec<Scope>>,
}

impl Caller {
    /// Whoever asks a service without keys.
    pub fn anybody() -> Self {
        Self { tenant: "default".into(), scopes: None }
    }

    /// The holder of a key.
    pub fn with_key(tenant: &str, scopes: Vec<Scope>) -> Self {
        Self { tenant: tenant.into(), scopes: Some(scopes) }
    }

    /// 403 where the key is too narrow.
    pub fn needs(&self, scope: Scope) -> Result<(), Problem> {
        match &self.scopes {
            Some(scopes) if !scopes.contains(&scope) => {
                let detail = format!("this needs a key with the scope {}", scope.name());
                Err(Problem::new(StatusCode::FORBIDDEN, "scope-missing", "The key may not do this", detail))
            }
            _ => Ok(()),
        }
    }

    /// 403 where keys are asked for at all: of a route that says nothing of who may call it.
    pub fn needs_no_key(&self) -> Result<(), Problem> {
        match &self.scopes {
            None => Ok(()),
            Some(_) => {
                let detail = "no key opens this";
                Err(Problem::new(StatusCode::FORBIDDEN, "scope-missing", "The key may not do this", detail))
            }
        }
    }
}

/// The layer that knows keys has put the caller into the request.
impl<S: Sync> FromRequestParts<S> for Caller {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        // A request that no layer let in sees a tenant that has nothing.
        Ok(parts.extensions.get().cloned().unwrap_or_else(|| Self::with_key("", Vec::new())))
    }
}

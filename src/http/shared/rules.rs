//! What each route needs of a key.
//!
//! It is what the document says it needs (`security`), so there is one list. A route of `/v1` that says nothing is closed
//! to all: a test holds the list against the routes.

use std::collections::HashMap;

use axum::http::Method;

use super::caller::Scope;

/// What each route needs: nothing, or a scope.
#[derive(Debug, Default)]
pub struct Rules(HashMap<(Method, String), Option<Scope>>);

impl Rules {
    /// The rules that a document states: an operation's one scope, or none where it is open to all.
    pub fn of(document: &str) -> Self {
        let document: serde_json::Value = serde_json::from_str(document).unwrap_or_default();
        let mut rules = HashMap::new();
        for (path, item) in document["paths"].as_object().into_iter().flatten() {
            for (method, operation) in item.as_object().into_iter().flatten() {
                let Ok(method) = Method::from_bytes(method.to_uppercase().as_bytes()) else { continue };
                let scope = operation["security"][0]["key"][0].as_str().and_then(Scope::from_name);
                if scope.is_some() || !path.starts_with("/v1") {
                    rules.insert((method, path.clone()), scope);
                }
            }
        }
        Self(rules)
    }

    /// Nothing, or a scope; `None` where no rule is known.
    pub fn of_route(&self, method: &Method, path: &str) -> Option<Option<Scope>> {
        // HEAD is GET without a body.
        let method = if method == Method::HEAD { &Method::GET } else { method };
        self.0.get(&(method.clone(), path.to_owned())).copied()
    }
}

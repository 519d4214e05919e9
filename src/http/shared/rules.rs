//! What each route needs of a key.
//!
//! It is what the document says it needs (`security`), so there is one list. A route of `/v1` that says nothing is closed
//! to all: a test holds the list against the routes.

use std::collections::HashMap;

use axum::http::Method;

use super::caller::Scope;

/// What a route needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Nothing: it tells no tenant's data.
    Open,
    Scope(Scope),
    /// It says nothing of it, so nobody is let in who needs a key.
    Closed,
}

/// What each route needs.
#[derive(Debug, Default)]
pub struct Rules(HashMap<(Method, String), Rule>);

impl Rules {
    /// The rules that a document states: an operation's one scope; outside `/v1` none means open to all.
    pub fn of(document: &str) -> Self {
        let document: serde_json::Value = serde_json::from_str(document).unwrap_or_default();
        let mut rules = HashMap::new();
        for (path, item) in document["paths"].as_object().into_iter().flatten() {
            for (method, operation) in item.as_object().into_iter().flatten() {
                let Ok(method) = Method::from_bytes(method.to_uppercase().as_bytes()) else { continue };
                let scope = operation["security"][0]["key"][0].as_str().and_then(Scope::from_name);
                let unsaid = if path.starts_with("/v1") { Rule::Closed } else { Rule::Open };
                rules.insert((method, path.clone()), scope.map_or(unsaid, Rule::Scope));
            }
        }
        Self(rules)
    }

    /// What a route needs; closed where the document does not know it.
    pub fn of_route(&self, method: &Method, path: &str) -> Rule {
        // HEAD is GET without a body.
        let method = if method == Method::HEAD { &Method::GET } else { method };
        self.0.get(&(method.clone(), path.to_owned())).copied().unwrap_or(Rule::Closed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_route_that_says_nothing_is_closed_below_v1_and_open_elsewhere() {
        let read = r#"{"security": [{"key": ["read"]}]}"#;
        let document =
            format!(r#"{{"paths": {{"/v1/a": {{"get": {read}, "post": {{}}}}, "/livez": {{"get": {{}}}}}}}}"#);
        let rules = Rules::of(&document);
        assert_eq!(rules.of_route(&Method::GET, "/v1/a"), Rule::Scope(Scope::Read));
        assert_eq!(rules.of_route(&Method::HEAD, "/v1/a"), Rule::Scope(Scope::Read));
        assert_eq!(rules.of_route(&Method::POST, "/v1/a"), Rule::Closed);
        assert_eq!(rules.of_route(&Method::GET, "/livez"), Rule::Open);
        assert_eq!(rules.of_route(&Method::PUT, "/v1/a"), Rule::Closed);
    }
}

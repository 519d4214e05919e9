//! Query parameters, read one by one, every fault kept for one answer.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::str::FromStr;

use axum::http::Uri;

use super::page::{from_cursor, from_numbered_cursor};
use super::problem::Problem;

/// The query of one request.
pub struct Params {
    pairs: Vec<(String, String)>,
    /// The parameters that were asked for: any other is a fault.
    known: RefCell<BTreeSet<String>>,
    faults: Vec<(String, String)>,
}

impl Params {
    pub fn of(uri: &Uri) -> Self {
        let query = uri.query().unwrap_or_default();
        Self {
            pairs: form_urlencoded::parse(query.as_bytes()).into_owned().collect(),
            known: RefCell::default(),
            faults: Vec::new(),
        }
    }

    /// A parameter's last value.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.known.borrow_mut().insert(name.to_owned());
        self.pairs.iter().rev().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// All values of a parameter.
    pub fn all(&self, name: &str) -> Vec<String> {
        self.known.borrow_mut().insert(name.to_owned());
        self.pairs.iter().filter(|(key, _)| key == name).map(|(_, value)| value.clone()).collect()
    }

    pub fn fault(&mut self, name: &str, detail: impl Into<String>) {
        self.faults.push((name.to_owned(), detail.into()));
    }

    /// A number in `[low, high]`.
    pub fn number<T>(&mut self, name: &str, low: T, high: T) -> Option<T>
    where
        T: FromStr + PartialOrd + std::fmt::Display,
    {
        let text = self.text(name)?;
        match text.trim().parse::<T>() {
            Ok(value) if value >= low && value <= high => Some(value),
            _ => {
                self.fault(name, format!("must be a number in [{low}, {high}]"));
                None
            }
        }
    }

    /// One of the choices; the first where the parameter is absent.
    pub fn choice<T: Copy>(&mut self, name: &str, choices: &[(&str, T)]) -> T {
        match self.text(name) {
            None => choices[0].1,
            Some(text) => match choices.iter().find(|(known, _)| *known == text) {
                Some((_, value)) => *value,
                None => {
                    let known: Vec<&str> = choices.iter().map(|(known, _)| *known).collect();
                    self.fault(name, format!("must be one of {}", known.join(", ")));
                    choices[0].1
                }
            },
        }
    }

    /// `label=key:value`, any number of them.
    pub fn labels(&mut self) -> Vec<(String, String)> {
        let mut labels = Vec::new();
        let given = self.all("label");
        if given.len() > MOST_LABELS {
            self.fault("label", format!("is given {} times; the limit is {MOST_LABELS}", given.len()));
            return labels;
        }
        for text in given {
            match text.split_once(':') {
                Some((key, value)) if !key.is_empty() => labels.push((key.to_owned(), value.to_owned())),
                _ => self.fault("label", "must be key:value"),
            }
        }
        labels
    }

    /// `limit` and `cursor` of a list: how many, and the id to start below.
    pub fn page(&mut self) -> (i64, Option<String>) {
        let limit = self.number("limit", 1, MOST_ITEMS).unwrap_or(DEFAULT_ITEMS);
        let cursor = self.text("cursor").map(str::to_owned);
        let before = cursor.and_then(|cursor| {
            let before = from_cursor(&cursor);
            if before.is_none() {
                self.fault("cursor", "is not one this service gave");
            }
            before
        });
        (limit, before)
    }

    /// The same of a list that a number orders.
    pub fn numbered_page(&mut self) -> (i64, Option<i64>) {
        let limit = self.number("limit", 1, MOST_ITEMS).unwrap_or(DEFAULT_ITEMS);
        let cursor = self.text("cursor").map(from_numbered_cursor);
        if cursor == Some(None) {
            self.fault("cursor", "is not one this service gave");
        }
        (limit, cursor.flatten())
    }

    /// The faults as one problem, or nothing.
    pub fn finish(mut self) -> Result<(), Problem> {
        let known = self.known.take();
        let strangers: BTreeSet<String> =
            self.pairs.iter().filter(|(name, _)| !known.contains(name)).map(|(name, _)| name.clone()).collect();
        for name in strangers.into_iter().take(MOST_STRANGERS) {
            let name = name.chars().take(60).collect::<String>();
            self.fault(&name, "is not known here");
        }
        if self.faults.is_empty() { Ok(()) } else { Err(Problem::invalid_parameters(self.faults)) }
    }
}

/// Unknown parameters that are listed at most.
const MOST_STRANGERS: usize = 20;
const MOST_LABELS: usize = 16;
const DEFAULT_ITEMS: i64 = 50;
const MOST_ITEMS: i64 = 1000;
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_kept() {
        let uri: Uri = "/x?limit=0&cursor=%21&label=abc&level=NaN".parse().unwrap();
        let mut params = Params::of(&uri);
        params.page();
        params.labels();
        assert_eq!(params.number("level", -1.0, 1.0), None);
        let problem = params.finish().unwrap_err();
        assert_eq!(problem.errors.len(), 4);
    }
}

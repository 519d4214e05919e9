//! How long maps are kept: `--keep-maps 30,site:hq=365,kind:reference=forever`.
//!
//! Of the rules whose label a map has, the one that keeps it longest counts; without any, the rule without a label; without
//! that, it is kept for ever. What a place names is kept whatever the rules say: that is the store's business.

use std::collections::BTreeMap;
use std::str::FromStr;
use std::time::Duration;

const DAY: f64 = 24.0 * 3600.0;
/// More days than this are for ever.
const LONGEST: f64 = 36_500.0;

/// Maps with this label, or all others, are kept for so long.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    label: Option<(String, String)>,
    /// `None`: for ever.
    keep: Option<Duration>,
}

impl FromStr for Rule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (label, time) = match text.rsplit_once('=') {
            None => (None, text),
            Some((label, time)) => {
                let label = label.split_once(':').filter(|(key, _)| !key.is_empty());
                let (key, value) = label.ok_or_else(|| format!("{text} is not KEY:VALUE=DAYS"))?;
                (Some((key.to_owned(), value.to_owned())), time)
            }
        };
        if time == "forever" {
            return Ok(Self { label, keep: None });
        }
        let days = time.parse().ok().filter(|days: &f64| (0.0..=LONGEST).contains(days));
        let days = days.ok_or_else(|| format!("{time} is neither a number of days nor `forever`"))?;
        Ok(Self { label, keep: Some(Duration::from_secs_f64(days * DAY)) })
    }
}

/// Rules together.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Retention(pub Vec<Rule>);

impl Retention {
    /// No map is removed that is younger; none at all without this.
    pub fn shortest(&self) -> Option<Duration> {
        self.0.iter().filter_map(|rule| rule.keep).min()
    }

    /// Whether a map is kept no longer.
    pub fn is_over(&self, labels: &BTreeMap<String, String>, age: Duration) -> bool {
        let fits = |rule: &&Rule| rule.label.as_ref().is_some_and(|(key, value)| labels.get(key) == Some(value));
        let is_over = |rule: &Rule| rule.keep.is_some_and(|keep| age > keep);
        let mut labelled = self.0.iter().filter(fits).peekable();
        if labelled.peek().is_some() {
            return labelled.all(is_over);
        }
        let mut others = self.0.iter().filter(|rule| rule.label.is_none()).peekable();
        others.peek().is_some() && others.all(is_over)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_that_keeps_longest_counts() {
        let rules = ["30", "site:hq=365", "site:hq=7", "kind:reference=forever", "kind:a=b:c=0.5"];
        let keep = Retention(rules.iter().map(|rule| rule.parse().unwrap()).collect());
        let days = |days: f64| Duration::from_secs_f64(days * DAY);
        let labels = |all: &[(&str, &str)]| {
            all.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect::<BTreeMap<_, _>>()
        };
        assert_eq!(keep.shortest(), Some(days(0.5)));
        assert!(keep.is_over(&labels(&[]), days(31.0)) && !keep.is_over(&labels(&[]), days(29.0)));
        let hq = labels(&[("site", "hq"), ("floor", "1")]);
        assert!(!keep.is_over(&hq, days(364.0)) && keep.is_over(&hq, days(366.0)));
        assert!(!keep.is_over(&labels(&[("site", "hq"), ("kind", "reference")]), days(9999.0)));
        assert!(keep.is_over(&labels(&[("kind", "a=b:c")]), days(1.0)));
        let only = Retention(vec!["site:hq=1".parse().unwrap()]);
        assert!(!only.is_over(&labels(&[("site", "lab")]), days(9999.0)), "nothing is said of it");
        assert_eq!(Retention::default().shortest(), None);
        for wrong in ["", "-1", "NaN", "1e9", "x=3", ":v=3", "site:hq=soon"] {
            assert!(wrong.parse::<Rule>().is_err(), "{wrong}");
        }
    }
}

//! The bar that shows how far a job is: its share of the time, its stage, its steps and how fast they go, and how long
//! it will still take, about.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Before so much was seen to be done, nothing is said of the time that is left.
const SEEN: f64 = 5.0;
/// Nor before so long: the first steps are of other kinds than those that follow.
const AFTER: Duration = Duration::from_secs(3);
/// How often the time that has passed is drawn anew.
const TICK: Duration = Duration::from_millis(250);

/// Where a job stands.
#[derive(Debug, Clone, Copy)]
pub struct Standing<'a> {
    /// Of the whole, about in proportion to time.
    pub percent: f64,
    pub stage: &'a str,
    /// The fit's steps.
    pub step: u64,
}

/// A bar on a terminal, and nothing elsewhere.
pub struct Bar {
    bar: ProgressBar,
    begun: Option<Seen>,
    /// Where the stage, or a count of steps that began anew, was first seen.
    stage: Option<(String, Seen)>,
}

/// When something was first seen, and at what.
#[derive(Debug, Clone, Copy)]
struct Seen {
    at: Instant,
    percent: f64,
    step: u64,
}

impl Bar {
    pub fn new() -> Self {
        let bar = ProgressBar::new(100);
        if let Ok(style) = ProgressStyle::with_template("{bar:20} {pos:>3} % [{elapsed}] {wide_msg}") {
            bar.set_style(style);
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(TICK);
        }
        Self { bar, begun: None, stage: None }
    }

    /// Whether nobody sees it.
    pub fn is_hidden(&self) -> bool {
        self.bar.is_hidden()
    }

    /// Shows words alone, where it cannot be said how long something takes.
    pub fn says(&mut self, percent: f64, words: String) {
        (self.begun, self.stage) = (None, None);
        self.bar.set_position(percent.max(0.0) as u64);
        self.bar.set_message(words);
    }

    /// Shows where a job stands.
    pub fn show(&mut self, now: Standing<'_>) {
        let seen = Seen { at: Instant::now(), percent: now.percent, step: now.step };
        let begun = *self.begun.get_or_insert(seen);
        let same = self.stage.as_ref().is_some_and(|(stage, first)| stage == now.stage && first.step <= now.step);
        if !same {
            self.stage = Some((now.stage.to_owned(), seen));
        }
        let first = self.stage.as_ref().map_or(seen, |(_, first)| *first);
        self.bar.set_position(now.percent.max(0.0) as u64);
        self.bar.set_message(words(
            now.stage,
            (now.step, now.step - first.step, seen.at - first.at),
            (now.percent, now.percent - begun.percent, seen.at - begun.at),
        ));
    }
}

impl Drop for Bar {
    /// Leaves the line to what comes next.
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Stage, the time that is left, and steps with their rate: what matters least is cut off where a terminal is narrow.
/// `steps` is the last one, how many were seen, and within what time; `done` the same of the whole, in per cent.
fn words(stage: &str, steps: (u64, u64, Duration), done: (f64, f64, Duration)) -> String {
    let mut words = stage.to_owned();
    let (percent, seen, within) = done;
    if seen >= SEEN && within >= AFTER && percent < 100.0 {
        words.push_str(&format!(", about {} left", span(within.mul_f64((100.0 - percent) / seen))));
    }
    let (step, seen, within) = steps;
    if step > 0 {
        words.push_str(&format!(", step {step}"));
    }
    if seen > 1 {
        words.push_str(&format!(", {:.1} steps/s", seen as f64 / within.as_secs_f64().max(1e-3)));
    }
    words
}

/// A time as people say it.
fn span(time: Duration) -> String {
    match time.as_secs_f64() {
        seconds if seconds < 90.0 => format!("{} s", seconds.round().max(1.0)),
        seconds if seconds < 5400.0 => format!("{} min", (seconds / 60.0).round()),
        seconds => format!("{:.1} h", seconds / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_what_was_seen_and_steps_have_a_rate() {
        let seconds = Duration::from_secs;
        let nothing = (0.0, 0.0, seconds(0));
        assert_eq!(words("preparing", (0, 0, seconds(0)), nothing), "preparing");
        assert_eq!(words("fitting", (1, 0, seconds(9)), nothing), "fitting, step 1");
        // Seen from 20 to 40 per cent within 10 s: the other 60 take three times as long.
        let shown = words("fitting", (12, 10, seconds(4)), (40.0, 20.0, seconds(10)));
        assert_eq!(shown, "fitting, about 30 s left, step 12, 2.5 steps/s");
        let early = words("fitting", (12, 10, seconds(1)), (40.0, 20.0, seconds(1)));
        assert_eq!(early, "fitting, step 12, 10.0 steps/s");
        assert_eq!(words("done", (0, 0, seconds(0)), (100.0, 90.0, seconds(10))), "done");
    }

    #[test]
    fn times_are_said_in_the_unit_that_fits() {
        let said = [0.2, 42.4, 150.0, 9000.0].map(|seconds| span(Duration::from_secs_f64(seconds)));
        assert_eq!(said, ["1 s", "42 s", "3 min", "2.5 h"]);
    }
}

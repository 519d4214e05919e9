//! The tree of frames that a recording's transforms make: who hangs on whom, and the way from one frame to another.

use std::collections::BTreeMap;

use super::error::RecordingError;

/// Pairs of frames with a transform; a robot with every joint and gripper has some hundred.
const MOST_EDGES: usize = 4096;

/// A frame in its parent.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    pub child: String,
    pub parent: String,
}

/// How often a transform is told of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Told {
    moving: usize,
    fixed: usize,
}

/// A step from frame to frame: along an edge from parent to child, or back.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    pub edge: Edge,
    pub backwards: bool,
}

#[derive(Debug, Clone, Default)]
pub struct Frames {
    told: BTreeMap<Edge, Told>,
}

impl Frames {
    /// Notes a transform.
    pub fn note(&mut self, child: &str, parent: &str, fixed: bool) -> Result<(), RecordingError> {
        let edge = Edge { child: child.to_owned(), parent: parent.to_owned() };
        if self.told.len() >= MOST_EDGES && !self.told.contains_key(&edge) {
            return Err(RecordingError::TooMany { what: "pairs of frames", limit: MOST_EDGES });
        }
        let told = self.told.entry(edge).or_default();
        if fixed {
            told.fixed += 1
        } else {
            told.moving += 1
        }
        Ok(())
    }

    /// Whether a transform holds all the time: it is in `/tf_static`, or told of once.
    pub fn is_fixed(&self, edge: &Edge) -> bool {
        self.told.get(edge).is_some_and(|told| told.moving <= 1)
    }

    pub fn knows(&self, frame: &str) -> bool {
        self.told.keys().any(|edge| edge.child == frame || edge.parent == frame)
    }

    /// The edge to a frame's parent; where transforms name several parents, the one told of most.
    fn up(&self, frame: &str) -> Option<&Edge> {
        let edges = self.told.iter().filter(|(edge, _)| edge.child == frame);
        edges.max_by_key(|(_, told)| (told.moving, told.fixed)).map(|(edge, _)| edge)
    }

    /// The edges from a frame up to the root of its tree.
    pub fn ancestry(&self, frame: &str) -> Vec<Edge> {
        let (mut edges, mut at) = (Vec::<Edge>::new(), frame);
        while let Some(edge) = self.up(at) {
            // Transforms in a circle have no root.
            if edge.parent == frame || edges.iter().any(|passed| passed.child == edge.parent) {
                break;
            }
            edges.push(edge.clone());
            at = &edge.parent;
        }
        edges
    }

    /// The frame of the body that a frame is fixed to: as far up as nothing moves.
    pub fn body(&self, frame: &str) -> String {
        let fixed = self.ancestry(frame).into_iter().take_while(|edge| self.is_fixed(edge));
        fixed.last().map_or_else(|| frame.to_owned(), |edge| edge.parent)
    }

    /// The way from one frame to another, through the nearest frame that both hang on.
    pub fn way(&self, from: &str, to: &str) -> Option<Vec<Step>> {
        let (up, down) = (self.ancestry(from), self.ancestry(to));
        let line = |start: &str, edges: &[Edge]| -> Vec<String> {
            std::iter::once(start.to_owned()).chain(edges.iter().map(|edge| edge.parent.clone())).collect()
        };
        let (ours, theirs) = (line(from, &up), line(to, &down));
        let (k, l) = ours
            .iter()
            .enumerate()
            .find_map(|(k, frame)| theirs.iter().position(|other| other == frame).map(|l| (k, l)))?;
        let back = up.into_iter().take(k).map(|edge| Step { edge, backwards: true });
        let forth: Vec<Edge> = down.into_iter().take(l).collect();
        Some(back.chain(forth.into_iter().rev().map(|edge| Step { edge, backwards: false })).collect())
    }

    /// In words: `map -> odom (812 times), base_link -> laser (fixed)`.
    pub fn listing(&self) -> String {
        if self.told.is_empty() {
            return "no transforms".into();
        }
        let shown = self.told.iter().take(MOST_SHOWN).map(|(Edge { child, parent }, told)| match told.moving {
            0 => format!("{parent} -> {child} (fixed)"),
            1 => format!("{parent} -> {child} (once)"),
            times => format!("{parent} -> {child} ({times} times)"),
        });
        let more = self.told.len().saturating_sub(MOST_SHOWN);
        let more = (more > 0).then(|| format!("and {more} more"));
        shown.chain(more).collect::<Vec<_>>().join(", ")
    }
}

/// Transforms that a listing has at most.
const MOST_SHOWN: usize = 40;

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Frames {
        let mut frames = Frames::default();
        for (parent, child, fixed) in
            [("map", "odom", false), ("odom", "base", false), ("base", "laser", true), ("base", "foot", true)]
        {
            frames.note(child, parent, fixed).unwrap();
            frames.note(child, parent, fixed).unwrap();
        }
        frames
    }

    #[test]
    fn a_way_goes_up_to_what_both_hang_on_and_down_again() {
        let frames = robot();
        let names = |from, to| -> Vec<(String, bool)> {
            frames.way(from, to).unwrap().into_iter().map(|step| (step.edge.child, step.backwards)).collect()
        };
        assert_eq!(names("map", "laser"), [("odom".into(), false), ("base".into(), false), ("laser".into(), false)]);
        assert_eq!(names("foot", "laser"), [("foot".into(), true), ("laser".into(), false)]);
        assert_eq!((names("laser", "laser"), frames.way("map", "camera")), (vec![], None));
        assert_eq!(frames.body("laser"), "base");
    }

    #[test]
    fn transforms_in_a_circle_end() {
        let mut frames = Frames::default();
        for (parent, child) in [("a", "b"), ("b", "c"), ("c", "a"), ("d", "d")] {
            frames.note(child, parent, false).unwrap();
        }
        assert!(frames.ancestry("a").len() <= 3 && frames.ancestry("d").is_empty());
    }
}

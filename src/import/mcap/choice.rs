//! Which topic has the scans, and what says where they were taken.
//!
//! Scans: the one topic that has any, or the one that is asked for. Poses, unless one is asked for, in this order: the
//! transforms up to `map`, which some SLAM or localisation has corrected; a pose topic with a covariance; the transforms
//! up to `odom` or whatever else the robot moves in; odometry topics; poses without covariance. Of topics there must be
//! one of the kind: between two, a person chooses.
//!
//! A pose topic tells of the robot; from there to the scanner the transforms lead. Where a topic does not say what it
//! tells of, it is the body that the scanner is fixed to.

use super::contents::{Contents, Kind, Topic, listed};
use super::error::RecordingError;
use super::frames::Step;

/// What a person asks for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ask {
    pub scan_topic: Option<String>,
    /// A frame of the transforms, or a topic of odometry or poses.
    pub pose_topic: Option<String>,
}

/// What is taken from a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    pub scans: String,
    pub kind: Kind,
    pub poses: Poses,
    /// For each frame that scans are in: the way there, from the root or from what a pose topic tells of.
    pub ways: Vec<(String, Vec<Step>)>,
    pub notes: Vec<String>,
}

/// Where poses come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Poses {
    /// The transforms, from this frame.
    Frames(String),
    /// A topic of this kind.
    Topic(String, Kind),
}

/// A pose topic with fewer messages is an operator's hint, no track.
const TRACK: usize = 2;

impl Contents {
    pub fn choose(&self, ask: &Ask) -> Result<Chosen, RecordingError> {
        let (name, topic) = self.scan_topic(ask.scan_topic.as_deref())?;
        let frame = topic.frames.first().cloned().unwrap_or_default();
        let poses = match ask.pose_topic.as_deref() {
            Some(asked) => self.asked_poses(asked)?,
            None => self.found_poses(name, &frame)?,
        };
        let mut notes = Vec::new();
        let mut ways = vec![(frame.clone(), self.way_to(&poses, &frame, &mut notes)?)];
        for other in topic.frames.iter().skip(1) {
            match self.way_to(&poses, other, &mut notes) {
                Ok(way) => ways.push((other.clone(), way)),
                Err(_) => notes.push(format!("scans in frame {other:?} are left out: no transform leads there")),
            }
        }
        Ok(Chosen { scans: name.clone(), kind: topic.kind, poses, ways, notes })
    }

    fn scan_topic(&self, asked: Option<&str>) -> Result<(&String, &Topic), RecordingError> {
        let all = || self.topics.iter().filter(|(_, topic)| topic.kind.has_scans());
        let there: Vec<_> = all().filter(|(_, topic)| topic.is_readable()).collect();
        if let Some(asked) = asked {
            let listing = || format!("topics with scans: {}", listed(there.iter().copied()));
            let unknown = || RecordingError::ScanTopic { topic: asked.to_owned(), listing: listing() };
            let found = all().find(|(name, _)| name.trim_start_matches('/') == asked.trim_start_matches('/'));
            let (name, topic) = found.ok_or_else(unknown)?;
            return if topic.is_readable() { Ok((name, topic)) } else { Err(unreadable(name, topic)) };
        }
        match there[..] {
            [one] => Ok(one),
            [] => {
                // Scans that cannot be read say more than that there are none.
                let scans = self.topics.iter().find(|(_, topic)| topic.channel.kind.contains("LaserScan"));
                match scans {
                    Some((name, topic)) => Err(unreadable(name, topic)),
                    None => Err(RecordingError::NoScans(format!("It has: {}", listed(self.topics.iter())))),
                }
            }
            _ => Err(RecordingError::SeveralScanTopics(listed(there.into_iter()))),
        }
    }

    /// A frame, or a topic.
    fn asked_poses(&self, asked: &str) -> Result<Poses, RecordingError> {
        let bare = asked.trim_start_matches('/');
        let named = self.topics.iter().find(|(name, _)| name.trim_start_matches('/') == bare);
        match named {
            Some((name, topic)) if topic.kind.has_poses() => {
                let there = topic.is_readable();
                return if there { Ok(Poses::Topic(name.clone(), topic.kind)) } else { Err(unreadable(name, topic)) };
            }
            // `/tf` itself: the transforms, whatever the robot is called.
            Some((_, topic)) if topic.kind == Kind::Transforms => {}
            _ if !self.frames.ancestry(bare).is_empty() => return Ok(Poses::Frames(self.root_of(bare))),
            _ => {
                let topics = listed(self.topics.iter().filter(|(_, topic)| topic.kind.has_poses()));
                let listing = format!("topics with poses: {topics}; frames: {}", self.frames.listing());
                return Err(RecordingError::PoseTopic { topic: asked.to_owned(), listing });
            }
        }
        Ok(Poses::Frames(String::new()))
    }

    /// The frame that poses are in: `map` where a frame hangs on it, else `odom`, else the root.
    fn root_of(&self, frame: &str) -> String {
        let up: Vec<String> = self.frames.ancestry(frame).into_iter().map(|edge| edge.parent).collect();
        let named = |name: &str| up.iter().find(|frame| frame.rsplit('/').next() == Some(name));
        named("map").or_else(|| named("odom")).or(up.last()).cloned().unwrap_or_else(|| frame.to_owned())
    }

    fn found_poses(&self, scans: &str, frame: &str) -> Result<Poses, RecordingError> {
        let root = self.root_of(frame);
        let moves = self.frames.ancestry(frame).iter().any(|edge| !self.frames.is_fixed(edge));
        let last = root.rsplit('/').next().unwrap_or_default();
        let of = |kind: Kind| -> Vec<(&String, &Topic)> {
            let tracks = |topic: &Topic| topic.kind == kind && topic.is_readable() && topic.messages >= TRACK;
            self.topics.iter().filter(|(_, topic)| tracks(topic)).collect()
        };
        // A scanner that is fixed to the map stands still: a map of one place.
        if last == "map" && root != frame {
            return Ok(Poses::Frames(root));
        }
        let one = |kind: Kind| match of(kind)[..] {
            [] => Ok(None),
            [(name, _)] => Ok(Some(Poses::Topic(name.clone(), kind))),
            ref several => Err(RecordingError::SeveralPoseTopics(listed(several.iter().copied()))),
        };
        if let Some(poses) = one(Kind::PoseWithCovariance)? {
            return Ok(poses);
        }
        if moves || (last == "odom" && root != frame) {
            return Ok(Poses::Frames(root));
        }
        for kind in [Kind::Odometry, Kind::Pose] {
            if let Some(poses) = one(kind)? {
                return Ok(poses);
            }
        }
        let missing = match self.frames.knows(frame) {
            true => format!("its frame hangs on {root:?}, which nothing moves ({})", self.frames.listing()),
            false if self.topics.values().any(|topic| topic.kind == Kind::Transforms) => {
                return Err(RecordingError::NoTransform {
                    from: self.a_root(),
                    to: frame.to_owned(),
                    known: self.frames.listing(),
                });
            }
            false => "there are no transforms, no odometry and no poses".to_owned(),
        };
        Err(RecordingError::NoPoses { topic: scans.to_owned(), frame: frame.to_owned(), detail: missing })
    }

    /// Some frame that all else may hang on, for a message.
    fn a_root(&self) -> String {
        let frames = ["map", "odom"].into_iter().find(|frame| self.frames.knows(frame));
        frames.unwrap_or("map").to_owned()
    }

    /// The way to a scanner's frame, from the root or from what a topic tells of.
    fn way_to(&self, poses: &Poses, frame: &str, notes: &mut Vec<String>) -> Result<Vec<Step>, RecordingError> {
        let missing = |from: &str| RecordingError::NoTransform {
            from: from.to_owned(),
            to: frame.to_owned(),
            known: self.frames.listing(),
        };
        match poses {
            Poses::Frames(root) if root.is_empty() => {
                let root = self.root_of(frame);
                if root == frame {
                    Err(missing(&self.a_root()))
                } else {
                    self.frames.way(&root, frame).ok_or_else(|| missing(&root))
                }
            }
            Poses::Frames(root) => self.frames.way(root, frame).ok_or_else(|| missing(root)),
            Poses::Topic(name, _) => {
                let child = self.topics.get(name).map_or("", |topic| &topic.child);
                if child == frame {
                    return Ok(Vec::new());
                }
                if !child.is_empty() {
                    return self.frames.way(child, frame).ok_or_else(|| missing(child));
                }
                let body = self.frames.body(frame);
                if body == frame {
                    notes.push(format!(
                        "no transform says where the scanner {frame:?} sits on the robot: {name} is taken for its own poses"
                    ));
                }
                self.frames.way(&body, frame).ok_or_else(|| missing(&body))
            }
        }
    }
}

/// Why a topic that should do cannot be read.
fn unreadable(name: &str, topic: &Topic) -> RecordingError {
    let encoding = topic.channel.encoding.as_str();
    if encoding != "cdr" {
        let advice = match encoding {
            "ros1" => {
                "This was a ROS 1 bag: `rosbags-convert --src OLD.bag --dst NEW --dst-storage mcap` (PyPI rosbags) makes a ROS 2 recording of it"
            }
            "protobuf" | "json" | "flatbuffer" => {
                "Record the ROS 2 topic itself (`ros2 bag record -s mcap`), or send the scans as a job's JSON"
            }
            _ => "Record it with `ros2 bag record -s mcap`",
        };
        return RecordingError::Encoding { topic: name.to_owned(), encoding: encoding.to_owned(), advice };
    }
    let detail = topic.fault.clone().unwrap_or_else(|| "it has no messages".into());
    RecordingError::Message { topic: name.to_owned(), kind: topic.channel.kind.clone(), detail }
}

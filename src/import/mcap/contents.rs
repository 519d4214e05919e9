//! What is in a recording: its topics, its frames, from when to when. The first of two readings; nothing is kept but
//! counts.

use std::collections::BTreeMap;
use std::fmt;

use super::error::RecordingError;
use super::frames::Frames;
use super::messages::{Echoes, Header, Odometry, PoseStamped, PoseWithCovariance, Scan, Sighting, Transforms, decode};
use super::records::{Channel, Message};

/// What a topic's messages are to a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Scan,
    Echoes,
    Transforms,
    Odometry,
    PoseWithCovariance,
    Pose,
    Other,
}

impl Kind {
    /// Of a message's type, with or without `msg/` in it.
    pub fn of(channel: &Channel) -> Self {
        match channel.kind.replace("/msg/", "/").as_str() {
            "sensor_msgs/LaserScan" => Self::Scan,
            "sensor_msgs/MultiEchoLaserScan" => Self::Echoes,
            "tf2_msgs/TFMessage" | "tf/tfMessage" => Self::Transforms,
            "nav_msgs/Odometry" => Self::Odometry,
            "geometry_msgs/PoseWithCovarianceStamped" => Self::PoseWithCovariance,
            "geometry_msgs/PoseStamped" => Self::Pose,
            _ => Self::Other,
        }
    }

    pub fn has_scans(self) -> bool {
        matches!(self, Self::Scan | Self::Echoes)
    }

    pub fn has_poses(self) -> bool {
        matches!(self, Self::Odometry | Self::PoseWithCovariance | Self::Pose)
    }
}

/// A scan of either kind.
pub fn scan<'a>(kind: Kind, data: &'a [u8]) -> re_cdr::Result<Scan<'a>> {
    if kind == Kind::Echoes { Ok(decode::<Echoes<'a>>(data)?.0) } else { decode(data) }
}

/// A pose of any kind.
pub fn sighting<'a>(kind: Kind, data: &'a [u8]) -> re_cdr::Result<Sighting<'a>> {
    match kind {
        Kind::Odometry => Ok(decode::<Odometry<'a>>(data)?.0),
        Kind::PoseWithCovariance => Ok(decode::<PoseWithCovariance<'a>>(data)?.0),
        _ => Ok(decode::<PoseStamped<'a>>(data)?.0),
    }
}

/// Transforms on this topic hold for good.
pub fn is_static(topic: &str) -> bool {
    topic.ends_with("tf_static")
}

/// A topic, by what it carries.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    pub kind: Kind,
    pub channel: Channel,
    pub messages: usize,
    /// Messages that are not what their type says, and what is wrong with the first.
    pub unreadable: usize,
    pub fault: Option<String>,
    /// From the first stamp to the last, nanoseconds.
    pub stamps: Option<(i64, i64)>,
    /// The frames its messages are in, in the order they come, and what an odometry topic tells of.
    pub frames: Vec<String>,
    pub child: String,
}

/// Frames of one topic that are told apart.
const MOST_FRAMES: usize = 16;

/// What is in a recording.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    pub topics: BTreeMap<String, Topic>,
    pub frames: Frames,
    /// From the first message recorded to the last, nanoseconds.
    pub logged: Option<(u64, u64)>,
}

impl Contents {
    /// Counts a message.
    pub fn note(&mut self, message: &Message<'_>) -> Result<(), RecordingError> {
        let channel = message.channel;
        let (first, last) = self.logged.unwrap_or((message.logged, message.logged));
        self.logged = Some((first.min(message.logged), last.max(message.logged)));
        let topic = self.topics.entry(channel.topic.clone()).or_insert_with(|| Topic {
            kind: Kind::of(channel),
            channel: (**channel).clone(),
            messages: 0,
            unreadable: 0,
            fault: None,
            stamps: None,
            frames: Vec::new(),
            child: String::new(),
        });
        topic.messages += 1;
        if channel.encoding != "cdr" {
            return Ok(());
        }
        let data = message.data;
        let header = match topic.kind {
            Kind::Other => return Ok(()),
            Kind::Transforms => match decode::<Transforms<'_>>(data) {
                Ok(Transforms(transforms)) => {
                    for transform in transforms.iter().filter(|transform| transform.pose.is_some()) {
                        self.frames.note(transform.child, transform.header.frame, is_static(&channel.topic))?;
                        topic.spans(transform.header.stamp);
                    }
                    return Ok(());
                }
                Err(error) => Err(error),
            },
            kind if kind.has_scans() => scan(kind, data).map(|scan| (scan.header, "")),
            kind => sighting(kind, data).map(|sighting| (sighting.header, sighting.child)),
        };
        match header {
            Ok((header, child)) => topic.tells(header, child),
            Err(error) => {
                topic.unreadable += 1;
                topic.fault.get_or_insert_with(|| error.to_string());
            }
        }
        Ok(())
    }
}

impl Topic {
    fn spans(&mut self, stamp: i64) {
        let (first, last) = self.stamps.unwrap_or((stamp, stamp));
        self.stamps = Some((first.min(stamp), last.max(stamp)));
    }

    fn tells(&mut self, header: Header<'_>, child: &str) {
        self.spans(header.stamp);
        if self.frames.len() < MOST_FRAMES && !self.frames.iter().any(|frame| frame == header.frame) {
            self.frames.push(header.frame.to_owned());
        }
        if self.child.is_empty() {
            self.child = child.to_owned();
        }
    }

    /// Whether it has messages that can be read.
    pub fn is_readable(&self) -> bool {
        self.channel.encoding == "cdr" && self.messages > self.unreadable
    }
}

/// Topics that a listing has at most.
const MOST_SHOWN: usize = 60;

/// In one line: `/scan (sensor_msgs/msg/LaserScan, 241 messages, frame laser)`.
pub fn listed<'a>(topics: impl Iterator<Item = (&'a String, &'a Topic)>) -> String {
    let shown: Vec<String> = topics.take(MOST_SHOWN).map(|(name, topic)| format!("{name} ({topic})")).collect();
    if shown.is_empty() { "none".into() } else { shown.join(", ") }
}

impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.channel.kind.is_empty() { "no type" } else { &self.channel.kind };
        write!(f, "{kind}, {} messages", self.messages)?;
        if self.channel.encoding != "cdr" {
            write!(f, ", encoded as {:?}", self.channel.encoding)?;
        }
        if self.unreadable > 0 {
            write!(f, ", {} unreadable", self.unreadable)?;
        }
        if let Some(frame) = self.frames.first() {
            write!(f, ", frame {frame}")?;
        }
        if !self.child.is_empty() {
            write!(f, " -> {}", self.child)?;
        }
        Ok(())
    }
}

impl fmt::Display for Contents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = self.logged.unwrap_or_default();
        writeln!(f, "{} topics, {:.1} s", self.topics.len(), (last - first) as f64 * 1e-9)?;
        let width = self.topics.keys().map(|name| name.len()).max().unwrap_or(0).min(40);
        for (name, topic) in &self.topics {
            writeln!(f, "  {name:<width$}  {topic}")?;
        }
        writeln!(f, "frames: {}", self.frames.listing())
    }
}

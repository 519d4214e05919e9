//! What can be wrong with a recording, and what to do about it.
//!
//! Every message is for the person who has the file: it says what was found and the next step. Options are named as the
//! service has them (`scan_topic`); the command line has flags of the same names.

use thiserror::Error;

#[derive(Debug, Error)]
pub enum RecordingError {
    #[error("the recording cannot be read: {0}")]
    Io(#[from] std::io::Error),
    #[error(
        "the file ends in the middle of a record, after {0} bytes: the recorder was stopped hard, or a copy is not whole. `mcap recover FILE -o WHOLE.mcap` saves what is there"
    )]
    Truncated(u64),
    #[error(
        "the file is damaged: {0}. `mcap doctor FILE` says more, `mcap recover FILE -o WHOLE.mcap` saves what can be read"
    )]
    Damaged(String),
    #[error(
        "{what} has {bytes} bytes; the limit is {limit}. Keep only what a map needs: `mcap filter FILE -o SMALL.mcap -y /scan -y /odom -y '/tf.*'`, with --chunk-size 1048576 where chunks are too large"
    )]
    TooLarge { what: &'static str, bytes: u64, limit: u64 },
    #[error(
        "the recording has more than {limit} {what}; take a part of it with from and to, or every so many scans with every"
    )]
    TooMany { what: &'static str, limit: usize },
    #[error(
        "chunks are compressed with {0:?}, which is not known here; zstd and lz4 are: `mcap compress FILE -o OUT.mcap --compression zstd`"
    )]
    Compression(String),
    #[error("{topic} is encoded as {encoding:?}; ROS 2 recordings have \"cdr\". {advice}")]
    Encoding { topic: String, encoding: String, advice: &'static str },
    #[error("a message on {topic} is not a {kind}: {detail}")]
    Message { topic: String, kind: String, detail: String },
    #[error(
        "the recording has no laser scans: no topic of type sensor_msgs/msg/LaserScan or MultiEchoLaserScan has a message. {0}"
    )]
    NoScans(String),
    #[error("{topic} is no topic with scans here; {listing}")]
    ScanTopic { topic: String, listing: String },
    #[error("several topics have scans; choose one with scan_topic (--scan-topic): {0}")]
    SeveralScanTopics(String),
    #[error(
        "nothing says where the scanner of {topic} (frame {frame:?}) was: {detail}. Record /tf and /tf_static, an odometry or a pose topic beside the scans"
    )]
    NoPoses { topic: String, frame: String, detail: String },
    #[error("{topic} gives no poses here; {listing}")]
    PoseTopic { topic: String, listing: String },
    #[error("several topics have poses; choose one with pose_topic (--pose-topic): {0}")]
    SeveralPoseTopics(String),
    #[error(
        "no transform leads from frame {from:?} to the scanner's frame {to:?}: the recording knows {known}. /tf_static is sent once, at the start of a driver: record from before it starts, or restart it while recording"
    )]
    NoTransform { from: String, to: String, known: String },
    #[error("none of the {scans} scans has a pose: {detail}")]
    NoScanHasPose { scans: usize, detail: String },
    #[error(
        "the scanner of {topic} looks {degrees:.0} degrees out of the plane in every scan; maps are made of level scans. Its mounting is in /tf_static, and may be wrong there"
    )]
    Tilted { topic: String, degrees: f64 },
    #[error("from, to and every leave none of the recording's {0} scans")]
    NothingSelected(usize),
    #[error("the work was stopped")]
    Stopped,
}

/// Which of the options a person has to change, where it is one.
impl RecordingError {
    pub fn option(&self) -> Option<&'static str> {
        match self {
            Self::ScanTopic { .. } | Self::SeveralScanTopics(_) => Some("scan_topic"),
            Self::PoseTopic { .. } | Self::SeveralPoseTopics(_) => Some("pose_topic"),
            Self::NothingSelected(_) => Some("from"),
            _ => None,
        }
    }
}

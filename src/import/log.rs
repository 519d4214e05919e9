//! A robot's log, whatever it is: told by its first bytes, never by its name.
//!
//! What cannot become a map is named kindly, with the way to what can: a ROS 1 bag, a rosbag2 database, a picture of a map.

use std::io::Read;

use thiserror::Error;

use super::mcap::{Ask, GoesOn, Limits, MAGIC, Recording, RecordingError, Source, list_mcap, read_mcap};
use super::{ImportError, Selection, parse_carmen};
use crate::scan::LaserScan;

/// A log's scans, and what a person should know of how they came about.
pub type Log = Recording;

#[derive(Debug, Error)]
pub enum LogError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("{0}: a CARMEN log has FLASER lines, a ROS 2 recording is an MCAP file")]
    Carmen(#[from] ImportError),
    #[error("the file is empty: nothing was recorded, or nothing was copied")]
    Empty,
    #[error("{0}")]
    Other(&'static str),
    #[error("the log cannot be read: {0}")]
    Io(#[from] std::io::Error),
}

impl LogError {
    /// Which of a recording's options has to be changed, where it is one.
    pub fn option(&self) -> Option<&'static str> {
        match self {
            Self::Recording(error) => error.option(),
            _ => None,
        }
    }
}

/// What can be told of a file that is no log, by its first bytes.
const STRANGERS: [(&[u8], &str); 9] = [
    (
        b"#ROSBAG",
        "this is a ROS 1 bag; a ROS 2 recording can be made of it: `rosbags-convert --src OLD.bag --dst NEW --dst-storage mcap` (pip install rosbags)",
    ),
    (
        b"SQLite format 3\0",
        "this is a rosbag2 database (.db3); `rosbags-convert --src FOLDER --dst NEW --dst-storage mcap` (pip install rosbags) or `mcap convert OLD.db3 NEW.mcap` makes an MCAP recording of it",
    ),
    (b"P5", PICTURE),
    (b"P2", PICTURE),
    (b"\x89PNG", PICTURE),
    (b"BM", PICTURE),
    (b"image:", PICTURE),
    (
        b"\x28\xb5\x2f\xfd",
        "this is compressed with zstd; unpack it first (`zstd -d FILE`): a rosbag2 that is compressed as a whole is an .mcap inside",
    ),
    (b"PK\x03\x04", "this is a zip archive; send the recording that is in it"),
];
const PICTURE: &str = "this is a picture of a map, as map_server has it. A picture is no evidence: it does not say from where a wall was seen, how often, or how exactly, so no distance with a sigma can be fitted to it. Send the scans it was made from: a ROS 2 recording (MCAP), a CARMEN log, or a job's JSON";

/// How much of a file tells what it is.
const FRONT: usize = 4096;

/// A source that is unpacked on the way where it is gzipped, up to `limit` bytes.
fn plain<'a>(source: &'a Source<'a>, limit: u64) -> impl Fn() -> std::io::Result<Box<dyn Read>> + 'a {
    move || {
        let mut file = source()?;
        let mut front = Vec::new();
        file.by_ref().take(2).read_to_end(&mut front)?;
        let packed = front == [0x1f, 0x8b];
        let whole = std::io::Cursor::new(front).chain(file);
        Ok(match packed {
            true => Box::new(Capped { reader: flate2::read::MultiGzDecoder::new(whole), left: limit, limit }),
            false => Box::new(whole),
        })
    }
}

/// A reader that fails, and does not just end, where more comes out of it than may.
struct Capped<R> {
    reader: R,
    left: u64,
    limit: u64,
}

impl<R: Read> Read for Capped<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.reader.read(buffer)?;
        let over = || {
            let detail = format!("it unpacks to more than {} bytes", self.limit);
            std::io::Error::new(std::io::ErrorKind::FileTooLarge, detail)
        };
        self.left = self.left.checked_sub(read as u64).ok_or_else(over)?;
        Ok(read)
    }
}

/// Whether a log is an MCAP recording; what it is if it is no log at all.
fn is_mcap(source: &Source<'_>) -> Result<bool, LogError> {
    let mut front = Vec::new();
    source()?.take(FRONT as u64).read_to_end(&mut front)?;
    if front.is_empty() {
        return Err(LogError::Empty);
    }
    if front.starts_with(MAGIC) {
        return Ok(true);
    }
    match STRANGERS.iter().find(|(begins, _)| front.starts_with(begins)) {
        Some((_, what)) => Err(LogError::Other(what)),
        None => Ok(false),
    }
}

/// The selected scans of a log, gzipped or not.
pub fn read_log(
    source: &Source<'_>,
    ask: &Ask,
    selection: &Selection,
    limits: &Limits,
    goes_on: &GoesOn<'_>,
) -> Result<Log, LogError> {
    let source = plain(source, limits.file);
    if is_mcap(&source)? {
        return Ok(read_mcap(&source, ask, selection, limits, goes_on)?);
    }
    let scans = carmen(&source, limits)?;
    let all = scans.len();
    let scans = selection.of(scans);
    if scans.is_empty() {
        return Err(RecordingError::NothingSelected(all).into());
    }
    if scans.len() > limits.scans {
        return Err(RecordingError::TooMany { what: "scans", limit: limits.scans }.into());
    }
    Ok(Log { scans, notes: Vec::new() })
}

/// What is in a log, in words.
pub fn list_log(source: &Source<'_>, ask: &Ask, limits: &Limits) -> Result<String, LogError> {
    let source = plain(source, limits.file);
    if is_mcap(&source)? {
        return Ok(list_mcap(&source, ask, limits)?);
    }
    let scans = carmen(&source, limits)?;
    let beams = scans.first().map_or(0, |scan| scan.ranges.len());
    Ok(format!("a CARMEN log of {} scans with {beams} beams each, corrected poses beside them\n", scans.len()))
}

fn carmen(source: &Source<'_>, limits: &Limits) -> Result<Vec<LaserScan>, LogError> {
    let mut text = Vec::new();
    let limit = limits.file;
    let bytes = source()?.take(limit + 1).read_to_end(&mut text)? as u64;
    if bytes > limit {
        return Err(RecordingError::TooLarge { what: "the log", bytes, limit }.into());
    }
    // A file that is no text is told from a log that is torn.
    if text.iter().take(FRONT).any(|byte| *byte == 0) {
        return Err(LogError::Other("this is neither an MCAP recording nor a CARMEN log"));
    }
    Ok(parse_carmen(&String::from_utf8_lossy(&text))?)
}

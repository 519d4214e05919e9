//! ROS 2 recordings (MCAP) into scans with poses.
//!
//! A recording is read twice. The first reading counts what is there (`contents`), so that the topics can be chosen
//! (`choice`) and everything that is missing can be named before anything is kept; the second keeps the chosen scans and
//! what places them (`placing`, over `frames` and `track`), and makes each message a scan, or several where the robot
//! moved while the beams went round (`sweep`). `records` reads the file itself and holds every length against its limit;
//! `messages` reads CDR.

mod choice;
mod contents;
mod error;
mod frames;
mod messages;
mod placing;
mod records;
mod sweep;
mod track;

use std::io::Read;

pub use choice::Ask;
pub use error::RecordingError;
pub use records::{Limits, MAGIC};

use choice::Chosen;
use contents::Contents;
use messages::Scan;
use placing::{Placed, Placing};

use super::Selection;
use crate::scan::LaserScan;

/// Where a recording's bytes come from: opened anew for each reading.
pub type Source<'a> = dyn Fn() -> std::io::Result<Box<dyn Read>> + 'a;

/// Whether the work should go on.
pub type GoesOn<'a> = dyn Fn() -> bool + 'a;

/// What a recording gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    pub scans: Vec<LaserScan>,
    /// What a person should know of how they came about.
    pub notes: Vec<String>,
}

/// What is in a recording, in words, and what would be taken of it.
pub fn list_mcap(source: &Source<'_>, ask: &Ask, limits: &Limits) -> Result<String, RecordingError> {
    let contents = contents(source, limits, &|| true)?;
    let chosen = match contents.choose(ask) {
        Ok(Chosen { scans, poses, .. }) => match poses {
            choice::Poses::Frames(root) => format!("a map would take {scans}, placed by the frames from {root:?}"),
            choice::Poses::Topic(name, _) => format!("a map would take {scans}, placed by {name}"),
        },
        Err(error) => format!("no map yet: {error}"),
    };
    Ok(format!("{contents}{chosen}\n"))
}

/// The selected scans of a recording, each with the pose it was taken from.
pub fn read_mcap(
    source: &Source<'_>,
    ask: &Ask,
    selection: &Selection,
    limits: &Limits,
    goes_on: &GoesOn<'_>,
) -> Result<Recording, RecordingError> {
    let contents = contents(source, limits, goes_on)?;
    let chosen = contents.choose(ask)?;
    let mut taken = Taken { placing: Placing::of(&chosen, &contents.frames), ..Taken::default() };
    records::walk(source()?, limits, goes_on, &mut |message| {
        if message.channel.topic == chosen.scans {
            return taken.scan(&message, &chosen, selection, limits);
        }
        taken.placing.note(&message, limits.poses)
    })?;
    taken.placing.settle();
    if taken.kept.is_empty() {
        return Err(RecordingError::NothingSelected(taken.stamps.len()));
    }
    taken.placed(chosen, limits)
}

fn contents(source: &Source<'_>, limits: &Limits, goes_on: &GoesOn<'_>) -> Result<Contents, RecordingError> {
    let mut contents = Contents::default();
    records::walk(source()?, limits, goes_on, &mut |message| contents.note(&message))?;
    Ok(contents)
}

/// What the second reading keeps.
#[derive(Default)]
struct Taken {
    placing: Placing,
    /// When every scan was recorded and taken, selected or not: the count of epochs needs all.
    stamps: Vec<(u64, i64)>,
    kept: Vec<Kept>,
    ranges: usize,
    unreadable: usize,
    fault: Option<String>,
}

/// A selected scan.
struct Kept {
    /// Its place in `stamps`.
    index: usize,
    /// Which of the chosen ways leads to it.
    way: usize,
    /// Its header's frame is told by the way.
    scan: Scan<'static>,
}

impl Taken {
    fn scan(
        &mut self,
        message: &records::Message<'_>,
        chosen: &Chosen,
        selection: &Selection,
        limits: &Limits,
    ) -> Result<(), RecordingError> {
        let index = self.stamps.len();
        let read = contents::scan(chosen.kind, message.data).map_err(|error| error.to_string());
        let read = read.and_then(|scan| match sweep::fault(&scan, most_beams(limits)) {
            Some(fault) => Err(fault),
            None => Ok(scan),
        });
        let scan = match read {
            Ok(scan) => scan,
            Err(fault) => {
                self.unreadable += 1;
                self.fault.get_or_insert(fault);
                return Ok(());
            }
        };
        if index >= limits.poses {
            return Err(RecordingError::TooMany { what: "scans, taken or not", limit: limits.poses });
        }
        self.stamps.push((message.logged, scan.header.stamp));
        let way = chosen.ways.iter().position(|(frame, _)| frame == scan.header.frame);
        let (true, Some(way)) = (selection.takes(index), way) else { return Ok(()) };
        self.ranges += scan.ranges.len();
        if self.kept.len() >= limits.scans {
            return Err(RecordingError::TooMany { what: "scans", limit: limits.scans });
        }
        if self.ranges > limits.ranges {
            return Err(RecordingError::TooMany { what: "ranges", limit: limits.ranges });
        }
        let header = messages::Header { stamp: scan.header.stamp, frame: "" };
        self.kept.push(Kept { index, way, scan: Scan { header, ..scan } });
        Ok(())
    }

    /// The scans with their poses.
    fn placed(self, chosen: Chosen, limits: &Limits) -> Result<Recording, RecordingError> {
        let epochs = self.epochs();
        let mut notes = chosen.notes;
        let (mut scans, mut homeless, mut tilted) = (Vec::new(), 0usize, (0usize, 0.0f64));
        let (mut split, mut back) = (0usize, None);
        for Kept { index, way, scan } in &self.kept {
            let (way, epoch) = (&chosen.ways[*way].1, epochs[*index]);
            if epoch > 0 {
                back.get_or_insert(*index);
            }
            let at = |seconds: f64| -> Option<Placed> {
                let stamp = scan.header.stamp.saturating_add((seconds * 1e9).round() as i64);
                self.placing.at(way, epoch, stamp)
            };
            if let Some(placed) = at(0.0).filter(|placed| !placed.is_level()) {
                tilted = (tilted.0 + 1, placed.tilt.to_degrees());
                continue;
            }
            match sweep::scans(scan, &at) {
                Some(parts) => {
                    split += usize::from(parts.len() > 1);
                    scans.extend(parts);
                }
                None => homeless += 1,
            }
            if scans.len() > limits.scans {
                return Err(RecordingError::TooMany { what: "scans and parts of scans", limit: limits.scans });
            }
        }
        let all = self.kept.len();
        if scans.is_empty() && homeless == 0 && tilted.0 > 0 {
            return Err(RecordingError::Tilted { topic: chosen.scans, degrees: tilted.1 });
        }
        if scans.is_empty() {
            return Err(RecordingError::NoScanHasPose { scans: all, detail: self.apart() });
        }
        let mut note = |count: usize, what: &str| {
            if count > 0 {
                notes.push(format!("{count} of {all} scans {what}"));
            }
        };
        note(homeless, "are left out: their time lies before, after or in a gap of the poses");
        note(tilted.0, "are left out: the scanner is not level in them");
        note(split, "are given in parts, because the robot moved while their beams went round");
        note(self.unreadable, &format!("cannot be read: {}", self.fault.as_deref().unwrap_or_default()));
        if sweep::drop_largest(&mut scans) {
            notes.push("ranges that equal range_max are taken for no return".into());
        }
        if let Some(index) = back {
            notes.push(format!(
                "time goes back at scan {index} (a simulation started anew, or a recording played twice?): what follows is \
                 placed in the same frame; to {index} takes only what comes before"
            ));
        }
        Ok(Recording { scans, notes })
    }

    /// The epoch of every scan.
    fn epochs(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.stamps.len()).collect();
        order.sort_by_key(|k| self.stamps[*k].0);
        let sorted = track::epochs(order.iter().map(|k| self.stamps[*k].1));
        let mut epochs = vec![0; self.stamps.len()];
        order.into_iter().zip(sorted).for_each(|(k, epoch)| epochs[k] = epoch);
        epochs
    }

    /// How the times of scans and poses lie to each other, in words.
    fn apart(&self) -> String {
        let stamps = || self.kept.iter().map(|kept| kept.scan.header.stamp);
        let (Some(first), Some(last)) = (stamps().min(), stamps().max()) else { return "there are none".into() };
        let seconds = |stamp: i64| stamp as f64 * 1e-9;
        match self.placing.span() {
            None => "no message places them. Record /tf, or choose another pose_topic".into(),
            Some((begin, end)) if begin > last || end < first => {
                let apart = if begin > last { begin - last } else { first - end };
                format!(
                    "they are stamped {:.3} to {:.3} s, the poses {:.3} to {:.3} s: two clocks that differ, {:.1} s apart at \
                     the least. Set one clock (chrony, or use_sim_time on all nodes or on none) and record again",
                    seconds(first),
                    seconds(last),
                    seconds(begin),
                    seconds(end),
                    seconds(apart)
                )
            }
            Some((begin, end)) => format!(
                "they are stamped {:.3} to {:.3} s, the poses {:.3} to {:.3} s with gaps over a second in which the robot \
                 moves. Record /tf at 10 Hz or more, or choose another pose_topic",
                seconds(first),
                seconds(last),
                seconds(begin),
                seconds(end)
            ),
        }
    }
}

/// Beams that a scan may have: as a job.
fn most_beams(limits: &Limits) -> usize {
    limits.ranges.min(100_000)
}

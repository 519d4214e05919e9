//! A join: several maps, each in a frame of its own, as one.
//!
//! Its request is that of one fit of all their scans, each in the frame it was reported in, and guesses at where the frames
//! lie. A scan that two of the maps share is counted once, and says how their frames lie: they are one. (Scans are the same
//! where all their ranges are, to the last bit: no two measurements are.) Of a map that was joined itself its frames are
//! taken, not the map.

use std::collections::{BTreeMap, HashMap};

use nalgebra::Vector3;

use super::document::Node;
use super::frames::{Joined, Named, ORIGIN};
use super::limits::Limits;
use super::reader::Reader;
use super::request::{Area, JobRequest, MapPart, RequestError, Tiling};
use crate::fit::{Distance, FitOptions, Poses, Weighting};
use crate::geometry::{Cov3, Pose, in_frame, inverse};
use crate::living::{Guess, moved};
use crate::scan::LaserScan;
use crate::spline::{Lattice, LatticeError};

/// Maps that are joined at once at most, and frames.
const MOST_MAPS: usize = 64;
/// How well a frame is guessed where its guess does not say: metres, radians.
const LOOSE: [f64; 3] = [0.5, 0.5, 0.15];
/// A coordinate that a map's request calls exactly known is known this well in a join, whose frames are found by poses:
/// metres and radians.
const EXACT: f64 = 1e-5;
/// Frames nearer than this are one.
const SAME: f64 = 1e-9;

/// A map to be joined.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    pub id: String,
    pub guess: Guess,
}

/// A join's body.
#[derive(Debug, Clone, PartialEq)]
pub struct JoinBody {
    name: Option<String>,
    labels: BTreeMap<String, String>,
    priority: i32,
    pub members: Vec<Member>,
    distance: Option<Distance>,
    resolution: f64,
    area: Area,
    tiling: Tiling,
    options: FitOptions,
    deadline_seconds: Option<f64>,
}

/// Reads a join's body.
pub fn join_body(json: &[u8], limits: &Limits) -> Result<JoinBody, RequestError> {
    let document = Node::parse(json, limits.values)?;
    let mut reader = Reader::new(limits);
    let body = reader.join(&document);
    reader.concluded(body)
}

impl Reader<'_> {
    fn join(&mut self, document: &Node) -> Option<JoinBody> {
        if !matches!(document, Node::Object(_)) {
            return self.fault("", format!("a join is an object, not {}", document.kind()));
        }
        self.known(document, "", &["name", "labels", "maps", "map", "fit", "priority", "deadline_seconds"]);
        let (name, labels, priority, deadline_seconds) = self.about(document);
        let members = self.required(document, "", "maps", Self::members);
        let map = self.required(document, "", "map", |reader, node, at| {
            reader.object(node, at, &["distance", "resolution", "bounds", "margin", "tiling"])?;
            let distance = reader.optional(node, at, "distance", |r, n, p| r.choice(n, p, &["sdf", "vdf"]));
            let spacing = reader.spacing(node, at)?;
            let distance = distance?.map(|name| if name == "vdf" { Distance::Vector } else { Distance::Signed });
            Some((distance, spacing))
        });
        let options = self.optional(document, "", "fit", Self::fit).map(Option::unwrap_or_default);
        if let Some(options) = &options
            && (options.poses == Some(Poses::Fixed) || options.weighting == Weighting::Paper)
        {
            let at = if options.weighting == Weighting::Paper { "/fit/weighting" } else { "/fit/poses" };
            self.fault::<()>(at, "a join finds its frames by its poses: they are refined, and weights calibrated");
        }
        let (distance, (resolution, area, tiling)) = map?;
        Some(JoinBody {
            name: name?,
            labels: labels?.unwrap_or_default(),
            priority: priority?.unwrap_or(0) as i32,
            members: members?,
            distance,
            resolution,
            area,
            tiling,
            options: options?,
            deadline_seconds: deadline_seconds?,
        })
    }

    fn members(&mut self, node: &Node, at: &str) -> Option<Vec<Member>> {
        match node {
            Node::Array(maps) if maps.len() > MOST_MAPS => {
                self.fault(at, format!("{} maps; the limit is {MOST_MAPS}", maps.len()))
            }
            Node::Array(maps) => {
                let read: Vec<Option<Member>> =
                    maps.iter().enumerate().map(|(k, map)| self.member(map, &format!("{at}/{k}"), k == 0)).collect();
                read.into_iter().collect()
            }
            Node::Numbers(none) if none.is_empty() => self.fault(at, "at least one map is needed"),
            other => self.fault(at, format!("must be an array of maps, not {}", other.kind())),
        }
    }

    fn member(&mut self, node: &Node, at: &str, first: bool) -> Option<Member> {
        self.object(node, at, &["id", "pose", "pose_covariance"])?;
        let id = self.required(node, at, "id", Self::text);
        // The first is held: where nobody says, the joined frame is its own.
        let pose = match first {
            true => self.optional(node, at, "pose", Self::pose).map(|pose| pose.unwrap_or(ORIGIN)),
            false => self.required(node, at, "pose", Self::pose),
        };
        let covariance = self.optional(node, at, "pose_covariance", Self::covariance);
        let loose = || Cov3::from_diagonal(&Vector3::from(LOOSE.map(|sigma| sigma * sigma)));
        Some(Member { id: id?, guess: Guess { pose: pose?, covariance: covariance?.unwrap_or_else(loose) } })
    }
}

/// The scans of one frame, in it.
struct Part {
    guess: Guess,
    scans: Vec<LaserScan>,
}

impl JoinBody {
    /// The request of all scans, of the requests that the maps were fitted from, in the members' order.
    pub fn request(self, maps: &[JobRequest], limits: &Limits) -> Result<JobRequest, RequestError> {
        let mut reader = Reader::new(limits);
        let request = self.gathered(maps, &mut reader);
        reader.concluded(request)
    }

    fn gathered(self, maps: &[JobRequest], reader: &mut Reader<'_>) -> Option<JobRequest> {
        let Some(first) = maps.first() else { return reader.fault("/maps", "at least one map is needed") };
        let mut all = Gathering::default();
        for (member, map) in self.members.iter().zip(maps) {
            all.add(member, map);
        }
        let scans: Vec<LaserScan> = all
            .parts
            .iter()
            .enumerate()
            .flat_map(|(frame, part)| {
                part.scans.iter().map(move |scan| LaserScan { frame, ..moved(scan, &part.guess.pose) })
            })
            .collect();
        reader.all_count("/maps", &scans)?;
        let seen = reader.returns(&scans)?;
        let distance = self.distance.unwrap_or(first.distance);
        let map = MapPart { distance, resolution: self.resolution, area: self.area, tiling: self.tiling };
        let lattice = reader.lattice(&scans, &seen, &map)?;
        let guesses = all.parts.iter().map(|part| part.guess).collect();
        reader.within_limits(JobRequest {
            name: self.name,
            labels: self.labels,
            priority: self.priority,
            scans,
            noise: first.noise,
            distance,
            lattice,
            area: self.area,
            tiling: self.tiling,
            parts: None,
            options: self.options,
            joined: Some(Joined { guesses, named: all.named }),
            deadline_seconds: self.deadline_seconds,
        })
    }
}

/// Frames as they are gathered from maps.
#[derive(Default)]
struct Gathering {
    parts: Vec<Part>,
    named: Vec<Named>,
    /// By a scan's fingerprint: its frame, and its pose there.
    known: HashMap<Vec<u64>, (usize, Pose)>,
}

impl Gathering {
    fn add(&mut self, member: &Member, map: &JobRequest) {
        let held = Guess { pose: ORIGIN, covariance: Cov3::zeros() };
        let own = map.joined.as_ref().map_or_else(|| vec![held], |joined| joined.guesses.clone());
        for (frame, guess) in own.iter().enumerate() {
            let back = inverse(&guess.pose);
            let scans: Vec<LaserScan> = map
                .scans
                .iter()
                .filter(|scan| scan.frame == frame)
                .map(|scan| noised(if guess.pose == ORIGIN { scan.clone() } else { moved(scan, &back) }, map))
                .collect();
            let shared = scans.iter().find_map(|scan| {
                let (frame, pose) = self.known.get(&fingerprint(scan))?;
                Some((*frame, in_frame(pose, &inverse(&scan.pose))))
            });
            let (at, offset) = match shared {
                Some((at, offset)) if near_nothing(&offset) => (at, ORIGIN),
                Some(shared) => shared,
                None => {
                    let pose = in_frame(&member.guess.pose, &guess.pose);
                    let covariance = member.guess.covariance + guess.covariance;
                    self.parts.push(Part { guess: Guess { pose, covariance }, scans: Vec::new() });
                    (self.parts.len() - 1, ORIGIN)
                }
            };
            // Counted once across maps; what one map has twice it has twice.
            let mut new = Vec::new();
            for scan in scans {
                let print = fingerprint(&scan);
                if !self.known.contains_key(&print) {
                    let scan = if offset == ORIGIN { scan } else { moved(&scan, &offset) };
                    new.push((print, scan.pose));
                    self.parts[at].scans.push(scan);
                }
            }
            self.known.extend(new.into_iter().map(|(print, pose)| (print, (at, pose))));
            if frame == 0 {
                let offset = in_frame(&offset, &back);
                self.named.push(Named { map_id: member.id.clone(), frame: at, offset });
            }
        }
    }
}

/// A scan with the noise of its own request, of which nothing is exactly known.
fn noised(scan: LaserScan, map: &JobRequest) -> LaserScan {
    let mut scan = scan.with_noise(&map.noise);
    if let Some(covariance) = &mut scan.pose_covariance {
        *covariance += Cov3::identity() * (EXACT * EXACT);
    }
    scan
}

/// What tells a scan from every other: its ranges and bearings.
fn fingerprint(scan: &LaserScan) -> Vec<u64> {
    let beams = [scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max];
    beams.iter().chain(&scan.ranges).map(|value| if value.is_nan() { u64::MAX } else { value.to_bits() }).collect()
}

fn near_nothing(pose: &Pose) -> bool {
    pose.x.abs() < SAME && pose.y.abs() < SAME && pose.theta.abs() < SAME
}

impl JobRequest {
    /// The scans of a join in their frames.
    pub fn scans_in_frames(&self) -> Vec<LaserScan> {
        let Some(joined) = &self.joined else { return self.scans.clone() };
        let back: Vec<Pose> = joined.guesses.iter().map(|guess| inverse(&guess.pose)).collect();
        self.scans.iter().map(|scan| moved(scan, &back[scan.frame])).collect()
    }

    /// The scans of a join where its frames are put.
    pub fn placed_scans(&self, places: &[Pose]) -> Vec<LaserScan> {
        let Some(joined) = &self.joined else { return self.scans.clone() };
        let shift: Vec<Pose> =
            joined.guesses.iter().zip(places).map(|(guess, place)| in_frame(place, &inverse(&guess.pose))).collect();
        self.scans.iter().map(|scan| moved(scan, &shift[scan.frame])).collect()
    }

    /// The request of a join whose frames are put somewhere, with the lattice that this takes.
    pub fn placed(&self, places: &[Pose], limits: &Limits) -> Result<Self, LatticeError> {
        let scans = self.placed_scans(places);
        let lattice = match self.area.bounds {
            Some(_) => self.lattice.clone(),
            None => {
                let returns = crate::scan::returns_of(&scans).into_iter().map(|seen| seen.point);
                let around = returns.chain(scans.iter().map(|scan| scan.pose.position()));
                let bounds = crate::geometry::Bounds::around(around).ok_or(LatticeError::Bounds)?;
                Lattice::covering(&bounds.grown(self.area.margin), self.lattice.resolution, limits.lattice)?
            }
        };
        Ok(Self { scans, lattice, ..self.clone() })
    }
}

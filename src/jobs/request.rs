//! A job request: JSON in, scans and options out, or every fault with a pointer to it.
//!
//! Pointers are RFC 6901. Every size is checked here, before anything of that size is built; a request that passes can
//! be fitted. A member that this version does not know is a fault, so that a client learns of its typing errors.

use std::collections::BTreeMap;

use thiserror::Error;

use super::document::{DocumentError, Node};
use super::frames::Joined;
use super::limits::{Fault, Limits};
use super::reader::{FARTHEST, Reader};
use super::record::{Parts, Progress};
use crate::fit::{self, Distance, Estimate, FitOptions, Footprint, Poses, Weighting};
use crate::geometry::{Bounds, Pose, Vec2};
use crate::map::{self, Cost, FittedMap, Survey, SurveyError};
use crate::scan::{LaserScan, Noise, returns_of};
use crate::sparse::Team;
use crate::spline::{Lattice, LatticeError};

#[derive(Debug, Error)]
pub enum RequestError {
    #[error("{0}")]
    Document(#[from] DocumentError),
    #[error("the request has {} fault(s)", .0.len())]
    Faults(Vec<Fault>),
    #[error("what the store keeps of the request is damaged: {0}")]
    Damaged(&'static str),
}

/// A request that can be fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct JobRequest {
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    pub priority: i32,
    pub scans: Vec<LaserScan>,
    pub noise: Noise,
    pub distance: Distance,
    pub lattice: Lattice,
    /// What the lattice was laid out for.
    pub area: Area,
    /// Whether it may be fitted in parts where it is too large for one.
    pub tiling: Tiling,
    /// In how many parts it is fitted, about; `None` where it is not divided.
    pub parts: Option<usize>,
    pub options: FitOptions,
    /// Of a join: the frames its scans were reported in. The scans stand where the guesses put them.
    pub joined: Option<Joined>,
    /// From submission.
    pub deadline_seconds: Option<f64>,
}

/// What becomes of a map that has more control points in use than one fit may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tiling {
    /// It is fitted in parts.
    #[default]
    Auto,
    /// It is refused.
    None,
}

/// The area a map is to cover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// As asked for; `None`: what the scans met and where they were taken from, and `margin` around it.
    pub bounds: Option<Bounds>,
    /// Metres.
    pub margin: f64,
}

impl JobRequest {
    /// What a request's document may have.
    pub const MEMBERS: [&str; 8] = ["name", "labels", "scans", "noise", "map", "fit", "priority", "deadline_seconds"];

    /// The fit's end, found again; `map` is this request's. `go_on` says whether to go on.
    pub fn resume(&self, map: &FittedMap, go_on: &dyn Fn() -> bool) -> Result<Estimate, SurveyError> {
        if self.joined.is_some() {
            let places: Vec<Pose> = map.frames.iter().map(|frame| frame.put).collect();
            let placed = Self {
                joined: None,
                lattice: map.lattice().clone(),
                scans: self.placed_scans(&places),
                ..self.clone()
            };
            return placed.resume(map, go_on);
        }
        self.survey().resume_while(map, go_on)
    }

    /// The fit that is asked for, by one thread unless others are named: a service has its own for others' requests.
    pub fn survey(&self) -> Survey<'_> {
        let survey = Survey::new(&self.scans, self.noise).distance(self.distance).team(Team::default());
        survey.lattice(self.lattice.clone()).options(self.options)
    }

    /// Where its job stands before it is begun.
    pub fn queued(&self) -> Progress {
        let parts = self.parts.map(|total| Parts { total, done: 0, running: 0 });
        Progress { parts, ..Progress::queued(self.options.max_iterations) }
    }

    /// How large the fit is, and what the map will take; `None` where `goes_on` does not hold any more.
    pub fn cost(&self, goes_on: &dyn Fn() -> bool) -> Option<(Footprint, Cost)> {
        let footprint = fit::footprint(&self.scans, self.distance, &self.lattice, &self.options, goes_on)?;
        Some((footprint, map::cost(self.distance, &footprint)))
    }

    /// What the map takes at most: as if all of the lattice were in use, every beam had a return, and every scan saw all others'
    /// surroundings.
    pub fn most(&self) -> Cost {
        self.most_with((3 * self.scans.len()).pow(2) / 2)
    }

    /// The same with so many entries of the factor between poses.
    fn most_with(&self, pose_entries: usize) -> Cost {
        let returns = self.scans.iter().map(|scan| scan.ranges.len()).sum();
        let (control_points, scans) = (self.lattice.len(), self.scans.len());
        map::cost(self.distance, &Footprint { lattice: control_points, control_points, scans, returns, pose_entries })
    }

    /// The memory that the fit needs, bytes, where that is more than so much. More is found out only where what is known does
    /// not tell: where scans look, then what their beams pass.
    pub fn outgrows(&self, bytes: u64, goes_on: &dyn Fn() -> bool) -> Option<f64> {
        let fits = |cost: Cost| cost.bytes <= bytes as f64;
        let looked = || self.most_with(fit::pose_entries(&self.scans, self.distance, &self.lattice));
        if fits(self.most()) || fits(looked()) {
            return None;
        }
        self.cost(goes_on).map(|(_, cost)| cost.bytes).filter(|need| *need > bytes as f64)
    }

    /// Reads and validates a request.
    pub fn parse(json: &[u8], limits: &Limits) -> Result<Self, RequestError> {
        let document = Node::parse(json, limits.values)?;
        let mut reader = Reader::new(limits);
        let request = reader.request(&document);
        reader.concluded(request)
    }
}

impl Reader<'_> {
    fn request(&mut self, document: &Node) -> Option<JobRequest> {
        let campaign = self.campaign(document, &JobRequest::MEMBERS)?;
        let map = self.required(document, "", "map", Self::map);
        let seen = campaign.scans.as_deref().and_then(|scans| self.returns(scans));
        let lattice = match (&campaign.scans, &seen, &map) {
            (Some(scans), Some(seen), Some(map)) => self.lattice(scans, seen, map),
            _ => None,
        };
        let (scans, noise, lattice, map) = (campaign.scans?, campaign.noise?, lattice?, map?);
        self.within_limits(JobRequest {
            name: campaign.name?,
            labels: campaign.labels?.unwrap_or_default(),
            priority: campaign.priority?.unwrap_or(0) as i32,
            scans,
            noise,
            distance: map.distance,
            lattice,
            area: map.area,
            tiling: map.tiling,
            parts: None,
            options: campaign.options?.unwrap_or_default(),
            joined: None,
            deadline_seconds: campaign.deadline_seconds?,
        })
    }

    /// What all that is fitted has in common; `None` where the document is no object.
    pub(super) fn campaign(&mut self, document: &Node, known: &[&str]) -> Option<Campaign> {
        if !matches!(document, Node::Object(_)) {
            return self.fault("", format!("a job is an object, not {}", document.kind()));
        }
        self.known(document, "", known);
        let (name, labels, priority, deadline_seconds) = self.about(document);
        Some(Campaign {
            name,
            labels,
            priority,
            deadline_seconds,
            scans: self.required(document, "", "scans", Self::scans),
            noise: self.required(document, "", "noise", Self::noise),
            options: self.optional(document, "", "fit", Self::fit),
        })
    }

    /// What was read, or the faults there were.
    pub(super) fn concluded<T>(mut self, read: Option<T>) -> Result<T, RequestError> {
        match read {
            Some(read) if self.faults.is_empty() => Ok(read),
            _ => {
                if self.unlisted > 0 {
                    let detail = format!("{} more faults are not listed", self.unlisted);
                    self.faults.push(Fault { pointer: String::new(), detail });
                }
                Err(RequestError::Faults(self.faults))
            }
        }
    }

    pub(super) fn returns(&mut self, scans: &[LaserScan]) -> Option<Vec<Vec2>> {
        let returns: Vec<Vec2> = returns_of(scans).into_iter().map(|seen| seen.point).collect();
        if returns.is_empty() {
            return self.fault("/scans", "no beam of any scan has a return in [range_min, range_max]");
        }
        Some(returns)
    }

    pub(super) fn lattice(&mut self, scans: &[LaserScan], seen: &[Vec2], map: &MapPart) -> Option<Lattice> {
        let bounds = match map.area.bounds {
            Some(bounds) => bounds,
            None => Bounds::around(seen.iter().copied().chain(scans.iter().map(|scan| scan.pose.position())))?
                .grown(map.area.margin),
        };
        if bounds.min.iter().chain(&bounds.max).any(|v| v.abs() > 4.0 * FARTHEST) {
            return self.fault("/map/bounds", "the map's area is too far from the origin");
        }
        match Lattice::covering(&bounds, map.resolution, self.limits.lattice) {
            Ok(lattice) if seen.iter().any(|p| bounds.contains(*p)) => Some(lattice),
            Ok(_) => self.fault("/map/bounds", "no return of any scan lies inside the bounds"),
            Err(LatticeError::TooLarge { needed, limit }) => {
                self.too_large(&bounds, map.resolution, format!("{needed:.0} control points in all"), limit)
            }
            Err(LatticeError::Bounds) => self.fault("/map/bounds", "the map's area is empty; give a margin or bounds"),
            Err(error @ LatticeError::Resolution(_)) => self.fault("/map/resolution", error.to_string()),
        }
    }

    /// Divides a fit that has more control points in use than one may have, or refuses it. Of a large rectangle most may be
    /// out of sight.
    pub(super) fn within_limits(&mut self, request: JobRequest) -> Option<JobRequest> {
        let limit = self.limits.control_points;
        let JobRequest { scans, distance, lattice, options, .. } = &request;
        if lattice.len() <= limit {
            return Some(request);
        }
        let used = fit::control_points(scans, *distance, lattice, options, limit);
        match request.tiling {
            _ if used.total() <= limit => Some(request),
            Tiling::Auto if used.total() <= self.limits.in_parts => {
                Some(JobRequest { parts: Some(used.branches()), ..request })
            }
            tiling => {
                let limit = if tiling == Tiling::Auto { self.limits.in_parts } else { limit };
                let needed = format!("{} control points in use", used.total());
                self.too_large(&lattice.bounds(), lattice.resolution, needed, limit)
            }
        }
    }

    /// Says so, and the finest resolution that surely fits, to two digits.
    fn too_large<T>(&mut self, bounds: &Bounds, resolution: f64, needed: String, limit: usize) -> Option<T> {
        let fits = |resolution: f64| Lattice::covering(bounds, resolution, self.limits.control_points).is_ok();
        let digit = 10f64.powf(resolution.log10().floor() - 1.0);
        let coarser = std::iter::successors(Some(resolution), |r| Some(r * 1.05)).take(400);
        let finest = coarser.map(|r| (r / digit).ceil() * digit).find(|r| fits(*r));
        let advice = finest.map_or(String::new(), |r| format!("; {} fits", (r * 1e6).round() / 1e6));
        self.fault("/map/resolution", format!("this resolution needs {needed}; the limit is {limit}{advice}"))
    }

    fn map(&mut self, node: &Node, at: &str) -> Option<MapPart> {
        self.object(node, at, &["distance", "resolution", "bounds", "margin", "tiling"])?;
        let distance = self.required(node, at, "distance", |r, n, p| r.choice(n, p, &["sdf", "vdf"]));
        let (resolution, area, tiling) = self.spacing(node, at)?;
        let distance = if distance? == "vdf" { Distance::Vector } else { Distance::Signed };
        Some(MapPart { distance, resolution, area, tiling })
    }

    /// A lattice's spacing, metres, its area, and what becomes of one that is too large.
    pub(super) fn spacing(&mut self, node: &Node, at: &str) -> Option<(f64, Area, Tiling)> {
        let resolution = self.required(node, at, "resolution", |r, n, p| r.positive(n, p, 1e-4, 1e4));
        let bounds = self.optional(node, at, "bounds", Self::bounds);
        let margin = self.optional(node, at, "margin", |r, n, p| r.number(n, p, 0.0, 1e4));
        let tiling = self.optional(node, at, "tiling", |r, n, p| r.choice(n, p, &["auto", "none"]))?;
        let tiling = if tiling == Some("none") { Tiling::None } else { Tiling::Auto };
        let resolution = resolution?;
        Some((resolution, Area { bounds: bounds?, margin: margin?.unwrap_or(3.0 * resolution) }, tiling))
    }

    fn bounds(&mut self, node: &Node, at: &str) -> Option<Bounds> {
        self.object(node, at, &["min", "max"])?;
        let min = self.required(node, at, "min", |r, n, p| r.numbers(n, p, 2));
        let max = self.required(node, at, "max", |r, n, p| r.numbers(n, p, 2));
        let (min, max) = (min?, max?);
        for axis in 0..2 {
            if min[axis] >= max[axis] {
                self.fault::<()>(&format!("{at}/max/{axis}"), "must be greater than min");
            }
        }
        (min[0] < max[0] && min[1] < max[1]).then_some(Bounds { min: [min[0], min[1]], max: [max[0], max[1]] })
    }

    pub(super) fn fit(&mut self, node: &Node, at: &str) -> Option<FitOptions> {
        let names = [
            "weighting",
            "poses",
            "max_iterations",
            "tolerance",
            "eikonal_weight",
            "eikonal_scale",
            "smoothing",
            "model_sigma",
            "band",
        ];
        self.object(node, at, &names)?;
        let weighting = self.optional(node, at, "weighting", |r, n, p| r.choice(n, p, &["paper", "calibrated"]));
        let poses = self.optional(node, at, "poses", |r, n, p| r.choice(n, p, &["fixed", "refined"]));
        let max_iterations = self.optional(node, at, "max_iterations", |r, n, p| r.integer(n, p, 1, 1000));
        let tolerance = self.optional(node, at, "tolerance", |r, n, p| r.positive(n, p, 1e-14, 1.0));
        let mut weight = |name| self.optional(node, at, name, |r, n, p| r.positive(n, p, 1e-9, 1e9));
        let (eikonal_weight, eikonal_scale) = (weight("eikonal_weight"), weight("eikonal_scale"));
        let model_sigma = self.optional(node, at, "model_sigma", |r, n, p| r.number(n, p, 0.0, 1e3));
        let smoothing = self.optional(node, at, "smoothing", |r, n, p| r.number(n, p, 0.0, 1e9));
        let band = self.optional(node, at, "band", |r, n, p| r.number(n, p, 0.0, 1e4));
        let (weighting, poses) = (weighting?, poses?);
        if (weighting, poses) == (Some("paper"), Some("refined")) {
            return self.fault(&format!("{at}/poses"), "the published objective has fixed poses; use calibrated");
        }
        let default = FitOptions::default();
        Some(FitOptions {
            weighting: if weighting == Some("paper") { Weighting::Paper } else { Weighting::Calibrated },
            poses: poses.map(|poses| if poses == "fixed" { Poses::Fixed } else { Poses::Refined }),
            max_iterations: max_iterations?.map_or(default.max_iterations, |n| n as usize),
            tolerance: tolerance?.unwrap_or(default.tolerance),
            eikonal_weight: eikonal_weight?,
            eikonal_scale: eikonal_scale?,
            smoothing: smoothing?,
            model_sigma: model_sigma?,
            band: band?,
        })
    }
}

/// A map as it is asked for.
pub(super) struct MapPart {
    pub distance: Distance,
    pub resolution: f64,
    pub area: Area,
    pub tiling: Tiling,
}

/// What all that is fitted has in common, member by member; what is faulty is `None`.
pub(super) struct Campaign {
    pub name: Option<Option<String>>,
    pub labels: Option<Option<BTreeMap<String, String>>>,
    pub priority: Option<Option<i64>>,
    pub scans: Option<Vec<LaserScan>>,
    pub noise: Option<Noise>,
    pub options: Option<Option<FitOptions>>,
    pub deadline_seconds: Option<Option<f64>>,
}

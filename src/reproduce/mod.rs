//! The method's two experiments again, figure by figure, from simulation.
//!
//! Source: Arukgoda, Ranasinghe, Dantanarayana, Dissanayake, Furukawa, "Representation of Uncertain Occupancy Maps with
//! High Level Feature Vectors", CASE 2019. Its figures 1 to 10 and its two tables, each as a [`Plate`] or a [`Table`],
//! drawn with the published objective where ours differs from it, and with ours beside it; what was published about a
//! figure stands beside what is measured here. The text's room has no printed size; ours is that of
//! [`Scenario::experiment_one`]. Experiment 2 runs in an office of our own making and, where its walls are at hand, in
//! the corridor of Willow Garage.

mod contours;
mod corridor;
mod limit;
mod page;
mod room;
mod tables;
mod truth;

use thiserror::Error;

pub use page::page;
pub use truth::{DistanceJudgement, GridJudgement, Judgement, Truth};

use crate::map::SurveyError;
use crate::render::RenderError;
use crate::sim::{Scenario, Survey};
use crate::sparse::SparseError;
use crate::spline::LatticeError;

/// The draw of the noise that is shown.
const SEED: u64 = 1;
/// Control points of a lattice at most; no experiment comes near.
const LARGEST_LATTICE: usize = 100_000;

/// A figure with its words.
#[derive(Debug, Clone, PartialEq)]
pub struct Plate {
    /// `figure-04`; also the stem of its files.
    pub name: String,
    pub title: String,
    pub caption: String,
    pub svg: String,
    pub compared: Vec<Compared>,
}

/// What was published, and what is measured here.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    pub published: String,
    pub measured: String,
}

/// A table with its words; the first row is the head.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// `table-1`; also the stem of its file.
    pub name: String,
    pub title: String,
    pub rows: Vec<Vec<String>>,
}

/// Everything.
#[derive(Debug, Clone, PartialEq)]
pub struct Reproduction {
    pub tables: Vec<Table>,
    pub plates: Vec<Plate>,
}

#[derive(Debug, Error)]
pub enum ReproduceError {
    #[error(transparent)]
    Survey(#[from] SurveyError),
    #[error(transparent)]
    Sparse(#[from] SparseError),
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Steps of a reproduction without Willow Garage; with it there is one more.
pub const STEPS: usize = 8;

/// Draws everything. `observer` is told what begins.
pub fn reproduce(willow: Option<&Survey>, observer: &mut dyn FnMut(&str)) -> Result<Reproduction, ReproduceError> {
    let scenario = Scenario::experiment_one();
    observer("tables");
    let tables = vec![tables::experiment_one(&scenario), tables::experiment_two()];
    observer("figures 1 to 3: the room and its point cloud");
    let mut plates = vec![room::uncertain_cloud(&scenario), room::room_and_poses(&scenario), room::cloud(&scenario)];
    observer("figure 4: what a spline can hold");
    plates.push(limit::errors_of_direct_splines(&scenario)?);
    observer("figures 5 and 6: contour and signed distance");
    let fits = contours::Fits::of(&scenario)?;
    plates.extend([fits.contour(&scenario)?, fits.distance()?]);
    observer("figure 7: two-sigma bounds, 20 draws");
    plates.push(fits.bounds(&scenario)?);
    observer("figure 8: contours by resolution");
    plates.push(contours::by_resolution(&scenario)?);
    observer("figures 9 and 10: an office");
    let office = Survey::office(crate::scan::Noise::EXPERIMENT_TWO.sigma_range, SEED);
    plates.extend(corridor::cloud_and_grid(&office, "", "an office of our own making")?);
    if let Some(willow) = willow {
        observer("figures 9 and 10: Willow Garage");
        plates.extend(corridor::cloud_and_grid(willow, "-willow", "the Willow Garage corridor")?);
    }
    Ok(Reproduction { tables, plates })
}

fn compared(published: &str, measured: String) -> Compared {
    Compared { published: published.into(), measured }
}

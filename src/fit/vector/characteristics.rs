//! Which way the nearest surface lies: the characteristics along which distance grows.
//!
//! At a collocation point `x` with the nearest surface point `p`, the field is `x - p` and its direction
//! `(x - p) / |x - p|`; close to a surface it is the surface's normal. Which of many noisy points is the nearest one is
//! luck, and turns `x - p`; so the directions from all that are nearly as near are averaged. Where neighbouring points
//! disagree about `p` by more than their own distance lies the cut locus: the field jumps there, no spline can follow,
//! and no direction is given; nor is one inside a wall of which both faces were seen, where the field turns back. There
//! `x - p` itself is a hint at what the field is, lest it be anything.

use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::fit::collocation::gauss;
use crate::fit::surfels::{Surfel, Surfels};
use crate::geometry::{Vec2, turned};
use crate::sparse::Team;
use crate::spline::Lattice;

/// Collocation points along a cell's side, in its local coordinates.
pub(super) fn collocation() -> [f64; 2] {
    [gauss(2)[0].0, gauss(2)[1].0]
}

/// Nearer to a surface than this many cells its normal is the direction.
const NORMAL_WITHIN: f64 = 0.75;
/// So many of the nearest surfels are asked; one that is this many cells farther than the nearest counts 1/e.
const TIES: usize = 24;
const TIE: f64 = 0.2;
/// Directions with at least this cosine between them are averaged.
const ALIKE: f64 = 0.8;
/// Nearer to a surface's end than this many cells there is no direction away from it.
const SHORTEST: f64 = 0.05;
/// Neighbouring collocation points whose nearest surface points are farther apart than this many times their own
/// distance, plus this many cells, have the cut locus between them.
const JUMP: f64 = 1.5;
const SLACK: f64 = 0.5;
/// Between two faces of one wall, farther apart than the one and nearer than the other of these many cells, the field
/// turns back: no direction holds there.
const THICK: [f64; 2] = [0.1, 2.0];
/// Faces whose normals' cosine is below this are opposite ones.
const OPPOSITE: f64 = -0.8;
/// Neighbours are looked at this many collocation points away.
const WINDOW: isize = 3;

/// What is known of the field at a collocation point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Course {
    /// The unit vector along which it grows.
    Along(Vec2),
    /// About what it is, where it jumps or turns back.
    About(Vec2),
}

/// The field's course at the collocation points of every cell; `None` outside the active cells.
pub struct Characteristics {
    courses: Vec<Option<Course>>,
    /// The share of the active collocation points that lie on the cut locus.
    pub left_out: f64,
}

struct Foot {
    place: Vec2,
    point: Vec2,
    /// `None` inside a wall.
    direction: Option<Vec2>,
}

impl Characteristics {
    /// `cells` marks the cells in which directions are asked for, x fastest.
    pub fn trace(lattice: &Lattice, surfels: &Surfels, cells: &[bool], team: &Team) -> Self {
        let anchors = surfels.all.iter().enumerate().map(|(k, s)| GeomWithData::new(s.anchor.into(), k)).collect();
        let tree: RTree<GeomWithData<[f64; 2], usize>> = RTree::bulk_load(anchors);
        let [nx, ny] = lattice.cells;
        // The collocation points as one grid, 2 nx x 2 ny.
        let (width, along) = (2 * nx, collocation());
        let foot_of = |k: usize| {
            let cell = [k % width / 2, k / width / 2];
            let local = [along[k % width % 2], along[k / width % 2]];
            cells[lattice.cell_index(cell)]
                .then(|| foot(lattice.point(cell, local), surfels, &tree, lattice.resolution))?
        };
        let row = |j: usize| (j * width..(j + 1) * width).map(foot_of).collect::<Vec<_>>();
        let feet: Vec<Option<Foot>> = team.each((0..2 * ny).collect(), row).into_iter().flatten().collect();
        let smooth = |k: usize, own: &Foot| {
            let (i, j) = ((k % width) as isize, (k / width) as isize);
            (-WINDOW..=WINDOW).flat_map(|dj| (-WINDOW..=WINDOW).map(move |di| (i + di, j + dj))).all(|(i, j)| {
                let inside = (0..width as isize).contains(&i) && (0..2 * ny as isize).contains(&j);
                let other = if inside { feet[i as usize + j as usize * width].as_ref() } else { None };
                other.filter(|other| other.direction.is_some()).is_none_or(|other| {
                    let allowed = JUMP * (other.place - own.place).norm() + SLACK * lattice.resolution;
                    (other.point - own.point).norm() <= allowed
                })
            })
        };
        let course = |(k, foot): (usize, &Option<Foot>)| {
            let own = foot.as_ref()?;
            let along = own.direction.filter(|_| smooth(k, own)).map(Course::Along);
            Some(along.unwrap_or(Course::About(own.place - own.point)))
        };
        let courses: Vec<Option<Course>> = feet.iter().enumerate().map(course).collect();
        let along = courses.iter().filter(|course| matches!(course, Some(Course::Along(_)))).count();
        let left_out = 1.0 - along as f64 / feet.iter().flatten().count().max(1) as f64;
        Self { courses, left_out }
    }

    /// The course at collocation point `(a, b)` of a cell.
    pub fn at(&self, lattice: &Lattice, cell: [usize; 2], a: usize, b: usize) -> Option<Course> {
        self.courses[2 * cell[0] + a + (2 * cell[1] + b) * 2 * lattice.cells[0]]
    }
}

fn foot(x: Vec2, surfels: &Surfels, tree: &RTree<GeomWithData<[f64; 2], usize>>, h: f64) -> Option<Foot> {
    let near: Vec<&Surfel> = tree.nearest_neighbor_iter(x.into()).take(TIES).map(|at| &surfels.all[at.data]).collect();
    let (nearest, others) = near.split_first()?;
    let (point, own) = (nearest_point(nearest, x).0, direction(nearest, x, h));
    if others.iter().any(|other| between_faces(nearest, other, x, h)) {
        return Some(Foot { place: x, point, direction: None });
    }
    let distance = (x - point).norm();
    let sum = others.iter().fold(own, |sum, other| {
        let (farther, way) = ((x - nearest_point(other, x).0).norm() - distance, direction(other, x, h));
        if way.dot(&own) > ALIKE { sum + way * (-farther.max(0.0) / (TIE * h)).exp() } else { sum }
    });
    Some(Foot { place: x, point, direction: Some(sum.normalize()) })
}

/// Whether `x` lies inside a wall of which both faces were seen: behind either, as the scanners saw them.
fn between_faces(one: &Surfel, other: &Surfel, x: Vec2, h: f64) -> bool {
    let [near, far] = [one, other].map(|face| nearest_point(face, x).0);
    let thickness = one.normal.dot(&(far - near)) / h;
    one.normal.dot(&other.normal) < OPPOSITE
        && (THICK[0]..THICK[1]).contains(&thickness)
        && one.normal.dot(&(x - near)) > 0.0
        && other.normal.dot(&(x - far)) > 0.0
}

/// The direction from a surfel to `x`.
fn direction(surfel: &Surfel, x: Vec2, h: f64) -> Vec2 {
    let (point, ends) = nearest_point(surfel, x);
    let least = if ends { SHORTEST } else { NORMAL_WITHIN };
    let normal = surfel.normal * surfel.normal.dot(&(x - point)).signum();
    (x - point).try_normalize(least * h).unwrap_or(normal)
}

/// The point of a surfel nearest to `x`, and whether that is an end of its surface.
fn nearest_point(surfel: &Surfel, x: Vec2) -> (Vec2, bool) {
    let tangent = turned(surfel.normal);
    let wished = tangent.dot(&(x - surfel.anchor));
    let along = wished.clamp(-surfel.reach[0], surfel.reach[1]);
    let ends = (wished < along && !surfel.goes_on[0]) || (wished > along && !surfel.goes_on[1]);
    (surfel.anchor + tangent * along, ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::vector::tests::corridor;
    use crate::geometry::Bounds;

    #[test]
    fn a_corridor_is_crossed_straight_and_its_middle_left_out() {
        let (_, surfels) = corridor(&[]);
        let lattice = Lattice::covering(&Bounds { min: [2.0, 0.0], max: [6.0, 2.0] }, 0.25, 10_000).unwrap();
        let traced = Characteristics::trace(&lattice, &surfels, &vec![true; lattice.cell_count()], &Team::default());
        let mut straight = 0;
        for (i, j) in (0..lattice.cells[0]).flat_map(|i| (0..lattice.cells[1]).map(move |j| (i, j))) {
            let y = lattice.point([i, j], [0.5, collocation()[0]]).y;
            match traced.at(&lattice, [i, j], 0, 0) {
                Some(Course::Along(direction)) if (y - 1.0).abs() > 0.3 => {
                    straight += usize::from(direction.y.abs() > 0.99)
                }
                Some(Course::Along(_)) => assert!((y - 1.0).abs() > 0.1, "the field jumps at {y}"),
                Some(Course::About(_)) => assert!((y - 1.0).abs() < 0.6, "nothing jumps at {y}"),
                None => panic!("an active cell without a course"),
            }
        }
        assert!(straight > 50 && traced.left_out > 0.2 && traced.left_out < 0.7);
    }
}

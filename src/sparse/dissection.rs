//! Geometric nested dissection of a grid (George 1973), with poses.
//!
//! The grid is halved along its longer side by a separator as wide as the stencil reaches (3), the halves are ordered
//! first and the separator last, and so on down. A factor then fills in O(n log n) entries where a banded order
//! would need O(n^1.5); measured on this stencil it is 2.5 times faster than AMD at 160 k control points.
//!
//! A pose is coupled to every control point its scan saw. It goes down into a half as long as it touches nothing in the
//! other one, and is ordered last in the part where it stays: after every point it touches there, and beside the
//! separators it touches above. So no pose fills in more than its own view does, and whatever sees one point is coupled
//! in the factor.
//!
//! What is not in use comes before everything: it is coupled to nothing, and between two points of a separator it would
//! keep them out of one supernode, whose dense columns are what makes a factorisation fast.
//!
//! A *branch* is a part that holds its share of the points in use: what lies in it is eliminated without the rest of the
//! grid, by whichever thread has time. [`Census`] says how large a branch may be; that depends on the grid alone, so that
//! the same numbers are added in the same order however many threads there are.
//!
//! Poses that stay in one part are all coupled with each other. Where that would take more than coupling all that each of
//! them sees, and then all points of the part, they are a crowd: the part's poses come first, and its points follow as they
//! stand. So thousands of scans from one room cost what the room's points do.

use std::ops::Range;

/// Grid rows that separate two halves: the reach of the stencil.
const SEPARATOR: usize = 3;
/// A part no longer than this in either direction is ordered as it stands.
const LEAF: usize = 8;

/// What is eliminated at a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A grid point, x fastest.
    Point(usize),
    Pose(usize),
}

/// A rectangle of grid points.
#[derive(Clone, Copy)]
struct Part {
    first: [usize; 2],
    size: [usize; 2],
}

impl Part {
    fn holds(&self, point: [usize; 2]) -> bool {
        (0..2).all(|axis| point[axis].wrapping_sub(self.first[axis]) < self.size[axis])
    }

    /// This part's piece along an axis.
    fn piece(&self, axis: usize, start: usize, extent: usize) -> Self {
        let (mut first, mut size) = (self.first, self.size);
        first[axis] += start;
        size[axis] = extent;
        Self { first, size }
    }

    /// Its halves, and what separates them; `None` where it is ordered as it stands.
    fn halves(&self) -> Option<([Self; 2], Self)> {
        let axis = usize::from(self.size[1] > self.size[0]);
        let extent = self.size[axis];
        (extent > LEAF).then(|| {
            let lower = (extent - SEPARATOR) / 2;
            let upper = lower + SEPARATOR;
            let halves = [self.piece(axis, 0, lower), self.piece(axis, upper, extent - upper)];
            (halves, self.piece(axis, lower, SEPARATOR))
        })
    }

    fn points(self) -> impl Iterator<Item = [usize; 2]> {
        let columns = self.first[0]..self.first[0] + self.size[0];
        let rows = self.first[1]..self.first[1] + self.size[1];
        rows.flat_map(move |j| columns.clone().map(move |i| [i, j]))
    }
}

/// Unknowns of a pose.
const POSE: usize = 3;
/// What a multiply-add costs in a supernode as narrow as a pose, beside one in a wide one: its time is the memory's.
const NARROW: f64 = 10.0;

/// A branch holds at most this share of all points in use, and no more of them than a thread should hold at once; what
/// is smaller is not worth a thread.
const BRANCHES: usize = 8;
const LARGEST_BRANCH: usize = 50_000;
const SMALLEST_BRANCH: usize = 100;

/// How many points are in use in any rectangle of a grid.
pub struct Census {
    size: [usize; 2],
    /// Of the points before this one along both axes; a row and a column more than the grid has.
    sums: Vec<usize>,
}

impl Census {
    pub fn of(size: [usize; 2], in_use: impl Fn(usize) -> bool) -> Self {
        let row = size[0] + 1;
        let mut sums = vec![0; row * (size[1] + 1)];
        for (i, j) in (0..size[1]).flat_map(|j| (0..size[0]).map(move |i| (i, j))) {
            let own = usize::from(in_use(i + j * size[0]));
            let at = (i + 1) + (j + 1) * row;
            sums[at] = own + sums[at - 1] + sums[at - row] - sums[at - row - 1];
        }
        Self { size, sums }
    }

    /// All points in use.
    pub fn total(&self) -> usize {
        self.count(&Part { first: [0, 0], size: self.size })
    }

    /// How many branches hold points in use, as long as no crowd of poses keeps some of them together.
    pub fn branches(&self) -> usize {
        let mut open = vec![Part { first: [0, 0], size: self.size }];
        let mut branches = 0;
        while let Some(part) = open.pop() {
            match part.halves().filter(|_| !self.is_branch(&part)) {
                Some((halves, _)) => open.extend(halves),
                None => branches += usize::from(self.count(&part) > 0),
            }
        }
        branches
    }

    fn is_branch(&self, part: &Part) -> bool {
        self.count(part) <= (self.total() / BRANCHES).clamp(SMALLEST_BRANCH, LARGEST_BRANCH)
    }

    fn count(&self, part: &Part) -> usize {
        let sum = |i: usize, j: usize| self.sums[i + j * (self.size[0] + 1)];
        let ([i, j], [width, height]) = (part.first, part.size);
        sum(i + width, j + height) + sum(i, j) - sum(i + width, j) - sum(i, j + height)
    }
}

/// What is eliminated when, and together.
pub struct Order {
    pub steps: Vec<Step>,
    /// Ranges of steps that do without those outside; ascending.
    pub branches: Vec<Range<usize>>,
}

/// An elimination order for the points of a census, with so many unknowns a point, and the poses that see the points in
/// `views`.
pub fn order(census: &Census, components: usize, views: &[&[usize]]) -> Order {
    let row = census.size[0];
    let place = |point: &usize| [point % row, point / row];
    let poses = views.iter().map(|view| view.iter().map(place).collect()).enumerate().collect();
    let Dissection { order, branches, .. } = Dissection::of(census.size, components, poses, Some(census));
    Order { steps: order, branches }
}

/// About how many entries the factor has because of poses: between those that stay in one part. `corners` are those of
/// the rectangles of points that each pose sees.
pub fn entries_of_poses(size: [usize; 2], components: usize, corners: impl Iterator<Item = [[usize; 2]; 4]>) -> f64 {
    let poses = corners.map(|corners| corners.to_vec()).enumerate().collect();
    Dissection::of(size, components, poses, None).entries_of_poses
}

type View = (usize, Vec<[usize; 2]>);

struct Dissection<'a> {
    row: usize,
    components: usize,
    order: Vec<Step>,
    entries_of_poses: f64,
    census: Option<&'a Census>,
    branches: Vec<Range<usize>>,
}

impl<'a> Dissection<'a> {
    fn of(size: [usize; 2], components: usize, poses: Vec<View>, census: Option<&'a Census>) -> Self {
        let (order, branches, entries_of_poses) = (Vec::new(), Vec::new(), 0.0);
        let mut all = Self { row: size[0], components, order, entries_of_poses, census, branches };
        let whole = Part { first: [0, 0], size };
        all.order = whole.points().filter(|point| !all.is_in_use(*point)).map(|point| all.step(point)).collect();
        let begin = all.order.len();
        all.dissect(whole, poses, false);
        // Whoever has the first branch has what is not in use, too.
        all.branches.iter_mut().take(1).filter(|first| first.start == begin).for_each(|first| first.start = 0);
        all
    }

    /// `inside`: the part lies in a branch.
    fn dissect(&mut self, part: Part, poses: Vec<View>, inside: bool) {
        let first = self.order.len();
        let begins = !inside && self.census.is_some_and(|census| census.is_branch(&part));
        let divided = self.divide(part, poses, inside || begins);
        let holds_some = || self.census.is_some_and(|census| census.count(&part) > 0);
        if (begins || !(inside || divided)) && holds_some() {
            self.branches.push(first..self.order.len());
        }
    }

    /// Whether the part was divided, or ordered as it stands.
    fn divide(&mut self, part: Part, poses: Vec<View>, inside: bool) -> bool {
        let Some((halves, separator)) = part.halves() else {
            self.end(part, poses);
            return false;
        };
        let (mut below, mut here): ([Vec<View>; 2], Vec<View>) = Default::default();
        for (pose, view) in poses {
            match halves.map(|half| view.iter().any(|point| half.holds(*point))) {
                [true, false] => below[0].push(within(halves[0], pose, view)),
                [false, true] => below[1].push(within(halves[1], pose, view)),
                _ => here.push((pose, view)),
            }
        }
        if self.is_crowd(&here, below.iter().flatten(), part) {
            self.end(part, below.into_iter().chain([here]).flatten().collect());
            return false;
        }
        for (half, own) in halves.into_iter().zip(below) {
            self.dissect(half, own, inside);
        }
        self.points_of(separator);
        self.last(here);
        true
    }

    /// Whether coupling the poses that would come last takes more than coupling what each of the part's poses sees, and
    /// then all of the part's points, in multiply-adds.
    fn is_crowd<'v>(&self, last: &[View], others: impl Iterator<Item = &'v View>, part: Part) -> bool {
        let unknowns = (self.components * part.size[0] * part.size[1]) as f64;
        let seen = |own: &View| ((self.components * extent(own)) as f64).powi(2);
        let first =
            NARROW * (others.map(seen).sum::<f64>() + last.iter().map(seen).sum::<f64>()) + unknowns.powi(3) / 3.0;
        ((POSE * last.len()) as f64).powi(3) / 3.0 > first
    }

    /// A part that is not divided further.
    fn end(&mut self, part: Part, poses: Vec<View>) {
        if self.is_crowd(&poses, std::iter::empty(), part) {
            self.entries_of_poses += 0.5 * ((self.components * part.size[0] * part.size[1]) as f64).powi(2);
            self.order.extend(poses.into_iter().map(|(pose, _)| Step::Pose(pose)));
            self.points_of(part);
        } else {
            self.points_of(part);
            self.last(poses);
        }
    }

    /// The points of a part that are in use, as they stand.
    fn points_of(&mut self, part: Part) {
        let points = part.points().filter(|point| self.is_in_use(*point)).map(|point| self.step(point));
        let own: Vec<Step> = points.collect();
        self.order.extend(own);
    }

    fn is_in_use(&self, point: [usize; 2]) -> bool {
        self.census.is_none_or(|census| census.count(&Part { first: point, size: [1, 1] }) > 0)
    }

    fn step(&self, [i, j]: [usize; 2]) -> Step {
        Step::Point(i + j * self.row)
    }

    fn last(&mut self, poses: Vec<View>) {
        self.entries_of_poses += 0.5 * ((POSE * poses.len()) as f64).powi(2);
        self.order.extend(poses.into_iter().map(|(pose, _)| Step::Pose(pose)));
    }
}

/// The points of the rectangle around what a pose sees.
fn extent((_, view): &View) -> usize {
    let span = |axis: usize| {
        let (low, high) = view.iter().fold((usize::MAX, 0), |(low, high), at| (low.min(at[axis]), high.max(at[axis])));
        (high + 1).saturating_sub(low)
    };
    span(0) * span(1)
}

/// What a pose sees of a part.
fn within(part: Part, pose: usize, mut view: Vec<[usize; 2]>) -> View {
    view.retain(|point| part.holds(*point));
    (pose, view)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_grid_point_and_pose_is_eliminated_once() {
        for size in [[4, 4], [49, 49], [200, 7], [9, 31]] {
            let n = size[0] * size[1];
            let views: Vec<Vec<usize>> = (0..5).map(|k| (0..n).skip(k).step_by(3 + k).take(20).collect()).collect();
            let views: Vec<&[usize]> = views.iter().map(Vec::as_slice).collect();
            let order = order(&Census::of(size, |_| true), 1, &views).steps;
            let mut points: Vec<usize> =
                order.iter().filter_map(|s| if let Step::Point(p) = s { Some(*p) } else { None }).collect();
            points.sort_unstable();
            assert!(points.iter().copied().eq(0..n), "{size:?}");
            assert!((0..5).all(|pose| order.iter().filter(|s| **s == Step::Pose(pose)).count() == 1));
        }
    }

    #[test]
    fn a_crowd_of_poses_comes_before_all_it_sees() {
        let size = [20, 20];
        let views: Vec<Vec<usize>> = (0..500).map(|k| vec![(7 * k) % 399, (7 * k) % 399 + 1]).collect();
        let views: Vec<&[usize]> = views.iter().map(Vec::as_slice).collect();
        for (count, crowd) in [(500, true), (5, false)] {
            let order = order(&Census::of(size, |_| true), 1, &views[..count]).steps;
            let at = |step: Step| order.iter().position(|s| *s == step).unwrap();
            let first = (0..count).filter(|&pose| at(Step::Pose(pose)) < at(Step::Point(views[pose][0]))).count();
            assert!(if crowd { first > 300 } else { first == 0 }, "{first} of {count}");
            assert_eq!(order.len(), 400 + count);
        }
    }

    #[test]
    fn poses_cost_what_those_that_stay_together_couple_but_never_more_than_their_part() {
        let box_of = |first: usize, last: usize| [[first, first], [last, first], [first, last], [last, last]];
        let few = entries_of_poses([40, 40], 1, (0..4).map(|_| box_of(2, 30)));
        assert_eq!(few, 0.5 * 12f64.powi(2));
        let crowd = entries_of_poses([8, 8], 2, (0..10_000).map(|_| box_of(0, 7)));
        assert_eq!(crowd, 0.5 * 128f64.powi(2));
    }

    #[test]
    fn a_pose_comes_after_all_it_sees() {
        let size = [40, 30];
        let view: Vec<usize> = (3..9).flat_map(|j| (4..12).map(move |i| i + j * 40)).collect();
        let order = order(&Census::of(size, |_| true), 1, &[&view]).steps;
        let at = |step: Step| order.iter().position(|s| *s == step).unwrap();
        let pose = at(Step::Pose(0));
        // It stays where it is seen: far from the end.
        assert!(pose < 700);
        let later = view.iter().filter(|&&p| at(Step::Point(p)) > pose).count();
        assert!(later < view.len() / 2, "{later} separators' points follow");
    }

    #[test]
    fn branches_hold_their_share_and_are_as_many_as_the_census_says() {
        // A corridor around an empty court.
        let (size, court) = ([120, 90], 20..70);
        let census = Census::of(size, |p| !(court.contains(&(p % 120)) && court.contains(&(p / 120))));
        assert_eq!(census.total(), 120 * 90 - 50 * 50);
        let order = order(&census, 2, &[]);
        let points = |range: &Range<usize>| -> Vec<usize> {
            let all =
                order.steps[range.clone()].iter().filter_map(|s| if let Step::Point(p) = s { Some(*p) } else { None });
            all.filter(|p| !(court.contains(&(p % 120)) && court.contains(&(p / 120)))).collect()
        };
        let held = |range: &Range<usize>| points(range).len();
        assert!(order.branches.windows(2).all(|pair| pair[0].end <= pair[1].start));
        // What is not in use comes first, and between nothing that is.
        let unused =
            |s: &&Step| matches!(s, Step::Point(p) if court.contains(&(p % 120)) && court.contains(&(p / 120)));
        assert_eq!(order.steps.iter().take_while(unused).count(), 50 * 50);
        assert!(order.branches.iter().all(|range| held(range) <= census.total() / BRANCHES));
        let many = order.branches.iter().filter(|range| held(range) > 0).count();
        assert_eq!(many, census.branches());
        assert!((BRANCHES..4 * BRANCHES).contains(&many), "{many}");
        // Nothing in one branch is within the stencil's reach of another's.
        let mut owner = vec![None; 120 * 90];
        for (k, range) in order.branches.iter().enumerate() {
            points(range).into_iter().for_each(|p| owner[p] = Some(k));
        }
        for (p, q) in (0..90).flat_map(|j| (0..117).map(move |i| (i + 120 * j, i + 3 + 120 * j))) {
            assert!(owner[p].is_none() || owner[q].is_none() || owner[p] == owner[q]);
        }
    }
}

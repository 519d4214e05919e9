//! The pattern of a whole system: control points of one or two components, and poses.
//!
//! Unknowns are numbered component by component, `k n + p` for control point `p` of component `k`, then three a pose,
//! `K n + 3 s + a`. Coupled are control points that share a cell, of all components; each pose with the control points
//! in its [`Views`]; and a pose's three unknowns with each other. As faer reads it: the lower triangle in CSC, with an
//! elimination order from [`dissection`](super::dissection).

use std::ops::Range;
use std::sync::Arc;

use faer::sparse::SymbolicSparseColMatRef;

use super::dissection::{Census, Step, order};
use super::error::{LARGEST_CLIQUE, SparseError};
use super::stencil::Stencil;

/// Entries between poses and control points at most.
const LARGEST_COUPLING: usize = 40_000_000;

/// Which control points each pose is coupled to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Views {
    starts: Vec<usize>,
    points: Vec<usize>,
}

impl Views {
    /// Views of so many poses, from (pose, control point) pairs in any order.
    pub fn of(poses: usize, pairs: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let mut own: Vec<Vec<usize>> = vec![Vec::new(); poses];
        pairs.into_iter().for_each(|(pose, point)| own[pose].push(point));
        let mut views = Self { starts: vec![0], points: Vec::new() };
        for mut view in own {
            view.sort_unstable();
            view.dedup();
            views.points.extend(view);
            views.starts.push(views.points.len());
        }
        views
    }

    pub fn poses(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The number of (pose, control point) pairs.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Where a pose's pairs lie among all.
    pub fn span(&self, pose: usize) -> std::ops::Range<usize> {
        self.starts[pose]..self.starts[pose + 1]
    }

    /// A pose's control points, ascending.
    pub fn view(&self, pose: usize) -> &[usize] {
        &self.points[self.span(pose)]
    }

    /// Where the pair of a pose and a control point lies among all.
    #[inline]
    pub fn position(&self, pose: usize, point: usize) -> Option<usize> {
        self.view(pose).binary_search(&point).ok().map(|at| self.starts[pose] + at)
    }

    /// Refuses views that would couple more than a system of so many components should hold; before a pattern is made.
    pub fn check_size(&self, components: usize) -> Result<(), SparseError> {
        let entries = 3 * components * self.len();
        if entries > LARGEST_COUPLING {
            return Err(SparseError::TooLarge { entries, limit: LARGEST_COUPLING });
        }
        // All poses that see one control point are coupled in the factor.
        let mut seen_by = vec![0usize; self.points.iter().max().map_or(0, |last| last + 1)];
        self.points.iter().for_each(|&point| seen_by[point] += 1);
        let most = seen_by.into_iter().max().unwrap_or(0);
        let clique = (3 * most).saturating_mul(3 * most) / 2;
        match clique > LARGEST_CLIQUE {
            true => Err(SparseError::TooLarge { entries: clique, limit: LARGEST_CLIQUE }),
            false => Ok(()),
        }
    }

    /// Every pair as (pose, control point).
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.poses()).flat_map(|pose| self.view(pose).iter().map(move |&point| (pose, point)))
    }
}

/// See the module.
#[derive(Debug)]
pub struct Pattern {
    stencil: Arc<Stencil>,
    components: usize,
    views: Views,
    column_starts: Vec<usize>,
    rows: Vec<usize>,
    /// For each stored entry, where its value lies among the parts of a matrix; see [`super::SystemMatrix`].
    sources: Vec<usize>,
    /// The unknown eliminated at each step.
    order: Vec<usize>,
    /// Ranges of steps that are eliminated without the rest; see [`super::dissection`].
    branches: Vec<Range<usize>>,
}

impl Pattern {
    /// The pattern of one component without poses.
    pub fn of_stencil(stencil: &Arc<Stencil>) -> Arc<Self> {
        Self::new(stencil.clone(), 1, Views::of(0, []))
    }

    /// The pattern of `components` (1 or 2) on a stencil, and of poses with their views.
    pub fn new(stencil: Arc<Stencil>, components: usize, views: Views) -> Arc<Self> {
        let mut pattern = Self {
            column_starts: vec![0],
            rows: Vec::new(),
            sources: Vec::new(),
            order: Vec::new(),
            branches: Vec::new(),
            stencil,
            components,
            views,
        };
        pattern.fill();
        (pattern.order, pattern.branches) = pattern.elimination_order();
        Arc::new(pattern)
    }

    /// The pattern with room for these views: this one where it has it, so that its analysis stands, else one in which
    /// what was seen before keeps its place.
    pub fn with_room_for(self: &Arc<Self>, stencil: &Arc<Stencil>, components: usize, views: Views) -> Arc<Self> {
        let alike =
            self.components == components && Arc::ptr_eq(&self.stencil, stencil) && self.views.poses() == views.poses();
        if !alike {
            return Self::new(stencil.clone(), components, views);
        }
        if views.pairs().all(|(pose, point)| self.views.position(pose, point).is_some()) {
            return self.clone();
        }
        let all = Views::of(views.poses(), self.views.pairs().chain(views.pairs()));
        Self::new(stencil.clone(), components, all)
    }

    pub fn stencil(&self) -> &Arc<Stencil> {
        &self.stencil
    }

    pub fn components(&self) -> usize {
        self.components
    }

    pub fn views(&self) -> &Views {
        &self.views
    }

    /// The number of coefficients: control points x components.
    pub fn coefficients(&self) -> usize {
        self.components * self.stencil.dimension()
    }

    /// The number of unknowns.
    pub fn dimension(&self) -> usize {
        self.coefficients() + 3 * self.views.poses()
    }

    /// Every stored entry as (row, column, place among a matrix's parts).
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        (0..self.dimension()).flat_map(move |column| {
            let span = self.column_starts[column]..self.column_starts[column + 1];
            span.map(move |at| (self.rows[at], column, self.sources[at]))
        })
    }

    /// The stored entries of a column, as rows and places among a matrix's parts.
    pub(super) fn column(&self, column: usize) -> (&[usize], &[usize]) {
        let span = self.column_starts[column]..self.column_starts[column + 1];
        (&self.rows[span.clone()], &self.sources[span])
    }

    pub(super) fn sources(&self) -> &[usize] {
        &self.sources
    }

    pub(super) fn order(&self) -> &[usize] {
        &self.order
    }

    pub(super) fn branches(&self) -> &[Range<usize>] {
        &self.branches
    }

    /// The number of values in a matrix's parts: blocks of the stencil (one, or four for two components), three a pair
    /// of the views and component, nine a pose.
    pub(super) fn parts(&self) -> PartStarts {
        let blocks = self.components * self.components;
        let coupling = blocks * self.stencil.len();
        let poses = coupling + 3 * self.components * self.views.len();
        PartStarts { coupling, poses, end: poses + 9 * self.views.poses() }
    }

    pub(super) fn symbolic(&self) -> SymbolicSparseColMatRef<'_, usize> {
        let n = self.dimension();
        SymbolicSparseColMatRef::new_checked(n, n, &self.column_starts, None, &self.rows)
    }

    fn fill(&mut self) {
        let (n, poses, starts) = (self.stencil.dimension(), self.views.poses(), self.parts());
        let mut seen_by: Vec<Vec<(usize, usize)>> = vec![Vec::new(); n];
        for (at, (pose, point)) in self.views.pairs().enumerate() {
            seen_by[point].push((pose, at));
        }
        // Upper neighbours of each control point, for the block between components.
        let mut above: Vec<Vec<(usize, usize)>> = vec![Vec::new(); if self.components == 2 { n } else { 0 }];
        if self.components == 2 {
            for (at, (row, column)) in self.stencil.entries().enumerate().filter(|(_, (row, column))| row != column) {
                above[row].push((column, at));
            }
        }
        let stencil = self.stencil.clone();
        for (component, point) in (0..self.components).flat_map(|k| (0..n).map(move |p| (k, p))) {
            let own = component * 3 * stencil.len();
            for at in stencil.column(point) {
                self.push(component * n + stencil.row(at), own + at);
            }
            if component == 0 && self.components == 2 {
                // (y of p, x of q): part 2 holds it for p at or after q, part 1 for p before.
                for &(before, at) in &above[point] {
                    self.push(n + before, stencil.len() + at);
                }
                for at in stencil.column(point) {
                    self.push(n + stencil.row(at), 2 * stencil.len() + at);
                }
            }
            for &(pose, at) in &seen_by[point] {
                let first = starts.coupling + 3 * (component * self.views.len() + at);
                (0..3).for_each(|a| self.push(self.components * n + 3 * pose + a, first + a));
            }
            self.column_starts.push(self.rows.len());
        }
        for (pose, a) in (0..poses).flat_map(|pose| (0..3).map(move |a| (pose, a))) {
            for b in a..3 {
                self.push(self.components * n + 3 * pose + b, starts.poses + 9 * pose + 3 * b + a);
            }
            self.column_starts.push(self.rows.len());
        }
    }

    fn push(&mut self, row: usize, source: usize) {
        self.rows.push(row);
        self.sources.push(source);
    }

    fn elimination_order(&self) -> (Vec<usize>, Vec<Range<usize>>) {
        let (n, first_pose) = (self.stencil.dimension(), self.coefficients());
        let views: Vec<&[usize]> = (0..self.views.poses()).map(|pose| self.views.view(pose)).collect();
        let census = Census::of(self.stencil.size(), |point| self.stencil.is_active(point));
        let by_points = order(&census, self.components, &views);
        let (mut unknowns, mut starts) = (Vec::with_capacity(self.dimension()), Vec::new());
        for step in by_points.steps {
            starts.push(unknowns.len());
            match step {
                Step::Point(point) => unknowns.extend((point..self.coefficients()).step_by(n)),
                Step::Pose(pose) => unknowns.extend(first_pose + 3 * pose..first_pose + 3 * pose + 3),
            }
        }
        starts.push(unknowns.len());
        let branches = by_points.branches.into_iter().map(|range| starts[range.start]..starts[range.end]);
        (unknowns, branches.collect())
    }
}

/// Where a matrix's parts begin in its values; the stencil's blocks come first.
pub(super) struct PartStarts {
    pub coupling: usize,
    pub poses: usize,
    pub end: usize,
}

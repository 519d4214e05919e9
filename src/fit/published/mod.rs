//! The published vector objective: the scalar Eikonal equation on `|V|`, and `V.V = 0` at returns.
//!
//! ```text
//! f(V) = sum over quadrature points  rho_e (|g|^2 - 1)^2        g = grad |V| = J^T V / |V|,  2 x 2 Gauss points a cell
//!      + sum over returns            rho_o V.V                  rho_o = 1 / (n cov n), mapped onto [1, 2]
//!      + integral of                 lambda (thin-plate energy of V_x and of V_y), a little
//! ```
//!
//! after Arukgoda et al., CASE 2019, `n` the surface's normal (the printed weight, through the gradient of `V.V`, is
//! unbounded). It does not change when `V` is turned everywhere by one angle, so the Hessian of both components
//! together is singular and no minimum can be certified. As published, the components are taken apart:
//! Levenberg-Marquardt with Gauss-Newton's block of either; in the covariance the returns and poses that both answer to
//! tie them. Kept for comparison; it ends farther from the truth than it starts.

mod inputs;

use rstar::RTree;

use self::inputs::PublishedInputs;
use super::collocation::{gauss, thin_plate};
use super::estimate::{Distance, Estimate, Minimum, missed_by};
use super::options::{FitOptions, Poses, Weighting, Weights};
use super::signed::{largest, least_squares};
use super::surfels::normals;
use super::vector::DEFAULT_BAND;
use super::viewpoint::{information, onto_one_to_two, range_sigma, returns_inside, viewpoints};
use super::{FitError, Job, Observer, Progress, in_use};
use crate::geometry::Vec2;
use crate::scan::Return;
use crate::sparse::{CellBlock, Cholesky, SparseError, Stencil, StencilMatrix};
use crate::spline::{BasisRow, Lattice, SUPPORT, dot, gather};

/// The thin-plate weight where the request has none: the Eikonal term says nothing of the component across `V`.
const SMOOTHING: f64 = 1e-3;
/// `|V|` is held away from zero by this many cells, where its gradient has no meaning.
const SHORTEST: f64 = 0.05;
/// Damping, as a share of the mean diagonal: at first, and by what it rises and falls.
const FIRST_DAMPING: f64 = 1e-2;
const RAISE: f64 = 4.0;
const LOWER: f64 = 0.3;
/// Damping beyond which no step helps.
const STUCK: f64 = 1e8;
/// What keeps control points determined that nothing else does, as a share of the mean diagonal.
const RIDGE: f64 = 1e-9;

/// Fits the published objective from the nearest-return field.
pub(super) fn fit(job: &Job<'_>, observer: Observer<'_>) -> Result<Estimate, FitError> {
    let &Job { scans, noise, lattice, options, .. } = job;
    let returns = returns_inside(scans, lattice)?;
    let mut weights = Weights::resolve(
        options,
        lattice.resolution,
        information(lattice, &returns, range_sigma(scans, noise, &returns)),
    );
    weights.smoothing = options.smoothing.unwrap_or(SMOOTHING);
    weights.poses = Poses::Fixed;
    let viewpoints = viewpoints(scans, noise, weights.model_sigma)?;
    let evidence = job.evidence(observer)?;
    let band = options.band.unwrap_or(DEFAULT_BAND);
    let stencil = Stencil::of_cells(lattice, &evidence.cells_within(lattice, band));
    let mut cholesky = job.cholesky(&stencil)?;
    let normals = normals::outward(&returns, lattice.resolution);
    let across = |(seen, n): (&Return, &Vec2)| 1.0 / n.dot(&(viewpoints[seen.scan].noise.covariance(seen) * n));
    let trust = onto_one_to_two(returns.iter().zip(&normals).map(across).collect());
    let objective = Published::new(lattice, &stencil, &returns, &trust, &weights);
    let End { components: [x, y], minimum, hessians } = match (job.ended(0), job.ended(1)) {
        (Some(x), Some(y)) => {
            let Normal { value, blocks, .. } = objective.assemble(&[x.clone(), y.clone()], &cholesky);
            End { components: [x, y], minimum: Minimum { objective: value, ..Minimum::default() }, hessians: blocks }
        }
        _ => {
            let start = nearest_return_field(lattice, &returns, &mut cholesky)?;
            objective.minimise(start, options, &mut cholesky, observer)?
        }
    };
    let field = [in_use(lattice, &stencil, x), in_use(lattice, &stencil, y)];
    let places: Vec<Vec2> = returns.iter().map(|seen| seen.point).collect();
    let rms = missed_by(&field, places.iter().copied());
    let inputs = PublishedInputs { field: field.clone(), stencil, returns, trust, viewpoints: viewpoints.clone() };
    let system = inputs.system(&hessians);
    Ok(Estimate {
        distance: Distance::Vector,
        weighting: Weighting::Paper,
        lattice: lattice.clone(),
        surfaces: field.into(),
        evidence,
        minimum,
        weights,
        converged: false,
        unconverged: Some(
            "the published vector objective leaves the field's turn open: it has no minimum to certify".into(),
        ),
        resume: Vec::new(),
        system,
        inputs: Box::new(inputs),
        cholesky,
        viewpoints,
        poses: scans.iter().map(|scan| scan.pose).collect(),
        rms,
        returns: places,
        surfels: None,
        seen_through: None,
        cut_locus: None,
    })
}

/// The least-squares spline of the vector from the nearest return.
fn nearest_return_field(
    lattice: &Lattice,
    returns: &[Return],
    cholesky: &mut Cholesky,
) -> Result<[Vec<f64>; 2], FitError> {
    let tree = RTree::bulk_load(returns.iter().map(|seen| [seen.point.x, seen.point.y]).collect());
    let away = |p: Vec2, axis: usize| tree.nearest_neighbor([p.x, p.y]).map_or(0.0, |nearest| p[axis] - nearest[axis]);
    let [x, y] = [0, 1].map(|axis| least_squares(lattice, 0.0, cholesky, |_, p| away(p, axis)));
    Ok([x?.coefficients, y?.coefficients])
}

/// The objective, ready to be evaluated.
struct Published<'a> {
    lattice: &'a Lattice,
    /// Cells in use, by column and row.
    cells: Vec<[usize; 2]>,
    rows: Vec<BasisRow>,
    /// The returns' basis rows and lowest control points, with `rho_o`.
    seen: Vec<([f64; SUPPORT], [usize; SUPPORT], f64)>,
    eikonal: f64,
    plate: CellBlock,
    shortest: f64,
}

/// Value, gradient and Gauss-Newton's blocks.
struct Normal {
    value: f64,
    gradient: [Vec<f64>; 2],
    blocks: [StencilMatrix; 2],
}

/// Where a minimisation stopped.
struct End {
    components: [Vec<f64>; 2],
    minimum: Minimum,
    hessians: [StencilMatrix; 2],
}

impl<'a> Published<'a> {
    fn new(lattice: &'a Lattice, stencil: &Stencil, returns: &[Return], trust: &[f64], weights: &Weights) -> Self {
        let [nx, ny] = lattice.cells;
        let in_use = |cell: &[usize; 2]| stencil.is_active_cell(lattice.support(*cell)[0]);
        let side = gauss(2);
        let h = lattice.resolution;
        let rows = side.iter().flat_map(|&(w, _)| side.iter().map(move |&(t, _)| BasisRow::at(t, w, h))).collect();
        let place = |(seen, &trust): (&Return, &f64)| {
            let at = lattice.locate_or_extend(seen.point);
            in_use(&at.cell).then(|| (lattice.value_row(&at), lattice.support(at.cell), trust))
        };
        Self {
            lattice,
            cells: (0..nx * ny).map(|k| [k % nx, k / nx]).filter(in_use).collect(),
            rows,
            seen: returns.iter().zip(trust).filter_map(place).collect(),
            eikonal: weights.eikonal,
            plate: thin_plate(h, weights.smoothing),
            shortest: SHORTEST * h,
        }
    }

    fn value(&self, c: &[Vec<f64>; 2]) -> f64 {
        let mut value = 0.0;
        for &cell in &self.cells {
            let local = self.local(c, &self.lattice.support(cell));
            value += local.iter().map(|own| 0.5 * dot(&self.plate.times(own), own)).sum::<f64>();
            value += self.rows.iter().map(|row| self.eikonal * self.residual(row, &local).0.powi(2)).sum::<f64>();
        }
        value
            + self
                .seen
                .iter()
                .map(|(row, support, trust)| {
                    trust * self.local(c, support).iter().map(|own| dot(row, own).powi(2)).sum::<f64>()
                })
                .sum::<f64>()
    }

    fn local(&self, c: &[Vec<f64>; 2], support: &[usize; SUPPORT]) -> [[f64; SUPPORT]; 2] {
        [gather(&c[0], support), gather(&c[1], support)]
    }

    /// `r = |g|^2 - 1` with `g_k = d_k V . V / m`, `m^2 = |V|^2 + shortest^2`, and its derivatives by the cell's
    /// coefficients of either component: `dr/dV = 2 sum g_k (d_k V - g_k V / m) / m`, `dr/d(d_k V) = 2 g_k V / m`.
    fn residual(&self, row: &BasisRow, local: &[[f64; SUPPORT]; 2]) -> (f64, [[f64; SUPPORT]; 2]) {
        let along = |basis: &[f64; SUPPORT]| Vec2::new(dot(basis, &local[0]), dot(basis, &local[1]));
        let (v, slopes) = (along(&row.value), [along(&row.dx), along(&row.dy)]);
        let m = v.norm().hypot(self.shortest);
        let g = slopes.map(|slope| slope.dot(&v) / m);
        let by_value: Vec2 = (0..2).map(|k| (slopes[k] - v * (g[k] / m)) * (2.0 * g[k] / m)).sum();
        let by_slope = g.map(|g| v * (2.0 * g / m));
        let change = |axis: usize| {
            std::array::from_fn(|k| {
                by_value[axis] * row.value[k] + by_slope[0][axis] * row.dx[k] + by_slope[1][axis] * row.dy[k]
            })
        };
        (g[0] * g[0] + g[1] * g[1] - 1.0, [change(0), change(1)])
    }

    fn assemble(&self, c: &[Vec<f64>; 2], cholesky: &Cholesky) -> Normal {
        let stencil = cholesky.pattern().stencil();
        let zeros = || vec![0.0; self.lattice.len()];
        let blocks = [0, 1].map(|_| StencilMatrix::zeros(stencil.clone()));
        let mut normal = Normal { value: self.value(c), gradient: [zeros(), zeros()], blocks };
        for &cell in &self.cells {
            let support = self.lattice.support(cell);
            let local = self.local(c, &support);
            let residuals: Vec<_> = self.rows.iter().map(|row| self.residual(row, &local)).collect();
            for axis in 0..2 {
                let (mut block, mut slope) = (self.plate, self.plate.times(&local[axis]));
                for (r, change) in &residuals {
                    let own = &change[axis];
                    block.add_scaled(2.0 * self.eikonal, &CellBlock::symmetric_product(own, own));
                    slope.iter_mut().zip(own).for_each(|(slope, own)| *slope += 2.0 * self.eikonal * r * own);
                }
                normal.blocks[axis].add_cell(support[0], &block);
                support.iter().zip(slope).for_each(|(&k, slope)| normal.gradient[axis][k] += slope);
            }
        }
        for (row, support, trust) in &self.seen {
            let mut block = CellBlock::ZERO;
            block.add_scaled(2.0 * trust, &CellBlock::symmetric_product(row, row));
            let local = self.local(c, support);
            for (axis, own) in local.iter().enumerate() {
                let pull = 2.0 * trust * dot(row, own);
                normal.blocks[axis].add_cell(support[0], &block);
                support.iter().zip(row).for_each(|(&k, value)| normal.gradient[axis][k] += pull * value);
            }
        }
        for block in &mut normal.blocks {
            let mean = block.diagonal().iter().sum::<f64>() / stencil.active_len().max(1) as f64;
            block.shift_diagonal(|k| if stencil.is_active(k) { RIDGE * mean } else { mean });
        }
        normal
    }

    fn minimise(
        &self,
        mut c: [Vec<f64>; 2],
        options: &FitOptions,
        cholesky: &mut Cholesky,
        observer: Observer<'_>,
    ) -> Result<End, FitError> {
        let mut normal = self.assemble(&c, cholesky);
        let steepest = |normal: &Normal| largest(&normal.gradient[0]).max(largest(&normal.gradient[1]));
        let (first, mut damping, mut minimum) = (steepest(&normal), FIRST_DAMPING, Minimum::default());
        loop {
            minimum.objective = normal.value;
            minimum.gradient_norm = steepest(&normal);
            minimum.relative_gradient = if first > 0.0 { minimum.gradient_norm / first } else { 0.0 };
            if !(normal.value.is_finite() && first.is_finite()) {
                return Err(FitError::NotFinite);
            }
            let (iteration, max_iterations) = (minimum.iterations, options.max_iterations);
            let (objective, relative_gradient) = (minimum.objective, minimum.relative_gradient);
            if observer(&Progress { iteration, max_iterations, objective, relative_gradient }).is_break() {
                return Err(FitError::Cancelled);
            }
            if relative_gradient <= options.tolerance || iteration >= max_iterations || damping > STUCK {
                return Ok(End { components: c, minimum, hessians: normal.blocks });
            }
            minimum.iterations += 1;
            while damping <= STUCK {
                minimum.factorisations += 2;
                let trial = step(&c, &normal, damping, cholesky)?;
                if self.value(&trial) < normal.value {
                    c = trial;
                    damping *= LOWER;
                    break;
                }
                damping *= RAISE;
            }
            normal = self.assemble(&c, cholesky);
        }
    }
}

/// The damped step of either component by itself.
fn step(
    c: &[Vec<f64>; 2],
    normal: &Normal,
    damping: f64,
    cholesky: &mut Cholesky,
) -> Result<[Vec<f64>; 2], SparseError> {
    let mut trial = c.clone();
    for ((into, block), gradient) in trial.iter_mut().zip(&normal.blocks).zip(&normal.gradient) {
        let mut damped = block.clone();
        let diagonal = damped.diagonal();
        let mean = diagonal.iter().sum::<f64>() / diagonal.len() as f64;
        damped.shift_diagonal(|_| damping * mean);
        cholesky.factorise(&damped)?;
        let downhill: Vec<f64> = gradient.iter().map(|slope| -slope).collect();
        let change = cholesky.solve_checked(&damped, &downhill)?;
        into.iter_mut().zip(change).for_each(|(c, change)| *c += change);
    }
    Ok(trial)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Bounds;
    use crate::sim::Scenario;
    use crate::sparse::Pattern;

    #[test]
    fn the_gradient_agrees_with_central_differences() {
        let scenario = Scenario::experiment_one();
        let bounds = Bounds { min: [-0.6, 1.0], max: [1.5, 3.0] };
        let lattice = Lattice::covering(&bounds, 0.25, 1_000).unwrap();
        let scans = scenario.scans(1);
        let options = FitOptions { weighting: Weighting::Paper, max_iterations: 1, ..Default::default() };
        let job = Job::alone(&scans, &scenario.noise, &lattice, &options);
        let fit = fit(&job, &mut |_| std::ops::ControlFlow::Continue(())).unwrap();
        let returns = returns_inside(&scans, &lattice).unwrap();
        let trust = vec![1.5; returns.len()];
        let stencil = fit.system.hessian.pattern().stencil();
        let cholesky = Cholesky::analyse(&Pattern::of_stencil(stencil)).unwrap();
        let objective = Published::new(&lattice, stencil, &returns, &trust, &fit.weights);
        let c = [0, 1].map(|axis: usize| {
            fit.surfaces[axis].coefficients.iter().map(|c| if c.is_nan() { 0.0 } else { *c }).collect::<Vec<_>>()
        });
        let normal = objective.assemble(&c, &cholesky);
        let scale = largest(&normal.gradient[0]).max(largest(&normal.gradient[1]));
        for (axis, k) in (0..2).flat_map(|axis| (0..lattice.len()).step_by(7).map(move |k| (axis, k))) {
            let at = |e: f64| {
                let mut moved = c.clone();
                moved[axis][k] += e;
                objective.value(&moved)
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!(!stencil.is_active(k) || (slope - normal.gradient[axis][k]).abs() < 1e-5 * scale.max(1.0));
        }
    }
}

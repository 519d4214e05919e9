//! The field a map holds: a signed distance, or a vector from the nearest surface.
//!
//! Whatever it is, a query needs the same few things of it at a point: the distance, its gradient and their covariance.
//! A vector field gives them along its own direction `n`: there `n . V` is a signed distance whose coefficients are
//! `n_x c_x + n_y c_y`, so the block of their covariance is `n_x^2 C_xx + n_x n_y (C_xy + C_yx) + n_y^2 C_yy`. Away
//! from surfaces `n = V / |V|`; within half a cell of one, where noise decides which way a short vector points, `n` is
//! the direction in which `V` grows fastest. So `sigma` is that of the signed distance across the surface, which is
//! normal; `|V|` itself is not, being folded at zero.

use nalgebra::SymmetricEigen;

use crate::geometry::{Cov2, Vec2};
use crate::sparse::{CellBlock, StencilMatrix};
use crate::spline::{BasisRow, Lattice, Located, SUPPORT, Surface, dot, gather};
use crate::uncertainty::{Kind, Marginals, VectorCovariance, VectorMarginals};

/// A vector shorter than this many cells takes its direction from how the field grows.
const SHORT: f64 = 0.5;

/// A map's field with its covariance.
#[derive(Debug, Clone)]
pub enum Field {
    Signed { surface: Surface, marginals: Marginals },
    Vector { components: [Surface; 2], marginals: Box<VectorMarginals> },
}

/// A vector field at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorAt {
    /// From the nearest surface point, metres.
    pub vector: Vec2,
    /// Rows are the gradients of the components.
    pub jacobian: Cov2,
    /// `n`; see the module.
    pub direction: Vec2,
}

impl VectorAt {
    pub fn divergence(&self) -> f64 {
        self.jacobian.trace()
    }

    /// The direction in which the field grows fastest: a surface's normal, up to sign.
    pub fn fastest_growth(&self) -> Vec2 {
        fastest_growth(self.jacobian)
    }
}

/// A scalar distance at a point: the basis row, its cell's coefficients and their covariance.
pub(super) struct Local {
    pub row: BasisRow,
    pub coefficients: [f64; SUPPORT],
    pub covariance: CellBlock,
}

impl Field {
    /// `sdf` or `vdf`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Signed { .. } => "sdf",
            Self::Vector { .. } => "vdf",
        }
    }

    pub fn lattice(&self) -> &Lattice {
        match self {
            Self::Signed { surface, .. } => &surface.lattice,
            Self::Vector { components, .. } => &components[0].lattice,
        }
    }

    /// The coefficients by the names that the contract gives them; NaN where a control point is not in use.
    pub fn coefficients(&self) -> Vec<(&'static str, &[f64])> {
        match self {
            Self::Signed { surface, .. } => vec![("sdf", &surface.coefficients)],
            Self::Vector { components: [x, y], .. } => vec![("vdf_x", &x.coefficients), ("vdf_y", &y.coefficients)],
        }
    }

    /// The coefficients' variances, named as they are, square metres; NaN where a control point is not in use.
    pub fn variances(&self, kind: Kind) -> Vec<(&'static str, Vec<f64>)> {
        match self {
            Self::Signed { marginals, .. } => vec![("sdf", masked_diagonal(marginals.of(kind)))],
            Self::Vector { marginals, .. } => {
                let own = marginals.of(kind);
                vec![("vdf_x", masked_diagonal(&own.xx)), ("vdf_y", masked_diagonal(&own.yy))]
            }
        }
    }

    /// Where a point lies on the lattice; `None` outside it and where no control points are in use.
    pub fn locate(&self, p: Vec2) -> Option<Located> {
        let stencil = match self {
            Self::Signed { marginals, .. } => marginals.posterior.stencil(),
            Self::Vector { marginals, .. } => marginals.posterior.xx.stencil(),
        };
        self.lattice().locate(p).filter(|at| stencil.is_active_cell(self.lattice().support(at.cell)[0]))
    }

    /// The vector field at a point; `None` for a signed distance and where no control points are in use.
    pub fn vector(&self, p: Vec2) -> Option<VectorAt> {
        self.vector_at(&self.locate(p)?)
    }

    fn vector_at(&self, at: &Located) -> Option<VectorAt> {
        let Self::Vector { components, .. } = self else { return None };
        let [x, y] = [components[0].jet_at(at), components[1].jet_at(at)];
        let vector = Vec2::new(x.value, y.value);
        let jacobian = Cov2::from_rows(&[x.gradient.transpose(), y.gradient.transpose()]);
        let direction = direction(vector, jacobian, SHORT * self.lattice().resolution);
        Some(VectorAt { vector, jacobian, direction })
    }

    /// The field's own value: the distance, negative in free space where it is signed, or the vector's length.
    pub fn value(&self, p: Vec2) -> Option<f64> {
        match self {
            Self::Signed { surface, .. } => self.locate(p).map(|at| surface.jet_at(&at).value),
            Self::Vector { .. } => self.vector(p).map(|at| at.vector.norm()),
        }
    }

    /// The field's own value and its gradient.
    pub fn slope(&self, p: Vec2) -> Option<(f64, Vec2)> {
        match self {
            Self::Signed { surface, .. } => {
                self.locate(p).map(|at| surface.jet_at(&at)).map(|jet| (jet.value, jet.gradient))
            }
            Self::Vector { .. } => self.vector(p).map(|at| (at.vector.norm(), at.jacobian.transpose() * at.direction)),
        }
    }

    /// The field's own value at a point, and its standard deviation along its direction: of a vector field what tells
    /// where a surface is, and nothing of how far the nearest one is.
    pub fn across(&self, p: Vec2, kind: Kind) -> Option<(f64, f64)> {
        let at = self.locate(p)?;
        let (row, first) = (self.lattice().row(&at).value, self.lattice().support(at.cell)[0]);
        let (distance, variance) = match self {
            Self::Signed { surface, marginals } => {
                (dot(&row, &surface.gather(at.cell)), marginals.of(kind).cell_form(first, &row))
            }
            Self::Vector { marginals, .. } => {
                let vector = self.vector_at(&at)?;
                let [xx, xy, yy] = marginals.of(kind).forms(first, &row);
                let n = vector.direction;
                (vector.vector.norm(), n.x * n.x * xx + 2.0 * n.x * n.y * xy + n.y * n.y * yy)
            }
        };
        Some((distance, variance.max(0.0).sqrt()))
    }

    /// The standard deviation of a vector field's component along a unit vector.
    pub fn sigma_along(&self, p: Vec2, n: Vec2, kind: Kind) -> Option<f64> {
        let [xx, xy, yy] = self.vector_covariance(p, kind)?;
        Some((n.x * n.x * xx + 2.0 * n.x * n.y * xy + n.y * n.y * yy).sqrt())
    }

    /// The vector's covariance [xx, xy, yy] at a point, square metres.
    pub fn vector_covariance(&self, p: Vec2, kind: Kind) -> Option<[f64; 3]> {
        let Self::Vector { marginals, .. } = self else { return None };
        let at = self.locate(p)?;
        let first = self.lattice().support(at.cell)[0];
        Some(marginals.of(kind).forms(first, &self.lattice().row(&at).value))
    }

    /// What a query needs at a located point.
    pub(super) fn local(&self, at: &Located, kind: Kind) -> Option<Local> {
        let lattice = self.lattice();
        let (row, support) = (lattice.row(at), lattice.support(at.cell));
        match self {
            Self::Signed { surface, marginals } => {
                let (coefficients, covariance) = (surface.gather(at.cell), marginals.of(kind).cell(support[0]));
                Some(Local { row, coefficients, covariance })
            }
            Self::Vector { components, marginals } => {
                let n = self.vector_at(at)?.direction;
                let [x, y] = [0, 1].map(|axis: usize| gather(&components[axis].coefficients, &support));
                let coefficients = std::array::from_fn(|k| n.x * x[k] + n.y * y[k]);
                Some(Local { row, coefficients, covariance: marginals.of(kind).cell_along(support[0], n) })
            }
        }
    }
}

impl VectorCovariance {
    /// The forms `[xx, xy, yy]` of a cell's blocks with one basis row.
    fn forms(&self, first: usize, row: &[f64; SUPPORT]) -> [f64; 3] {
        let cross = 0.5 * (self.xy.cell_form(first, row) + self.yx.cell_form(first, row));
        [self.xx.cell_form(first, row), cross, self.yy.cell_form(first, row)]
    }

    /// The covariance of `n_x c_x + n_y c_y` over a cell.
    fn cell_along(&self, first: usize, n: Vec2) -> CellBlock {
        let mut block = CellBlock::ZERO;
        let weights = [n.x * n.x, n.x * n.y, n.x * n.y, n.y * n.y];
        self.parts().iter().zip(weights).for_each(|(part, weight)| block.add_scaled(weight, &part.cell(first)));
        block
    }
}

/// `n`: along the vector, or where that is shorter than `short` the way the field grows fastest, towards it.
fn direction(vector: Vec2, jacobian: Cov2, short: f64) -> Vec2 {
    match vector.try_normalize(short) {
        Some(direction) => direction,
        None => {
            let fastest = fastest_growth(jacobian);
            if fastest.dot(&vector) < 0.0 { -fastest } else { fastest }
        }
    }
}

fn fastest_growth(jacobian: Cov2) -> Vec2 {
    let eigen = SymmetricEigen::new(0.5 * (jacobian + jacobian.transpose()));
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
}

fn masked_diagonal(matrix: &StencilMatrix) -> Vec<f64> {
    let mut diagonal = matrix.diagonal();
    diagonal.iter_mut().enumerate().filter(|(k, _)| !matrix.stencil().is_active(*k)).for_each(|(_, v)| *v = f64::NAN);
    diagonal
}

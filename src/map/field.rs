//! The field a map holds: a signed distance, or a vector from the nearest surface, with the covariance of its
//! coefficients between control points that share a cell.
//!
//! Whatever it is, a query needs the same few things of it at a point: the distance, its gradient and their covariance.
//! A vector field gives them along its own direction `n`: there `n . V` is a signed distance whose coefficients are
//! `n_x c_x + n_y c_y`, so the block of their covariance is `n_x^2 C_xx + n_x n_y (C_xy + C_yx) + n_y^2 C_yy`. Away
//! from surfaces `n = V / |V|`; within half a cell of one, where noise decides which way a short vector points, `n` is
//! the direction in which `V` grows fastest. So `sigma` is that of the signed distance across the surface, which is
//! normal; `|V|` itself is not, being folded at zero.

use nalgebra::SymmetricEigen;

use crate::fit::Distance;
use crate::geometry::{Cov2, Vec2};
use crate::sparse::{CellBlock, Stencil, StencilMatrix};
use crate::spline::{BasisRow, Lattice, Located, SUPPORT, Surface, dot};
use crate::uncertainty::{Kind, Marginals};

/// A vector shorter than this many cells takes its direction from how the field grows.
const SHORT: f64 = 0.5;

/// One covariance of a field on the stencil, square metres: of a signed distance one part; of a vector xx, xy, yx, yy,
/// where entry (row, column) of xy is between the x coefficient of the row's control point and the y coefficient of the
/// column's, for rows no lower than columns.
#[derive(Debug, Clone)]
pub struct CellCovariance {
    pub parts: Vec<StencilMatrix>,
}

/// A map's field with its covariances.
#[derive(Debug, Clone)]
pub struct Field {
    /// One component, or two; NaN at control points that are not in use.
    surfaces: Vec<Surface>,
    /// Propagated, posterior.
    covariances: [CellCovariance; 2],
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

impl CellCovariance {
    /// What a query needs of an estimate's marginals.
    pub fn of(marginals: &Marginals, kind: Kind) -> Self {
        let own = marginals.of(kind);
        let k = own.pattern().components();
        let mut parts: Vec<StencilMatrix> = (0..k * k).map(|part| own.stencil_block(part / k, part % k)).collect();
        parts.iter_mut().for_each(round_as_stored);
        Self { parts }
    }

    /// The forms of a cell's blocks with one basis row: `[xx]`, or `[xx, xy, yy]`, the cross one being a mean.
    fn forms(&self, first: usize, row: &[f64; SUPPORT]) -> [f64; 3] {
        let form = |part: usize| self.parts[part].cell_form(first, row);
        match self.parts.len() {
            1 => [form(0), 0.0, 0.0],
            _ => [form(0), 0.5 * (form(1) + form(2)), form(3)],
        }
    }
}

impl Field {
    /// A field from its components and its covariances, propagated and posterior.
    pub fn new(surfaces: Vec<Surface>, covariances: [CellCovariance; 2]) -> Self {
        Self { surfaces, covariances }
    }

    pub fn distance(&self) -> Distance {
        if self.surfaces.len() == 1 { Distance::Signed } else { Distance::Vector }
    }

    pub fn lattice(&self) -> &Lattice {
        &self.surfaces[0].lattice
    }

    pub fn covariance(&self, kind: Kind) -> &CellCovariance {
        &self.covariances[usize::from(kind == Kind::Posterior)]
    }

    pub fn stencil(&self) -> &Stencil {
        self.covariances[0].parts[0].stencil()
    }

    fn names(&self) -> &'static [&'static str] {
        match self.distance() {
            Distance::Signed => &["sdf"],
            Distance::Vector => &["vdf_x", "vdf_y"],
        }
    }

    /// The coefficients by the names that the contract gives them; NaN where a control point is not in use.
    pub fn coefficients(&self) -> Vec<(&'static str, &[f64])> {
        let values = self.surfaces.iter().map(|surface| surface.coefficients.as_slice());
        self.names().iter().copied().zip(values).collect()
    }

    /// The coefficients' variances, named as they are, square metres; NaN where a control point is not in use.
    pub fn variances(&self, kind: Kind) -> Vec<(&'static str, Vec<f64>)> {
        let own = &self.covariance(kind).parts;
        let diagonals = own.iter().step_by(self.surfaces.len() + 1).map(masked_diagonal);
        self.names().iter().copied().zip(diagonals).collect()
    }

    /// Where a point lies on the lattice; `None` outside it and where no control points are in use.
    pub fn locate(&self, p: Vec2) -> Option<Located> {
        let at = self.lattice().locate(p)?;
        self.stencil().is_active_cell(self.lattice().support(at.cell)[0]).then_some(at)
    }

    /// The vector field at a point; `None` for a signed distance and where no control points are in use.
    pub fn vector(&self, p: Vec2) -> Option<VectorAt> {
        self.vector_at(&self.locate(p)?)
    }

    fn vector_at(&self, at: &Located) -> Option<VectorAt> {
        let [x, y] = self.surfaces.as_slice() else { return None };
        let [x, y] = [x.jet_at(at), y.jet_at(at)];
        let vector = Vec2::new(x.value, y.value);
        let jacobian = Cov2::from_rows(&[x.gradient.transpose(), y.gradient.transpose()]);
        let direction = direction(vector, jacobian, SHORT * self.lattice().resolution);
        Some(VectorAt { vector, jacobian, direction })
    }

    /// The coefficients of a cell: of a vector field, its first component's.
    pub(super) fn gather(&self, cell: [usize; 2]) -> [f64; SUPPORT] {
        self.surfaces[0].gather(cell)
    }

    /// The field's own value: the distance, negative in free space where it is signed, or the vector's length.
    pub fn value(&self, p: Vec2) -> Option<f64> {
        let at = self.locate(p)?;
        Some(match self.surfaces.as_slice() {
            [x, y] => Vec2::new(x.value_at(&at), y.value_at(&at)).norm(),
            _ => self.surfaces[0].value_at(&at),
        })
    }

    /// The field's own value and its gradient.
    pub fn slope(&self, p: Vec2) -> Option<(f64, Vec2)> {
        let at = self.locate(p)?;
        Some(match self.vector_at(&at) {
            Some(at) => (at.vector.norm(), at.jacobian.transpose() * at.direction),
            None => {
                let jet = self.surfaces[0].jet_at(&at);
                (jet.value, jet.gradient)
            }
        })
    }

    /// The field's own value at a point, and its standard deviation along its direction: of a vector field what tells
    /// where a surface is, and nothing of how far the nearest one is.
    pub fn across(&self, p: Vec2, kind: Kind) -> Option<(f64, f64)> {
        let at = self.locate(p)?;
        let (row, first) = (self.lattice().value_row(&at), self.lattice().support(at.cell)[0]);
        let [xx, xy, yy] = self.covariance(kind).forms(first, &row);
        Some(match self.vector_at(&at) {
            None => (dot(&row, &self.surfaces[0].gather(at.cell)), xx.sqrt()),
            Some(vector) => (vector.vector.norm(), along(vector.direction, [xx, xy, yy]).sqrt()),
        })
    }

    /// The standard deviation of a vector field's component along a unit vector.
    pub fn sigma_along(&self, p: Vec2, n: Vec2, kind: Kind) -> Option<f64> {
        self.vector_covariance(p, kind).map(|forms| along(n, forms).sqrt())
    }

    /// The vector's covariance [xx, xy, yy] at a point, square metres.
    pub fn vector_covariance(&self, p: Vec2, kind: Kind) -> Option<[f64; 3]> {
        let at = self.locate(p).filter(|_| self.distance() == Distance::Vector)?;
        let first = self.lattice().support(at.cell)[0];
        Some(self.covariance(kind).forms(first, &self.lattice().value_row(&at)))
    }

    /// What a query needs of a signed distance at a located point.
    pub(super) fn local(&self, at: &Located, kind: Kind) -> Local {
        let lattice = self.lattice();
        let covariance = self.covariance(kind).parts[0].cell(lattice.support(at.cell)[0]);
        Local { row: lattice.row(at), coefficients: self.surfaces[0].gather(at.cell), covariance }
    }
}

fn along(n: Vec2, [xx, xy, yy]: [f64; 3]) -> f64 {
    n.x * n.x * xx + 2.0 * n.x * n.y * xy + n.y * n.y * yy
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

/// A map is the same before it is stored and after: what lies off the diagonal is kept as f32.
fn round_as_stored(part: &mut StencilMatrix) {
    let diagonal = part.diagonal();
    part.values.iter_mut().for_each(|value| *value = f64::from(*value as f32));
    part.set_diagonal(&diagonal);
}

fn masked_diagonal(matrix: &StencilMatrix) -> Vec<f64> {
    let mut diagonal = matrix.diagonal();
    diagonal.iter_mut().enumerate().filter(|(k, _)| !matrix.stencil().is_active(*k)).for_each(|(_, v)| *v = f64::NAN);
    diagonal
}

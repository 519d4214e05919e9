//! Signed distance and sigma at points in rows, as pictures ask for them.
//!
//! Neighbours on a row share a cell and their height `w` in it. There the value and its variance are those of a line,
//!
//! ```text
//! d(t) = sum_a b_a(t) s_a,                s_a = sum_b b_b(w) c_ab
//! sigma^2(t) = sum_aa' b_a(t) b_a'(t) M_aa',   M_aa' = sum_bb' b_b(w) b_b'(w) C_ab,a'b'
//! ```
//!
//! with the four basis functions `b`, the cell's coefficients `c` and their covariance `C`: what is summed over the height
//! is kept for the next point. A vector map's distance is that to its surfaces, of which points share nothing.

use super::FittedMap;
use super::field::Field;
use crate::fit::Distance;
use crate::geometry::Vec2;
use crate::spline::{Located, SUPPORT, cubic};
use crate::uncertainty::Kind;

/// A walk over a map's points; see the module.
pub struct Sweep<'a> {
    map: &'a FittedMap,
    kind: Kind,
    /// The last point's cell and height.
    here: Option<([usize; 2], f64)>,
    values: [f64; 4],
    /// Formed at the second point of a row: it takes as long as four points by themselves.
    covariance: Option<[[f64; 4]; 4]>,
}

impl<'a> Sweep<'a> {
    pub fn over(map: &'a FittedMap, kind: Kind) -> Self {
        Self { map, kind, here: None, values: [0.0; 4], covariance: None }
    }

    /// The distance, and whether anything was observed there; `None` outside the lattice and where no control points are
    /// in use.
    pub fn distance(&mut self, p: Vec2) -> Option<(f64, bool)> {
        let field = &self.map.field;
        if field.distance() == Distance::Vector {
            return Some((self.map.distance_alone(p)?, self.map.observed(p)?));
        }
        let at = field.locate(p)?;
        self.enter(&at);
        let x = cubic(at.local[0], 0);
        Some((x.iter().zip(&self.values).map(|(x, value)| x * value).sum(), self.seen(&at)))
    }

    /// The distance's standard deviation where anything was observed.
    pub fn seen_sigma(&mut self, p: Vec2) -> Option<f64> {
        let (map, kind) = (self.map, self.kind);
        if map.field.distance() == Distance::Vector {
            return map.observed(p)?.then(|| map.distance(p, kind))?.map(|(_, sigma)| sigma);
        }
        let at = map.field.locate(p).filter(|at| self.seen(at))?;
        if !self.enter(&at) {
            return map.field.across(p, kind).map(|(_, sigma)| sigma);
        }
        let along = self.covariance.get_or_insert_with(|| along_row(&map.field, &at, kind));
        let x = cubic(at.local[0], 0);
        let form: f64 = (0..SUPPORT).map(|k| x[k / 4] * x[k % 4] * along[k / 4][k % 4]).sum();
        Some(form.sqrt())
    }

    /// Goes to a point; whether the last one was on the same row of the same cell.
    fn enter(&mut self, at: &Located) -> bool {
        let here = Some((at.cell, at.local[1]));
        if self.here == here {
            return true;
        }
        let (coefficients, y) = (self.map.field.gather(at.cell), cubic(at.local[1], 0));
        self.values = std::array::from_fn(|a| (0..4).map(|b| y[b] * coefficients[a + 4 * b]).sum());
        (self.here, self.covariance) = (here, None);
        false
    }

    fn seen(&self, at: &Located) -> bool {
        self.map.evidence.located(at).any()
    }
}

/// `M` of a cell at a height.
fn along_row(field: &Field, at: &Located, kind: Kind) -> [[f64; 4]; 4] {
    let block = field.covariance(kind).parts[0].cell(field.lattice().support(at.cell)[0]);
    let y = cubic(at.local[1], 0);
    let column = |a: usize| -> [f64; SUPPORT] { std::array::from_fn(|k| if k % 4 == a { y[k / 4] } else { 0.0 }) };
    let images: [[f64; SUPPORT]; 4] = std::array::from_fn(|a| block.times(&column(a)));
    std::array::from_fn(|a| std::array::from_fn(|other| (0..4).map(|b| y[b] * images[other][a + 4 * b]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Survey;
    use crate::sim::Scenario;

    #[test]
    fn a_row_is_what_its_points_are() {
        let room = Scenario::experiment_one();
        for distance in [Distance::Signed, Distance::Vector] {
            let map = Survey::new(&room.scans(1), room.noise).distance(distance).resolution(0.5).map().unwrap();
            let bounds = map.lattice().bounds();
            let point = |k: usize| {
                let share = [k % 97, k / 97].map(|n| n as f64 / 96.0 * 1.1 - 0.05);
                Vec2::from(std::array::from_fn(|axis| {
                    bounds.min[axis] + share[axis] * (bounds.max[axis] - bounds.min[axis])
                }))
            };
            for kind in [Kind::Propagated, Kind::Posterior] {
                let (mut distances, mut sigmas) = (Sweep::over(&map, kind), Sweep::over(&map, kind));
                let mut seen = 0;
                for p in (0..97 * 97).map(point) {
                    let (exact, observed) = (map.distance(p, kind), map.observed(p) == Some(true));
                    let swept = distances.distance(p);
                    assert_eq!(swept.map(|(_, observed)| observed), exact.map(|_| observed), "{p:?}");
                    let sigma = sigmas.seen_sigma(p);
                    assert_eq!(sigma.is_some(), exact.is_some() && observed, "{p:?}");
                    let Some((d, exact_sigma)) = exact else { continue };
                    assert!((swept.unwrap().0 - d).abs() < 1e-12, "{p:?}");
                    if let Some(sigma) = sigma {
                        assert!((sigma / exact_sigma - 1.0).abs() < 1e-9, "{p:?}: {sigma}, {exact_sigma}");
                        seen += 1;
                    }
                }
                assert!(seen > 2000, "{seen}");
            }
        }
    }
}

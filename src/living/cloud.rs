//! Points that scans met, and a raster of how near they are: what maps are aligned by.

use rstar::RTree;

use crate::geometry::{Bounds, Vec2};

/// Points a square of this side are one, metres.
const GRAIN: f64 = 0.1;
/// How wide the raster's kernel is, metres.
const KERNEL: f64 = 0.15;
/// Raster cells at most.
const MOST_CELLS: f64 = 2e7;
/// Neighbours of a point within this make its line, metres.
const LINE: f64 = 0.35;

/// Points such that a square has one, in a fixed order.
pub fn thinned(points: Vec<Vec2>) -> Vec<Vec2> {
    let key = |p: &Vec2| ((p.y / GRAIN).floor() as i64, (p.x / GRAIN).floor() as i64);
    let mut keyed: Vec<_> = points.iter().map(|p| (key(p), *p)).collect();
    keyed.sort_by_key(|(key, _)| *key);
    keyed.chunk_by(|a, b| a.0 == b.0).map(|own| own.iter().map(|(_, p)| *p).sum::<Vec2>() / own.len() as f64).collect()
}

/// The normal of the line through a point and its neighbours, where they lie on one.
pub fn line_normal(tree: &RTree<[f64; 2]>, p: Vec2) -> Option<Vec2> {
    let near: Vec<Vec2> = tree.locate_within_distance(p.into(), LINE * LINE).map(|q| Vec2::new(q[0], q[1])).collect();
    if near.len() < 3 {
        return None;
    }
    let mean = near.iter().sum::<Vec2>() / near.len() as f64;
    let spread = near.iter().map(|q| (q - mean) * (q - mean).transpose()).sum::<nalgebra::Matrix2<f64>>();
    let eigen = spread.symmetric_eigen();
    let (k, least) = eigen.eigenvalues.argmin();
    (least < 0.1 * eigen.eigenvalues.max()).then(|| eigen.eigenvectors.column(k).into_owned())
}

/// How near surfaces are: `exp(-d^2 / 2 KERNEL^2)` of the nearest point.
pub struct Raster {
    origin: Vec2,
    cell: f64,
    size: [usize; 2],
    values: Vec<f32>,
}

impl Raster {
    pub fn of(points: &[Vec2], bounds: &Bounds) -> Self {
        let [width, height] = bounds.size();
        let cell = (width * height / MOST_CELLS).sqrt().max(0.5 * GRAIN);
        let size = [width, height].map(|length| (length / cell).ceil() as usize + 1);
        let mut own = Self { origin: Vec2::from(bounds.min), cell, size, values: vec![0.0; size[0] * size[1]] };
        let reach = (3.0 * KERNEL / cell).ceil() as i64;
        for p in points {
            let at = (p - own.origin) / cell;
            let (i, j) = (at.x.floor() as i64, at.y.floor() as i64);
            for (a, b) in (-reach..=reach).flat_map(|a| (-reach..=reach).map(move |b| (i + a, j + b))) {
                let (Ok(column), Ok(row)) = (usize::try_from(a), usize::try_from(b)) else { continue };
                if column < size[0] && row < size[1] {
                    let center = own.origin + Vec2::new(a as f64 + 0.5, b as f64 + 0.5) * cell;
                    let near = (-(center - p).norm_squared() / (2.0 * KERNEL * KERNEL)).exp() as f32;
                    let value = &mut own.values[column + row * size[0]];
                    *value = value.max(near);
                }
            }
        }
        own
    }

    pub fn at(&self, p: Vec2) -> f64 {
        let at = (p - self.origin) / self.cell;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        if inside { f64::from(self.values[at.x as usize + at.y as usize * self.size[0]]) } else { 0.0 }
    }
}

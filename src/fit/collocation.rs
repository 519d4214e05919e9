//! Integrals over a cell: Gauss-Legendre points, and the thin-plate energy, which they integrate exactly.

use crate::sparse::CellBlock;
use crate::spline::BasisRow;

/// Gauss-Legendre points on [0, 1] with their weights, by number.
pub(super) fn gauss(points: usize) -> &'static [(f64, f64)] {
    const TWO: [(f64, f64); 2] = [(0.211_324_865_405_187_1, 0.5), (0.788_675_134_594_812_9, 0.5)];
    const THREE: [(f64, f64); 3] = [
        (0.112_701_665_379_258_31, 0.277_777_777_777_777_8),
        (0.5, 0.444_444_444_444_444_4),
        (0.887_298_334_620_741_7, 0.277_777_777_777_777_8),
    ];
    const FOUR: [(f64, f64); 4] = [
        (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
        (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
        (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
        (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
    ];
    match points {
        2 => &TWO,
        3 => &THREE,
        _ => &FOUR,
    }
}

/// The Hessian block of the thin-plate energy over one cell: exact, since 4 Gauss points a side integrate degree 7.
pub(super) fn thin_plate(h: f64, weight: f64) -> CellBlock {
    let mut block = CellBlock::ZERO;
    for &(t, t_weight) in gauss(4) {
        for &(w, w_weight) in gauss(4) {
            let row = BasisRow::at(t, w, h);
            let scale = 2.0 * weight * t_weight * w_weight * h * h;
            block.add_scaled(scale, &CellBlock::symmetric_product(&row.dxx, &row.dxx));
            block.add_scaled(2.0 * scale, &CellBlock::symmetric_product(&row.dxy, &row.dxy));
            block.add_scaled(scale, &CellBlock::symmetric_product(&row.dyy, &row.dyy));
        }
    }
    block
}

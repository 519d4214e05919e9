//! The problem of `examples/side_by_side` in arael, for its marginal covariances (`CovMode::AllMarginals`: a selected
//! inverse on a supernodal factor). arael has no residual over an array of references, so the sixteen control points of
//! a cell are written out; what couples them goes through its list of coordinates.
//!
//!   arael-peer DIR      prints the seconds that an assembly with all marginals takes, and the least and largest sigma

use std::time::Instant;

use arael::covariance::{CovMode, Covariance};
use arael::model::{Param, SelfBlock};
use arael::refs::{self, Ref};

#[arael::model]
struct ControlPoint {
    c: Param<f64>,
    hb: SelfBlock<ControlPoint>,
}

/// One Gauss point: `scale (|grad u|^2 - 1)`.
#[rustfmt::skip]
#[arael::model]
#[arael(constraint(coo, {
    let gx = slope.dx0 * c0.c + slope.dx1 * c1.c + slope.dx2 * c2.c + slope.dx3 * c3.c
        + slope.dx4 * c4.c + slope.dx5 * c5.c + slope.dx6 * c6.c + slope.dx7 * c7.c
        + slope.dx8 * c8.c + slope.dx9 * c9.c + slope.dx10 * c10.c + slope.dx11 * c11.c
        + slope.dx12 * c12.c + slope.dx13 * c13.c + slope.dx14 * c14.c + slope.dx15 * c15.c;
    let gy = slope.dy0 * c0.c + slope.dy1 * c1.c + slope.dy2 * c2.c + slope.dy3 * c3.c
        + slope.dy4 * c4.c + slope.dy5 * c5.c + slope.dy6 * c6.c + slope.dy7 * c7.c
        + slope.dy8 * c8.c + slope.dy9 * c9.c + slope.dy10 * c10.c + slope.dy11 * c11.c
        + slope.dy12 * c12.c + slope.dy13 * c13.c + slope.dy14 * c14.c + slope.dy15 * c15.c;
    [slope.scale * (gx * gx + gy * gy - 1.0)]
}))]
struct Slope {
    #[arael(ref = root.points)] c0: Ref<ControlPoint>, #[arael(ref = root.points)] c1: Ref<ControlPoint>,
    #[arael(ref = root.points)] c2: Ref<ControlPoint>, #[arael(ref = root.points)] c3: Ref<ControlPoint>,
    #[arael(ref = root.points)] c4: Ref<ControlPoint>, #[arael(ref = root.points)] c5: Ref<ControlPoint>,
    #[arael(ref = root.points)] c6: Ref<ControlPoint>, #[arael(ref = root.points)] c7: Ref<ControlPoint>,
    #[arael(ref = root.points)] c8: Ref<ControlPoint>, #[arael(ref = root.points)] c9: Ref<ControlPoint>,
    #[arael(ref = root.points)] c10: Ref<ControlPoint>, #[arael(ref = root.points)] c11: Ref<ControlPoint>,
    #[arael(ref = root.points)] c12: Ref<ControlPoint>, #[arael(ref = root.points)] c13: Ref<ControlPoint>,
    #[arael(ref = root.points)] c14: Ref<ControlPoint>, #[arael(ref = root.points)] c15: Ref<ControlPoint>,
    dx0: f64, dx1: f64, dx2: f64, dx3: f64, dx4: f64, dx5: f64, dx6: f64, dx7: f64,
    dx8: f64, dx9: f64, dx10: f64, dx11: f64, dx12: f64, dx13: f64, dx14: f64, dx15: f64,
    dy0: f64, dy1: f64, dy2: f64, dy3: f64, dy4: f64, dy5: f64, dy6: f64, dy7: f64,
    dy8: f64, dy9: f64, dy10: f64, dy11: f64, dy12: f64, dy13: f64, dy14: f64, dy15: f64,
    scale: f64,
}

/// One return: `sqrt(weight) u`.
#[rustfmt::skip]
#[arael::model]
#[arael(constraint(coo, {
    [hit.b0 * c0.c + hit.b1 * c1.c + hit.b2 * c2.c + hit.b3 * c3.c
        + hit.b4 * c4.c + hit.b5 * c5.c + hit.b6 * c6.c + hit.b7 * c7.c
        + hit.b8 * c8.c + hit.b9 * c9.c + hit.b10 * c10.c + hit.b11 * c11.c
        + hit.b12 * c12.c + hit.b13 * c13.c + hit.b14 * c14.c + hit.b15 * c15.c]
}))]
struct Hit {
    #[arael(ref = root.points)] c0: Ref<ControlPoint>, #[arael(ref = root.points)] c1: Ref<ControlPoint>,
    #[arael(ref = root.points)] c2: Ref<ControlPoint>, #[arael(ref = root.points)] c3: Ref<ControlPoint>,
    #[arael(ref = root.points)] c4: Ref<ControlPoint>, #[arael(ref = root.points)] c5: Ref<ControlPoint>,
    #[arael(ref = root.points)] c6: Ref<ControlPoint>, #[arael(ref = root.points)] c7: Ref<ControlPoint>,
    #[arael(ref = root.points)] c8: Ref<ControlPoint>, #[arael(ref = root.points)] c9: Ref<ControlPoint>,
    #[arael(ref = root.points)] c10: Ref<ControlPoint>, #[arael(ref = root.points)] c11: Ref<ControlPoint>,
    #[arael(ref = root.points)] c12: Ref<ControlPoint>, #[arael(ref = root.points)] c13: Ref<ControlPoint>,
    #[arael(ref = root.points)] c14: Ref<ControlPoint>, #[arael(ref = root.points)] c15: Ref<ControlPoint>,
    b0: f64, b1: f64, b2: f64, b3: f64, b4: f64, b5: f64, b6: f64, b7: f64,
    b8: f64, b9: f64, b10: f64, b11: f64, b12: f64, b13: f64, b14: f64, b15: f64,
}

#[arael::model]
#[arael(root)]
struct Surface {
    points: refs::Vec<ControlPoint>,
    slopes: std::vec::Vec<Slope>,
    hits: std::vec::Vec<Hit>,
}

/// The four cubic B-splines at a local coordinate, and their derivatives.
fn basis(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    let inner = |t: f64| (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0;
    let value = [s * s * s / 6.0, inner(t), inner(s), t * t * t / 6.0];
    let slope = [-s * s / 2.0, (3.0 * t * t - 4.0 * t) / 2.0, (-3.0 * t * t + 2.0 * t + 1.0) / 2.0, t * t / 2.0];
    (value, slope)
}

fn product(x: &[f64; 4], y: &[f64; 4], scale: f64) -> [f64; 16] {
    std::array::from_fn(|k| x[k % 4] * y[k / 4] * scale)
}

fn numbers(file: &str) -> Vec<[u8; 8]> {
    let bytes = std::fs::read(file).unwrap_or_else(|error| panic!("{file}: {error}"));
    bytes.chunks_exact(8).map(|chunk| chunk.try_into().expect("eight bytes")).collect()
}

fn load(folder: &str) -> Surface {
    let meta = std::fs::read_to_string(format!("{folder}/meta.txt")).expect("meta.txt");
    let meta: Vec<f64> = meta.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    let (nx, ny, h, rho) = (meta[0] as usize, meta[1] as usize, meta[2], meta[3]);
    let mut surface = Surface { points: refs::Vec::new(), slopes: Vec::new(), hits: Vec::new() };
    let points: Vec<Ref<ControlPoint>> = numbers(&format!("{folder}/start.f64"))
        .into_iter()
        .map(|c| surface.points.push(ControlPoint { c: Param::new(f64::from_le_bytes(c)), hb: SelfBlock::new() }))
        .collect();
    let support = |cell: usize| -> [Ref<ControlPoint>; 16] {
        let first = cell % nx + cell / nx * (nx + 3);
        std::array::from_fn(|k| points[first + k % 4 + k / 4 * (nx + 3)])
    };
    let gauss = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
    for cell in 0..nx * ny {
        for q in 0..4 {
            let ((x, x_slope), (y, y_slope)) = (basis(gauss[q % 2]), basis(gauss[q / 2]));
            let (dx, dy) = (product(&x_slope, &y, 1.0 / h), product(&x, &y_slope, 1.0 / h));
            surface.slopes.push(slope(support(cell), dx, dy, (rho * h * h / 4.0).sqrt()));
        }
    }
    let places: Vec<f64> = numbers(&format!("{folder}/returns.f64")).into_iter().map(f64::from_le_bytes).collect();
    for (cell, place) in numbers(&format!("{folder}/cells.i64")).into_iter().zip(places.chunks_exact(3)) {
        let ((x, _), (y, _)) = (basis(place[0]), basis(place[1]));
        surface.hits.push(hit(support(i64::from_le_bytes(cell) as usize), product(&x, &y, place[2].sqrt())));
    }
    surface
}

#[rustfmt::skip]
fn slope(c: [Ref<ControlPoint>; 16], dx: [f64; 16], dy: [f64; 16], scale: f64) -> Slope {
    Slope {
        c0: c[0], c1: c[1], c2: c[2], c3: c[3], c4: c[4], c5: c[5], c6: c[6], c7: c[7],
        c8: c[8], c9: c[9], c10: c[10], c11: c[11], c12: c[12], c13: c[13], c14: c[14], c15: c[15],
        dx0: dx[0], dx1: dx[1], dx2: dx[2], dx3: dx[3], dx4: dx[4], dx5: dx[5], dx6: dx[6], dx7: dx[7],
        dx8: dx[8], dx9: dx[9], dx10: dx[10], dx11: dx[11], dx12: dx[12], dx13: dx[13], dx14: dx[14], dx15: dx[15],
        dy0: dy[0], dy1: dy[1], dy2: dy[2], dy3: dy[3], dy4: dy[4], dy5: dy[5], dy6: dy[6], dy7: dy[7],
        dy8: dy[8], dy9: dy[9], dy10: dy[10], dy11: dy[11], dy12: dy[12], dy13: dy[13], dy14: dy[14], dy15: dy[15],
        scale,
    }
}

#[rustfmt::skip]
fn hit(c: [Ref<ControlPoint>; 16], b: [f64; 16]) -> Hit {
    Hit {
        c0: c[0], c1: c[1], c2: c[2], c3: c[3], c4: c[4], c5: c[5], c6: c[6], c7: c[7],
        c8: c[8], c9: c[9], c10: c[10], c11: c[11], c12: c[12], c13: c[13], c14: c[14], c15: c[15],
        b0: b[0], b1: b[1], b2: b[2], b3: b[3], b4: b[4], b5: b[5], b6: b[6], b7: b[7],
        b8: b[8], b9: b[9], b10: b[10], b11: b[11], b12: b[12], b13: b[13], b14: b[14], b15: b[15],
    }
}

fn main() {
    let folder = std::env::args().nth(1).expect("arael-peer DIR");
    let mut surface = load(&folder);
    let begun = Instant::now();
    let covariance = surface.assemble_covariance(CovMode::AllMarginals).expect("a covariance");
    let seconds = begun.elapsed().as_secs_f64();
    let sigmas = surface.points.iter().map(|point| covariance.std_dev(point).expect("a sigma")[0]);
    let (least, most) = sigmas.fold((f64::INFINITY, 0.0f64), |(a, b), s| (a.min(s), b.max(s)));
    println!("# arael {} parameters: all marginals {seconds:.6} s, sigma {least:.6} to {most:.6}", covariance.dim());
}

//! Figures 1 to 3: what goes in. The room, the poses, the point cloud and how uncertain its points are.

use nalgebra::SymmetricEigen;

use super::{Plate, SEED, compared};
use crate::geometry::{Bounds, Vec2};
use crate::render::{Axes, Figure, draw_poses};
use crate::scan::{LaserScan, ReturnNoise, returns_of};
use crate::sim::Scenario;

/// A colour a scan.
const SCANS: [&str; 3] = ["#d95f02", "#1b9e77", "#7570b3"];
/// Every so many returns has its ellipse drawn.
const ELLIPSES: usize = 6;
/// Ellipses are drawn this much larger than two sigma: two centimetres in eight metres are too small to see.
const MAGNIFIED: f64 = 3.0;
/// Walls are grey: the contour is black.
pub const WALL_COLOR: &str = "#8c8c8c";
pub const WALL: &str = "fill=\"none\" stroke=\"#8c8c8c\" stroke-width=\"1.8\"";

pub fn uncertain_cloud(scenario: &Scenario) -> Plate {
    let (scans, mut figure) = drawn(scenario, "Figure 1: a point cloud is uncertain, every point in its own way");
    draw_cloud(&scans, &mut figure);
    let noise = scenario.noise;
    let pose = nalgebra::Vector3::new(noise.sigma_x, noise.sigma_y, noise.sigma_theta).map(|sigma| sigma * sigma);
    let noise = ReturnNoise {
        pose: Some(crate::geometry::Cov3::from_diagonal(&pose)),
        range_variance: noise.sigma_range.powi(2),
        model_variance: 0.0,
    };
    let mut longest: f64 = 0.0;
    let mut shortest = f64::INFINITY;
    let ellipses: Vec<Vec<Vec2>> = returns_of(&scans)
        .iter()
        .step_by(ELLIPSES)
        .map(|seen| {
            let eigen = SymmetricEigen::new(noise.covariance(seen));
            let axes = eigen.eigenvalues.map(|value| 2.0 * value.max(0.0).sqrt());
            longest = longest.max(axes.max());
            shortest = shortest.min(axes.min());
            let point = |k: usize| {
                let turn = std::f64::consts::TAU * k as f64 / 24.0;
                let own = Vec2::new(axes.x * turn.cos(), axes.y * turn.sin()) * MAGNIFIED;
                seen.point + eigen.eigenvectors * own
            };
            (0..24).map(point).collect()
        })
        .collect();
    figure.path(ellipses.iter().map(Vec::as_slice), true, "fill=\"none\" stroke=\"#555\" stroke-width=\"0.7\"");
    Plate {
        name: "figure-01".into(),
        title: "Point cloud with its uncertainty".into(),
        caption: format!(
            "Returns of the three scans, a colour each; every {ELLIPSES}th with its two-sigma ellipse, {MAGNIFIED} times \
             enlarged. cov(X) = J_pose cov(pose) J_pose' + J_r sigma_r^2 J_r'."
        ),
        svg: figure.finish(),
        compared: vec![compared(
            "A point's uncertainty comes from the pose's and the range's, and grows across the beam with distance.",
            format!("Two-sigma half axes from {:.0} mm to {:.0} mm.", 1e3 * shortest, 1e3 * longest),
        )],
    }
}

pub fn room_and_poses(scenario: &Scenario) -> Plate {
    let (_, mut figure) = drawn(scenario, "Figure 2: the room and the scanner's poses");
    let reach = 0.9;
    let views: Vec<Vec<Vec2>> = scenario
        .poses
        .iter()
        .map(|pose| {
            let half = scenario.lidar.field_of_view / 2.0;
            let rim = (0..=24).map(|k| pose.project(reach, half * (f64::from(k) / 12.0 - 1.0)));
            std::iter::once(pose.position()).chain(rim).collect()
        })
        .collect();
    let fill = "fill=\"#7570b3\" fill-opacity=\"0.15\"";
    figure.path(views.iter().map(Vec::as_slice), true, fill);
    draw_poses(&scenario.poses, &mut figure);
    Plate {
        name: "figure-02".into(),
        title: "Room and poses".into(),
        caption:
            "The L-shaped room (8 m x 8 m, inner corner at (4, 4); the published room's size is not printed) and the \
                  three true poses, each with the sector it sees."
                .into(),
        svg: figure.finish(),
        compared: vec![compared("Three poses, a 180 degree scanner.", "The same; 181 beams.".into())],
    }
}

pub fn cloud(scenario: &Scenario) -> Plate {
    let (scans, mut figure) = drawn(scenario, "Figure 3: the point cloud");
    draw_cloud(&scans, &mut figure);
    let returns = returns_of(&scans);
    let off = returns.iter().map(|seen| scenario.world.signed_distance(seen.point).powi(2)).sum::<f64>();
    let rms = (off / returns.len() as f64).sqrt();
    Plate {
        name: "figure-03".into(),
        title: "The room's point cloud".into(),
        caption: "All returns where the reported poses put them, a colour a scan: where scans overlap, walls are doubled by the \
                  poses' errors."
            .into(),
        svg: figure.finish(),
        compared: vec![compared(
            "Noise of Table I on poses and ranges.",
            format!("{} returns, {:.0} mm rms off the walls.", returns.len(), 1e3 * rms),
        )],
    }
}

/// The draw that is shown, and a figure with the room's walls.
fn drawn(scenario: &Scenario, title: &str) -> (Vec<LaserScan>, Figure) {
    let mut figure = Figure::new(axes(&scenario.world.bounds()), title);
    draw_room(scenario, &mut figure);
    // An L leaves it empty.
    figure.legend_in_corner();
    (scenario.scans(SEED), figure)
}

fn axes(room: &Bounds) -> Axes {
    Axes::panel(room.grown(0.4), 680)
}

pub fn draw_room(scenario: &Scenario, figure: &mut Figure) {
    let walls: Vec<[Vec2; 2]> = scenario.world.walls().map(|(a, b)| [a, b]).collect();
    figure.path(walls.iter().map(|wall| wall.as_slice()), false, WALL);
    figure.legend(&[("true walls", WALL_COLOR)]);
}

fn draw_cloud(scans: &[LaserScan], figure: &mut Figure) {
    for ((scan, color), k) in scans.iter().zip(SCANS).zip(1..) {
        figure.legend_of_dots(&[(format!("scan {k}").as_str(), color)]);
        figure.dots(returns_of(std::slice::from_ref(scan)).iter().map(|seen| seen.point), 1.3, color);
    }
}

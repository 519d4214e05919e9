//! What many replicates say together.

use super::cases::Case;
use super::replicate::{Replicate, Truth};

pub const HEADER: &str = "world,noise,resolution,beams,replicates,converged,coverage_plain,coverage_corners,coverage_inside,\
ratio,bias,boundary_rms,inside_rmse,smooth_rmse,pose_position,pose_heading,pose_coverage,factorisations,seconds,\
eikonal_weight,eikonal_scale,smoothing";

/// The figures of one case; see the fields of [`HEADER`].
pub struct Tally {
    replicates: usize,
    converged: f64,
    coverage_plain: f64,
    coverage_corners: f64,
    coverage_inside: f64,
    ratio: f64,
    bias: f64,
    boundary_rms: f64,
    inside_rmse: f64,
    smooth_rmse: f64,
    pose_position: f64,
    pose_heading: f64,
    pose_coverage: f64,
    factorisations: f64,
    seconds: f64,
    weights: [f64; 3],
}

impl Tally {
    pub fn of(truth: &Truth, all: Vec<Replicate>) -> Self {
        let boundary = |keep: &dyn Fn(usize) -> bool| covered(&all, keep, |r| &r.boundary);
        let n = all.len() as f64;
        let mut ratios = Vec::new();
        let mut bias = Vec::new();
        for k in (0..truth.boundary.len()).filter(|&k| truth.plain[k]) {
            let mean = all.iter().map(|r| r.boundary[k].0).sum::<f64>() / n;
            let spread = all.iter().map(|r| (r.boundary[k].0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let predicted = all.iter().map(|r| r.boundary[k].1.powi(2)).sum::<f64>() / n;
            ratios.push((predicted / spread).sqrt());
            bias.push(mean);
        }
        let poses = || all.iter().flat_map(|r| &r.poses);
        let ratio_of = |axes: &[usize]| {
            let sum =
                |which: usize| poses().map(|p| axes.iter().map(|&a| p[which][a].powi(2)).sum::<f64>()).sum::<f64>();
            (sum(1) / sum(0)).sqrt()
        };
        let held = poses().flat_map(|p| (0..3).map(move |a| p[1][a].abs() <= 2.0 * p[2][a]));
        let smooth = |k: usize| truth.smooth[k];
        Self {
            replicates: all.len(),
            converged: share(all.iter().map(|r| r.converged)),
            coverage_plain: boundary(&|k| truth.plain[k]),
            coverage_corners: boundary(&|_| true),
            coverage_inside: covered(&all, &smooth, |r| &r.inside),
            ratio: median(ratios),
            bias: rms(bias.into_iter()),
            boundary_rms: median(all.iter().map(|r| rms(r.boundary.iter().map(|b| b.0))).collect()),
            inside_rmse: median(all.iter().map(|r| rms(r.inside.iter().map(|b| b.0))).collect()),
            smooth_rmse: median(
                all.iter().map(|r| rms(r.inside.iter().zip(&truth.smooth).filter(|s| *s.1).map(|b| b.0.0))).collect(),
            ),
            pose_position: ratio_of(&[0, 1]),
            pose_heading: ratio_of(&[2]),
            pose_coverage: share(held),
            factorisations: median(all.iter().map(|r| r.factorisations as f64).collect()),
            seconds: median(all.iter().map(|r| r.seconds).collect()),
            weights: [0, 1, 2].map(|k| median(all.iter().map(|r| r.weights[k]).collect())),
        }
    }

    /// The figures as a line of the table.
    pub fn line(&self, case: &Case) -> String {
        let [eikonal, scale, smoothing] = self.weights;
        format!(
            "{},{},{},{},{},{:.2},{:.3},{:.3},{:.3},{:.3},{:.4},{:.4},{:.4},{:.4},{:.2},{:.2},{:.3},{:.0},{:.2},{:.0},{:.3},{:.2}",
            case.world,
            case.noise,
            case.scenario.resolution,
            case.beams,
            self.replicates,
            self.converged,
            self.coverage_plain,
            self.coverage_corners,
            self.coverage_inside,
            self.ratio,
            self.bias,
            self.boundary_rms,
            self.inside_rmse,
            self.smooth_rmse,
            self.pose_position,
            self.pose_heading,
            self.pose_coverage,
            self.factorisations,
            self.seconds,
            eikonal,
            scale,
            smoothing,
        )
    }
}

fn covered(all: &[Replicate], keep: &dyn Fn(usize) -> bool, of: impl Fn(&Replicate) -> &Vec<(f64, f64)>) -> f64 {
    share(all.iter().flat_map(|r| {
        of(r)
            .iter()
            .enumerate()
            .filter(|(k, _)| keep(*k))
            .map(|(_, (e, sigma))| e.abs() <= 2.0 * sigma)
            .collect::<Vec<_>>()
    }))
}

fn share(held: impl Iterator<Item = bool>) -> f64 {
    let (yes, n) = held.fold((0.0, 0.0), |(yes, n), held| (yes + f64::from(u8::from(held)), n + 1.0));
    yes / n
}

pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (sum / n).sqrt()
}

pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    if values.is_empty() { f64::NAN } else { 0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2]) }
}

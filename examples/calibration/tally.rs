//! What many replicates say together.

use super::cases::Case;
use super::replicate::{Replicate, Truth};

pub const HEADER: &str = "world,noise,resolution,beams,replicates,converged,coverage_plain,coverage_corners,coverage_inside,\
ratio,ratio_median,pose_coverage,coverage_plain_se,coverage_corners_se,coverage_inside_se,ratio_se,ratio_median_se,\
pose_coverage_se,bias,boundary_rms,inside_rmse,smooth_rmse,pose_position,pose_heading,factorisations,seconds,\
eikonal_weight,eikonal_scale,smoothing";

/// The draws fall into so many groups, of which the jackknife leaves out one at a time.
const GROUPS: usize = 20;

/// How far sigma is to be believed.
#[derive(Clone, Copy)]
struct Trust {
    coverage_plain: f64,
    coverage_corners: f64,
    coverage_inside: f64,
    /// Median over the wall's points: root mean square of the draws' sigmas over their errors' standard deviation.
    ratio: f64,
    /// The same with the median of the draws' sigmas: the mean square follows the few widest.
    ratio_median: f64,
    pose_coverage: f64,
}

impl Trust {
    fn of(truth: &Truth, all: &[&Replicate]) -> Self {
        let boundary = |keep: &dyn Fn(usize) -> bool| covered(all, keep, |r| &r.boundary);
        let mut ratios = (Vec::new(), Vec::new());
        for k in (0..truth.boundary.len()).filter(|&k| truth.plain[k]) {
            let spread = deviation(all.iter().map(|r| r.boundary[k].0));
            ratios.0.push(rms(all.iter().map(|r| r.boundary[k].1)) / spread);
            ratios.1.push(median(all.iter().map(|r| r.boundary[k].1).collect()) / spread);
        }
        let poses = all.iter().flat_map(|r| &r.poses);
        Self {
            coverage_plain: boundary(&|k| truth.plain[k]),
            coverage_corners: boundary(&|_| true),
            coverage_inside: covered(all, &|k| truth.smooth[k], |r| &r.inside),
            ratio: median(ratios.0),
            ratio_median: median(ratios.1),
            pose_coverage: share(poses.flat_map(|p| (0..3).map(move |a| p[1][a].abs() <= 2.0 * p[2][a]))),
        }
    }

    fn all(&self) -> [f64; 6] {
        let Self { coverage_plain, coverage_corners, coverage_inside, ratio, ratio_median, pose_coverage } = *self;
        [coverage_plain, coverage_corners, coverage_inside, ratio, ratio_median, pose_coverage]
    }

    /// The figures' standard errors by the grouped jackknife: what another set of draws would change.
    fn standard_errors(truth: &Truth, all: &[&Replicate]) -> [f64; 6] {
        let groups = GROUPS.min(all.len());
        let without = |group: usize| -> [f64; 6] {
            let rest: Vec<&Replicate> =
                all.iter().enumerate().filter(|(k, _)| k % groups != group).map(|(_, own)| *own).collect();
            Self::of(truth, &rest).all()
        };
        let left: Vec<[f64; 6]> = (0..groups).map(without).collect();
        std::array::from_fn(|figure| {
            let spread = deviation(left.iter().map(|own| own[figure]));
            spread * (groups - 1) as f64 / (groups as f64).sqrt()
        })
    }
}

/// The figures of one case; see the fields of [`HEADER`].
pub struct Tally {
    replicates: usize,
    converged: f64,
    trust: [f64; 6],
    standard_errors: [f64; 6],
    bias: f64,
    boundary_rms: f64,
    inside_rmse: f64,
    smooth_rmse: f64,
    pose_position: f64,
    pose_heading: f64,
    factorisations: f64,
    seconds: f64,
    weights: [f64; 3],
}

impl Tally {
    pub fn of(truth: &Truth, drawn: &[Replicate]) -> Self {
        let all: Vec<&Replicate> = drawn.iter().collect();
        let bias = (0..truth.boundary.len())
            .filter(|&k| truth.plain[k])
            .map(|k| all.iter().map(|r| r.boundary[k].0).sum::<f64>() / all.len() as f64);
        let ratio_of = |axes: &[usize]| {
            let error = |which: usize| {
                rms(all.iter().flat_map(|r| &r.poses).flat_map(|p| axes.iter().map(move |&axis| p[which][axis])))
            };
            error(1) / error(0)
        };
        Self {
            replicates: all.len(),
            converged: share(all.iter().map(|r| r.converged)),
            trust: Trust::of(truth, &all).all(),
            standard_errors: Trust::standard_errors(truth, &all),
            bias: rms(bias),
            boundary_rms: median(all.iter().map(|r| rms(r.boundary.iter().map(|b| b.0))).collect()),
            inside_rmse: median(all.iter().map(|r| rms(r.inside.iter().map(|b| b.0))).collect()),
            smooth_rmse: median(
                all.iter().map(|r| rms(r.inside.iter().zip(&truth.smooth).filter(|s| *s.1).map(|b| b.0.0))).collect(),
            ),
            pose_position: ratio_of(&[0, 1]),
            pose_heading: ratio_of(&[2]),
            factorisations: median(all.iter().map(|r| r.factorisations as f64).collect()),
            seconds: median(all.iter().map(|r| r.seconds).collect()),
            weights: [0, 1, 2].map(|k| median(all.iter().map(|r| r.weights[k]).collect())),
        }
    }

    /// The figures as a line of the table.
    pub fn line(&self, case: &Case) -> String {
        let trust: Vec<String> = self.trust.iter().chain(&self.standard_errors).map(|v| format!("{v:.3}")).collect();
        let [eikonal, scale, smoothing] = self.weights;
        format!(
            "{},{},{},{},{},{:.2},{},{:.4},{:.4},{:.4},{:.4},{:.2},{:.2},{:.0},{:.2},{:.0},{:.3},{:.2}",
            case.world,
            case.noise,
            case.scenario.resolution,
            case.beams,
            self.replicates,
            self.converged,
            trust.join(","),
            self.bias,
            self.boundary_rms,
            self.inside_rmse,
            self.smooth_rmse,
            self.pose_position,
            self.pose_heading,
            self.factorisations,
            self.seconds,
            eikonal,
            scale,
            smoothing,
        )
    }
}

fn covered(all: &[&Replicate], keep: &dyn Fn(usize) -> bool, of: impl Fn(&Replicate) -> &Vec<(f64, f64)>) -> f64 {
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

/// The sample's standard deviation.
fn deviation(values: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let n = values.len() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
}

pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (sum / n).sqrt()
}

pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    if values.is_empty() { f64::NAN } else { 0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2]) }
}

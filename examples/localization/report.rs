//! Errors of located scans against the truth, and how honest their covariances are.

use mapfit::geometry::{Pose, wrap_angle};
use mapfit::localize::Located;
use nalgebra::Vector3;

/// The 95 % quantile of chi squared with three degrees of freedom.
const WITHIN: f64 = 7.815;

/// Errors of located scans against the truth, and how many truths lie within the 95 % ellipsoid.
pub fn report(title: &str, located: &[Located], truths: &[Pose], seconds: f64) {
    let mut errors = Vec::new();
    let (mut covered, mut failed, mut lost, mut narrow) = (0, 0, 0, 0);
    for (own, truth) in located.iter().zip(truths) {
        let (Some(pose), Some(covariance)) = (own.pose, own.covariance) else {
            lost += 1;
            continue;
        };
        let off = Vector3::new(pose.x - truth.x, pose.y - truth.y, wrap_angle(pose.theta - truth.theta));
        errors.push(off.xy().norm());
        failed += usize::from(off.xy().norm() > 0.5 || off.z.abs() > 10f64.to_radians());
        match covariance.try_inverse() {
            Some(inverse) => covered += usize::from(off.dot(&(inverse * off)) <= WITHIN),
            None => narrow += 1,
        }
    }
    errors.sort_by(f64::total_cmp);
    let at =
        |share: f64| errors.get(((errors.len() as f64 - 1.0) * share).round() as usize).map_or(f64::NAN, |e| 1e3 * e);
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt() * 1e3;
    println!(
        "{title}: {} scans, {lost} nowhere, {failed} wrong; median {:.0} rms {rms:.0} 95 % {:.0} mm; {:.0} % in the 95 % \
         ellipsoid ({narrow} singular); {:.1} ms a scan",
        truths.len(),
        at(0.5),
        at(0.95),
        100.0 * covered as f64 / errors.len().max(1) as f64,
        1e3 * seconds / truths.len() as f64,
    );
}

/// How often the truth is the first of the hypotheses, and among five.
pub fn hypotheses(located: &[Located], truths: &[Pose]) {
    let right = |pose: &Pose, truth: &Pose| {
        (pose.position() - truth.position()).norm() < 0.3
            && wrap_angle(pose.theta - truth.theta).abs() < 5f64.to_radians()
    };
    let first = |own: &Located, truth: &Pose| own.hypotheses.first().is_some_and(|best| right(&best.pose, truth));
    let five = |own: &Located, truth: &Pose| own.hypotheses.iter().any(|one| right(&one.pose, truth));
    let count = |test: &dyn Fn(&Located, &Pose) -> bool| {
        located.iter().zip(truths).filter(|(own, truth)| test(own, truth)).count()
    };
    println!("  right first {} and among five {} of {}", count(&first), count(&five), truths.len());
}

//! What a map is, for a person who waited for it: how large, of how much, how good.

use std::fmt::Write;

use serde_json::Value;

/// The lines of a map's summary, of its `lattice` and `fit`, and of what was said of its scans' log.
pub fn summary(map: &Value, notes: &[String]) -> String {
    let fit = &map["fit"];
    let lines = [
        ("size", size(&map["lattice"], fit["active_control_points"].as_u64())),
        ("returns", fit["observations"].to_string()),
        ("left out", left_out(fit["seen_through"].as_f64())),
        ("log", notes.join("; ")),
        ("rms", rms(fit["rms"].as_f64())),
        ("seconds", seconds(fit)),
        ("converged", converged(fit)),
    ];
    let mut text = String::new();
    for (name, said) in lines.iter().filter(|(_, said)| !said.is_empty()) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {name:<13}{said}");
    }
    text
}

fn size(lattice: &Value, active: Option<u64>) -> String {
    let spacing = lattice["resolution"].as_f64().unwrap_or(f64::NAN);
    let [nx, ny] = [0, 1].map(|axis: usize| lattice["cells"][axis].as_u64().unwrap_or(0));
    let [width, height] = [nx, ny].map(|cells| cells as f64 * spacing);
    let used = active.map(|active| format!(" ({active} in use)")).unwrap_or_default();
    format!("{} x {} control points{used}, {spacing} m apart: {width:.1} m x {height:.1} m", nx + 3, ny + 3)
}

fn left_out(share: Option<f64>) -> String {
    match share {
        None => String::new(),
        Some(share) if share <= 0.0 => "nothing".into(),
        Some(share) => {
            format!("{:.2} % of the returns, where beams of other scans passed: people, doors, glass", 100.0 * share)
        }
    }
}

fn rms(metres: Option<f64>) -> String {
    metres.map(|rms| format!("{:.1} mm from returns to surfaces", 1e3 * rms)).unwrap_or_default()
}

fn seconds(fit: &Value) -> String {
    let of = |value: &Value| value.as_f64().unwrap_or_default();
    let stages = &fit["stages"];
    let (fitting, covariance) = (of(&stages["fitting"]), of(&stages["covariance"]));
    format!("{:.1} ({fitting:.1} fitting, {covariance:.1} covariance)", of(&fit["seconds"]))
}

fn converged(fit: &Value) -> String {
    match (fit["converged"] == true, fit["unconverged"].as_str()) {
        (true, _) => format!("yes, after {} steps", fit["iterations"]),
        (false, Some(why)) => format!("NO: {why}"),
        (false, None) => "NO".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_summary_has_size_returns_what_is_left_out_rms_seconds_and_whether_the_fit_converged() {
        let mut map = json!({
            "lattice": {"resolution": 0.2, "cells": [36, 40]},
            "fit": {
                "observations": 543, "seen_through": 0.0123, "rms": 0.0213, "seconds": 1.24, "iterations": 31,
                "stages": {"fitting": 1.0, "covariance": 0.24}, "converged": true,
            },
        });
        let notes = ["2 of 9 scans are left out".to_owned()];
        let expected = "  size         39 x 43 control points, 0.2 m apart: 7.2 m x 8.0 m
  returns      543
  left out     1.23 % of the returns, where beams of other scans passed: people, doors, glass
  log          2 of 9 scans are left out
  rms          21.3 mm from returns to surfaces
  seconds      1.2 (1.0 fitting, 0.2 covariance)
  converged    yes, after 31 steps
";
        assert_eq!(summary(&map, &notes), expected);
        map["fit"]["converged"] = false.into();
        map["fit"]["unconverged"] = "1 step is too few".into();
        assert!(summary(&map, &[]).ends_with("  converged    NO: 1 step is too few\n"));
    }
}

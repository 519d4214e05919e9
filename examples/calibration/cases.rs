//! What is studied: every world at three resolutions, at five levels of noise, and with other beams.

use std::path::Path;

use mapfit::geometry::{Bounds, Pose, Vec2};
use mapfit::scan::Noise;
use mapfit::sim::{Lidar, Scenario, World};

pub struct Case {
    pub name: String,
    pub world: &'static str,
    pub noise: &'static str,
    pub beams: String,
    pub scenario: Scenario,
}

/// Experiment 1's noise with poses and ranges scaled.
fn noise(poses: f64, ranges: f64) -> Noise {
    let one = Noise::EXPERIMENT_ONE;
    Noise {
        sigma_x: one.sigma_x * poses,
        sigma_y: one.sigma_y * poses,
        sigma_theta: one.sigma_theta * poses,
        sigma_range: one.sigma_range * ranges,
    }
}

pub fn all(data: &Path) -> Result<Vec<Case>, Box<dyn std::error::Error>> {
    let mut cases = Vec::new();
    let worlds = [
        ("L", Scenario::experiment_one()),
        ("U", Scenario::u_room()),
        ("T", Scenario::t_room()),
        ("pillars", Scenario::pillar_room()),
        ("house", house(data)?),
    ];
    for (world, base) in worlds {
        let mut add = |noise_name: &'static str, noise: Noise, resolution: f64, scans: &[Pose], lidar: Lidar| {
            let scenario = Scenario { noise, resolution, lidar, poses: scans.to_vec(), ..base.clone() };
            let beams = format!("{}x{}", scans.len(), lidar.beams);
            let name = format!("{world}/{noise_name}/{resolution}/{beams}");
            cases.push(Case { name, world, noise: noise_name, beams, scenario });
        };
        let narrow = base.lidar;
        for resolution in [0.1, 0.2, 0.4] {
            add("as1", noise(1.0, 1.0), resolution, &base.poses, narrow);
        }
        add("half", noise(0.5, 0.5), 0.2, &base.poses, narrow);
        add("five", noise(5.0, 5.0), 0.2, &base.poses, narrow);
        add("poses5", noise(5.0, 1.0), 0.2, &base.poses, narrow);
        add("ranges5", noise(1.0, 5.0), 0.2, &base.poses, narrow);
        let wide = Lidar::of_degrees(270, 270.0);
        let doubled = doubled(&base);
        add("as1", noise(1.0, 1.0), 0.2, &doubled, wide);
        add("poses5", noise(5.0, 1.0), 0.2, &doubled, wide);
        add("as1", noise(1.0, 1.0), 0.2, &base.poses, Lidar::of_degrees(721, 180.0));
    }
    Ok(cases)
}

/// Every pose, and a second one half a metre ahead of it that looks the other way.
fn doubled(scenario: &Scenario) -> Vec<Pose> {
    let ahead = |pose: &Pose| {
        let place = pose.position() + pose.direction(0.0) * 0.5;
        Pose::new(place.x, place.y, pose.theta + 2.0)
    };
    scenario.poses.iter().flat_map(|pose| [*pose, ahead(pose)]).collect()
}

/// The upper left room of the HouseExpo plan, with its slanted wall and what is seen of the doorways.
fn house(data: &Path) -> Result<Scenario, Box<dyn std::error::Error>> {
    #[derive(serde::Deserialize)]
    struct Plan {
        verts: Vec<[f64; 2]>,
    }
    let file = data.join("house-expo/room_1451.json");
    let text = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    let plan: Plan = serde_json::from_str(&text)?;
    let world = World { outline: plan.verts.iter().map(|v| Vec2::new(v[0], v[1])).collect(), pillars: vec![] };
    let poses = [[1.2, 9.6, -0.9], [3.4, 6.2, 1.9], [0.9, 6.3, 0.7]];
    let scenario = Scenario::like_experiment_one(world, &poses);
    Ok(Scenario { bounds: Bounds { min: [-0.5, 4.5], max: [6.5, 11.4] }, ..scenario })
}

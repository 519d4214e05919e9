//! Level lines of the distance, and the band in which a level lies within so many standard deviations.
//!
//! Level 0 is where the field vanishes, and of a vector map its band reaches as many standard deviations of the field to
//! either side. Other levels are traced on the distance, and so is the band
//! of a signed map: where `|u - level| <= k sigma`, traced on the signed ratio `(u - level) / sigma`, which crosses a
//! band narrower than the sampling cleanly. Both are kept where there is evidence: a level in space nobody saw is not a
//! wall.

use geo_types::{Coord, LineString, MultiLineString, MultiPolygon, Polygon};

use super::{ALWAYS, RenderError, Wanted, asked_seldom, still};
use crate::fit::Distance;
use crate::geometry::{Vec2, turned};
use crate::map::{FittedMap, Samples, level_lines, zero_lines};
use crate::uncertainty::Kind;

/// Ratios beyond this many sigma are all the same.
const FAR: f64 = 1e3;

/// A level's lines, and the band around it where one was asked for; metres in the map's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Contours {
    pub level: f64,
    pub lines: MultiLineString<f64>,
    /// The band's half-width in standard deviations, and the band.
    pub band: Option<(f64, MultiPolygon<f64>)>,
}

/// Traces a level, and with `sigma_band` the band of that many standard deviations.
pub fn contours(map: &FittedMap, level: f64, sigma_band: Option<f64>, kind: Kind) -> Result<Contours, RenderError> {
    contours_while(map, level, sigma_band, kind, ALWAYS)
}

/// Traces them as long as they are wanted.
pub fn contours_while(
    map: &FittedMap,
    level: f64,
    sigma_band: Option<f64>,
    kind: Kind,
    wanted: Wanted,
) -> Result<Contours, RenderError> {
    let goes_on = asked_seldom(wanted);
    let lines = match level {
        0.0 => zero_lines(map.chart())?,
        level => level_lines(map.chart(), level, |p| goes_on().then(|| map.distance_and_gradient(p))?)?,
    };
    still(wanted)?;
    let vector = map.field.distance() == Distance::Vector;
    let band = match sigma_band {
        Some(k) if level == 0.0 && vector => {
            let strips = lines.iter().map(|line| Polygon::new(line_string(&strip(map, line, k, kind)), vec![]));
            Some((k, MultiPolygon(strips.collect())))
        }
        Some(k) => Some((k, band(map, level, k, kind, wanted)?)),
        None => None,
    };
    Ok(Contours { level, lines: MultiLineString(lines.iter().map(|line| line_string(line)).collect()), band })
}

fn line_string(line: &[Vec2]) -> LineString<f64> {
    LineString(line.iter().map(|p| Coord { x: p.x, y: p.y }).collect())
}

/// The ring `k` standard deviations around a line, counter-clockwise.
fn strip(map: &FittedMap, line: &[Vec2], k: f64, kind: Kind) -> Vec<Vec2> {
    let side = |sign: f64| -> Vec<Vec2> {
        (0..line.len())
            .map(|at| {
                let ahead = line[(at + 1).min(line.len() - 1)] - line[at.saturating_sub(1)];
                let across = turned(ahead).try_normalize(0.0).unwrap_or_default();
                let sigma = map.field.across(line[at], kind).map_or(0.0, |(_, sigma)| sigma);
                line[at] + across * (sign * k * sigma)
            })
            .collect()
    };
    let mut ring = side(-1.0);
    ring.extend(side(1.0).into_iter().rev());
    ring.push(ring[0]);
    ring
}

fn band(map: &FittedMap, level: f64, k: f64, kind: Kind, wanted: Wanted) -> Result<MultiPolygon<f64>, RenderError> {
    let samples = Samples::over(map.lattice());
    let ratio = |p: Vec2| match map.distance(p, kind) {
        Some((u, sigma)) if map.evidence.at(map.lattice(), p).any() => {
            ((u - level) / sigma.max(1e-12)).clamp(-FAR, FAR)
        }
        _ => FAR,
    };
    let goes_on = asked_seldom(wanted);
    let ratios = samples.collect(|p| if goes_on() { ratio(p) } else { FAR });
    still(wanted)?;
    let bands = samples.tracer().isobands(&ratios, &[-k, k])?;
    // Where nobody looked there is no ratio, and from a far one on the level's other side to none there seems to lie a
    // band. Somewhere on its edge a band has the ratio that it is made of, as finely as it was sampled.
    let is_there = |polygon: &&Polygon<f64>| {
        polygon.exterior().0.iter().any(|&p| ratio(samples.to_world(p)).abs() < FAR.min(10.0 * k.max(1.0)))
    };
    let polygons = bands.iter().flat_map(|band| &band.geometry().0).filter(is_there).map(|polygon| {
        let ring = |ring: &LineString<f64>, outer: bool| {
            let points = ring.0.iter().map(|&p| samples.to_world(p)).map(|p| Coord { x: p.x, y: p.y }).collect();
            oriented(LineString(points), outer)
        };
        let holes = polygon.interiors().iter().map(|hole| ring(hole, false)).collect();
        Polygon::new(ring(polygon.exterior(), true), holes)
    });
    Ok(MultiPolygon(polygons.collect()))
}

/// The ring wound as RFC 7946 asks: counter-clockwise outside, clockwise for a hole.
fn oriented(mut ring: LineString<f64>, outer: bool) -> LineString<f64> {
    let doubled: f64 = ring.0.windows(2).map(|e| e[0].x * e[1].y - e[1].x * e[0].y).sum();
    if (doubled > 0.0) != outer {
        ring.0.reverse();
    }
    ring
}

//! The lines on which a field vanishes: what a contour draws.

use ::contour::Error;

use super::{level, walls};
use crate::fit::Distance;
use crate::geometry::Vec2;
use crate::map::Chart;

/// Traces the lines.
pub(crate) fn zero_lines(chart: Chart<'_>) -> Result<Vec<Vec<Vec2>>, Error> {
    match chart.field.distance() {
        Distance::Vector => Ok(walls::walls(chart)),
        Distance::Signed => level::level_lines(chart, 0.0, |p| chart.field.slope(p)),
    }
}

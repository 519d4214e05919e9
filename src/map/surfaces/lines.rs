//! The lines on which a field vanishes: what a contour draws.

use ::contour::Error;

use super::{level, walls};
use crate::geometry::Vec2;
use crate::map::{Chart, Field};

/// Traces the lines.
pub(crate) fn zero_lines(chart: Chart<'_>) -> Result<Vec<Vec<Vec2>>, Error> {
    match chart.field {
        Field::Vector { .. } => Ok(walls::walls(chart)),
        Field::Signed { .. } => level::level_lines(chart, 0.0, |p| chart.field.slope(p)),
    }
}

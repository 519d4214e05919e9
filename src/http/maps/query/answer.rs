//! What a map answers: an array a field, in the points' order, and how it travels.

use utoipa::ToSchema;

use super::columns::{Column, Flags, Rows, Scalars};
use super::question::Question;
use super::{FIELDS, SIGNED_ALONE, VECTOR_ALONE};
use crate::fit::Distance;
use crate::geometry::{Cov2, Vec2};
use crate::http::shared::problem::Problem;
use crate::http::shared::ration::PIECE;
use crate::map::FittedMap;
use crate::map::npz::{NpzError, NpzWriter};
use crate::uncertainty::Kind;

/// Numbers a point that each of [`FIELDS`] has; `observed` takes less.
const WIDTHS: [usize; FIELDS.len()] = [1, 2, 1, 2, 1, 1, 3, 2, 2, 3];
/// Points between two looks at whether the client still waits, and in one stretch of text.
const STRETCH: usize = 1024;

/// Arrays in the order of the points, those of `fields`; a point outside the lattice has nulls, and one where no control
/// points are in use has nothing but `observed` and `clearance`.
#[derive(Debug, Default, ToSchema)]
pub struct QueryAnswer {
    pub kind: &'static str,
    /// To the nearest surface, metres; of an sdf negative in free space.
    #[schema(value_type = Option<Vec<Option<f64>>>, nullable = false)]
    pub distance: Option<Scalars>,
    #[schema(value_type = Option<Vec<Option<[f64; 2]>>>, nullable = false)]
    pub gradient: Option<Rows<2>>,
    /// The standard deviation of the distance, metres.
    #[schema(value_type = Option<Vec<Option<f64>>>, nullable = false)]
    pub sigma: Option<Scalars>,
    /// The surface point that the distance is measured from; null where the map has no surface.
    #[schema(value_type = Option<Vec<Option<[f64; 2]>>>, nullable = false)]
    pub nearest: Option<Rows<2>>,
    /// The unsigned distance to the nearest surface or to space that nobody observed, whichever is nearer, metres.
    #[schema(value_type = Option<Vec<Option<f64>>>, nullable = false)]
    pub clearance: Option<Scalars>,
    /// Whether there is evidence here: a beam passed, or a surface was met within half a cell.
    #[schema(value_type = Option<Vec<Option<bool>>>, nullable = false)]
    pub observed: Option<Flags>,
    /// sdf alone: [xx, xy, yy]
    #[schema(value_type = Option<Vec<Option<[f64; 3]>>>, nullable = false)]
    pub gradient_covariance: Option<Rows<3>>,
    /// sdf alone: the distance's covariance with the gradient, [dx, dy].
    #[schema(value_type = Option<Vec<Option<[f64; 2]>>>, nullable = false)]
    pub distance_gradient_covariance: Option<Rows<2>>,
    /// vdf alone: the spline's value, metres.
    #[schema(value_type = Option<Vec<Option<[f64; 2]>>>, nullable = false)]
    pub vector: Option<Rows<2>>,
    /// vdf alone: [xx, xy, yy]
    #[schema(value_type = Option<Vec<Option<[f64; 3]>>>, nullable = false)]
    pub vector_covariance: Option<Rows<3>>,
}

impl QueryAnswer {
    /// Of an answer to a question of so many points and fields, bytes at most.
    pub fn bytes(question: &Question) -> usize {
        let marked = WIDTHS.iter().zip(question.fields).filter(|(_, marked)| *marked);
        question.points.len() * marked.map(|(width, _)| width * size_of::<f64>()).sum::<usize>()
    }

    /// Asks the map about every point, as long as `wanted` holds.
    pub fn of(map: &FittedMap, question: &Question, wanted: &dyn Fn() -> bool) -> Result<Self, Problem> {
        let mut answer = Self::empty(map.field.distance(), question);
        for stretch in question.points.chunks(STRETCH) {
            if !wanted() {
                return Err(Problem::too_slow());
            }
            answer.ask(map, question.kind, stretch);
        }
        Ok(answer)
    }

    /// Without points: the arrays that are wanted and that a distance has.
    fn empty(distance: Distance, question: &Question) -> Self {
        let other = if distance == Distance::Vector { SIGNED_ALONE } else { VECTOR_ALONE };
        let wanted = |at: usize| question.fields[at] && !other.contains(&at);
        let n = question.points.len();
        let scalars = |at| wanted(at).then(|| Scalars(Vec::with_capacity(n)));
        fn rows<const K: usize>(wanted: bool, n: usize) -> Option<Rows<K>> {
            wanted.then(|| Rows(Vec::with_capacity(n)))
        }
        Self {
            kind: if question.kind == Kind::Propagated { "propagated" } else { "posterior" },
            distance: scalars(0),
            gradient: rows(wanted(1), n),
            sigma: scalars(2),
            nearest: rows(wanted(3), n),
            clearance: scalars(4),
            observed: wanted(5).then(|| Flags(Vec::with_capacity(n))),
            gradient_covariance: rows(wanted(6), n),
            distance_gradient_covariance: rows(wanted(7), n),
            vector: rows(wanted(8), n),
            vector_covariance: rows(wanted(9), n),
        }
    }

    fn ask(&mut self, map: &FittedMap, kind: Kind, points: &[Vec2]) {
        let slopes = self.gradient_covariance.is_some() || self.distance_gradient_covariance.is_some();
        let surface = self.distance.is_some() || self.gradient.is_some() || self.sigma.is_some() || slopes;
        for p in points {
            let at = surface.then(|| map.query(*p, kind)).flatten();
            add(&mut self.distance, at.map(|at| at.distance));
            add_row(&mut self.gradient, at.map(|at| at.gradient.into()));
            add(&mut self.sigma, at.map(|at| at.sigma));
            if let Some(nearest) = &mut self.nearest {
                let foot = at.and_then(|at| at.nearest).or_else(|| map.nearest(*p));
                nearest.0.push(foot.map_or([f64::NAN; 2], Into::into));
            }
            if let Some(clearance) = &mut self.clearance {
                clearance.0.push(map.clearance(*p).unwrap_or(f64::NAN));
            }
            if let Some(observed) = &mut self.observed {
                observed.0.push(map.observed(*p));
            }
            let slopes = at.and_then(|at| at.slopes);
            add_row(&mut self.gradient_covariance, slopes.map(|slopes| packed(slopes.gradient)));
            add_row(&mut self.distance_gradient_covariance, slopes.map(|slopes| slopes.with_distance.into()));
            if let Some(vector) = &mut self.vector {
                vector.0.push(map.vector(*p).map_or([f64::NAN; 2], Into::into));
            }
            if let Some(covariance) = &mut self.vector_covariance {
                covariance.0.push(map.vector_covariance(*p, kind).unwrap_or([f64::NAN; 3]));
            }
        }
    }

    fn columns(&self) -> Vec<(&'static str, &dyn Column)> {
        fn of<C: Column>(column: &Option<C>) -> Option<&dyn Column> {
            column.as_ref().map(|column| column as &dyn Column)
        }
        let all = [
            of(&self.distance),
            of(&self.gradient),
            of(&self.sigma),
            of(&self.nearest),
            of(&self.clearance),
            of(&self.observed),
            of(&self.gradient_covariance),
            of(&self.distance_gradient_covariance),
            of(&self.vector),
            of(&self.vector_covariance),
        ];
        FIELDS.into_iter().zip(all).filter_map(|(name, column)| Some((name, column?))).collect()
    }

    /// As arrays of the same names; what is null is NaN, and false for `observed`.
    pub fn npz(&self) -> Result<Vec<u8>, NpzError> {
        let mut npz = NpzWriter::default();
        for (name, column) in self.columns() {
            column.store(name, &mut npz)?;
        }
        npz.finish()
    }

    /// As JSON, in pieces that are written when they are asked for.
    pub fn json(self, points: usize) -> Pieces {
        Pieces { answer: self, points, column: 0, point: 0 }
    }
}

fn add(column: &mut Option<Scalars>, value: Option<f64>) {
    if let Some(column) = column {
        column.0.push(value.unwrap_or(f64::NAN));
    }
}

fn add_row<const K: usize>(column: &mut Option<Rows<K>>, row: Option<[f64; K]>) {
    if let Some(column) = column {
        column.0.push(row.unwrap_or([f64::NAN; K]));
    }
}

fn packed(covariance: Cov2) -> [f64; 3] {
    [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]]
}

/// The JSON of an answer, a stretch of a column at a time.
pub struct Pieces {
    answer: QueryAnswer,
    points: usize,
    /// Where the text is: which column, and how many of its points are written.
    column: usize,
    point: usize,
}

impl Iterator for Pieces {
    type Item = serde_json::Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        let columns = self.answer.columns();
        if self.column > columns.len() {
            return None;
        }
        let mut text = Vec::new();
        if (self.column, self.point) == (0, 0) {
            text.extend_from_slice(format!("{{\"kind\":\"{}\"", self.answer.kind).as_bytes());
        }
        while text.len() < PIECE {
            let Some((name, column)) = columns.get(self.column) else {
                self.column += 1;
                text.push(b'}');
                break;
            };
            let lead = if self.point == 0 { format!(",\"{name}\":[") } else { ",".to_owned() };
            text.extend_from_slice(lead.as_bytes());
            let end = self.points.min(self.point + STRETCH);
            if let Err(error) = column.write(self.point..end, &mut text) {
                return Some(Err(error));
            }
            self.point = end;
            if end == self.points {
                text.push(b']');
                (self.column, self.point) = (self.column + 1, 0);
            }
        }
        Some(Ok(text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pieces_of_an_answer_are_one_document() {
        for points in [0, 1, STRETCH, 3 * STRETCH + 7] {
            let numbers: Vec<f64> = (0..points).map(|k| if k % 5 == 0 { f64::NAN } else { k as f64 / 3.0 }).collect();
            let answer = QueryAnswer {
                kind: "posterior",
                distance: Some(Scalars(numbers.clone())),
                gradient: Some(Rows(numbers.iter().map(|v| [*v, 1.0]).collect())),
                observed: Some(Flags(numbers.iter().map(|v| Some(v.is_nan())).collect())),
                ..Default::default()
            };
            let text: Vec<u8> = answer.json(points).flat_map(Result::unwrap).collect();
            let document: serde_json::Value = serde_json::from_slice(&text).unwrap();
            assert_eq!(document.as_object().unwrap().len(), 4);
            for (k, value) in numbers.iter().enumerate() {
                assert_eq!(document["distance"][k].as_f64(), Some(*value).filter(|v| v.is_finite()));
                assert_eq!(document["gradient"][k][0].as_f64(), Some(*value).filter(|v| v.is_finite()));
                assert_eq!(document["observed"][k], value.is_nan());
            }
        }
    }
}

//! The arrays of an answer: kept as numbers, written as text a stretch at a time.
//!
//! A quarter of a million points are 26 MB of numbers and 62 MB of JSON. The numbers are formed at once, so that a
//! thread that computes is not held up by a client that reads slowly; the text is made as it is taken.

use std::ops::Range;

use serde::Serialize;

use crate::map::npz::{NpzError, NpzWriter};

/// A number a point.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scalars(pub Vec<f64>);

/// `K` numbers a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows<const K: usize>(pub Vec<[f64; K]>);

/// Yes or no a point.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Flags(pub Vec<Option<bool>>);

/// An array of the answer. What has no value is NaN here, and null in JSON.
pub trait Column: Send {
    /// Of these points, as elements of a JSON array without its brackets.
    fn write(&self, points: Range<usize>, out: &mut Vec<u8>) -> serde_json::Result<()>;
    /// As an array of an archive.
    fn store(&self, name: &str, npz: &mut NpzWriter) -> Result<(), NpzError>;
}

fn elements<T: Serialize>(values: impl Iterator<Item = T>, out: &mut Vec<u8>) -> serde_json::Result<()> {
    for (k, value) in values.enumerate() {
        if k > 0 {
            out.push(b',');
        }
        serde_json::to_writer(&mut *out, &value)?;
    }
    Ok(())
}

fn number(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn row<const K: usize>(row: &[f64; K]) -> Option<&[f64]> {
    row.iter().all(|value| value.is_finite()).then_some(&row[..])
}

impl Column for Scalars {
    fn write(&self, points: Range<usize>, out: &mut Vec<u8>) -> serde_json::Result<()> {
        elements(self.0[points].iter().map(|value| number(*value)), out)
    }

    fn store(&self, name: &str, npz: &mut NpzWriter) -> Result<(), NpzError> {
        npz.array(name, &[self.0.len()], &self.0).map(drop)
    }
}

impl<const K: usize> Column for Rows<K> {
    fn write(&self, points: Range<usize>, out: &mut Vec<u8>) -> serde_json::Result<()> {
        elements(self.0[points].iter().map(row), out)
    }

    fn store(&self, name: &str, npz: &mut NpzWriter) -> Result<(), NpzError> {
        npz.array(name, &[self.0.len(), K], self.0.as_flattened()).map(drop)
    }
}

impl Column for Flags {
    fn write(&self, points: Range<usize>, out: &mut Vec<u8>) -> serde_json::Result<()> {
        elements(self.0[points].iter(), out)
    }

    fn store(&self, name: &str, npz: &mut NpzWriter) -> Result<(), NpzError> {
        let flags: Vec<bool> = self.0.iter().map(|flag| flag.unwrap_or(false)).collect();
        npz.array(name, &[flags.len()], &flags).map(drop)
    }
}

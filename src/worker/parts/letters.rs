//! Parcels and answers as files: arrays that `numpy.load` opens, stored as they are.
//!
//! A file's checksums are the archive's (CRC-32 of each array); what a branch's lists have to be is checked by whoever
//! works on it.

use crate::map::npz::{NpzError, NpzReader, NpzWriter};
use crate::sparse::{Answer, Parcel};

/// What both sides have to agree on: while workers are replaced one after the other, some are of another version.
const FORMAT: u32 = 1;

fn known(format: u32) -> Result<(), NpzError> {
    match format {
        FORMAT => Ok(()),
        other => Err(NpzError::Array(std::io::Error::other(format!("a part of format {other} is unknown here")))),
    }
}

pub fn of_parcel(parcel: &Parcel) -> Result<Vec<u8>, NpzError> {
    let mut npz = NpzWriter::stored();
    for (name, values) in [
        ("begins", &parcel.begins),
        ("row_starts", &parcel.row_starts),
        ("rows", &parcel.rows),
        ("places", &parcel.places),
        ("wanted", &parcel.wanted),
        ("counts", &vec![FORMAT, parcel.border, parcel.matrices]),
    ] {
        npz.array(name, &[values.len()], values)?;
    }
    for (name, values) in [
        ("entries", &parcel.entries),
        ("above", &parcel.above),
        ("factor", &parcel.factor),
        ("derivative", &parcel.derivative),
    ] {
        npz.array(name, &[values.len()], values)?;
    }
    npz.finish()
}

pub fn parcel(bytes: &[u8]) -> Result<Parcel, NpzError> {
    let mut npz = NpzReader::new(bytes, bytes.len() as u64)?;
    let counts: Vec<u32> = npz.array("counts")?;
    let count = |k: usize| counts.get(k).copied().unwrap_or_default();
    known(count(0))?;
    Ok(Parcel {
        begins: npz.array("begins")?,
        row_starts: npz.array("row_starts")?,
        rows: npz.array("rows")?,
        border: count(1),
        matrices: count(2),
        places: npz.array("places")?,
        entries: npz.array("entries")?,
        above: npz.array("above")?,
        wanted: npz.array("wanted")?,
        factor: npz.array("factor")?,
        derivative: npz.array("derivative")?,
    })
}

pub fn of_answer(answer: &Answer) -> Result<Vec<u8>, NpzError> {
    let mut npz = NpzWriter::stored();
    npz.array("counts", &[1], &[FORMAT])?;
    npz.array("values", &[answer.values.len()], &answer.values)?;
    npz.array("handed_on", &[answer.handed_on.len()], &answer.handed_on)?;
    npz.finish()
}

pub fn answer(bytes: &[u8]) -> Result<Answer, NpzError> {
    let mut npz = NpzReader::new(bytes, bytes.len() as u64)?;
    let counts: Vec<u32> = npz.array("counts")?;
    known(counts.first().copied().unwrap_or_default())?;
    Ok(Answer { values: npz.array("values")?, handed_on: npz.array("handed_on")? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_arrives_and_what_is_damaged_does_not() {
        let sent = Parcel {
            begins: vec![0, 3],
            row_starts: vec![0, 1],
            rows: vec![3],
            border: 1,
            matrices: 2,
            above: vec![0.5, f64::MIN_POSITIVE],
            wanted: vec![2],
            factor: vec![-0.0; 12],
            ..Parcel::default()
        };
        let bytes = of_parcel(&sent).unwrap();
        assert_eq!(parcel(&bytes).unwrap(), sent);
        let answered = Answer { values: vec![1.0, -2.5], handed_on: vec![] };
        assert_eq!(answer(&of_answer(&answered).unwrap()).unwrap(), answered);
        let mut later = NpzWriter::stored();
        later.array("counts", &[3], &[FORMAT + 1, 0, 0]).unwrap();
        assert!(parcel(&later.finish().unwrap()).unwrap_err().to_string().contains("format 2"));
        for at in [40, bytes.len() / 2, bytes.len() - 30] {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            assert!(parcel(&damaged).is_err() || parcel(&damaged).unwrap() == sent, "a flipped bit at {at}");
        }
        assert!(parcel(&bytes[..bytes.len() - 1]).is_err() && answer(&bytes).is_err());
    }
}

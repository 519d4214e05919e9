//! Arrays as `.npz`: a zip of `.npy` files, which `numpy.load` and `scipy.sparse.load_npz` open.
//!
//! Archives are deterministic: entries in the order they were added, all dated 1980-01-01, one compression level.
//! Reading caps what a crafted archive may unpack to.

use std::io::{self, Cursor, Read, Write};

use npyz::WriterBuilder;
use thiserror::Error;
use zip::write::SimpleFileOptions;

#[derive(Debug, Error)]
pub enum NpzError {
    #[error("the archive could not be written or read: {0}")]
    Archive(#[from] zip::result::ZipError),
    #[error("an array could not be written or read: {0}")]
    Array(#[from] io::Error),
    #[error("array {0} is larger than it may be")]
    TooLarge(String),
}

/// An archive being written.
pub struct NpzWriter {
    zip: zip::ZipWriter<Cursor<Vec<u8>>>,
    method: zip::CompressionMethod,
}

impl Default for NpzWriter {
    fn default() -> Self {
        Self { zip: zip::ZipWriter::new(Cursor::new(Vec::new())), method: zip::CompressionMethod::Deflated }
    }
}

impl NpzWriter {
    /// For numbers of which no two bytes repeat, as those of dense covariances: compressed they only take longer.
    pub fn stored() -> Self {
        Self { method: zip::CompressionMethod::Stored, ..Self::default() }
    }

    /// Adds a C-ordered array; an empty shape is a scalar.
    pub fn array<T: npyz::AutoSerialize + Copy>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: &[T],
    ) -> Result<&mut Self, NpzError> {
        let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
        let mut bytes = Vec::with_capacity(128 + std::mem::size_of_val(values));
        let mut npy = npyz::WriteOptions::<T>::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
        npy.extend(values.iter().copied())?;
        npy.finish()?;
        self.entry(name, &bytes)
    }

    /// Adds a byte string as a numpy scalar of dtype `S`, which is how scipy names a sparse format.
    pub fn bytes(&mut self, name: &str, value: &str) -> Result<&mut Self, NpzError> {
        let text = format!("|S{}", value.len().max(1));
        let invalid = |error: npyz::ParseTypeStrError| io::Error::new(io::ErrorKind::InvalidData, error.to_string());
        let dtype = npyz::DType::new_scalar(text.parse().map_err(invalid)?);
        let mut bytes = Vec::new();
        let mut npy = npyz::WriteOptions::<[u8]>::new().dtype(dtype).shape(&[]).writer(&mut bytes).begin_nd()?;
        npy.push(value.as_bytes())?;
        npy.finish()?;
        self.entry(name, &bytes)
    }

    pub fn finish(self) -> Result<Vec<u8>, NpzError> {
        Ok(self.zip.finish()?.into_inner())
    }

    fn entry(&mut self, name: &str, bytes: &[u8]) -> Result<&mut Self, NpzError> {
        let level = (self.method == zip::CompressionMethod::Deflated).then_some(1);
        let options = SimpleFileOptions::default()
            .compression_method(self.method)
            .compression_level(level)
            .last_modified_time(zip::DateTime::DEFAULT)
            .large_file(bytes.len() as u64 > u64::from(u32::MAX / 2));
        self.zip.start_file(format!("{name}.npy"), options)?;
        self.zip.write_all(bytes)?;
        Ok(self)
    }
}

/// An archive being read.
pub struct NpzReader<'a> {
    zip: zip::ZipArchive<Cursor<&'a [u8]>>,
    limit: u64,
}

impl<'a> NpzReader<'a> {
    /// `limit` bytes a single array may unpack to.
    pub fn new(bytes: &'a [u8], limit: u64) -> Result<Self, NpzError> {
        Ok(Self { zip: zip::ZipArchive::new(Cursor::new(bytes))?, limit })
    }

    /// Whether there is an array of this name.
    pub fn has(&self, name: &str) -> bool {
        self.zip.index_for_name(&format!("{name}.npy")).is_some()
    }

    /// An array's values in the order they are stored.
    pub fn array<T: npyz::Deserialize>(&mut self, name: &str) -> Result<Vec<T>, NpzError> {
        let mut file = self.zip.by_name(&format!("{name}.npy"))?;
        let mut bytes = Vec::new();
        file.by_ref().take(self.limit + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > self.limit {
            return Err(NpzError::TooLarge(name.into()));
        }
        Ok(npyz::NpyFile::new(&bytes[..])?.into_vec()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_as_they_went_and_bytes_do_not_depend_on_the_clock() {
        let write = || {
            let mut npz = NpzWriter::default();
            npz.array("sdf", &[2, 3], &[1.5f64, -2.0, 0.0, f64::NAN, 1e-300, 7.0]).unwrap();
            npz.array("resolution", &[], &[0.2f64]).unwrap();
            npz.array("indices", &[3], &[1i64, 2, 3]).unwrap();
            npz.bytes("format", "csc").unwrap();
            npz.finish().unwrap()
        };
        let bytes = write();
        assert_eq!(bytes, write());
        let mut npz = NpzReader::new(&bytes, 1 << 20).unwrap();
        let sdf: Vec<f64> = npz.array("sdf").unwrap();
        assert_eq!((sdf[1], sdf[4], sdf[3].is_nan()), (-2.0, 1e-300, true));
        assert_eq!(npz.array::<i64>("indices").unwrap(), [1, 2, 3]);
        assert!(npz.array::<f64>("absent").is_err());
        assert!(matches!(NpzReader::new(&bytes, 16).unwrap().array::<f64>("sdf"), Err(NpzError::TooLarge(_))));
    }
}

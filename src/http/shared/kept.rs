//! What is kept of jobs' requests, unpacked: joins and updates begin with it.
//!
//! A request of megabytes of spaces is kept in a kilobyte, and a join may name a map many times: what all of it comes
//! to is asked before any of it is unpacked, and is bounded by what the service may hold. That bound is one for all new
//! requests that are at it: others wait in their turns.

use std::io::Read;

use super::compute::Turn;
use super::problem::Problem;

/// Of what fits and answers may hold together, what requests that are unpacked at once may be: they are parsed, put
/// together and packed again, and some are at it side by side.
const SHARE: u64 = 8;
const BOUNDS: (u64, u64) = (64 << 20, 512 << 20);

/// Bytes of kept requests that may be unpacked at once, and so for one new one.
pub fn most_unpacked(memory: u64) -> u64 {
    (memory / SHARE).clamp(BOUNDS.0, BOUNDS.1)
}

impl Turn {
    /// A kept request, and its bytes once it is unpacked, counted as far as one beyond `most`. Its frame says so; those
    /// of the first version do not, and are read through by the threads that compute, holding nothing.
    pub async fn measured(&self, packed: Vec<u8>, most: u64) -> Result<(Vec<u8>, u64), Problem> {
        if let Some(bytes) = told(&packed) {
            return Ok((packed, bytes));
        }
        let count = move |_: &_| {
            let bytes = counted(&packed, most);
            Ok((packed, bytes))
        };
        self.run(count).await
    }
}

/// The bytes of a kept request, where its frame says them.
pub fn told(packed: &[u8]) -> Option<u64> {
    zstd::zstd_safe::get_frame_content_size(packed).ok().flatten()
}

fn counted(packed: &[u8], most: u64) -> u64 {
    let read =
        |decoder: zstd::Decoder<'_, _>| std::io::copy(&mut decoder.take(most.saturating_add(1)), &mut std::io::sink());
    zstd::Decoder::new(packed).and_then(read).unwrap_or(u64::MAX)
}

/// A kept request, unpacked.
pub fn unpack(packed: &[u8]) -> Result<Vec<u8>, Problem> {
    zstd::decode_all(packed).map_err(|error| Problem::internal(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_request_says_how_large_it_is() {
        let request = vec![b' '; 3 << 20];
        let packed = zstd::bulk::compress(&request, 1).unwrap();
        assert!(packed.len() < 10_000);
        assert_eq!(told(&packed), Some(3 << 20));
        assert_eq!(unpack(&packed).unwrap(), request);
        assert_eq!((told(b"something else"), counted(b"something else", 1 << 20)), (None, u64::MAX));
    }

    /// As the first version packed them.
    #[test]
    fn one_that_does_not_say_so_is_counted() {
        let packed = zstd::encode_all(&vec![b' '; 3 << 20][..], 1).unwrap();
        assert_eq!(told(&packed), None);
        assert_eq!(counted(&packed, 4 << 20), 3 << 20);
        assert_eq!(counted(&packed, 1 << 20), (1 << 20) + 1);
    }
}

//! The records of an MCAP file, one after the other, in bounded memory (<https://mcap.dev/spec>).
//!
//! Records are an opcode, a length and that many bytes; a chunk holds further records, compressed. Readers of the format
//! take memory for whatever length a file claims, so this one is ours: a length is held against its limit before anything
//! of that size is taken, a chunk is unpacked into as many bytes as it said and no more, and the sum of what is unpacked
//! has a limit too. What a map needs nothing of (attachments, metadata, indexes) is passed over, whatever its size. One
//! chunk at a time is held.

use std::collections::BTreeMap;
use std::io::Read;
use std::rc::Rc;

use super::error::RecordingError;

/// The first and the last bytes of a file.
pub const MAGIC: &[u8] = b"\x89MCAP0\r\n";

const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;

/// A topic's name, a type's name and the like have so many bytes at most.
const LONGEST_NAME: usize = 1024;
/// Channels and schemas, each.
const MOST_CHANNELS: usize = 8192;

/// What a recording may make us hold and do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Bytes of a file that was gzipped, and of a log that is held as a whole.
    pub file: u64,
    /// Bytes of a record, and of a chunk, packed and unpacked.
    pub record: u64,
    /// Bytes of all chunks together, unpacked.
    pub unpacked: u64,
    /// Scans that are taken.
    pub scans: usize,
    /// Ranges of all of them.
    pub ranges: usize,
    /// Poses and transforms that are kept, and scans that are passed over.
    pub poses: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { file: 1 << 30, record: 64 << 20, unpacked: 1 << 30, scans: 20_000, ranges: 8_000_000, poses: 1_000_000 }
    }
}

/// Where messages of one kind come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    pub topic: String,
    /// The messages' type, as `sensor_msgs/msg/LaserScan`; empty where there is no schema.
    pub kind: String,
    /// How messages are encoded: `cdr`, `ros1`, `protobuf`, `json`.
    pub encoding: String,
}

/// A message as it lies in the file.
pub struct Message<'a> {
    pub channel: &'a Rc<Channel>,
    /// When it was recorded, nanoseconds.
    pub logged: u64,
    pub data: &'a [u8],
}

type Visit<'v> = dyn FnMut(Message<'_>) -> Result<(), RecordingError> + 'v;

/// Reads a file to its end and hands every message on. `goes_on` is asked before each chunk.
pub fn walk(
    file: impl Read,
    limits: &Limits,
    goes_on: &dyn Fn() -> bool,
    visit: &mut Visit<'_>,
) -> Result<(), RecordingError> {
    let mut walk = Walk { file, read: 0, unpacked: 0, limits, known: Known::default() };
    let (mut record, mut chunk) = (Vec::new(), Vec::new());
    walk.exactly(MAGIC.len() as u64, &mut record)?;
    if record != MAGIC {
        return Err(RecordingError::Damaged("it does not begin as an MCAP file".into()));
    }
    loop {
        let (opcode, length) = walk.head()?;
        match opcode {
            CHUNK => {
                if !goes_on() {
                    return Err(RecordingError::Stopped);
                }
                walk.within("a chunk", length)?;
                walk.exactly(length, &mut record)?;
                let records = walk.unpack(&record, &mut chunk)?;
                walk.known.records(records, visit)?;
            }
            SCHEMA | CHANNEL | MESSAGE => {
                walk.within("a record", length)?;
                walk.exactly(length, &mut record)?;
                walk.known.record(opcode, &record, visit)?;
            }
            FOOTER => {
                walk.pass_over(length)?;
                walk.exactly(MAGIC.len() as u64, &mut record)?;
                return match record == MAGIC {
                    true => Ok(()),
                    false => Err(RecordingError::Damaged("it does not end as an MCAP file".into())),
                };
            }
            _ => walk.pass_over(length)?,
        }
    }
}

struct Walk<'l, R> {
    file: R,
    /// Bytes so far, of the file and of what chunks unpacked to.
    read: u64,
    unpacked: u64,
    limits: &'l Limits,
    known: Known,
}

impl<R: Read> Walk<'_, R> {
    fn within(&self, what: &'static str, bytes: u64) -> Result<(), RecordingError> {
        let limit = self.limits.record;
        if bytes > limit { Err(RecordingError::TooLarge { what, bytes, limit }) } else { Ok(()) }
    }

    /// So many bytes; a buffer grows with what is there, not with what was claimed.
    fn exactly(&mut self, bytes: u64, into: &mut Vec<u8>) -> Result<(), RecordingError> {
        into.clear();
        let read = self.file.by_ref().take(bytes).read_to_end(into)? as u64;
        self.read += read;
        if read < bytes { Err(RecordingError::Truncated(self.read)) } else { Ok(()) }
    }

    fn pass_over(&mut self, bytes: u64) -> Result<(), RecordingError> {
        let passed = std::io::copy(&mut self.file.by_ref().take(bytes), &mut std::io::sink())?;
        self.read += passed;
        if passed < bytes { Err(RecordingError::Truncated(self.read)) } else { Ok(()) }
    }

    /// A record's opcode and length.
    fn head(&mut self) -> Result<(u8, u64), RecordingError> {
        let mut head = Vec::with_capacity(9);
        self.exactly(9, &mut head)?;
        let mut fields = Fields(&head);
        Ok((fields.array::<1>()?[0], fields.u64()?))
    }

    /// The records of a chunk, unpacked into `into` where they are packed.
    fn unpack<'a>(&mut self, chunk: &'a [u8], into: &'a mut Vec<u8>) -> Result<&'a [u8], RecordingError> {
        let mut fields = Fields(chunk);
        let _times = (fields.u64()?, fields.u64()?);
        let (size, checksum) = (fields.u64()?, fields.u32()?);
        let compression = fields.name()?;
        let packed = fields.u64()?;
        let packed = fields.bytes(packed)?;
        self.within("a chunk, unpacked,", size)?;
        self.unpacked += size;
        let limit = self.limits.unpacked;
        if self.unpacked > limit {
            return Err(RecordingError::TooLarge { what: "the recording, unpacked,", bytes: self.unpacked, limit });
        }
        let records = match compression {
            "" => packed,
            "zstd" => {
                into.clear();
                into.reserve_exact(size as usize);
                let damaged = |error| RecordingError::Damaged(format!("a chunk cannot be unpacked: {error}"));
                // At one go, without a window of the packer's choice.
                let mut decompressor = zstd::bulk::Decompressor::new().map_err(damaged)?;
                decompressor.decompress_to_buffer(packed, into).map_err(damaged)?;
                into
            }
            "lz4" => {
                into.clear();
                let mut decoder = lz4_flex::frame::FrameDecoder::new(packed).take(size + 1);
                let unpacked = decoder.read_to_end(into);
                unpacked.map_err(|error| RecordingError::Damaged(format!("a chunk cannot be unpacked: {error}")))?;
                into
            }
            other => return Err(RecordingError::Compression(other.to_owned())),
        };
        if records.len() as u64 != size {
            return Err(RecordingError::Damaged(format!("a chunk unpacks to other than the {size} bytes it says")));
        }
        if checksum != 0 && crc32fast::hash(records) != checksum {
            return Err(RecordingError::Damaged("a chunk's checksum is wrong".into()));
        }
        Ok(records)
    }
}

/// Schemas and channels so far.
#[derive(Default)]
struct Known {
    kinds: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Rc<Channel>>,
}

impl Known {
    /// A chunk's records.
    fn records(&mut self, chunk: &[u8], visit: &mut Visit<'_>) -> Result<(), RecordingError> {
        let mut fields = Fields(chunk);
        while !fields.0.is_empty() {
            let opcode = fields.array::<1>()?[0];
            let length = fields.u64()?;
            self.record(opcode, fields.bytes(length)?, visit)?;
        }
        Ok(())
    }

    fn record(&mut self, opcode: u8, record: &[u8], visit: &mut Visit<'_>) -> Result<(), RecordingError> {
        let mut fields = Fields(record);
        match opcode {
            SCHEMA => {
                let id = fields.u16()?;
                let kind = fields.name()?;
                if self.kinds.len() >= MOST_CHANNELS && !self.kinds.contains_key(&id) {
                    return Err(RecordingError::TooMany { what: "types of messages", limit: MOST_CHANNELS });
                }
                self.kinds.insert(id, kind.to_owned());
            }
            CHANNEL => {
                let (id, schema) = (fields.u16()?, fields.u16()?);
                let (topic, encoding) = (fields.name()?.to_owned(), fields.name()?.to_owned());
                let kind = self.kinds.get(&schema).cloned().unwrap_or_default();
                let channel = Channel { topic, kind, encoding };
                if self.channels.len() >= MOST_CHANNELS && !self.channels.contains_key(&id) {
                    return Err(RecordingError::TooMany { what: "channels", limit: MOST_CHANNELS });
                }
                if self.channels.get(&id).is_none_or(|known| **known != channel) {
                    self.channels.insert(id, Rc::new(channel));
                }
            }
            MESSAGE => {
                let channel = fields.u16()?;
                let _sequence = fields.u32()?;
                let logged = fields.u64()?;
                let _published = fields.u64()?;
                let channel = self.channels.get(&channel).ok_or_else(|| {
                    RecordingError::Damaged(format!("a message belongs to channel {channel}, which is not there"))
                })?;
                visit(Message { channel, logged, data: fields.0 })?;
            }
            _ => {}
        }
        Ok(())
    }
}

/// Little-endian fields of a record, from its front.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, count: u64) -> Result<&'a [u8], RecordingError> {
        let split = usize::try_from(count).ok().and_then(|count| self.0.split_at_checked(count));
        let (head, rest) =
            split.ok_or_else(|| RecordingError::Damaged("a record is shorter than what it holds".into()))?;
        self.0 = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], RecordingError> {
        let mut array = [0; N];
        array.copy_from_slice(self.bytes(N as u64)?);
        Ok(array)
    }

    fn u16(&mut self) -> Result<u16, RecordingError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    fn u32(&mut self) -> Result<u32, RecordingError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, RecordingError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn name(&mut self) -> Result<&'a str, RecordingError> {
        let length = self.u32()?;
        if length as usize > LONGEST_NAME {
            return Err(RecordingError::Damaged(format!("a name of {length} bytes")));
        }
        let bytes = self.bytes(u64::from(length))?;
        std::str::from_utf8(bytes).map_err(|_| RecordingError::Damaged("a name is no text".into()))
    }
}

//! Request bodies: JSON, as it is or compressed, whole and within the limit.
//!
//! What can be refused by its headers is, at once; the body is thrown away meanwhile, for a bounded while: a server that
//! answers and hangs up while a client still sends makes the client see a broken connection instead of the answer.
//! Decompression stops where its output outgrows the limit, so a bomb costs no more than an honest body. All bodies
//! together hold so many bytes at most until they are unpacked ([`super::ration`]); beyond, the answer is 503.

use std::io::Read;
use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderMap, StatusCode, header};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt;

use super::compute::Queue;
use super::negotiate::JSON;
use super::problem::Problem;
use super::ration::Share;
use super::state::Service;

/// How much of a refused body is received, as a multiple of the limit, and for how long.
const PATIENCE: usize = 4;
/// What every body may have without asking: no crowd of large ones keeps a small job or a question out.
const SMALL: usize = 16 << 10;
/// What a publication, a webhook or a change of labels may have: all labels there may be, twice over.
const FEW: usize = 128 << 10;
/// What is read in milliseconds.
const SMALL_JOB: usize = 256 << 10;
const PATIENCE_FOR: Duration = Duration::from_secs(20);
/// Bodies are kept in pieces of so many bytes.
const PIECE: usize = 1 << 20;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Identity,
    Gzip,
    Zstd,
}

/// A body as it came: still packed, so that what waits to be worked on is small.
pub struct Received {
    raw: Pieces,
    encoding: Encoding,
    limit: usize,
    /// Which of the known media types it has.
    pub media: &'static str,
    _share: Share,
}

impl Received {
    /// Where it waits to be read: small ones never behind large ones, nor behind what may be large once it is unpacked.
    pub fn queue(&self) -> Queue {
        match self.encoding {
            Encoding::Identity if self.raw.len() <= SMALL_JOB => Queue::Small,
            _ => Queue::Requests,
        }
    }

    /// Where a question of a map waits to be answered: a few points never behind pictures and large arrays.
    pub fn queue_of_answer(&self) -> Queue {
        match self.encoding {
            Encoding::Identity if self.raw.len() <= SMALL => Queue::Small,
            _ => Queue::Answers,
        }
    }

    /// The bytes, decompressed. For the threads that compute: one body a permit is unpacked at a time.
    pub fn unpack(self) -> Result<Bytes, Problem> {
        let Self { raw, encoding, limit, .. } = self;
        match encoding {
            Encoding::Identity => Ok(raw.whole()),
            Encoding::Gzip => unpack(flate2::read::MultiGzDecoder::new(&raw.whole()[..]), limit),
            Encoding::Zstd => unpack(zstd::Decoder::new(&raw.whole()[..]).map_err(|error| unreadable(&error))?, limit),
        }
    }
}

/// A body as it grows: what is there is not moved for what comes, so it takes what it counts for.
#[derive(Default)]
struct Pieces(Vec<BytesMut>);

impl Pieces {
    fn len(&self) -> usize {
        self.0.iter().map(BytesMut::len).sum()
    }

    fn extend(&mut self, mut data: &[u8]) {
        while !data.is_empty() {
            match self.0.last_mut() {
                Some(last) if last.len() < PIECE => {
                    let (fits, rest) = data.split_at(data.len().min(PIECE - last.len()));
                    last.extend_from_slice(fits);
                    data = rest;
                }
                // Most bodies are small: only what follows a whole piece is expected to be one.
                Some(_) => self.0.push(BytesMut::with_capacity(PIECE)),
                None => self.0.push(BytesMut::new()),
            }
        }
    }

    fn whole(mut self) -> Bytes {
        if self.0.len() <= 1 {
            return self.0.pop().unwrap_or_default().freeze();
        }
        let mut whole = BytesMut::with_capacity(self.len());
        self.0.into_iter().for_each(|piece| whole.extend_from_slice(&piece));
        whole.freeze()
    }
}

impl Service {
    /// A body of one of these media types.
    pub async fn read_body(
        &self,
        headers: &HeaderMap,
        body: Body,
        known: &[&'static str],
    ) -> Result<Received, Problem> {
        self.read_within(self.limits.body, headers, body, known).await
    }

    /// The bytes of a body that is small, packed or not: so small that whoever receives it may read it, too.
    pub async fn read_few(&self, headers: &HeaderMap, body: Body, known: &[&'static str]) -> Result<Bytes, Problem> {
        self.read_within(FEW.min(self.limits.body), headers, body, known).await?.unpack()
    }

    async fn read_within(
        &self,
        limit: usize,
        headers: &HeaderMap,
        body: Body,
        known: &[&'static str],
    ) -> Result<Received, Problem> {
        let length = if announced(headers) > limit as u64 { Err(too_large(limit)) } else { Ok(()) };
        let checked = length.and_then(|()| Ok((media_type(headers, known)?, encoding(headers)?)));
        let ((media, encoding), body) = self.before(checked, body)?;
        let mut share = self.bodies.none();
        let within = self.limits.patience;
        let raw = receive(body, (limit, within), &mut |bytes| self.bodies.grow(&mut share, bytes)).await?;
        Ok(Received { raw, encoding, limit, media, _share: share })
    }

    /// Counts what was read of a body and waits for its turn, as bodies are; 503 where there is no room.
    pub fn hold(&self, bytes: usize) -> Result<Share, Problem> {
        let mut share = self.bodies.none();
        match self.bodies.grow(&mut share, bytes.saturating_sub(SMALL)) {
            true => Ok(share),
            false => Err(no_room()),
        }
    }

    /// What was found out before a body is read, and the body. One that will not be read is thrown away: the answer goes out
    /// at once, and the client, which may still be sending, sees it.
    pub fn before<T>(&self, outcome: Result<T, Problem>, body: Body) -> Result<(T, Body), Problem> {
        match outcome {
            Ok(found) => Ok((found, body)),
            Err(problem) => {
                let most = (self.limits.body, self.limits.patience);
                tokio::spawn(async move { receive(body, most, &mut |_| false).await.map(drop) });
                Err(problem)
            }
        }
    }
}

/// The length that a body says it has.
fn announced(headers: &HeaderMap) -> u64 {
    let length = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok());
    length.and_then(|length| length.parse().ok()).unwrap_or(0)
}

/// Which of the known media types a body has; `application/anything+json` is JSON, too.
fn media_type(headers: &HeaderMap, known: &[&'static str]) -> Result<&'static str, Problem> {
    let media = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let media = media.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    let json = media.starts_with("application/") && media.ends_with("+json");
    let found = known.iter().find(|known| media == **known || (json && **known == JSON.media));
    found.copied().ok_or_else(|| Problem::of_status(StatusCode::UNSUPPORTED_MEDIA_TYPE))
}

fn encoding(headers: &HeaderMap) -> Result<Encoding, Problem> {
    let named = headers.get(header::CONTENT_ENCODING).map(|value| value.to_str().unwrap_or("?").trim().to_lowercase());
    match named.as_deref() {
        None | Some("" | "identity") => Ok(Encoding::Identity),
        Some("gzip" | "x-gzip") => Ok(Encoding::Gzip),
        Some("zstd") => Ok(Encoding::Zstd),
        Some(_) => Err(Problem::of_status(StatusCode::UNSUPPORTED_MEDIA_TYPE)),
    }
}

/// Receives a body. `may_hold` is asked for the bytes of each piece; a piece that it refuses is thrown away, and all that
/// follow with it.
async fn receive(
    mut body: Body,
    (limit, within): (usize, Duration),
    may_hold: &mut (dyn FnMut(usize) -> bool + Send),
) -> Result<Pieces, Problem> {
    let mut kept = Pieces::default();
    let mut length = 0usize;
    let mut crowded = false;
    let whole = async {
        while let Some(frame) = body.frame().await {
            let frame = frame.map_err(|error| unreadable(&error))?;
            let Ok(data) = frame.into_data() else { continue };
            length = length.saturating_add(data.len());
            let counted = length.saturating_sub(SMALL).min(data.len());
            crowded = crowded || (length <= limit && !may_hold(counted));
            if length <= limit && !crowded {
                kept.extend(&data);
            } else {
                kept = Pieces::default();
                if length > PATIENCE * limit {
                    break;
                }
            }
        }
        Ok::<(), Problem>(())
    };
    // A second a megabyte, for who is far away, as long as an answer may take.
    let patience = PATIENCE_FOR.max(Duration::from_secs(limit as u64 >> 20)).min(within);
    let in_time = tokio::time::timeout(patience, whole).await;
    match in_time {
        Ok(outcome) => outcome?,
        Err(_) => {
            return Err(Problem::new(StatusCode::REQUEST_TIMEOUT, "timeout", "Timeout", "the body came too slowly"));
        }
    }
    match (length > limit, crowded) {
        (true, _) => Err(too_large(limit)),
        (_, true) => Err(no_room()),
        _ => Ok(kept),
    }
}

fn no_room() -> Problem {
    let detail = "the service holds as many bytes of requests as it may; try again".into();
    Problem { detail, ..Problem::of_status(StatusCode::SERVICE_UNAVAILABLE) }
}

fn unpack(decoder: impl Read, limit: usize) -> Result<Bytes, Problem> {
    let mut unpacked = Vec::new();
    decoder.take(limit as u64 + 1).read_to_end(&mut unpacked).map_err(|error| unreadable(&error))?;
    if unpacked.len() > limit { Err(too_large(limit)) } else { Ok(unpacked.into()) }
}

fn too_large(limit: usize) -> Problem {
    let detail = format!("the body is larger than {limit} bytes after decompression");
    Problem { detail, ..Problem::of_status(StatusCode::PAYLOAD_TOO_LARGE) }
}

fn unreadable(error: &dyn std::fmt::Display) -> Problem {
    let detail = format!("the body cannot be read: {error}");
    Problem { detail, ..Problem::of_status(StatusCode::BAD_REQUEST) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_in_pieces_is_what_came() {
        let came: Vec<u8> = (0..3 * PIECE + 17).map(|k| (k % 251) as u8).collect();
        for frame in [1000, 64 << 10, PIECE, 2 * PIECE + 1] {
            let mut pieces = Pieces::default();
            came.chunks(frame).for_each(|data| pieces.extend(data));
            assert_eq!((pieces.len(), pieces.0.len()), (came.len(), 4));
            assert!(pieces.whole() == came, "in frames of {frame} bytes");
        }
        assert!(Pieces::default().whole().is_empty());
    }
}

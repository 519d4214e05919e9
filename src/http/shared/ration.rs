//! A budget of bytes that many requests share.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::StatusCode;
use bytes::Bytes;
use http_body::{Frame, SizeHint};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::problem::Problem;

/// What is counted: a permit stands for so many bytes.
const UNIT: usize = 1024;

/// Bytes that may be held at once.
#[derive(Clone)]
pub struct Ration {
    units: Arc<Semaphore>,
    whole: u32,
}

/// Bytes that are held; given back when it is dropped.
pub struct Share(Option<OwnedSemaphorePermit>);

impl Ration {
    pub fn new(bytes: usize) -> Self {
        let whole = u32::try_from(bytes / UNIT).unwrap_or(u32::MAX >> 3).max(1);
        Self { units: Arc::new(Semaphore::new(whole as usize)), whole }
    }

    fn units_of(&self, bytes: usize) -> u32 {
        u32::try_from(bytes.div_ceil(UNIT)).unwrap_or(u32::MAX).min(self.whole)
    }

    /// Nothing yet; for what grows.
    pub fn none(&self) -> Share {
        Share(None)
    }

    /// Adds bytes to a share if they are to be had now.
    pub fn grow(&self, share: &mut Share, bytes: usize) -> bool {
        let Ok(more) = self.units.clone().try_acquire_many_owned(self.units_of(bytes)) else { return false };
        match &mut share.0 {
            Some(held) => held.merge(more),
            none => *none = Some(more),
        }
        true
    }

    /// A share of so many bytes, when they are to be had; 503 where that is not by then. More than the whole ration is all
    /// of it.
    pub async fn wait(&self, bytes: usize, until: Instant) -> Result<Share, Problem> {
        let held = self.units.clone().acquire_many_owned(self.units_of(bytes));
        let held = tokio::time::timeout_at(until.into(), held).await;
        held.ok().and_then(Result::ok).map(|held| Share(Some(held))).ok_or_else(Problem::too_slow)
    }
}

/// Answers up to this are not counted: no crowd of slow readers keeps a small one from its client.
const SMALL: usize = 64 << 10;
/// An answer is handed to the connection in pieces of about this many bytes: what is not yet taken stays here, counted.
pub const PIECE: usize = 64 << 10;
/// How long a client may take over an answer: so long, and so much longer as it has bytes at this many a second.
const TAKEN_WITHIN: Duration = Duration::from_secs(60);
const SLOWEST: usize = 64 << 10;

impl Ration {
    /// Bytes for an answer, taken before it is formed; 503 where too much is on its way already. One larger than the
    /// whole ration takes all of it.
    pub fn take(&self, bytes: usize) -> Result<Taken, Problem> {
        let mut share = self.none();
        if bytes > SMALL && !self.grow(&mut share, bytes) {
            let detail = "as many bytes of answers are on their way as may be; try again".into();
            return Err(Problem { detail, ..Problem::of_status(StatusCode::SERVICE_UNAVAILABLE) });
        }
        Ok(Taken { share, bytes })
    }
}

/// What an answer counts for until its client has taken it.
pub struct Taken {
    share: Share,
    bytes: usize,
}

impl Taken {
    /// A body whose bytes are there.
    pub fn body(self, bytes: Vec<u8>) -> Body {
        let (length, mut rest) = (bytes.len() as u64, Bytes::from(bytes));
        let pieces = std::iter::from_fn(move || {
            let piece = rest.len().min(PIECE);
            (piece > 0).then(|| Ok(rest.split_to(piece)))
        });
        self.answer(Box::new(pieces), Some(length))
    }

    /// A body that is written piece by piece.
    pub fn stream(self, pieces: impl Iterator<Item = std::io::Result<Vec<u8>>> + Send + 'static) -> Body {
        self.answer(Box::new(pieces.map(|piece| piece.map(Bytes::from))), None)
    }

    fn answer(self, pieces: Pieces, left: Option<u64>) -> Body {
        let seconds = (self.bytes / SLOWEST) as u64;
        let until = Instant::now() + TAKEN_WITHIN + Duration::from_secs(seconds);
        Body::new(Answer { pieces, left, until, _share: self.share })
    }
}

type Pieces = Box<dyn Iterator<Item = std::io::Result<Bytes>> + Send>;

struct Answer {
    pieces: Pieces,
    /// Bytes that are still here, where that is known.
    left: Option<u64>,
    until: Instant,
    _share: Share,
}

impl http_body::Body for Answer {
    type Data = Bytes;
    type Error = std::io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        if self.is_end_stream() {
            return Poll::Ready(None);
        }
        if Instant::now() > self.until {
            return Poll::Ready(Some(Err(std::io::ErrorKind::TimedOut.into())));
        }
        let piece = self.pieces.next();
        if let (Some(left), Some(Ok(piece))) = (&mut self.left, &piece) {
            *left = left.saturating_sub(piece.len() as u64);
        }
        Poll::Ready(piece.map(|piece| piece.map(Frame::data)))
    }

    fn is_end_stream(&self) -> bool {
        self.left == Some(0)
    }

    fn size_hint(&self) -> SizeHint {
        self.left.map_or_else(SizeHint::default, SizeHint::with_exact)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use http_body_util::BodyExt;

    #[tokio::test]
    async fn shares_grow_within_the_ration_and_come_back() {
        let ration = Ration::new(10 * UNIT);
        let (mut a, mut b) = (ration.none(), ration.none());
        assert!(ration.grow(&mut a, 6 * UNIT) && !ration.grow(&mut b, 5 * UNIT) && ration.grow(&mut b, 4 * UNIT));
        assert!(!ration.grow(&mut a, 1));
        drop(a);
        assert!(ration.grow(&mut b, 6 * UNIT));
    }

    #[tokio::test]
    async fn whoever_waits_has_a_share_once_it_is_free() {
        let (ration, soon) = (Ration::new(4 * UNIT), Instant::now() + Duration::from_millis(100));
        let all = ration.wait(9 * UNIT, soon).await.unwrap();
        assert_eq!(ration.wait(1, soon).await.err().unwrap().status, StatusCode::SERVICE_UNAVAILABLE);
        let later = Instant::now() + Duration::from_secs(60);
        let (share, ()) = tokio::join!(ration.wait(4 * UNIT, later), async { drop(all) });
        assert!(share.is_ok() && !ration.grow(&mut ration.none(), 1));
    }

    #[tokio::test]
    async fn an_answer_counts_until_its_last_piece_is_taken_and_small_ones_always_go() {
        let ration = Ration::new(2 * PIECE);
        let mut body = ration.take(5 * PIECE).unwrap().body(vec![7; 5 * PIECE]);
        let mut taken = body.frame().await.unwrap().unwrap().into_data().unwrap().len();
        assert!(!ration.grow(&mut ration.none(), 1), "four pieces are still here");
        assert_eq!(ration.take(2 * PIECE).err().unwrap().status, StatusCode::SERVICE_UNAVAILABLE);
        assert!(ration.take(SMALL).is_ok());
        while let Some(piece) = body.frame().await {
            taken += piece.unwrap().into_data().unwrap().len();
        }
        drop(body);
        assert_eq!(taken, 5 * PIECE);
        assert!(ration.grow(&mut ration.none(), 2 * PIECE));
    }
}

//! A budget of bytes that many requests share.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::body::Body;
use bytes::Bytes;
use http_body::{Frame, SizeHint};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

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

    /// Waits for bytes. What is larger than the whole gets the whole.
    pub async fn take(&self, bytes: usize) -> Share {
        // The semaphore is never closed, so this never fails.
        Share(self.units.clone().acquire_many_owned(self.units_of(bytes)).await.ok())
    }
}

/// A body that holds its share until it is sent or given up.
pub fn sharing(bytes: Bytes, share: Share) -> Body {
    Body::new(Sharing { body: Body::from(bytes), _share: share })
}

struct Sharing {
    body: Body,
    _share: Share,
}

impl http_body::Body for Sharing {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
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
        drop(b);
        let whole = ration.take(1000 * UNIT).await;
        assert!(!ration.grow(&mut ration.none(), 1));
        let mut body = sharing(Bytes::from_static(b"abc"), whole);
        while body.frame().await.is_some() {}
        drop(body);
        assert!(ration.grow(&mut ration.none(), 1));
    }
}

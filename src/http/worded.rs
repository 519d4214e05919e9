//! Words for what hyper refuses by itself.
//!
//! A request whose head cannot be read never becomes one: no layer of ours sees it, and hyper answers with a status and
//! nothing else before it closes. Every other answer has an `x-request-id`. So the stream below looks at what is
//! written to it: a whole head with one of hyper's three statuses, without a body and without an id, is hyper's own,
//! and goes out with a problem as its body. Of other writes a dozen bytes are looked at, and nothing is copied.

use std::io;
use std::io::IoSlice;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use axum::http::StatusCode;
use bytes::{Buf, Bytes};
use memchr::memmem::find;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use uuid::Uuid;

use super::shared::problem::{Problem, to_json};

/// A request's line and headers may have so many bytes: what a crowd of connections holds is bounded by it.
pub const LARGEST_HEAD: usize = 64 << 10;
/// hyper's own heads are shorter.
const LONGEST: usize = 512;
const NO_BODY: &str = "content-length: 0\r\n";
/// What is there already of a request that was refused is read, so much of it, before the stream closes: one that is
/// closed with bytes unread is reset, and the answer may be lost.
const READ_AWAY: usize = 1 << 20;

/// A stream to a client on which no error is without words.
pub struct Worded<S> {
    stream: S,
    refusal: Option<Refusal>,
}

struct Refusal {
    /// What is still to be written.
    text: Bytes,
    /// Bytes of the head that it is written for.
    head: usize,
    read_away: usize,
}

impl<S> Worded<S> {
    pub fn new(stream: S) -> Self {
        Self { stream, refusal: None }
    }
}

/// The status of a head that is hyper's own.
fn unworded(head: &[u8]) -> Option<StatusCode> {
    let status = head.strip_prefix(b"HTTP/1.1 ").or_else(|| head.strip_prefix(b"HTTP/1.0 "))?.get(..3)?;
    let status = match status {
        b"400" => StatusCode::BAD_REQUEST,
        b"414" => StatusCode::URI_TOO_LONG,
        b"431" => StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE,
        _ => return None,
    };
    let whole = head.len() <= LONGEST && head.ends_with(b"\r\n\r\n");
    (whole && find(head, NO_BODY.as_bytes()).is_some() && find(head, b"x-request-id:").is_none()).then_some(status)
}

/// hyper's head with a problem behind it.
fn worded(head: &[u8], status: StatusCode) -> Option<Bytes> {
    let problem = match status {
        StatusCode::BAD_REQUEST => Problem {
            detail: "the request is no HTTP/1.1, or has a header that is none".into(),
            ..Problem::of_status(status)
        },
        _ => {
            let detail = format!("the request has more than 100 headers, or its head more than {LARGEST_HEAD} bytes");
            Problem::new(status, "too-large", "Too large", detail)
        }
    };
    let id = Uuid::now_v7().to_string();
    // Which resource was meant nobody knows.
    let body = to_json(&problem.body("", &id)).ok()?;
    let fields = format!(
        "content-type: application/problem+json\r\ncontent-length: {}\r\n\
         x-content-type-options: nosniff\r\nx-request-id: {id}\r\n",
        body.len()
    );
    tracing::debug!(status = status.as_u16(), request_id = id, "a request could not be read");
    let head = std::str::from_utf8(head).ok()?.replacen(NO_BODY, &fields, 1);
    Some([head.into_bytes(), body].concat().into())
}

impl<S: AsyncWrite + Unpin> Worded<S> {
    /// Writes the words, and says then that the head was written.
    fn poll_words(&mut self, cx: &mut Context<'_>) -> Option<Poll<io::Result<usize>>> {
        let refusal = self.refusal.as_mut().filter(|refusal| refusal.text.has_remaining())?;
        while refusal.text.has_remaining() {
            match Pin::new(&mut self.stream).poll_write(cx, &refusal.text) {
                Poll::Ready(Ok(0)) => return Some(Poll::Ready(Err(io::ErrorKind::WriteZero.into()))),
                Poll::Ready(Ok(written)) => refusal.text.advance(written),
                other => return Some(other),
            }
        }
        Some(Poll::Ready(Ok(refusal.head)))
    }

    fn look_at(&mut self, written: &[u8]) {
        if self.refusal.is_none()
            && let Some(text) = unworded(written).and_then(|status| worded(written, status))
        {
            self.refusal = Some(Refusal { text, head: written.len(), read_away: 0 });
        }
    }
}

impl<S: AsyncWrite + AsyncRead + Unpin> AsyncWrite for Worded<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        self.look_at(buf);
        self.poll_words(cx).unwrap_or_else(|| Pin::new(&mut self.stream).poll_write(cx, buf))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        if let [head] = bufs {
            self.look_at(head);
        }
        self.poll_words(cx).unwrap_or_else(|| Pin::new(&mut self.stream).poll_write_vectored(cx, bufs))
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let Self { stream, refusal } = &mut *self;
        if let Some(refusal) = refusal {
            ready!(Pin::new(&mut *stream).poll_flush(cx))?;
            let mut thrown = [0; 8 << 10];
            while refusal.read_away < READ_AWAY {
                let mut thrown = ReadBuf::new(&mut thrown);
                match Pin::new(&mut *stream).poll_read(cx, &mut thrown) {
                    Poll::Ready(Ok(())) if !thrown.filled().is_empty() => refusal.read_away += thrown.filled().len(),
                    _ => break,
                }
            }
        }
        Pin::new(stream).poll_shutdown(cx)
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Worded<S> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hypers_own_heads_are_known_from_ours() {
        let of = |text: &str| unworded(text.as_bytes()).map(|status| status.as_u16());
        let own = "content-length: 0\r\nconnection: close\r\ndate: Thu, 26 Nov 2026 00:00:00 GMT\r\n\r\n";
        assert_eq!(of(&format!("HTTP/1.1 400 Bad Request\r\n{own}")), Some(400));
        assert_eq!(of(&format!("HTTP/1.0 431 Request Header Fields Too Large\r\n{own}")), Some(431));
        for other in [
            format!("HTTP/1.1 404 Not Found\r\n{own}"),
            format!("HTTP/1.1 200 OK\r\n{own}"),
            format!("HTTP/1.1 400 Bad Request\r\nx-request-id: 1\r\n{own}"),
            format!("HTTP/1.1 400 Bad Request\r\n{own}{{}}"),
            "HTTP/1.1 400 Bad Request\r\ncontent-length: 12\r\n\r\n".into(),
            "HTTP/1.1 4".into(),
            String::new(),
        ] {
            assert_eq!(of(&other), None, "{other}");
        }
    }
}

//! Connections: so many at once, and none for nothing.
//!
//! A connection that sends no whole header within `HEADER_WITHIN` is closed, an idle one with it; so is one whose client
//! takes nothing of an answer for `TAKEN_WITHIN`. Beyond the limit, connections wait in the kernel's queue.

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1::Builder;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio_io_timeout::TimeoutStream;

use super::tls::Tls;
use super::worded::{LARGEST_HEAD, Worded};

/// From the end of the last answer to the end of the next request's header.
const HEADER_WITHIN: Duration = Duration::from_secs(30);
/// How long a client may take nothing of an answer.
const TAKEN_WITHIN: Duration = Duration::from_secs(30);
/// A pause after an accept that failed: out of file descriptors, say.
const BREATH: Duration = Duration::from_millis(50);

/// Serves until `shutdown` resolves, then lets answers under way end.
pub async fn serve(
    listener: TcpListener,
    tls: Option<Tls>,
    app: Router,
    connections: usize,
    shutdown: impl Future<Output = ()>,
) {
    // Telling HTTP/2 from 1 would wait for a connection's first bytes, for ever.
    let mut builder = Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEADER_WITHIN).max_header_size(LARGEST_HEAD);
    let open = Arc::new(Semaphore::new(connections));
    let graceful = GracefulShutdown::new();
    // Dropped when the service closes, which ends waiting for a connection's first byte.
    let (closing, closed) = watch::channel(());
    tokio::pin!(shutdown);
    loop {
        let accepted = async {
            // Never closed, so a place always comes.
            let place = open.clone().acquire_owned().await.ok();
            (listener.accept().await, place)
        };
        let (accepted, place) = tokio::select! {
            accepted = accepted => accepted,
            () = &mut shutdown => break,
        };
        let stream = match accepted {
            Ok((stream, _)) => stream,
            Err(error) => {
                tracing::warn!(%error, "a connection could not be accepted");
                tokio::time::sleep(BREATH).await;
                continue;
            }
        };
        let (builder, app, watcher) = (builder.clone(), app.clone(), graceful.watcher());
        let (mut closed, acceptor) = (closed.clone(), tls.as_ref().map(Tls::acceptor));
        tokio::spawn(async move {
            let _place = place;
            let _ = stream.set_nodelay(true);
            // hyper's own time limit begins with the first byte.
            let mut first = [0; 1];
            tokio::select! {
                _ = stream.peek(&mut first) => {}
                () = tokio::time::sleep(HEADER_WITHIN) => return,
                _ = closed.changed() => return,
            }
            let mut stream = TimeoutStream::new(stream);
            stream.set_write_timeout(Some(TAKEN_WITHIN));
            let stream = Box::pin(stream);
            let ended = match acceptor {
                None => converse(stream, &builder, app, watcher).await,
                Some(acceptor) => {
                    let shaken = tokio::select! {
                        shaken = tokio::time::timeout(HEADER_WITHIN, acceptor.accept(stream)) => shaken,
                        _ = closed.changed() => return,
                    };
                    let Ok(Ok(stream)) = shaken else {
                        tracing::debug!("a connection did not get as far as TLS");
                        return;
                    };
                    converse(stream, &builder, app, watcher).await
                }
            };
            if let Err(error) = ended {
                tracing::debug!(%error, "a connection ended early");
            }
        });
    }
    drop((listener, closing));
    graceful.shutdown().await;
}

/// Answers a client until it closes, or until the service does.
async fn converse<S>(stream: S, builder: &Builder, app: Router, watcher: Watcher) -> hyper::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let service = TowerToHyperService::new(app);
    watcher.watch(builder.serve_connection(TokioIo::new(Worded::new(stream)), service)).await
}

//! Connections of viewers: how many, how long, how slow. No viewer can hold the memory or the time of the monitor.

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{Instant, Sleep};

/// Connections at once; a browser opens up to six for one page. Further ones are refused for the moment.
const MAX_CONNECTIONS: usize = 128;

/// Longest request head, bytes; also what waits for one slow viewer.
const MAX_BUFFER: usize = 16 * 1024;

/// Time limit for the head of a request, for its body, and for the next request on a connection.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// A viewer that takes nothing for this time is disconnected.
const WRITE_TIMEOUT: Duration = Duration::from_secs(10);

/// Pause after a connection that could not be accepted, for instance without free file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Time for the last events at the end of the run.
pub const LAST_WORDS: Duration = Duration::from_millis(200);

/// The answer to a connection too many; it fits into the buffer of a new socket.
const BUSY: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain\r\nContent-Length: 33\r\n\
    Retry-After: 5\r\nConnection: close\r\n\r\ntoo many connections; retry later";

/// Serves connections for ever.
pub async fn serve(listener: &TcpListener, router: Router, keep_alive: bool) {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(ACCEPT_PAUSE).await;
            continue;
        };
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
            // The client may have disconnected.
            let _ = stream.try_write(BUSY);
            continue;
        };
        let service = TowerToHyperService::new(router.clone());
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new())
            .header_read_timeout(REQUEST_TIMEOUT)
            .max_buf_size(MAX_BUFFER)
            .keep_alive(keep_alive);
        let connection = http.serve_connection(TokioIo::new(Patient::new(stream)), service);
        tokio::spawn(async move {
            // A client that breaks off is no fault of ours.
            let _ = connection.await;
            drop(place);
        });
    }
}

/// A connection that fails when its client takes nothing for a time.
struct Patient {
    stream: TcpStream,
    /// Runs while a write waits.
    waiting: Option<Pin<Box<Sleep>>>,
}

impl Patient {
    fn new(stream: TcpStream) -> Self {
        // Events are short and wanted at once.
        let _ = stream.set_nodelay(true);
        Self { stream, waiting: None }
    }

    fn limited<T>(&mut self, context: &mut Context, poll: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if poll.is_ready() {
            self.waiting = None;
            return poll;
        }
        let deadline = Instant::now() + WRITE_TIMEOUT;
        let waiting = self.waiting.get_or_insert_with(|| Box::pin(tokio::time::sleep_until(deadline)));
        waiting.as_mut().poll(context).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Patient {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Patient {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let poll = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.limited(context, poll)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let poll = Pin::new(&mut self.stream).poll_flush(context);
        self.limited(context, poll)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

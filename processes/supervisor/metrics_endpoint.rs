//! The metrics endpoint for Prometheus: one resource, `/metrics`, over HTTP/1.1.
//!
//! It has a limited number of threads, and every wait has a limit, so it cannot block the cell.

use super::command_socket::Call;
use super::metrics::CONTENT_TYPE;
use super::protocol::{Answer, Request};
use anyhow::{Context, Result};
use crossbeam::channel::{Sender, bounded};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longest request head, bytes; Prometheus sends about 300.
const MAX_HEAD: usize = 8192;

/// Connections at once; further ones are closed.
const MAX_CLIENTS: usize = 16;

/// Pause after a connection that could not be accepted, for instance without free file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Time limit for a client to send its request, and again to receive the answer.
const TIMEOUT: Duration = Duration::from_secs(2);

/// Listens on an address; returns it with the port that the system chose for port 0.
///
/// # Errors
/// The system refuses the address.
pub fn listen(address: SocketAddr, calls: Sender<Call>) -> Result<SocketAddr> {
    let listener = TcpListener::bind(address)
        .with_context(|| format!("--metrics {address}: cannot listen on this address"))?;
    let local = listener.local_addr()?;
    let clients = Arc::new(AtomicUsize::new(0));
    let accept = move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                std::thread::sleep(ACCEPT_PAUSE);
                continue;
            };
            if clients.fetch_add(1, Ordering::SeqCst) >= MAX_CLIENTS {
                clients.fetch_sub(1, Ordering::SeqCst);
                // Dropped unanswered: an answer could block this thread.
                continue;
            }
            let (calls, served) = (calls.clone(), Arc::clone(&clients));
            let serve = move || {
                // The client may have disconnected.
                let _ = serve(&stream, &calls);
                served.fetch_sub(1, Ordering::SeqCst);
            };
            if std::thread::Builder::new().name("metrics client".into()).spawn(serve).is_err() {
                clients.fetch_sub(1, Ordering::SeqCst);
            }
        }
    };
    std::thread::Builder::new().name("metrics".into()).spawn(accept).context("starting a thread")?;
    Ok(local)
}

fn serve(mut stream: &TcpStream, calls: &Sender<Call>) -> Result<()> {
    stream.set_write_timeout(Some(TIMEOUT))?;
    let reply = match head(stream) {
        Ok(head) => answer(&head, calls),
        Err(status) => Reply::error(status, ""),
    };
    stream.write_all(reply.to_bytes().as_slice())?;
    // Read the rest of the request for a moment: closing with unread bytes would discard the answer.
    stream.shutdown(std::net::Shutdown::Write)?;
    stream.set_read_timeout(Some(Duration::from_millis(100)))?;
    let mut rest = [0; 1024];
    let deadline = Instant::now() + TIMEOUT;
    while Instant::now() < deadline && matches!(stream.read(&mut rest), Ok(n) if n > 0) {}
    Ok(())
}

/// Reads up to the empty line; an error is a status line. The time limit is for the whole head.
fn head(mut stream: &TcpStream) -> Result<Vec<u8>, &'static str> {
    let deadline = Instant::now() + TIMEOUT;
    let mut head = Vec::with_capacity(1024);
    let mut chunk = [0; 1024];
    loop {
        let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
        stream.set_read_timeout(Some(left)).map_err(|_| "500 Internal Server Error")?;
        match stream.read(&mut chunk) {
            Ok(0) => return Err("400 Bad Request"),
            Ok(n) => head.extend_from_slice(&chunk[..n]),
            Err(_) => return Err("408 Request Timeout"),
        }
        if head.windows(4).any(|w| w == b"\r\n\r\n") {
            return Ok(head);
        }
        if head.len() > MAX_HEAD {
            return Err("431 Request Header Fields Too Large");
        }
        if Instant::now() >= deadline {
            return Err("408 Request Timeout");
        }
    }
}

struct Reply {
    status: &'static str,
    more: &'static str,
    body: String,
    with_body: bool,
}

impl Reply {
    fn error(status: &'static str, more: &'static str) -> Self {
        Self { status, more, body: format!("{status}; the metrics are at /metrics\n"), with_body: true }
    }

    fn to_bytes(&self) -> Vec<u8> {
        let (length, body) = (self.body.len(), if self.with_body { self.body.as_str() } else { "" });
        format!(
            "HTTP/1.1 {}\r\n{}Content-Type: {CONTENT_TYPE}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}",
            self.status, self.more
        )
        .into_bytes()
    }
}

fn answer(head: &[u8], calls: &Sender<Call>) -> Reply {
    let line = head.split(|&b| b == b'\r').next().unwrap_or_default();
    let Ok(line) = std::str::from_utf8(line) else { return Reply::error("400 Bad Request", "") };
    let words: Vec<&str> = line.split(' ').collect();
    let [method, target, version] = words[..] else { return Reply::error("400 Bad Request", "") };
    if !matches!(version, "HTTP/1.0" | "HTTP/1.1") {
        return Reply::error("505 HTTP Version Not Supported", "");
    }
    if !matches!(method, "GET" | "HEAD") {
        return Reply::error("405 Method Not Allowed", "Allow: GET, HEAD\r\n");
    }
    if target.split('?').next() != Some("/metrics") {
        return Reply::error("404 Not Found", "");
    }
    match metrics(calls) {
        Some(body) => Reply { status: "200 OK", more: "", body, with_body: method == "GET" },
        None => Reply::error("503 Service Unavailable", ""),
    }
}

/// Requests the metrics from the supervisor.
fn metrics(calls: &Sender<Call>) -> Option<String> {
    let (reply, answer) = bounded(1);
    calls.send((Request::Metrics {}, reply)).ok()?;
    match answer.recv_timeout(TIMEOUT).ok()? {
        Answer::Metrics(text) => Some(text),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer of an endpoint to some bytes.
    fn ask(address: SocketAddr, bytes: &[u8]) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(bytes).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8(answer).unwrap()
    }

    fn endpoint() -> SocketAddr {
        let (calls, requests) = bounded::<Call>(4);
        std::thread::spawn(move || {
            for (_, reply) in requests {
                let _ = reply.send(Answer::Metrics("a 1\n".into()));
            }
        });
        listen("127.0.0.1:0".parse().unwrap(), calls).unwrap()
    }

    #[test]
    fn valid_and_invalid_requests_get_their_status() {
        let address = endpoint();
        let ok = ask(address, b"GET /metrics?x=1 HTTP/1.1\r\nHost: cell\r\n\r\n");
        assert!(ok.starts_with("HTTP/1.1 200 OK\r\n") && ok.ends_with("\r\n\r\na 1\n"), "{ok}");
        assert!(ok.contains("Content-Length: 4\r\n"), "{ok}");
        let head = ask(address, b"HEAD /metrics HTTP/1.1\r\n\r\n");
        assert!(head.starts_with("HTTP/1.1 200 OK\r\n") && head.ends_with("\r\n\r\n"), "{head}");
        let long = vec![b'x'; 2 * MAX_HEAD];
        for (request, status) in [
            (&b"GET / HTTP/1.1\r\n\r\n"[..], "404"),
            (b"POST /metrics HTTP/1.1\r\n\r\n", "405"),
            (b"GET /metrics HTTP/3\r\n\r\n", "505"),
            (b"GET /metrics\r\n\r\n", "400"),
            (b"\xff\xfe\x00\r\n\r\n", "400"),
            (b"\r\n\r\n", "400"),
            (&long, "431"),
        ] {
            let answer = ask(address, request);
            assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{status}: {answer}");
        }
    }

    /// Proves: clients that send nothing, or half a head, do not block others.
    #[test]
    fn silent_clients_do_not_block_others() {
        let address = endpoint();
        let silent: Vec<TcpStream> =
            (0..MAX_CLIENTS - 1).map(|_| TcpStream::connect(address).unwrap()).collect();
        (&silent[0]).write_all(b"GET /metr").unwrap();
        assert!(ask(address, b"GET /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 200"));
        // The incomplete request is answered as well.
        let mut answer = String::new();
        (&silent[0]).read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
    }
}

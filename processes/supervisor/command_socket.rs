//! The command socket, over which people, scripts and PLC gateways control a running cell: one JSON object per line in each
//! direction, any number of lines per connection. No client can block the cell or another client.

use super::protocol::{Answer, Request};
use anyhow::{Context, Result, bail};
use crossbeam::channel::{Sender, bounded};
use serde::Serialize;
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longest request that is read, bytes.
const MAX_REQUEST: usize = 4096;

/// Clients at once; each one needs a thread.
const MAX_CLIENTS: usize = 32;

/// Further clients, for one short request each: `status` and `stop` work whatever the other clients do.
const RESERVED_CLIENTS: usize = 8;

/// Time limit for the request of a client on a reserved place.
const SHORT_TIMEOUT: Duration = Duration::from_secs(2);

/// Pause after a connection that could not be accepted, for instance without free file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Time limit for the end of a line, for sending an answer, and for an answer of the supervisor. Only an inspection takes as
/// long as its cycle.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Connections without a request for this time are closed.
const IDLE_TIMEOUT: Duration = Duration::from_secs(600);

/// A request with the channel for its answer.
pub type Call = (Request, Sender<Answer>);

/// Counts of the clients of a socket.
#[derive(Debug, Default)]
pub struct Clients {
    connected: AtomicUsize,
    unanswered: AtomicUsize,
}

impl Clients {
    /// Number of requests that were received and not answered yet.
    pub fn unanswered(&self) -> usize {
        self.unanswered.load(Ordering::SeqCst)
    }
}

/// Counts up until dropped.
struct Count<F: Fn(&Clients) -> &AtomicUsize>(Arc<Clients>, F);

impl<F: Fn(&Clients) -> &AtomicUsize> Count<F> {
    fn new(clients: &Arc<Clients>, of: F) -> Self {
        of(clients).fetch_add(1, Ordering::SeqCst);
        Self(Arc::clone(clients), of)
    }
}

impl<F: Fn(&Clients) -> &AtomicUsize> Drop for Count<F> {
    fn drop(&mut self) {
        (self.1)(&self.0).fetch_sub(1, Ordering::SeqCst);
    }
}

/// Listens on a socket and passes requests on.
pub fn listen(path: &Path, calls: Sender<Call>) -> Result<Arc<Clients>> {
    let listener = UnixListener::bind(path).with_context(|| format!("listening on {}", path.display()))?;
    let clients = Arc::new(Clients::default());
    let counts = Arc::clone(&clients);
    let accept = move || {
        for stream in listener.incoming() {
            match stream {
                Ok(stream) => accept(&Arc::new(stream), &calls, &counts),
                Err(_) => std::thread::sleep(ACCEPT_PAUSE),
            }
        }
    };
    std::thread::Builder::new().name("command socket".into()).spawn(accept).context("starting a thread")?;
    Ok(clients)
}

/// Serves a client in a thread of its own.
fn accept(stream: &Arc<UnixStream>, calls: &Sender<Call>, clients: &Arc<Clients>) {
    let place = Count::new(clients, |clients| &clients.connected);
    let connected = clients.connected.load(Ordering::SeqCst);
    // One line fits into the buffer of a new socket; a client may have disconnected.
    let refuse = |stream: &UnixStream, reason: String| drop(write(stream, &refused(reason)));
    if connected > MAX_CLIENTS + RESERVED_CLIENTS {
        return refuse(stream, too_many_clients());
    }
    let (calls, counts, served) = (calls.clone(), Arc::clone(clients), Arc::clone(stream));
    let serve = move || {
        let _place = place;
        // The client may have disconnected.
        let _ = if connected > MAX_CLIENTS {
            serve_shortly(&served, &calls, &counts)
        } else {
            serve(&served, &calls, &counts)
        };
    };
    if let Err(error) = std::thread::Builder::new().name("client".into()).spawn(serve) {
        tracing::warn!("a client is refused: {error}");
        refuse(stream, format!("the system has no thread for this client: {error}; retry later"));
    }
}

fn too_many_clients() -> String {
    format!(
        "{MAX_CLIENTS} clients are connected, which is the limit; only status, state, metrics, halt and stop are answered now"
    )
}

/// Answers line after line until the client disconnects or sends an invalid line.
fn serve(stream: &UnixStream, calls: &Sender<Call>, clients: &Arc<Clients>) -> Result<()> {
    stream.set_write_timeout(Some(TIMEOUT))?;
    let mut reader = BufReader::new(stream);
    loop {
        match line(&mut reader, stream, IDLE_TIMEOUT)? {
            Line::Text(text) if text.iter().all(u8::is_ascii_whitespace) => {}
            Line::Text(text) => {
                let _unanswered = Count::new(clients, |clients| &clients.unanswered);
                write(stream, &answer(request(&text), calls))?;
            }
            Line::End => return Ok(()),
            // The following bytes may belong to this line or to a new one.
            Line::Invalid(reason) => return write(stream, &refused(reason)),
        }
    }
}

/// Answers one request that needs no job.
fn serve_shortly(stream: &UnixStream, calls: &Sender<Call>, clients: &Arc<Clients>) -> Result<()> {
    stream.set_write_timeout(Some(SHORT_TIMEOUT))?;
    let text = match line(&mut BufReader::new(stream), stream, SHORT_TIMEOUT)? {
        Line::Text(text) => text,
        Line::End => return Ok(()),
        Line::Invalid(_) => return write(stream, &refused(too_many_clients())),
    };
    let _unanswered = Count::new(clients, |clients| &clients.unanswered);
    let request = request(&text).and_then(|request| match request {
        Request::Status {}
        | Request::State {}
        | Request::Metrics {}
        | Request::Halt {}
        | Request::Stop {} => Ok(request),
        _ => Err(refused(too_many_clients())),
    });
    write(stream, &answer(request, calls))
}

fn request(text: &[u8]) -> Result<Request, Answer> {
    serde_json::from_slice(text).map_err(|error| refused(format!("not a request: {error}")))
}

fn answer(request: Result<Request, Answer>, calls: &Sender<Call>) -> Answer {
    let request = match request {
        Ok(request) => request,
        Err(answer) => return answer,
    };
    let inspects = matches!(request, Request::Inspect { .. });
    let (reply, answer) = bounded(1);
    if calls.send((request, reply)).is_err() {
        return refused(STOPPED.into());
    }
    // Every cycle has an outcome within its deadline, so this returns.
    let answer = if inspects { answer.recv().ok() } else { answer.recv_timeout(TIMEOUT).ok() };
    answer.unwrap_or_else(|| refused(STOPPED.into()))
}

/// The answer to requests that come too late.
pub const STOPPED: &str = "the cell has stopped";

fn refused(reason: String) -> Answer {
    Answer::Refused(reason)
}

/// A line from a client.
enum Line {
    Text(Vec<u8>),
    End,
    Invalid(String),
}

/// Reads a line. The last one needs no line feed. A line that is incomplete for too long or too long is invalid.
fn line(reader: &mut BufReader<&UnixStream>, stream: &UnixStream, idle: Duration) -> Result<Line> {
    let mut text = Vec::new();
    let mut started = Instant::now();
    loop {
        let limit = if text.is_empty() { idle } else { TIMEOUT.min(idle) };
        let left = limit.saturating_sub(started.elapsed()).max(Duration::from_millis(1));
        stream.set_read_timeout(Some(left))?;
        let chunk = match reader.fill_buf() {
            Ok(chunk) => chunk,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(_) if text.is_empty() => {
                return Ok(Line::Invalid(format!("no request for {} s; connect again", idle.as_secs())));
            }
            Err(_) => {
                return Ok(Line::Invalid(format!("the line has no end within {} s", TIMEOUT.as_secs())));
            }
        };
        if chunk.is_empty() {
            return Ok(if text.is_empty() { Line::End } else { Line::Text(text) });
        }
        if text.is_empty() {
            started = Instant::now();
        }
        let end = chunk.iter().position(|&b| b == b'\n');
        let used = end.map_or(chunk.len(), |end| end + 1);
        text.extend_from_slice(&chunk[..end.unwrap_or(used)]);
        reader.consume(used);
        if text.len() > MAX_REQUEST {
            return Ok(Line::Invalid(format!("a request has at most {MAX_REQUEST} bytes")));
        }
        if end.is_some() {
            return Ok(Line::Text(text));
        }
        if started.elapsed() > TIMEOUT {
            return Ok(Line::Invalid(format!("the line has no end within {} s", TIMEOUT.as_secs())));
        }
    }
}

fn write<T: Serialize>(mut stream: &UnixStream, value: &T) -> Result<()> {
    let mut text = serde_json::to_vec(value)?;
    text.push(b'\n');
    Ok(stream.write_all(&text)?)
}

/// Sends a request to a running cell and returns its answer.
///
/// # Errors
/// No answer, or an invalid one.
pub fn ask(path: &Path, request: &Request) -> Result<Answer> {
    let stream = UnixStream::connect(path)?;
    let inspects = matches!(request, Request::Inspect { .. });
    stream.set_read_timeout(Some(TIMEOUT))?;
    if inspects { exchange_patiently(path, &stream, request) } else { exchange(&stream, request) }
}

/// Asks for an inspection, which takes as long as its cycle. While nothing comes, the cell is asked whether it still answers.
fn exchange_patiently(path: &Path, stream: &UnixStream, request: &Request) -> Result<Answer> {
    let sent = write(stream, request);
    let (mut reader, mut line) = (BufReader::new(stream), Vec::new());
    loop {
        // What was read before a time-out stays in the line.
        match reader.read_until(b'\n', &mut line) {
            Ok(_) => break,
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                let other = UnixStream::connect(path)?;
                other.set_read_timeout(Some(TIMEOUT))?;
                let asked = exchange(&other, &Request::Status {});
                asked.context(
                    "the part may be inspected or not, and its result is not known: see the log of the cell",
                )?;
            }
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e).context("the connection to the cell broke"),
        }
    }
    if line.is_empty() {
        sent?;
        bail!("the cell ended before it answered");
    }
    Ok(serde_json::from_slice(&line)?)
}

/// Sends a request and reads its answer.
fn exchange(stream: &UnixStream, request: &Request) -> Result<Answer> {
    // A cell that refuses a client closes without reading; its reason is there all the same.
    let sent = write(stream, request);
    let mut line = String::new();
    let read = BufReader::new(stream).read_line(&mut line);
    if line.is_empty() {
        sent?;
        read.with_context(|| format!("the cell did not answer within {} s", TIMEOUT.as_secs()))?;
        bail!("the cell ended before it answered");
    }
    Ok(serde_json::from_str(&line)?)
}

#[cfg(test)]
mod tests;

//! The command socket, over which people, scripts and PLC gateways control a running cell: one JSON object per line in each
//! direction, any number of lines per connection. No client can block the cell or another client.

use super::protocol::{Answer, Request};
use anyhow::{Context, Result, bail};
use crossbeam::channel::{Sender, bounded};
use serde::Serialize;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longest request, bytes.
const MAX_REQUEST: usize = 4096;

/// Clients at once; each one needs a thread.
const MAX_CLIENTS: usize = 32;

/// Time limit for the end of a line, for sending an answer, and for an answer of the supervisor. Only an inspection takes as
/// long as its cycle.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Connections without a request for this time are closed.
const IDLE_TIMEOUT: Duration = Duration::from_secs(600);

/// A request with the channel for its answer.
pub type Call = (Request, Sender<Answer>);

/// Listens on a socket and passes requests on.
pub fn listen(path: &Path, calls: Sender<Call>) -> Result<()> {
    let listener = UnixListener::bind(path).with_context(|| format!("listening on {}", path.display()))?;
    let clients = Arc::new(AtomicUsize::new(0));
    std::thread::spawn(move || {
        for stream in listener.incoming().filter_map(Result::ok) {
            if clients.fetch_add(1, Ordering::SeqCst) >= MAX_CLIENTS {
                clients.fetch_sub(1, Ordering::SeqCst);
                // One line fits into the buffer of a new socket; a client may have disconnected.
                let _ = write(
                    &stream,
                    &refused(format!("{MAX_CLIENTS} clients are connected, which is the limit")),
                );
                continue;
            }
            let (calls, clients) = (calls.clone(), Arc::clone(&clients));
            std::thread::spawn(move || {
                // The client may have disconnected.
                let _ = serve(&stream, &calls);
                clients.fetch_sub(1, Ordering::SeqCst);
            });
        }
    });
    Ok(())
}

/// Answers line after line until the client disconnects or sends an invalid line.
fn serve(stream: &UnixStream, calls: &Sender<Call>) -> Result<()> {
    stream.set_write_timeout(Some(TIMEOUT))?;
    let mut reader = BufReader::new(stream);
    loop {
        match line(&mut reader, stream)? {
            Line::Text(text) if text.iter().all(u8::is_ascii_whitespace) => {}
            Line::Text(text) => write(stream, &answer(&text, calls)?)?,
            Line::End => return Ok(()),
            // The following bytes may belong to this line or to a new one.
            Line::Invalid(reason) => return write(stream, &refused(reason)),
        }
    }
}

fn answer(text: &[u8], calls: &Sender<Call>) -> Result<Answer> {
    let request = match serde_json::from_slice::<Request>(text) {
        Ok(request) => request,
        Err(error) => return Ok(refused(format!("not a request: {error}"))),
    };
    let inspects = matches!(request, Request::Inspect { .. });
    let (reply, answer) = bounded(1);
    calls.send((request, reply))?;
    // Every cycle has an outcome within its deadline, so this returns.
    Ok(if inspects { answer.recv()? } else { answer.recv_timeout(TIMEOUT)? })
}

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
fn line(reader: &mut BufReader<&UnixStream>, stream: &UnixStream) -> Result<Line> {
    let mut text = Vec::new();
    let mut started = Instant::now();
    loop {
        let limit = if text.is_empty() { IDLE_TIMEOUT } else { TIMEOUT };
        let left = limit.saturating_sub(started.elapsed()).max(Duration::from_millis(1));
        stream.set_read_timeout(Some(left))?;
        let chunk = match reader.fill_buf() {
            Ok(chunk) => chunk,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(_) if text.is_empty() => {
                return Ok(Line::Invalid("no request for 10 min; connect again".into()));
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
    stream.set_read_timeout((!inspects).then_some(TIMEOUT))?;
    write(&stream, request)?;
    let mut line = String::new();
    BufReader::new(&stream).read_line(&mut line).context("the cell did not answer")?;
    if line.is_empty() {
        bail!("the cell ended before it answered");
    }
    Ok(serde_json::from_str(&line)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    /// A cell that answers every request with its debug text.
    fn cell() -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("command");
        let (calls, requests) = bounded::<Call>(4);
        listen(&path, calls).unwrap();
        std::thread::spawn(move || {
            for (request, reply) in requests {
                let _ = reply.send(Answer::Done(format!("{request:?}")));
            }
        });
        (folder, path)
    }

    fn received(mut stream: &UnixStream) -> String {
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn one_connection_carries_several_requests() {
        let (_folder, path) = cell();
        let answer = ask(&path, &Request::Restart { stage: "decode/cam1".into() }).unwrap();
        assert!(matches!(answer, Answer::Done(text) if text.contains("decode/cam1")));
        let stream = UnixStream::connect(&path).unwrap();
        (&stream)
            .write_all(b"{\"command\":\"status\"}\n\n{\"command\":\"stop\"}\r\n{\"command\":\"state\"}")
            .unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        assert_eq!(received(&stream), "{\"done\":\"Status\"}\n{\"done\":\"Stop\"}\n{\"done\":\"State\"}\n");
    }

    #[test]
    fn an_invalid_request_is_refused_with_its_reason_and_the_connection_stays_usable() {
        let (_folder, path) = cell();
        for invalid in [
            &b"{\"command\":\"dance\"}"[..],
            b"{\"command\":\"stop\",\"now\":true}",
            b"{\"command\":\"inspect\"}",
            b"[]",
            b"status",
            b"\x00\xff\xfe\x80",
            b"{\"command\":\"inspect\",\"part\":\"\xff\"}",
            &[b'['; 4000],
        ] {
            let stream = UnixStream::connect(&path).unwrap();
            (&stream).write_all(invalid).unwrap();
            (&stream).write_all(b"\n{\"command\":\"stop\"}\n").unwrap();
            stream.shutdown(std::net::Shutdown::Write).unwrap();
            let text = received(&stream);
            let lines: Vec<&str> = text.lines().collect();
            assert!(lines[0].starts_with("{\"refused\":\"not a request: "), "{text}");
            assert_eq!(lines[1..], ["{\"done\":\"Stop\"}"], "{text}");
        }
    }

    #[test]
    fn a_line_without_end_is_refused_when_it_is_too_long() {
        let (_folder, path) = cell();
        let stream = UnixStream::connect(&path).unwrap();
        // The cell may close before all of it is written.
        let _ = (&stream).write_all(&vec![b'x'; 3 * MAX_REQUEST]);
        let mut line = String::new();
        BufReader::new(&stream).read_line(&mut line).unwrap();
        assert_eq!(line, "{\"refused\":\"a request has at most 4096 bytes\"}\n");
    }

    #[test]
    fn more_clients_than_allowed_are_refused_and_the_others_are_served() {
        let (_folder, path) = cell();
        let clients: Vec<UnixStream> =
            (0..MAX_CLIENTS).map(|_| UnixStream::connect(&path).unwrap()).collect();
        // Half a line in each: none of them keeps the last one from being served.
        for mut client in &clients[1..] {
            client.write_all(b"{\"comm").unwrap();
        }
        assert!(received(&UnixStream::connect(&path).unwrap()).contains("32 clients are connected"));
        (&clients[0]).write_all(b"{\"command\":\"stop\"}\n").unwrap();
        let mut line = String::new();
        BufReader::new(&clients[0]).read_line(&mut line).unwrap();
        assert_eq!(line, "{\"done\":\"Stop\"}\n");
        drop(clients);
        let begin = Instant::now();
        while ask(&path, &Request::Stop {}).is_err()
            || !matches!(ask(&path, &Request::Stop {}), Ok(Answer::Done(_)))
        {
            assert!(begin.elapsed() < Duration::from_secs(60), "the places are not given back");
        }
    }
}

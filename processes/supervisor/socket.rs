//! The socket over which people, scripts and PLC gateways reach a running cell: one JSON object per line each way, any
//! number of lines per connection. Nothing that a client does or leaves undone blocks the cell or another client.

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

/// Clients at once; each costs a thread.
const MAX_CLIENTS: usize = 32;

/// How long either side waits for the other: the end of a line, room for an answer, the supervisor, which looks every
/// 20 ms. Only an inspection takes as long as its cycle.
const TIMEOUT: Duration = Duration::from_secs(10);

/// A client that says nothing for so long is asked to come again, so that forgotten connections do not use up the places.
const IDLE: Duration = Duration::from_secs(600);

/// A request with the way back.
pub type Call = (Request, Sender<Answer>);

/// Listens on a socket and hands requests on.
pub fn listen(path: &Path, calls: Sender<Call>) -> Result<()> {
    let listener = UnixListener::bind(path).with_context(|| format!("listening on {}", path.display()))?;
    let clients = Arc::new(AtomicUsize::new(0));
    std::thread::spawn(move || {
        for stream in listener.incoming().filter_map(Result::ok) {
            if clients.fetch_add(1, Ordering::SeqCst) >= MAX_CLIENTS {
                clients.fetch_sub(1, Ordering::SeqCst);
                // An empty socket takes a line at once; a client that went away needs none.
                let _ = write(
                    &stream,
                    &refused(format!("{MAX_CLIENTS} clients are connected, which is the limit")),
                );
                continue;
            }
            let (calls, clients) = (calls.clone(), Arc::clone(&clients));
            std::thread::spawn(move || {
                // A client that went away needs no answer.
                let _ = serve(&stream, &calls);
                clients.fetch_sub(1, Ordering::SeqCst);
            });
        }
    });
    Ok(())
}

/// Answers line after line until the client leaves or can no longer be understood.
fn serve(stream: &UnixStream, calls: &Sender<Call>) -> Result<()> {
    stream.set_write_timeout(Some(TIMEOUT))?;
    let mut reader = BufReader::new(stream);
    loop {
        match line(&mut reader, stream)? {
            Line::Text(text) if text.iter().all(u8::is_ascii_whitespace) => {}
            Line::Text(text) => write(stream, &answer(&text, calls)?)?,
            Line::End => return Ok(()),
            // What follows could be the rest of this line as well as a new one.
            Line::Lost(reason) => return write(stream, &refused(reason)),
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
    // Every cycle has an outcome within its deadline, so this ends.
    Ok(if inspects { answer.recv()? } else { answer.recv_timeout(TIMEOUT)? })
}

fn refused(reason: String) -> Answer {
    Answer::Refused(reason)
}

/// What a client sent.
enum Line {
    Text(Vec<u8>),
    End,
    Lost(String),
}

/// Reads a line. The last one needs no end; half a line, or one that is too long, is not waited for.
fn line(reader: &mut BufReader<&UnixStream>, stream: &UnixStream) -> Result<Line> {
    let mut text = Vec::new();
    let mut begun = Instant::now();
    loop {
        let patience = if text.is_empty() { IDLE } else { TIMEOUT };
        let left = patience.saturating_sub(begun.elapsed()).max(Duration::from_millis(1));
        stream.set_read_timeout(Some(left))?;
        let chunk = match reader.fill_buf() {
            Ok(chunk) => chunk,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(_) if text.is_empty() => {
                return Ok(Line::Lost("nothing was asked for long; connect again".into()));
            }
            Err(_) => return Ok(Line::Lost(format!("no end of the line within {} s", TIMEOUT.as_secs()))),
        };
        if chunk.is_empty() {
            return Ok(if text.is_empty() { Line::End } else { Line::Text(text) });
        }
        if text.is_empty() {
            begun = Instant::now();
        }
        let end = chunk.iter().position(|&b| b == b'\n');
        let used = end.map_or(chunk.len(), |end| end + 1);
        text.extend_from_slice(&chunk[..end.unwrap_or(used)]);
        reader.consume(used);
        if text.len() > MAX_REQUEST {
            return Ok(Line::Lost(format!("a request has at most {MAX_REQUEST} bytes")));
        }
        if end.is_some() {
            return Ok(Line::Text(text));
        }
        if begun.elapsed() > TIMEOUT {
            return Ok(Line::Lost(format!("no end of the line within {} s", TIMEOUT.as_secs())));
        }
    }
}

fn write<T: Serialize>(mut stream: &UnixStream, value: &T) -> Result<()> {
    let mut text = serde_json::to_vec(value)?;
    text.push(b'\n');
    Ok(stream.write_all(&text)?)
}

/// Asks a running cell.
///
/// # Errors
/// No answer, or none that can be understood.
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

    fn said(mut stream: &UnixStream) -> String {
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn requests_travel_one_after_the_other_over_one_connection() {
        let (_folder, path) = cell();
        let answer = ask(&path, &Request::Restart { stage: "decode/cam1".into() }).unwrap();
        assert!(matches!(answer, Answer::Done(text) if text.contains("decode/cam1")));
        let stream = UnixStream::connect(&path).unwrap();
        (&stream)
            .write_all(b"{\"command\":\"status\"}\n\n{\"command\":\"stop\"}\r\n{\"command\":\"state\"}")
            .unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        assert_eq!(said(&stream), "{\"done\":\"Status\"}\n{\"done\":\"Stop\"}\n{\"done\":\"State\"}\n");
    }

    #[test]
    fn nonsense_is_refused_with_its_reason_and_the_connection_stays_usable() {
        let (_folder, path) = cell();
        for nonsense in [
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
            (&stream).write_all(nonsense).unwrap();
            (&stream).write_all(b"\n{\"command\":\"stop\"}\n").unwrap();
            stream.shutdown(std::net::Shutdown::Write).unwrap();
            let said = said(&stream);
            let lines: Vec<&str> = said.lines().collect();
            assert!(lines[0].starts_with("{\"refused\":\"not a request: "), "{said}");
            assert_eq!(lines[1..], ["{\"done\":\"Stop\"}"], "{said}");
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
    fn too_many_clients_are_told_so_and_the_others_go_on() {
        let (_folder, path) = cell();
        let clients: Vec<UnixStream> =
            (0..MAX_CLIENTS).map(|_| UnixStream::connect(&path).unwrap()).collect();
        // Half a line in each: none of them keeps the last one from being served.
        for mut client in &clients[1..] {
            client.write_all(b"{\"comm").unwrap();
        }
        assert!(said(&UnixStream::connect(&path).unwrap()).contains("32 clients are connected"));
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

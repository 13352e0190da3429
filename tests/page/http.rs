//! A client that sends what it is told, also what no browser would.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// Long enough for a machine that does ten other things.
const PATIENCE: Duration = Duration::from_secs(60);

/// What the server sent back.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    fn parse(bytes: &[u8]) -> Self {
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap_or(bytes.len());
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        Self { status, head, body: bytes.get(end + 4..).unwrap_or_default().to_vec() }
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}\n{}", self.head, self.text()))
    }

    pub fn header(&self, name: &str) -> Option<&str> {
        let mut lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value)
    }
}

pub fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

/// Sends bytes as they are and reads until the end.
pub fn raw(address: SocketAddr, bytes: &[u8]) -> Answer {
    exchange(connect(address), bytes)
}

fn exchange(mut stream: TcpStream, bytes: &[u8]) -> Answer {
    // The other end may refuse before it has read all.
    let _ = stream.write_all(bytes);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    Answer::parse(&answer)
}

pub fn get(address: SocketAddr, path: &str) -> Answer {
    raw(address, format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").as_bytes())
}

/// Gets a path; `None` where nobody listens any more.
pub fn get_if(address: SocketAddr, path: &str) -> Option<Answer> {
    let stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    Some(exchange(stream, request.as_bytes()))
}

/// Posts a body, with more header lines that end with a line feed each.
pub fn post(address: SocketAddr, path: &str, body: &str, more: &str) -> Answer {
    let length = body.len();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: {length}\r\n{more}\r\n"
    );
    raw(address, (head + body).as_bytes())
}

/// A viewer that reads events.
pub struct Events {
    reader: std::cell::RefCell<BufReader<TcpStream>>,
}

impl Events {
    /// Opens the stream and waits until it is open.
    pub fn open(address: SocketAddr) -> Self {
        let mut stream = connect(address);
        write!(stream, "GET /api/events HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
        let mut reader = BufReader::new(stream);
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        assert!(line.contains(" 200 "), "{line}");
        Self { reader: std::cell::RefCell::new(reader) }
    }

    /// The data of the next event of a kind.
    pub fn until(&self, kind: &str) -> Value {
        self.next(kind).unwrap_or_else(|| panic!("no event {kind:?}"))
    }

    /// The same; `None` at the end of the cell.
    pub fn next(&self, kind: &str) -> Option<Value> {
        let begin = Instant::now();
        let mut found = false;
        loop {
            let mut line = String::new();
            let read = self.reader.borrow_mut().read_line(&mut line);
            if !matches!(read, Ok(bytes) if bytes > 0) || begin.elapsed() > PATIENCE {
                return None;
            }
            match line.trim_end().split_once(": ") {
                Some(("event", name)) => found = name == kind,
                Some(("data", data)) if found => return Some(serde_json::from_str(data).unwrap()),
                _ => {}
            }
        }
    }
}

//! The socket over which `status`, `restart` and `stop` reach a running cell: one JSON object per line each way.

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

/// Longest request, bytes.
const MAX_REQUEST: u64 = 4096;

/// How long either side waits for the other. The supervisor looks every 20 ms.
const TIMEOUT: Duration = Duration::from_secs(10);

/// What a person asks of a cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// How it is.
    Status {},
    /// Kill a stage and start it again.
    Restart {
        /// Name in the schedule.
        stage: String,
    },
    /// End the run.
    Stop {},
}

/// What the cell answers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Answer {
    /// How it is.
    Status(Status),
    /// Done.
    Done(String),
    /// Not done, and why.
    Refused(String),
}

/// How a cell is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// Name.
    pub cell: String,
    /// Process of the supervisor.
    pub pid: u32,
    /// The cycle that runs.
    pub cycle: Option<u64>,
    /// Cycles with an outcome.
    pub cycles_done: u64,
    /// Of these, ok.
    pub cycles_ok: u64,
    /// Cycles asked for; absent: until stopped.
    pub cycles_requested: Option<u64>,
    /// In the order of the schedule.
    pub stages: Vec<StageStatus>,
}

/// How a stage is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageStatus {
    /// Name.
    pub name: String,
    /// Process, while there is one.
    pub pid: Option<u32>,
    /// `up`, `starting`, …
    pub state: String,
    /// Failures since the start of the cell.
    pub restarts: u32,
    /// Since it last said anything, ms.
    pub silent_ms: u64,
}

/// A request with the way back.
pub type Call = (Request, Sender<Answer>);

/// Listens on a socket; requests come out of the channel.
pub fn listen(path: &Path) -> Result<Receiver<Call>> {
    let listener = UnixListener::bind(path).with_context(|| format!("listening on {}", path.display()))?;
    let (calls, requests) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().filter_map(Result::ok) {
            let calls = calls.clone();
            std::thread::spawn(move || {
                // A person who went away needs no answer.
                let _ = serve(&stream, &calls);
            });
        }
    });
    Ok(requests)
}

fn serve(stream: &UnixStream, calls: &Sender<Call>) -> Result<()> {
    stream.set_read_timeout(Some(TIMEOUT))?;
    let mut line = String::new();
    BufReader::new(stream.take(MAX_REQUEST)).read_line(&mut line)?;
    let answer = match serde_json::from_str::<Request>(&line) {
        Ok(request) => {
            let (reply, answer) = channel();
            calls.send((request, reply))?;
            answer.recv_timeout(TIMEOUT)?
        }
        Err(error) => Answer::Refused(format!("not a request: {error}")),
    };
    write(stream, &answer)
}

fn write<T: Serialize>(mut stream: &UnixStream, value: &T) -> Result<()> {
    let mut text = serde_json::to_string(value)?;
    text.push('\n');
    Ok(stream.write_all(text.as_bytes())?)
}

/// Asks a running cell.
pub fn ask(path: &Path, request: &Request) -> Result<Answer> {
    let stream = UnixStream::connect(path)?;
    stream.set_read_timeout(Some(TIMEOUT))?;
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

    #[test]
    fn requests_travel_and_nonsense_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("command");
        let requests = listen(&path).unwrap();
        let cell = std::thread::spawn(move || {
            let (request, reply) = requests.recv().unwrap();
            reply.send(Answer::Done(format!("{request:?}"))).unwrap();
        });
        let answer = ask(&path, &Request::Restart { stage: "decode/cam1".into() }).unwrap();
        assert!(matches!(answer, Answer::Done(text) if text.contains("decode/cam1")));
        cell.join().unwrap();

        let mut stream = UnixStream::connect(&path).unwrap();
        stream.write_all(b"{\"command\":\"dance\"}\n").unwrap();
        let mut line = String::new();
        BufReader::new(&stream).read_line(&mut line).unwrap();
        assert!(line.contains("refused"), "{line}");
    }
}

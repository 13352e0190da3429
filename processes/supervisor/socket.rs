//! The socket over which `status`, `restart` and `stop` reach a running cell: one JSON object per line each way.

use super::profile::{Outcomes, Percentiles};
use anyhow::{Context, Result, bail};
use rig::result::StageResult;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::mpsc::{Sender, channel};
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
    /// The same in the Prometheus text format.
    Metrics {},
    /// Kill a stage and start it again.
    Restart {
        /// Name in the schedule.
        stage: String,
    },
    /// End the run.
    Stop {},
}

/// What the cell answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Answer {
    /// How it is.
    Status(Box<Status>),
    /// In the Prometheus text format.
    Metrics(String),
    /// Done.
    Done(String),
    /// Not done, and why.
    Refused(String),
}

/// How a cell is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Of the last cycles; absent before the second one.
    pub cycles_per_minute: Option<f64>,
    /// Cycles by what became of them.
    pub outcomes: Outcomes,
    /// Cycles that were not done within their deadline.
    pub deadline_misses: u64,
    /// From start to outcome, of the last cycles that were ok.
    pub cycle_time: Percentiles,
    /// From the last frame to the verdict, of the same.
    pub latency: Percentiles,
    /// The last cycle that was not ok, and why.
    pub last_failure: Option<(u64, String)>,
    /// In the order of the schedule.
    pub stages: Vec<StageStatus>,
}

/// How a stage is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Cycles that `total` is the sum of.
    pub cycles: u64,
    /// Waiting for input, per cycle.
    pub wait: Percentiles,
    /// Computing, per cycle.
    pub compute: Percentiles,
    /// Handing outputs over, per cycle.
    pub send: Percentiles,
    /// What it did and used since the start of the cell.
    pub total: StageResult,
}

/// A request with the way back.
pub type Call = (Request, Sender<Answer>);

/// Listens on a socket and hands requests on.
pub fn listen(path: &Path, calls: Sender<Call>) -> Result<()> {
    let listener = UnixListener::bind(path).with_context(|| format!("listening on {}", path.display()))?;
    std::thread::spawn(move || {
        for stream in listener.incoming().filter_map(Result::ok) {
            let calls = calls.clone();
            std::thread::spawn(move || {
                // A person who went away needs no answer.
                let _ = serve(&stream, &calls);
            });
        }
    });
    Ok(())
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
        let (calls, requests) = channel();
        listen(&path, calls).unwrap();
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

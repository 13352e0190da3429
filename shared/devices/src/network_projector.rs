//! A projector that another program drives: it receives over the network what to show, and answers when the pattern stands.
//!
//! One datagram of text a command, numbered, so that a repeated one is not carried out twice:
//!
//! ```text
//! 17 begin 3             the third cycle begins             17 ok
//! 18 show proj1 4        show frame 4 (from 0) of proj1     18 ok        or  18 error REASON
//! 19 run proj1 19 20000  show all 19 frames of proj1, one every 20 000 µs, and fire the cameras with each    19 ok, at the start
//! ```

use crate::background::Background;
use crate::device::Projector;
use crate::error::DeviceError;
use cell::configuration::TriggerMode;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// A command without an answer is sent again after this time.
const REPEAT: Duration = Duration::from_millis(200);

/// A part may be put in place between two cycles: so long may the answer to `begin` take.
const BEGIN_LIMIT: Duration = Duration::from_secs(60);

/// Longest time until a pattern stands.
const SHOW_LIMIT: Duration = Duration::from_secs(5);

/// A sequence that runs by itself begins so long after the start of the cycle: by then every camera has let go of the frames of a
/// cycle that was broken off.
pub(crate) const LEAD_NS: u64 = 100_000_000;

const MAX_TEXT_BYTES: usize = 512;

/// A command to the other program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ProjectorCommand {
    /// A cycle begins, counted from 0: the part stands.
    Begin(u64),
    /// Show a frame of the sequence of a projector, counted from 0.
    Show {
        /// Name of the projector.
        projector: String,
        /// Number of the frame in its sequence, from 0.
        frame: usize,
    },
    /// Show the whole sequence of a projector in its own time, and fire the cameras with each frame.
    Run {
        /// Name of the projector.
        projector: String,
        /// Number of frames of the sequence.
        frames: usize,
        /// From one frame to the next, µs.
        period_us: u64,
    },
}

impl ProjectorCommand {
    fn parse(text: &str) -> Option<(u64, Self)> {
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words.as_slice() {
            [id, "begin", cycle] => Some((id.parse().ok()?, Self::Begin(cycle.parse().ok()?))),
            [id, "show", projector, frame] => {
                let projector = (*projector).to_owned();
                Some((id.parse().ok()?, Self::Show { projector, frame: frame.parse().ok()? }))
            }
            [id, "run", projector, frames, period_us] => {
                let (frames, period_us) = (frames.parse().ok()?, period_us.parse().ok()?);
                Some((id.parse().ok()?, Self::Run { projector: (*projector).to_owned(), frames, period_us }))
            }
            _ => None,
        }
    }
}

impl std::fmt::Display for ProjectorCommand {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Begin(cycle) => write!(f, "begin {cycle}"),
            Self::Show { projector, frame } => write!(f, "show {projector} {frame}"),
            Self::Run { projector, frames, period_us } => write!(f, "run {projector} {frames} {period_us}"),
        }
    }
}

/// The projectors of a cell, driven by another program.
pub(crate) struct NetworkProjector {
    socket: UdpSocket,
    address: SocketAddr,
    lights: Vec<Light>,
    id: u64,
    /// When the first sequence of a cycle may run.
    ready_ns: Option<u64>,
}

/// A projector as the other program knows it.
#[derive(Debug, Clone)]
pub(crate) struct Light {
    /// Name of the projector.
    pub name: String,
    /// Frames of its sequence.
    pub frames: usize,
    /// Who fires the cameras.
    pub trigger: TriggerMode,
}

impl NetworkProjector {
    /// Opens a socket towards the program; the projectors are in the order of the cell.
    pub fn new(address: SocketAddr, lights: Vec<Light>) -> Result<Self, DeviceError> {
        let fail = |source| DeviceError::Network { address, source };
        let socket = UdpSocket::bind(if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" }).map_err(fail)?;
        socket.connect(address).map_err(fail)?;
        socket.set_read_timeout(Some(REPEAT)).map_err(fail)?;
        // Answers to an earlier process with other numbers must not match: begin with the clock.
        let id = std::time::UNIX_EPOCH.elapsed().map_or(1, |t| t.as_micros() as u64);
        Ok(Self { socket, address, lights, id, ready_ns: None })
    }

    /// Sends a command until it is answered.
    fn ask(&mut self, command: &ProjectorCommand, limit: Duration) -> Result<(), DeviceError> {
        self.id += 1;
        let text = format!("{} {command}", self.id);
        let refused = |reason: String| DeviceError::Frame(format!("projector at {}: {reason}", self.address));
        let start = Instant::now();
        let mut buffer = [0; MAX_TEXT_BYTES];
        let mut last_fault = None;
        while start.elapsed() < limit {
            if let Err(source) = self.socket.send(text.as_bytes()) {
                last_fault = Some(source.to_string());
            }
            let sent = Instant::now();
            while sent.elapsed() < REPEAT {
                let answer = match self.socket.recv(&mut buffer) {
                    Ok(length) => String::from_utf8_lossy(&buffer[..length]).into_owned(),
                    Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => break,
                    Err(source) => {
                        // Nobody listens yet.
                        last_fault = Some(source.to_string());
                        std::thread::sleep(REPEAT / 4);
                        break;
                    }
                };
                match answer.trim().split_once(' ') {
                    Some((id, "ok")) if id == self.id.to_string() => return Ok(()),
                    Some((id, rest)) if id == self.id.to_string() => {
                        return Err(refused(rest.trim_start_matches("error ").to_owned()));
                    }
                    _ => {} // the answer to an earlier command
                }
            }
        }
        let fault = last_fault.map_or(String::new(), |fault| format!(" ({fault})"));
        Err(refused(format!("no answer to \"{command}\" within {} s{fault}", limit.as_secs())))
    }
}

impl Projector for NetworkProjector {
    fn begin(&mut self, cycle: u64, now_ns: u64) -> Result<(), DeviceError> {
        let sequenced = self.lights.iter().any(|light| light.trigger != TriggerMode::Stepped);
        self.ready_ns = sequenced.then_some(now_ns + LEAD_NS);
        self.ask(&ProjectorCommand::Begin(cycle), BEGIN_LIMIT)
    }

    fn due_ns(&self) -> Option<u64> {
        self.ready_ns
    }

    fn show(&mut self, projector: usize, frame: usize, _now_ns: u64) -> Result<(), DeviceError> {
        let Light { name, frames, trigger } = self.lights[projector].clone();
        self.ready_ns = None;
        match trigger {
            TriggerMode::Stepped => self.ask(&ProjectorCommand::Show { projector: name, frame }, SHOW_LIMIT),
            TriggerMode::Sequenced { period_ms } if frame == 0 => {
                let period_us = (period_ms * 1e3).round() as u64;
                self.ask(&ProjectorCommand::Run { projector: name, frames, period_us }, SHOW_LIMIT)
            }
            // The sequence runs: the cameras are fired without the cell.
            TriggerMode::Sequenced { .. } => Ok(()),
        }
    }
}

/// The other end: a program that carries out the commands, until dropped.
#[derive(Debug)]
pub struct ProjectorServer {
    address: SocketAddr,
    _answering: Background,
}

impl ProjectorServer {
    /// Listens on an address; `show` carries a command out and returns when it is done.
    ///
    /// # Errors
    /// The address is taken or may not be opened.
    pub fn start(
        address: SocketAddr,
        mut show: impl FnMut(ProjectorCommand) -> Result<(), String> + Send + 'static,
    ) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_read_timeout(Some(REPEAT))?;
        let address = socket.local_addr()?;
        let mut buffer = [0; MAX_TEXT_BYTES];
        let mut last: Option<(SocketAddr, u64, String)> = None;
        let answering = Background::start("projectors", move || {
            let Ok((length, from)) = socket.recv_from(&mut buffer) else { return };
            let text = String::from_utf8_lossy(&buffer[..length]).into_owned();
            let Some((id, command)) = ProjectorCommand::parse(&text) else { return };
            let answer = match &last {
                Some((client, done, answer)) if (*client, *done) == (from, id) => answer.clone(),
                _ => match show(command) {
                    Ok(()) => format!("{id} ok"),
                    Err(reason) => format!("{id} error {reason}"),
                },
            };
            // A client that is gone asks no more.
            let _ = socket.send_to(answer.as_bytes(), from);
            last = Some((from, id, answer));
        })?;
        Ok(Self { address, _answering: answering })
    }

    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    #[test]
    fn commands_arrive_once_in_order_and_refusals_come_back() {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let kept = seen.clone();
        let any = "127.0.0.1:0".parse().unwrap();
        let server = ProjectorServer::start(any, move |command| {
            // Longer than a client waits before it asks again.
            if command == ProjectorCommand::Begin(1) {
                std::thread::sleep(REPEAT * 3);
            }
            kept.lock().unwrap().push(command.to_string());
            if command.to_string().contains("proj2") { Err("the lamp is off".to_owned()) } else { Ok(()) }
        })
        .unwrap();
        let light = |name: &str, trigger| Light { name: name.to_owned(), frames: 19, trigger };
        let lights = vec![
            light("proj1", TriggerMode::Stepped),
            light("proj2", TriggerMode::Stepped),
            light("proj3", TriggerMode::Sequenced { period_ms: 12.5 }),
        ];
        let mut projector = NetworkProjector::new(server.address(), lights).unwrap();
        projector.begin(1, 0).unwrap();
        projector.show(0, 4, 0).unwrap();
        let refused = projector.show(1, 0, 0).unwrap_err().to_string();
        assert!(refused.contains("the lamp is off"), "{refused}");
        (0..19).for_each(|frame| projector.show(2, frame, 0).unwrap());
        assert_eq!(*seen.lock().unwrap(), ["begin 1", "show proj1 4", "show proj2 0", "run proj3 19 12500"]);
        drop(server);
        let lost =
            projector.ask(&ProjectorCommand::Begin(2), Duration::from_millis(500)).unwrap_err().to_string();
        assert!(lost.contains("no answer to \"begin 2\""), "{lost}");
    }
}

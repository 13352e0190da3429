//! The receiving process: it writes arrival times as JSON to its standard output.

use super::Plan;
use anyhow::{Context, Result, bail, ensure};
use ipc::cell::CellName;
use ipc::header::Frame;
use ipc::os::now_ns;
use ipc::port::Node;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::os::unix::net::UnixStream;
use std::time::Duration;
use twox_hash::XxHash3_64;

/// Longer than any frame takes; then the sender is gone.
const PATIENCE: Duration = Duration::from_secs(20);

/// Frames that only warm up: the first touch of each buffer costs page faults, which a cell has behind it at its start.
pub(super) const WARM_UP: u32 = 16;

/// Bytes before each frame of a stream: number, hash.
pub(super) const STREAM_HEADER: usize = 16;

/// Where frames come from.
#[derive(Debug, Clone)]
pub enum Source {
    /// The shared memory of a cell.
    Memory(CellName),
    /// The socket at a path.
    Socket(String),
    /// Frames on standard input.
    Pipe,
}

impl std::str::FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("memory", name)) => Ok(Self::Memory(CellName::new(name).map_err(|e| e.to_string())?)),
            Some(("socket", path)) => Ok(Self::Socket(path.to_owned())),
            Some(("pipe", _)) => Ok(Self::Pipe),
            _ => Err("memory:NAME, socket:PATH or pipe: are possible".into()),
        }
    }
}

/// Times of the received frames, ns on the machine's monotonic clock.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct ReceivedFrames {
    /// When each frame could be read.
    pub arrived_ns: Vec<u64>,
    /// When the last one had been read.
    pub read_ns: u64,
}

/// Receives all frames and reports their arrival.
pub(super) fn run(from: &Source, plan: Plan) -> Result<()> {
    let seen = match from {
        Source::Memory(name) => memory(name, plan)?,
        Source::Socket(path) => {
            let mut stream = UnixStream::connect(path).with_context(|| path.clone())?;
            stream.set_read_timeout(Some(PATIENCE))?;
            stream_of(&mut stream, plan)?
        }
        Source::Pipe => stream_of(&mut std::io::stdin().lock(), plan)?,
    };
    println!("{}", serde_json::to_string(&seen)?);
    Ok(())
}

impl ReceivedFrames {
    fn arrived(&mut self, number: u32, now_ns: u64) {
        if number >= WARM_UP {
            self.arrived_ns.push(now_ns);
        }
    }
}

fn memory(name: &CellName, plan: Plan) -> Result<ReceivedFrames> {
    let node = Node::join(name, "receiver")?;
    let listener = node.listener("receiver")?;
    let frames = node.subscriber::<Frame>("frame")?;
    frames.connect()?;
    let ready = node.publisher::<Frame>("ready", 1, &["sender".to_owned()], PATIENCE)?;
    ready.send(tiny(), &[0])?;
    let mut seen = ReceivedFrames::default();
    for number in 0..WARM_UP + plan.frames {
        let message = loop {
            if let Some(message) = frames.receive()? {
                break message;
            }
            if !listener.wait(PATIENCE)? && frames.receive()?.is_none() {
                bail!("no frame came for {} s", PATIENCE.as_secs());
            }
        };
        seen.arrived(number, now_ns());
        ensure!(message.header().frame == number, "frame {} came for {number}", message.header().frame);
        ensure!(
            message.header().cycle == XxHash3_64::oneshot(message.payload()),
            "frame {number} was damaged"
        );
    }
    seen.read_ns = now_ns();
    Ok(seen)
}

/// A message without contents.
pub(super) fn tiny() -> Frame {
    Frame { width_px: 1, height_px: 1, bytes_per_px: 1, full_scale_dn: 255, ..Frame::default() }
}

fn stream_of(stream: &mut dyn Read, plan: Plan) -> Result<ReceivedFrames> {
    let mut seen = ReceivedFrames::default();
    let (mut header, mut frame) = ([0; STREAM_HEADER], vec![0; plan.bytes()]);
    for number in 0..WARM_UP + plan.frames {
        stream.read_exact(&mut header).context("the sender ended")?;
        stream.read_exact(&mut frame).context("the sender ended")?;
        seen.arrived(number, now_ns());
        let [a, b, c, d, e, f, g, h, hash @ ..] = header;
        ensure!(
            u64::from_le_bytes([a, b, c, d, e, f, g, h]) == u64::from(number),
            "frames came out of order"
        );
        ensure!(u64::from_le_bytes(hash) == XxHash3_64::oneshot(&frame), "frame {number} was damaged");
    }
    seen.read_ns = now_ns();
    Ok(seen)
}

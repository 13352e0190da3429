//! The process that sends.

use super::Plan;
use super::receive::{ReceivedFrames, STREAM_HEADER, WARM_UP, tiny};
use anyhow::{Context, Result, ensure};
use ipc::cell::{CellLock, CellName};
use ipc::header::Frame;
use ipc::os::now_ns;
use ipc::port::{Node, TopicSize};
use std::io::{Read, Write};
use std::os::unix::net::UnixListener;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use twox_hash::XxHash3_64;

/// How long the receiver may take to connect, and to free a buffer.
const PATIENCE: Duration = Duration::from_secs(20);

/// A way of transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    Memory,
    Socket,
    Pipe,
}

/// All of them, the cell's own first.
pub(super) const WAYS: [Way; 3] = [Way::Memory, Way::Socket, Way::Pipe];

impl Way {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Memory => "shared memory",
            Self::Socket => "Unix socket",
            Self::Pipe => "pipe",
        }
    }
}

/// What was measured, ns on the machine's monotonic clock.
pub(super) struct Run {
    /// From the moment each frame was complete to the moment it could be read.
    pub latencies: Vec<u64>,
    /// When the first one was begun.
    pub begun_ns: u64,
    /// When the last one had been read.
    pub read_ns: u64,
}

/// Sends all frames to a process of their own.
pub(super) fn run(way: Way, plan: Plan) -> Result<Run> {
    let mut clock = Clock { plan, sent_ns: Vec::with_capacity(plan.frames as usize), begun_ns: 0, due_ns: 0 };
    let seen = match way {
        Way::Memory => memory(plan, &mut clock)?,
        Way::Socket => socket(plan, &mut clock)?,
        Way::Pipe => {
            let mut child = receiver("pipe:", plan, Stdio::piped())?;
            let mut stdin = child.stdin.take().context("the receiver has no input")?;
            stream(&mut stdin, plan, &mut clock)?;
            seen(child)?
        }
    };
    ensure!(seen.arrived_ns.len() == clock.sent_ns.len(), "{} frames did not arrive", way.name());
    let pairs = clock.sent_ns.iter().zip(&seen.arrived_ns);
    let latencies = pairs.map(|(sent, arrived)| arrived.saturating_sub(*sent)).collect();
    Ok(Run { latencies, begun_ns: clock.begun_ns, read_ns: seen.read_ns })
}

/// Paces the frames and notes when they are sent.
struct Clock {
    plan: Plan,
    sent_ns: Vec<u64>,
    begun_ns: u64,
    due_ns: u64,
}

impl Clock {
    /// Waits until a frame is due.
    fn begin(&mut self, number: u32) {
        let now = now_ns();
        self.due_ns = self.due_ns.max(now);
        std::thread::sleep(Duration::from_nanos(self.due_ns - now));
        self.due_ns += self.plan.period_ns;
        if number == WARM_UP {
            self.begun_ns = now_ns();
        }
    }

    fn complete(&mut self, number: u32) {
        if number >= WARM_UP {
            self.sent_ns.push(now_ns());
        }
    }
}

/// A frame that differs from the one before, at the speed of memory.
fn fill(frame: &mut [u8], number: u32) {
    frame.fill(number as u8);
}

fn memory(plan: Plan, clock: &mut Clock) -> Result<ReceivedFrames> {
    let name = CellName::new(&format!("bench-{}", std::process::id()))?;
    let _lock = CellLock::take(&name)?;
    let node = Node::join(&name, "sender")?;
    // As in a cell: a few frames may wait, one is being read, one written.
    let size = TopicSize { publishers: 1, subscribers: 1, buffer: 8, borrowed: 2 };
    let _held = (
        node.create_topic::<Frame>("frame", size)?,
        node.create_topic::<Frame>("ready", size)?,
        node.create_notification("receiver")?,
        node.create_notification("sender")?,
    );
    let (listener, ready) = (node.listener("sender")?, node.subscriber::<Frame>("ready")?);
    let frames = node.publisher::<Frame>("frame", plan.bytes(), &["receiver".to_owned()], PATIENCE)?;
    let child = receiver(&format!("memory:{}", name.as_str()), plan, Stdio::null())?;
    while ready.receive()?.is_none() {
        ensure!(listener.wait(PATIENCE)?, "the receiver did not come within {} s", PATIENCE.as_secs());
    }
    for number in 0..WARM_UP + plan.frames {
        clock.begin(number);
        let header = Frame { frame: number, width_px: plan.width_px, height_px: plan.height_px, ..tiny() };
        let mut loan = frames.loan(header)?;
        fill(loan.payload_mut(), number);
        loan.header_mut().cycle = XxHash3_64::oneshot(loan.payload());
        clock.complete(number);
        loan.send()?;
    }
    // The memory goes with this function: it stays until the receiver has read the last frame.
    seen(child)
}

fn socket(plan: Plan, clock: &mut Clock) -> Result<ReceivedFrames> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("socket");
    let listener = UnixListener::bind(&path)?;
    let child = receiver(&format!("socket:{}", path.display()), plan, Stdio::null())?;
    let (mut accepted, _) = listener.accept()?;
    stream(&mut accepted, plan, clock)?;
    seen(child)
}

fn stream(stream: &mut dyn Write, plan: Plan, clock: &mut Clock) -> Result<()> {
    let mut frame = vec![0; plan.bytes()];
    for number in 0..WARM_UP + plan.frames {
        clock.begin(number);
        fill(&mut frame, number);
        let mut header = [0; STREAM_HEADER];
        header[..8].copy_from_slice(&u64::from(number).to_le_bytes());
        header[8..].copy_from_slice(&XxHash3_64::oneshot(&frame).to_le_bytes());
        clock.complete(number);
        stream.write_all(&header)?;
        stream.write_all(&frame)?;
    }
    Ok(())
}

fn receiver(from: &str, plan: Plan, stdin: Stdio) -> Result<Child> {
    let numbers = [plan.frames, plan.width_px, plan.height_px].map(|n| n.to_string());
    let [frames, width, height] = &numbers;
    Command::new("/proc/self/exe")
        .args([
            "bench",
            "transport",
            "--receive",
            from,
            "--frames",
            frames,
            "--width-px",
            width,
            "--height-px",
            height,
        ])
        .stdin(stdin)
        .stdout(Stdio::piped())
        .spawn()
        .context("starting the receiver")
}

fn seen(mut child: Child) -> Result<ReceivedFrames> {
    let mut text = String::new();
    child.stdout.take().context("the receiver has no output")?.read_to_string(&mut text)?;
    ensure!(child.wait()?.success(), "the receiver failed");
    Ok(serde_json::from_str(&text)?)
}

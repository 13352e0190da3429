//! Writes the cycle record: the reports of the stages and, on request, the bytes that they send. A thread of its own writes.
//!
//! The supervisor never waits for the disk. While the disk is too slow, messages stay queued; their senders then wait, as
//! for any slow receiver.

use anyhow::{Context, Result, anyhow};
use cell::Cell;
use cell::Retention;
use cell::cycle_number::wire;
use cell::schedule::{Work, label, output};
use crossbeam::channel::{Receiver, Sender, unbounded};
use devices::LoadedCell;
use files::cycle_record::{
    ActivationEntry, ActivationName, CycleEntry, RecordHeader, RecordWriter, ValueKey,
};
use files::error::FileError;
use files::result::CycleResult;
use fringe::cloud::Point;
use ipc::header::{Cloud, Event, Frame, Header, Phase};
use ipc::port::{Node, Received, Subscriber};
use std::path::Path;
use std::thread::JoinHandle;

/// Messages that may wait for the disk before no more are received: a few frames of each camera.
const QUEUE_LIMIT: usize = 16;

/// An item to write.
enum Item {
    Value(ValueKey, Vec<u8>),
    Cycle(CycleEntry),
}

/// Cycles that are not in the record, and the first error.
#[derive(Debug, Default)]
struct Loss {
    cycles: u64,
    first: Option<FileError>,
}

/// Subscribers for the values of the record.
struct Subscribers {
    frames: Vec<Subscriber<Frame>>,
    phases: Vec<Subscriber<Phase>>,
    clouds: Vec<Subscriber<Cloud>>,
}

/// Records the cycles of a run.
pub struct CycleRecorder {
    subscribers: Subscribers,
    /// The cycle whose values are recorded, as in messages. With values recorded, one cycle is in flight at a time.
    current: Option<u64>,
    items: Option<Sender<Item>>,
    thread: Option<JoinHandle<Loss>>,
}

impl CycleRecorder {
    /// Creates the file, the thread and the subscribers.
    pub fn new(path: &Path, cell: &LoadedCell, node: &Node) -> Result<Self> {
        let writer = RecordWriter::create(path, &header(cell)?)?;
        let (items, waiting) = unbounded();
        let thread = std::thread::Builder::new().name("cycle record".into());
        let thread = thread
            .spawn(move || write(writer, &waiting))
            .context("starting the thread of the cycle record")?;
        let subscribers = Subscribers::new(cell, node)?;
        Ok(Self { subscribers, current: None, items: Some(items), thread: Some(thread) })
    }

    /// Connects to publishers that joined since the last call.
    pub fn connect(&self) -> Result<()> {
        self.subscribers.frames.iter().try_for_each(Subscriber::connect)?;
        self.subscribers.phases.iter().try_for_each(Subscriber::connect)?;
        Ok(self.subscribers.clouds.iter().try_for_each(Subscriber::connect)?)
    }

    /// Starts the record of a cycle.
    pub fn begin(&mut self, cycle: u64) {
        self.current = Some(wire(cycle));
    }

    /// Handles queued messages, as far as the disk keeps up.
    pub fn update(&mut self, cell: &Cell) -> Result<()> {
        self.take(cell, QUEUE_LIMIT)
    }

    /// Records the result of the inspection, which the supervisor receives itself.
    pub fn result(&self, cell: &Cell, wire_cycle: u64, text: &str) {
        if cell.graph.retention == Retention::All {
            self.record(cell, wire_cycle, Work::Inspect, text.as_bytes());
        }
    }

    /// Ends a cycle; `recipe` is the index of its recipe.
    pub fn end<'e>(
        &mut self,
        cell: &Cell,
        result: &CycleResult,
        recipe: usize,
        done: impl Iterator<Item = &'e Event>,
    ) -> Result<()> {
        // Values are sent before the report of their activation, so all of the cycle have arrived.
        self.take(cell, usize::MAX)?;
        self.current = None;
        self.send(Item::Cycle(entry(result, recipe, done)));
        Ok(())
    }

    /// Waits until everything is written.
    ///
    /// # Errors
    /// Cycles that could not be recorded.
    pub fn finish(&mut self) -> Result<()> {
        self.items = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        let loss = thread.join().map_err(|_| anyhow!("the thread of the cycle record panicked"))?;
        match loss.first {
            Some(first) if loss.cycles == 0 => {
                Err(anyhow::Error::from(first).context("the cycle record is complete, but not sealed"))
            }
            Some(first) => Err(anyhow::Error::from(first)
                .context(format!("{} cycles are missing in the cycle record", loss.cycles))),
            None => Ok(()),
        }
    }

    fn take(&self, cell: &Cell, limit: usize) -> Result<()> {
        let has_space = || self.items.as_ref().is_some_and(|items| items.len() < limit);
        drain(&self.subscribers.frames, &has_space, &mut |message| {
            let h = message.header();
            let (camera, projector, frame) = (h.camera as usize, h.projector as usize, h.frame as usize);
            self.record(cell, h.cycle, Work::Expose { camera, projector, frame }, message.payload());
        })?;
        drain(&self.subscribers.phases, &has_space, &mut |message| {
            let h = message.header();
            let Ok(info) = h.info() else { return };
            let (camera, projector) = (h.camera as usize, h.projector as usize);
            self.record(cell, h.cycle, Work::Phase { camera, projector, axis: info.axis }, message.payload());
        })?;
        drain(&self.subscribers.clouds, &has_space, &mut |message| {
            let h = message.header();
            let work =
                if h.pair == Cloud::FUSED { Work::Fuse } else { Work::Match { pair: h.pair as usize } };
            let used = (h.points as usize * size_of::<Point>()).min(message.payload().len());
            self.record(cell, h.cycle, work, &message.payload()[..used]);
        })
    }

    fn record(&self, cell: &Cell, wire_cycle: u64, work: Work, bytes: &[u8]) {
        if self.current != Some(wire_cycle) {
            return;
        }
        // An activation that is not in the schedule ends the cycle elsewhere.
        if let Some(activation) = cell.schedule.find(work) {
            let key = ValueKey { cycle: wire_cycle.saturating_sub(1), activation: activation as u32 };
            self.send(Item::Value(key, bytes.to_vec()));
        }
    }

    fn send(&self, item: Item) {
        if let Some(items) = &self.items {
            // The thread ends only when this sender is dropped.
            let _ = items.send(item);
        }
    }
}

impl Drop for CycleRecorder {
    fn drop(&mut self) {
        if let Err(error) = self.finish() {
            tracing::error!("{error:#}");
        }
    }
}

impl Subscribers {
    fn new(cell: &Cell, node: &Node) -> Result<Self> {
        let (graph, kept) = (&cell.graph, cell.graph.retention);
        let cameras =
            |prefix: &'static str| graph.cameras.iter().map(move |c| format!("{prefix}/{}", c.name));
        let pairs = graph.pairs.iter().map(|p| format!("cloud/{}", p.name)).chain(["cloud/fused".to_owned()]);
        let frames = cameras("frame").filter(|_| kept != Retention::Hashes);
        Ok(Self {
            frames: frames.map(|t| node.subscriber(&t)).collect::<Result<_, _>>()?,
            phases: cameras("phase")
                .filter(|_| kept == Retention::All)
                .map(|t| node.subscriber(&t))
                .collect::<Result<_, _>>()?,
            clouds: pairs
                .filter(|_| kept == Retention::All)
                .map(|t| node.subscriber(&t))
                .collect::<Result<_, _>>()?,
        })
    }
}

fn drain<H: Header>(
    subscribers: &[Subscriber<H>],
    has_space: &dyn Fn() -> bool,
    each: &mut dyn FnMut(Received<H>),
) -> Result<()> {
    for subscriber in subscribers {
        while has_space() {
            let Some(message) = subscriber.receive()? else { break };
            each(message);
        }
    }
    Ok(())
}

/// The thread: writes until the recorder is dropped.
fn write(mut writer: RecordWriter, items: &Receiver<Item>) -> Loss {
    let mut loss = Loss::default();
    let report = |error: FileError, first: &mut Option<FileError>| {
        tracing::error!("{error:#}; the cell continues");
        first.get_or_insert(error);
    };
    for item in items {
        match item {
            Item::Value(key, bytes) => {
                if let Err(error) = writer.value(key, &bytes) {
                    report(error, &mut loss.first);
                }
            }
            Item::Cycle(entry) => match writer.cycle(&entry) {
                Ok(true) => {}
                Ok(false) => loss.cycles += 1,
                Err(error) => {
                    loss.cycles += 1;
                    report(error, &mut loss.first);
                }
            },
        }
    }
    if let Err(error) = writer.finish() {
        report(error, &mut loss.first);
    }
    loss
}

fn header(cell: &LoadedCell) -> Result<RecordHeader> {
    let config = &cell.file;
    let path = config.document.path.to_str().context("the path of the configuration is not UTF-8")?;
    let activations = cell.schedule.activations.iter().map(|a| ActivationName {
        stage: cell.schedule.stages[a.stage].name.clone(),
        label: label(&cell.graph, a.work),
        output: output(&cell.graph, a.work),
    });
    Ok(RecordHeader {
        cell: cell.name.clone(),
        software: format!("fringecell {}", env!("CARGO_PKG_VERSION")),
        started: files::clock::rfc3339_now(),
        config: path.to_owned(),
        config_sha256: config.sha256.clone(),
        rig_sha256: config.rig_sha256.clone(),
        recipes: cell.config.recipes.iter().map(Into::into).collect(),
        recording_sha256: config.recording.as_ref().map(|r| r.recording.sha256.clone()),
        retention: cell.graph.retention,
        activations: activations.collect(),
    })
}

fn entry<'e>(result: &CycleResult, recipe: usize, done: impl Iterator<Item = &'e Event>) -> CycleEntry {
    let activations = done.map(|event| ActivationEntry {
        activation: event.activation,
        bytes: event.bytes,
        hash: [event.hash_high, event.hash_low],
        count: event.count,
        wait_ns: event.wait_ns,
        start_ns: event.start_ns,
        end_ns: event.end_ns,
    });
    CycleEntry {
        cycle: result.cycle,
        recipe: recipe as u32,
        outcome: result.outcome.clone(),
        verdict: result.verdict,
        latency_ns: result.latency_ns,
        activations: activations.collect(),
    }
}

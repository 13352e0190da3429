//! What the supervisor looks at for its report, beside the reports of the stages: one picture of each camera, the phase
//! maps and the fused cloud of the last cycle. It reads them where they lie; only a picture is copied.

use crate::graph::Cell;
use anyhow::Result;
use fringe::pattern::{PatternSet, locate};
use ipc::header::{Cloud, Frame, Header, Phase};
use ipc::payload;
use ipc::port::{Node, Received, Subscriber};
use std::collections::BTreeMap;

/// A camera's view under even light, as 8 bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Cycle on the wire.
    pub cycle: u64,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Grey values.
    pub values: Vec<u8>,
}

/// The ports and what was seen.
pub struct Watch {
    frames: Vec<Subscriber<Frame>>,
    phases: Vec<Subscriber<Phase>>,
    fused: Subscriber<Cloud>,
    /// By camera and projector.
    pub pictures: BTreeMap<(u32, u32), Picture>,
    /// By camera, projector and axis.
    pub maps: BTreeMap<(u32, u32, u32), Received<Phase>>,
    /// The cloud of the cycle that runs.
    running: Option<Received<Cloud>>,
    /// The cloud of the last cycle that was ok.
    pub cloud: Option<Received<Cloud>>,
    /// The frame of each projector's sequence that makes the picture.
    shown: Vec<usize>,
}

impl Watch {
    /// Opens the ports.
    pub fn new(node: &Node, cell: &Cell) -> Result<Self> {
        let names = |prefix: &str| -> Vec<String> {
            cell.graph.cameras.iter().map(|c| format!("{prefix}/{}", c.name)).collect()
        };
        let shown = cell.config.projectors.iter().map(|p| picture_frame(&p.sequence));
        Ok(Self {
            frames: names("frame").iter().map(|t| node.subscriber(t)).collect::<Result<_, _>>()?,
            phases: names("phase").iter().map(|t| node.subscriber(t)).collect::<Result<_, _>>()?,
            fused: node.subscriber("cloud/fused")?,
            pictures: BTreeMap::new(),
            maps: BTreeMap::new(),
            running: None,
            cloud: None,
            shown: shown.collect(),
        })
    }

    /// Connects to senders that came since.
    pub fn connect(&self) -> Result<()> {
        self.frames.iter().try_for_each(Subscriber::connect)?;
        self.phases.iter().try_for_each(Subscriber::connect)?;
        Ok(self.fused.connect()?)
    }

    /// Takes what has come.
    pub fn look(&mut self) -> Result<()> {
        for camera in &self.frames {
            while let Some(message) = camera.receive()? {
                let header = *message.header();
                if self.shown.get(header.projector as usize) == Some(&(header.frame as usize)) {
                    keep_picture(&mut self.pictures, &header, message.payload());
                }
            }
        }
        for camera in &self.phases {
            while let Some(message) = camera.receive()? {
                let header = message.header();
                self.maps.insert((header.camera, header.projector, header.axis), message);
            }
        }
        while let Some(message) = self.fused.receive()? {
            self.running = Some(message);
        }
        Ok(())
    }

    /// A cycle has its outcome: its cloud is kept if it is ok.
    pub fn ended(&mut self, wire_cycle: u64, ok: bool) {
        let of_cycle = self.running.take().filter(|c| c.header().cycle() == wire_cycle);
        if ok && of_cycle.is_some() {
            self.cloud = of_cycle;
        }
    }
}

/// White if the sequence has it, else its first frame.
fn picture_frame(sequence: &[PatternSet]) -> usize {
    let frames = sequence.iter().map(PatternSet::frames).sum();
    let is_white = |frame: &usize| {
        locate(sequence, *frame).is_some_and(|(set, _)| matches!(sequence[set], PatternSet::White {}))
    };
    (0..frames).find(is_white).unwrap_or(0)
}

fn keep_picture(pictures: &mut BTreeMap<(u32, u32), Picture>, header: &Frame, bytes: &[u8]) {
    let Ok(view) = payload::frame(header, bytes) else { return };
    let picture = pictures.entry((header.camera, header.projector)).or_insert_with(|| Picture {
        cycle: 0,
        width_px: header.width_px,
        height_px: header.height_px,
        values: vec![0; view.pixels.len()],
    });
    picture.cycle = header.cycle;
    let scale = 255.0 / f32::from(view.full_scale_dn);
    for (index, value) in picture.values.iter_mut().enumerate() {
        *value = (view.pixels.get(index) * scale).round() as u8;
    }
}

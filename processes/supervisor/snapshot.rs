//! Data of the last cycle for the report of a run: one image of each camera, the phase maps and the fused cloud. Phase maps
//! and cloud stay in shared memory until a stage is started again; images are copied.

use anyhow::Result;
use cell::Cell;
use fringe::cloud::Point;
use fringe::pattern::{PatternSet, locate};
use ipc::header::{Cloud, Frame, Header, Phase};
use ipc::payload;
use ipc::port::{Node, Received, Subscriber};
use std::collections::BTreeMap;

/// Image of a camera under uniform light, 8 bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraImage {
    /// Cycle as in messages.
    pub cycle: u64,
    /// Columns of the image, px.
    pub width_px: u32,
    /// Rows of the image, px.
    pub height_px: u32,
    /// Grey values, row by row.
    pub values: Vec<u8>,
}

/// A cloud where its sender wrote it, or a copy.
pub(super) enum KeptCloud {
    Shared(Received<Cloud>),
    Copied { wire_cycle: u64, points: Vec<Point> },
}

impl KeptCloud {
    pub(super) fn wire_cycle(&self) -> u64 {
        match self {
            Self::Shared(cloud) => cloud.header().cycle(),
            Self::Copied { wire_cycle, .. } => *wire_cycle,
        }
    }

    pub(super) fn points(&self) -> Result<&[Point]> {
        match self {
            Self::Shared(cloud) => Ok(payload::points(cloud.header(), cloud.payload())?),
            Self::Copied { points, .. } => Ok(points),
        }
    }
}

/// Ports and data of the last cycle.
pub struct Snapshot {
    frames: Vec<Subscriber<Frame>>,
    phases: Vec<Subscriber<Phase>>,
    fused: Subscriber<Cloud>,
    /// Images by indices of camera and projector.
    pub images: BTreeMap<(u32, u32), CameraImage>,
    /// Phase maps by indices of camera and projector and by axis.
    pub maps: BTreeMap<(u32, u32, u32), Received<Phase>>,
    /// Cloud of the cycle in progress.
    running: Option<Received<Cloud>>,
    /// Cloud of the last cycle that is ok.
    pub(super) cloud: Option<KeptCloud>,
    /// For each projector: the frame of its sequence that is kept as image.
    image_frames: Vec<usize>,
}

impl Snapshot {
    /// Opens the subscribers of all topics that are shown.
    pub fn new(node: &Node, cell: &Cell) -> Result<Self> {
        let names = |prefix: &str| -> Vec<String> {
            let here =
                cell.graph.cameras.iter().enumerate().filter(|(number, _)| cell.graph.has_camera(*number));
            here.map(|(_, c)| format!("{prefix}/{}", c.name)).collect()
        };
        let image_frames = cell.config.projectors.iter().map(|p| image_frame(&p.sequence));
        Ok(Self {
            frames: names("frame").iter().map(|t| node.subscriber(t)).collect::<Result<_, _>>()?,
            phases: names("phase").iter().map(|t| node.subscriber(t)).collect::<Result<_, _>>()?,
            fused: node.subscriber("cloud/fused")?,
            images: BTreeMap::new(),
            maps: BTreeMap::new(),
            running: None,
            cloud: None,
            image_frames: image_frames.collect(),
        })
    }

    /// Connects to publishers that joined since the last call and lets go of those that ended: phase maps are dropped, the cloud
    /// is copied.
    pub fn connect(&mut self) -> Result<()> {
        self.update()?;
        self.maps.clear();
        self.running = None;
        if let Some(cloud) = self.cloud.take() {
            let points = cloud.points()?.to_vec();
            self.cloud = Some(KeptCloud::Copied { wire_cycle: cloud.wire_cycle(), points });
        }
        self.frames.iter().try_for_each(Subscriber::connect)?;
        self.phases.iter().try_for_each(Subscriber::connect)?;
        Ok(self.fused.connect()?)
    }

    /// Handles all queued messages.
    pub fn update(&mut self) -> Result<()> {
        for camera in &self.frames {
            while let Some(message) = camera.receive()? {
                let header = *message.header();
                if self.image_frames.get(header.projector as usize) == Some(&(header.frame as usize)) {
                    keep_image(&mut self.images, &header, message.payload());
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

    /// Points of the cloud of a cycle; none if it is not ok.
    pub fn points_of(&self, wire_cycle: u64) -> Vec<Point> {
        let cloud = self.cloud.as_ref().filter(|cloud| cloud.wire_cycle() == wire_cycle);
        let points = cloud.and_then(|cloud| cloud.points().ok());
        points.map(<[Point]>::to_vec).unwrap_or_default()
    }

    /// Points of the last cycle that is ok.
    pub fn points(&self) -> Result<Option<&[Point]>> {
        self.cloud.as_ref().map(KeptCloud::points).transpose()
    }

    /// Ends a cycle; keeps its cloud if it is ok.
    pub fn end_cycle(&mut self, wire_cycle: u64, ok: bool) {
        let of_cycle = self.running.take().filter(|c| c.header().cycle() == wire_cycle);
        if let Some(cloud) = of_cycle.filter(|_| ok) {
            self.cloud = Some(KeptCloud::Shared(cloud));
        }
    }
}

/// The white frame of a sequence, or else its first frame.
fn image_frame(sequence: &[PatternSet]) -> usize {
    let frames = sequence.iter().map(PatternSet::frames).sum();
    let is_white = |frame: &usize| {
        locate(sequence, *frame).is_some_and(|(set, _)| matches!(sequence[set], PatternSet::White {}))
    };
    (0..frames).find(is_white).unwrap_or(0)
}

fn keep_image(images: &mut BTreeMap<(u32, u32), CameraImage>, header: &Frame, bytes: &[u8]) {
    let Ok(view) = payload::frame(header, bytes) else { return };
    let image = images.entry((header.camera, header.projector)).or_insert_with(|| CameraImage {
        cycle: 0,
        width_px: 0,
        height_px: 0,
        values: Vec::new(),
    });
    (image.cycle, image.width_px, image.height_px) = (header.cycle, header.width_px, header.height_px);
    view.to_8_bits(&mut image.values);
}

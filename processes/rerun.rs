//! One cycle through the same kernels as the stages', in the order of the schedule, in one process.

use crate::drivers::{Camera, Format, camera};
use crate::graph::Cell;
use crate::judgement::judge;
use crate::kernels::{self, Method, decoder, matcher};
use crate::schedule::{PairNode, Work};
use anyhow::{Context, Result, ensure};
use bytemuck::{cast_slice, cast_slice_mut};
use fringe::cloud::Point;
use fringe::decode::Decoder;
use fringe::fusion::Fuser;
use fringe::pattern::Axis;
use ipc::header::{Frame, Header, Phase};
use ipc::payload;
use std::collections::BTreeMap;

/// Where the frames of a cycle come from.
pub trait Frames {
    /// Writes the frame of an activation ([`Work::Expose`] by its number in the schedule).
    ///
    /// # Errors
    /// It cannot be had, or is of another size than `out`.
    fn expose(&mut self, activation: usize, out: &mut [u8]) -> Result<()>;
}

/// The frames that the drivers of the cell give.
pub struct Driven<'a> {
    cell: &'a Cell,
    cameras: Vec<Box<dyn Camera>>,
}

impl<'a> Driven<'a> {
    /// Opens the drivers.
    ///
    /// # Errors
    /// A driver that does not open.
    pub fn new(cell: &'a Cell) -> Result<Self> {
        let cameras = (0..cell.graph.cameras.len()).map(|number| camera(cell, number));
        Ok(Self { cell, cameras: cameras.collect::<Result<_>>()? })
    }

    /// A cycle starts.
    ///
    /// # Errors
    /// There is none with this number.
    pub fn begin(&mut self, cycle: u64) -> Result<()> {
        self.cameras.iter_mut().try_for_each(|camera| camera.begin(cycle))
    }
}

impl Frames for Driven<'_> {
    fn expose(&mut self, activation: usize, out: &mut [u8]) -> Result<()> {
        match self.cell.schedule.activations[activation].work {
            Work::Expose { camera, projector, frame } => self.cameras[camera].expose(projector, frame, out),
            other => anyhow::bail!("{other:?} is no exposure"),
        }
    }
}

/// Bytes aligned like those of a message.
#[derive(Debug, Default)]
struct Bytes {
    words: Vec<u64>,
    length: usize,
}

impl Bytes {
    fn resize(&mut self, length: usize) -> &mut [u8] {
        self.words.resize(length.div_ceil(8), 0);
        self.length = length;
        &mut cast_slice_mut(&mut self.words)[..length]
    }

    fn get(&self) -> &[u8] {
        &cast_slice(&self.words)[..self.length]
    }
}

/// The kernels of a cell and what they gave last.
pub struct Rerun<'a> {
    cell: &'a Cell,
    decoders: Decoders,
    pairs: Vec<(Method, usize)>,
    fuser: Fuser,
    frames: Vec<(Frame, Bytes)>,
    phases: PhaseMaps,
    clouds: Vec<Vec<Point>>,
    fused: Vec<Point>,
    recipe: usize,
    result: String,
}

impl<'a> Rerun<'a> {
    /// Builds what the stages would build.
    ///
    /// # Errors
    /// Settings that a kernel refuses.
    pub fn new(cell: &'a Cell) -> Result<Self> {
        let mut decoders = Decoders::new();
        for (projector, node) in cell.graph.projectors.iter().enumerate() {
            for &camera in &node.cameras {
                decoders.insert((camera, projector), decoder(cell, projector, camera)?);
            }
        }
        let pairs = (0..cell.graph.pairs.len()).map(|pair| matcher(cell, pair));
        let pairs = pairs.collect::<Result<Vec<_>>>()?;
        Ok(Self {
            cell,
            decoders,
            fuser: Fuser::default(),
            frames: cell.graph.cameras.iter().map(|_| (Frame::default(), Bytes::default())).collect(),
            phases: PhaseMaps::new(),
            clouds: pairs.iter().map(|(_, capacity)| vec![bytemuck::Zeroable::zeroed(); *capacity]).collect(),
            pairs,
            fused: Vec::new(),
            recipe: 0,
            result: String::new(),
        })
    }

    /// Forgets what an earlier cycle left; the next one is inspected with a recipe of the cell.
    pub fn begin(&mut self, recipe: usize) {
        self.recipe = recipe;
        self.decoders.values_mut().for_each(Decoder::begin);
    }

    /// Does one activation; what comes before it in the schedule must have been done. Gives the bytes that the stage
    /// would send, or none where it sends nothing that counts.
    ///
    /// # Errors
    /// What would have ended the cycle.
    pub fn step(&mut self, activation: usize, source: &mut dyn Frames) -> Result<&[u8]> {
        match self.cell.schedule.activations[activation].work {
            Work::Expose { camera, projector, frame } => {
                self.expose(activation, camera, projector, frame, source)
            }
            Work::Accumulate { camera, projector, frame } => {
                let (header, bytes) = &self.frames[camera];
                let view = payload::frame(header, bytes.get())?;
                seen(&mut self.decoders, camera, projector)?.push(frame, &view)?;
                Ok(&[])
            }
            Work::Phase { camera, projector, axis } => self.phase(camera, projector, axis),
            Work::Match { pair } => self.match_pair(pair),
            Work::Fuse => {
                let clouds: Vec<&[Point]> = self.clouds.iter().map(Vec::as_slice).collect();
                self.fused.clear();
                self.fuser.fuse(&clouds, &self.cell.fusion, &mut self.fused);
                ensure!(!self.fused.is_empty(), "no point at all");
                Ok(cast_slice(&self.fused))
            }
            Work::Inspect => {
                let recipe = self.cell.recipes.get(self.recipe);
                let recipe = recipe.with_context(|| format!("the cell has no recipe {}", self.recipe))?;
                self.result = serde_json::to_string(&judge(recipe.plan.as_ref(), &self.fused))?;
                Ok(self.result.as_bytes())
            }
            Work::Project { .. } | Work::Store => Ok(&[]),
        }
    }

    fn expose(
        &mut self,
        activation: usize,
        camera: usize,
        projector: usize,
        frame: usize,
        source: &mut dyn Frames,
    ) -> Result<&[u8]> {
        let node = &self.cell.graph.cameras[camera];
        let format = Format::of(kernels::full_scale_dn(&self.cell.config, projector, camera)?);
        let header = Frame {
            camera: camera as u32,
            projector: projector as u32,
            frame: frame as u32,
            width_px: node.width_px,
            height_px: node.height_px,
            bytes_per_px: format.bytes_per_px,
            full_scale_dn: format.full_scale_dn.into(),
            ..Frame::default()
        };
        let (kept, bytes) = &mut self.frames[camera];
        *kept = header;
        source.expose(activation, bytes.resize(header.payload_bytes()?))?;
        Ok(bytes.get())
    }

    fn phase(&mut self, camera: usize, projector: usize, axis: Axis) -> Result<&[u8]> {
        let decoder = seen(&mut self.decoders, camera, projector)?;
        let info = decoder.info(axis)?;
        let header = Phase {
            period_px: info.period_px,
            camera: camera as u32,
            projector: projector as u32,
            axis: Phase::axis_number(axis),
            width_px: info.width_px,
            height_px: info.height_px,
            ..Phase::default()
        };
        let (kept, bytes) = self.phases.entry((camera, projector, axis)).or_default();
        *kept = header;
        let room = bytes.resize(header.payload_bytes()?);
        decoder.finish(axis, &mut payload::phase_mut(&header, room)?)?;
        Ok(bytes.get())
    }

    fn match_pair(&mut self, pair: usize) -> Result<&[u8]> {
        let node = &self.cell.graph.pairs[pair];
        let axes = node.axes(&self.cell.graph.projectors[node.projector]);
        let views = views(&self.phases, node, &axes)?;
        let (method, capacity) = &mut self.pairs[pair];
        let cloud = &mut self.clouds[pair];
        cloud.resize(*capacity, bytemuck::Zeroable::zeroed());
        let matched = method.run(&views, pair as u32, cloud)?;
        cloud.truncate(matched.points() as usize);
        Ok(cast_slice(cloud))
    }
}

/// By camera and projector.
type Decoders = BTreeMap<(usize, usize), Decoder>;

/// By camera, projector and axis.
type PhaseMaps = BTreeMap<(usize, usize, Axis), (Phase, Bytes)>;

fn seen(decoders: &mut Decoders, camera: usize, projector: usize) -> Result<&mut Decoder> {
    decoders.get_mut(&(camera, projector)).context("the camera does not see this projector")
}

/// The phases of a pair: left first; with the projector method x before y.
fn views<'a>(
    phases: &'a PhaseMaps,
    pair: &PairNode,
    axes: &[Axis],
) -> Result<Vec<(Axis, fringe::phase::PhaseView<'a>)>> {
    let cameras = pair.cameras();
    let wanted = cameras.iter().flat_map(|&camera| axes.iter().map(move |&axis| (camera, axis)));
    wanted
        .map(|(camera, axis)| {
            let map = phases.get(&(camera, pair.projector, axis));
            let (header, bytes) = map.with_context(|| format!("the phase of camera {camera} is missing"))?;
            Ok((axis, payload::phase(header, bytes.get())?))
        })
        .collect()
}

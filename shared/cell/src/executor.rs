//! One cycle through the same kernels as the stages', in the order of the schedule, in one process.

use crate::cell::Cell;
use crate::error::CellError;
use crate::frame_format::FrameFormat;
use crate::graph::PairNode;
use crate::judgement::judge;
use crate::kernels::{Method, decoder, matcher};
use crate::schedule::Work;
use bytemuck::{cast_slice, cast_slice_mut};
use fringe::cloud::Point;
use fringe::decode::{DecodeError, Decoder};
use fringe::frame::FrameView;
use fringe::fusion::Fuser;
use fringe::matching::MatchError;
use fringe::pattern::Axis;
use fringe::phase::{PHASE_BYTES_PER_PX, PhaseInfo, PhaseView, PhaseViewMut};
use std::collections::BTreeMap;
use thiserror::Error;

/// Why a frame cannot be had.
pub type SourceError = Box<dyn std::error::Error + Send + Sync>;

/// Why a piece of work failed.
#[derive(Debug, Error)]
pub enum WorkError {
    /// The frame cannot be had.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The decoder refuses.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The matcher refuses.
    #[error(transparent)]
    Match(#[from] MatchError),
    /// The cell does not fit the schedule.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// An input of this work is missing: what comes before it in the schedule was not done.
    #[error("{0}")]
    Missing(String),
    /// No pair gives a point.
    #[error("no point at all")]
    NoPoint,
    /// The result cannot be written as JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// Where the frames of a cycle come from.
pub trait Frames {
    /// Writes the frame of an activation ([`Work::Expose`] by its number in the schedule).
    ///
    /// # Errors
    /// It cannot be had, or is of another size than `out`.
    fn expose(&mut self, activation: usize, out: &mut [u8]) -> Result<(), SourceError>;
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
pub struct Executor<'a> {
    cell: &'a Cell,
    decoders: Decoders,
    pairs: Vec<(Method, usize)>,
    fuser: Fuser,
    frames: Vec<(u16, Bytes)>,
    phases: PhaseMaps,
    clouds: Vec<Vec<Point>>,
    fused: Vec<Point>,
    recipe: usize,
    result: String,
}

impl<'a> Executor<'a> {
    /// Builds what the stages would build.
    ///
    /// # Errors
    /// Settings that a kernel refuses.
    pub fn new(cell: &'a Cell) -> Result<Self, CellError> {
        let mut decoders = Decoders::new();
        for (projector, node) in cell.graph.projectors.iter().enumerate() {
            for &camera in &node.cameras {
                decoders.insert((camera, projector), decoder(cell, projector, camera)?);
            }
        }
        let pairs = (0..cell.graph.pairs.len()).map(|pair| matcher(cell, pair));
        let pairs = pairs.collect::<Result<Vec<_>, CellError>>()?;
        Ok(Self {
            cell,
            decoders,
            fuser: Fuser::default(),
            frames: cell.graph.cameras.iter().map(|_| (0, Bytes::default())).collect(),
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
    pub fn step(&mut self, activation: usize, source: &mut dyn Frames) -> Result<&[u8], WorkError> {
        match self.cell.schedule.activations[activation].work {
            Work::Expose { camera, projector, .. } => self.expose(activation, camera, projector, source),
            Work::Accumulate { camera, projector, frame } => {
                let node = &self.cell.graph.cameras[camera];
                let (full_scale_dn, bytes) = &self.frames[camera];
                let view = FrameView::from_bytes(node.width_px, node.height_px, *full_scale_dn, bytes.get());
                let view = view.ok_or_else(|| WorkError::Missing("there is no frame".into()))?;
                seen(&mut self.decoders, camera, projector)?.push(frame, &view)?;
                Ok(&[])
            }
            Work::Phase { camera, projector, axis } => self.phase(camera, projector, axis),
            Work::Match { pair } => self.match_pair(pair),
            Work::Fuse => {
                let clouds: Vec<&[Point]> = self.clouds.iter().map(Vec::as_slice).collect();
                self.fused.clear();
                self.fuser.fuse(&clouds, &self.cell.fusion, &mut self.fused);
                if self.fused.is_empty() { Err(WorkError::NoPoint) } else { Ok(cast_slice(&self.fused)) }
            }
            Work::Inspect => {
                let recipe = self.cell.recipes.get(self.recipe);
                let recipe = recipe
                    .ok_or_else(|| WorkError::Missing(format!("the cell has no recipe {}", self.recipe)))?;
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
        source: &mut dyn Frames,
    ) -> Result<&[u8], WorkError> {
        let node = &self.cell.graph.cameras[camera];
        let FrameFormat { bytes_per_px, full_scale_dn } = self.cell.format(projector, camera)?;
        let pixels = node.width_px as usize * node.height_px as usize;
        let (full_scale, bytes) = &mut self.frames[camera];
        *full_scale = full_scale_dn;
        source.expose(activation, bytes.resize(pixels * bytes_per_px as usize))?;
        Ok(bytes.get())
    }

    fn phase(&mut self, camera: usize, projector: usize, axis: Axis) -> Result<&[u8], WorkError> {
        let decoder = seen(&mut self.decoders, camera, projector)?;
        let info = decoder.info(axis)?;
        let (known, bytes) =
            self.phases.entry((camera, projector, axis)).or_insert_with(|| (info, Bytes::default()));
        *known = info;
        let planes = PhaseViewMut::from_bytes(info, bytes.resize(PHASE_BYTES_PER_PX * info.len()));
        let mut planes = planes.ok_or_else(|| WorkError::Missing("the phase map has no memory".into()))?;
        decoder.finish(axis, &mut planes)?;
        Ok(bytes.get())
    }

    fn match_pair(&mut self, pair: usize) -> Result<&[u8], WorkError> {
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
type PhaseMaps = BTreeMap<(usize, usize, Axis), (PhaseInfo, Bytes)>;

fn seen(decoders: &mut Decoders, camera: usize, projector: usize) -> Result<&mut Decoder, WorkError> {
    let decoder = decoders.get_mut(&(camera, projector));
    decoder.ok_or_else(|| WorkError::Missing("the camera does not see this projector".into()))
}

/// The phases of a pair: left first; with the projector method x before y.
fn views<'a>(
    phases: &'a PhaseMaps,
    pair: &PairNode,
    axes: &[Axis],
) -> Result<Vec<(Axis, PhaseView<'a>)>, WorkError> {
    let cameras = pair.cameras();
    let wanted = cameras.iter().flat_map(|&camera| axes.iter().map(move |&axis| (camera, axis)));
    wanted
        .map(|(camera, axis)| {
            let map = phases.get(&(camera, pair.projector, axis));
            let view = map.and_then(|(info, bytes)| PhaseView::from_bytes(*info, bytes.get()));
            let view =
                view.ok_or_else(|| WorkError::Missing(format!("the phase of camera {camera} is missing")))?;
            Ok((axis, view))
        })
        .collect()
}

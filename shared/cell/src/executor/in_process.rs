//! One cycle through the same executors as the stages', in the order of the schedule, in one process.

use super::matching::{PairMatcher, Views};
use super::{ViewDecoder, ViewError, decoder, no_point, pair_matcher};
use crate::cell::Cell;
use crate::error::CellError;
use crate::frame_format::FrameFormat;
use crate::schedule::Work;
use bytemuck::{cast_slice, cast_slice_mut};
use fringe::cloud::Point;
use fringe::decode::DecodeError;
use fringe::frame::FrameView;
use fringe::fusion::Fuser;
use fringe::geometry::rig::pictures;
use fringe::matching::MatchError;
use fringe::pattern::Axis;
use fringe::phase::{PHASE_BYTES_PER_PX, PhaseInfo, PhaseView, PhaseViewMut};
use metrology::inspection::evaluate;
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
    /// The decoder refuses the frames or settings.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The frames give no phase.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The matcher refuses the phase maps.
    #[error(transparent)]
    Match(#[from] MatchError),
    /// The work is not that of this cell.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// An input of this work is missing: what comes before it in the schedule was not done.
    #[error("{0} is missing")]
    Missing(String),
    /// No pair gives a point.
    #[error("{0}")]
    NoPoint(String),
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

/// By camera and projector.
type Decoders = BTreeMap<(usize, usize), ViewDecoder>;

/// By camera and projector.
type PhaseMaps = BTreeMap<(usize, usize), Vec<(PhaseInfo, Bytes)>>;

/// The executors of a cell and what they gave last.
pub struct InProcess<'a> {
    cell: &'a Cell,
    decoders: Decoders,
    matchers: Vec<PairMatcher>,
    fuser: Fuser,
    /// The last frame of each camera, with its full scale.
    frames: Vec<(u16, Bytes)>,
    phases: PhaseMaps,
    clouds: Vec<Vec<Point>>,
    fused: Vec<Point>,
    recipe: usize,
    result: String,
}

impl<'a> InProcess<'a> {
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
        let matchers = (0..cell.graph.pairs.len()).map(|pair| pair_matcher(cell, pair));
        Ok(Self {
            cell,
            decoders,
            matchers: matchers.collect::<Result<_, _>>()?,
            fuser: Fuser::of_pictures(pictures(&cell.config.rig.pairs)),
            frames: cell.graph.cameras.iter().map(|_| (0, Bytes::default())).collect(),
            phases: PhaseMaps::new(),
            clouds: vec![Vec::new(); cell.graph.pairs.len()],
            fused: Vec::new(),
            recipe: 0,
            result: String::new(),
        })
    }

    /// Forgets what an earlier cycle left; the next one is inspected with a recipe of the cell.
    pub fn begin(&mut self, recipe: usize) {
        self.recipe = recipe;
        self.decoders.values_mut().for_each(ViewDecoder::begin);
        self.phases.clear();
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
                self.accumulate(camera, projector, frame)?;
                Ok(&[])
            }
            Work::Phase { camera, projector, axis } => self.phase(camera, projector, axis),
            Work::Match { pair } => self.match_pair(pair),
            Work::Take { pair } => {
                self.fuser.take(pair, &self.clouds[pair], &self.cell.config.settings.fusion);
                Ok(&[])
            }
            Work::Fuse => {
                let clouds: Vec<&[Point]> = self.clouds.iter().map(Vec::as_slice).collect();
                let settings = &self.cell.config.settings.fusion;
                let report = self.fuser.fuse(&clouds, settings, &mut self.fused);
                if report.points == 0 {
                    return Err(WorkError::NoPoint(no_point(report, settings)));
                }
                Ok(cast_slice(&self.fused))
            }
            Work::Inspect => {
                let recipe = self.cell.config.recipes.get(self.recipe);
                let recipe =
                    recipe.ok_or_else(|| WorkError::Missing(format!("recipe {}", self.recipe + 1)))?;
                let result = recipe.plan.as_ref().map(|plan| evaluate(plan, &self.fused));
                self.result = serde_json::to_string(&result)?;
                Ok(self.result.as_bytes())
            }
            // Of cells on several hosts: what a host does is recomputed as that of the whole cell.
            Work::Project { .. }
            | Work::Store
            | Work::Remote { .. }
            | Work::Receive { .. }
            | Work::HandOver
            | Work::Deliver => Ok(&[]),
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

    fn accumulate(&mut self, camera: usize, projector: usize, frame: usize) -> Result<(), WorkError> {
        let node = &self.cell.graph.cameras[camera];
        let (full_scale_dn, bytes) = &self.frames[camera];
        let view = FrameView::from_bytes(node.width_px, node.height_px, *full_scale_dn, bytes.get());
        let name = || self.cell.graph.frame_name(camera, projector, frame);
        let view = view.ok_or_else(|| WorkError::Missing(name()))?;
        Ok(lit(&mut self.decoders, self.cell, camera, projector)?.push(frame, &view)?)
    }

    fn phase(&mut self, camera: usize, projector: usize, axis: Axis) -> Result<&[u8], WorkError> {
        let decoder = lit(&mut self.decoders, self.cell, camera, projector)?;
        let info = decoder.info(axis)?;
        let maps = self.phases.entry((camera, projector)).or_default();
        maps.retain(|(known, _)| known.axis != axis);
        maps.push((info, Bytes::default()));
        let Some((_, bytes)) = maps.last_mut() else { return Ok(&[]) };
        let planes = PhaseViewMut::from_bytes(info, bytes.resize(PHASE_BYTES_PER_PX * info.len()));
        let mut planes = planes.ok_or_else(|| WorkError::Missing("memory for a phase".into()))?;
        decoder.finish(axis, &mut planes)?;
        Ok(bytes.get())
    }

    fn match_pair(&mut self, pair: usize) -> Result<&[u8], WorkError> {
        let node = &self.cell.graph.pairs[pair];
        let views = |camera: usize| {
            let maps = self.phases.get(&(camera, node.projector)).map_or(&[][..], Vec::as_slice);
            Views::of(maps.iter().filter_map(|(info, bytes)| PhaseView::from_bytes(*info, bytes.get())))
        };
        let mut cameras = node.cameras().into_iter().map(views);
        let (left, right) = (cameras.next().unwrap_or_default(), cameras.next().unwrap_or_default());
        let (points, _) = self.matchers[pair].cloud(&left, &right)?;
        self.clouds[pair] = points;
        Ok(cast_slice(&self.clouds[pair]))
    }
}

fn lit<'d>(
    decoders: &'d mut Decoders,
    cell: &Cell,
    camera: usize,
    projector: usize,
) -> Result<&'d mut ViewDecoder, CellError> {
    decoders.get_mut(&(camera, projector)).ok_or_else(|| CellError::NotSeen {
        camera: cell.graph.camera_name(camera).to_owned(),
        projector: cell.graph.projector_name(projector).to_owned(),
    })
}

//! From the frames of a camera to its absolute phase.

use super::evidence::{Expected, Threshold};
use super::exposures::Exposures;
use super::phase_method::{PhaseMethod, PhaseMethodError, SineFrames};
use crate::cell::Cell;
use crate::error::CellError;
use fringe::decode::{DecodeError, DecodeReport, DecodeSettings, Decoder, Diagnosis};
use fringe::frame::{FrameView, SharedFrame};
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::{PhaseInfo, PhaseMap, PhaseViewMut};
use thiserror::Error;

/// What a camera sees of a projector.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// What the projector shows.
    pub sequence: &'a [PatternSet],
    /// Columns and rows of the projector.
    pub extent_px: [u32; 2],
    /// Columns and rows of the camera.
    pub size_px: [u32; 2],
    /// Grey value of a full pixel.
    pub full_scale_dn: u16,
    /// Exposure times of a sequence that is shown once for each; empty: shown once.
    pub exposures_ms: &'a [f64],
}

/// Why frames give no phase.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ViewError {
    /// The decoder refuses the frames or settings.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The method of the wrapped phase refuses.
    #[error(transparent)]
    Method(#[from] PhaseMethodError),
    /// One of several exposures is refused.
    #[error("exposure of {exposure_ms} ms")]
    Exposure {
        /// Exposure time of the frames, ms.
        exposure_ms: f64,
        /// The fault of this exposure.
        source: Box<ViewError>,
    },
}

/// Decodes the frames of one camera under one projector, sequence after sequence. Frames of several exposures come exposure by
/// exposure; the phases are then merged ([`fringe::decode::merge_exposures`]).
#[derive(Debug)]
pub struct ViewDecoder {
    decoder: Decoder,
    method: PhaseMethod,
    frames: SineFrames,
    /// Of a sequence that is shown more than once.
    several: Option<Exposures>,
    evidence: bool,
}

/// A phase map with its report and diagnosis.
#[derive(Debug)]
pub struct Decoded {
    /// Absolute phase of each pixel.
    pub map: PhaseMap,
    /// How it came about; of several exposures, that with the most valid pixels.
    pub report: DecodeReport,
    /// What the order of each pixel rests on; empty for several exposures.
    pub diagnosis: Vec<Diagnosis>,
    /// What noise makes probable.
    pub expected: Expected,
    /// Between black and white; absent without a code, and for several exposures.
    pub threshold: Option<Threshold>,
    /// Pixels that each exposure measures best; empty for one exposure.
    pub best_of: Vec<usize>,
}

impl ViewDecoder {
    /// Allocates all that it needs.
    ///
    /// # Errors
    /// A sequence that gives no absolute phase, or settings out of range.
    pub fn new(view: &View<'_>, settings: &DecodeSettings, method: PhaseMethod) -> Result<Self, DecodeError> {
        let [width_px, height_px] = view.size_px;
        let decoder =
            Decoder::new(view.sequence, width_px, height_px, view.full_scale_dn, view.extent_px, settings)?;
        let several = match view.exposures_ms {
            [] | [_] => None,
            times => Some(Exposures::new(&decoder, times)?),
        };
        Ok(Self { frames: method.sine_frames(&decoder), decoder, method, several, evidence: false })
    }

    /// Also finds what the orders of each of several exposures rest on, for [`Self::decoded`].
    #[must_use]
    pub fn with_evidence(self) -> Self {
        Self { evidence: true, ..self }
    }

    /// Starts a new sequence; what has landed is forgotten.
    pub fn begin(&mut self) {
        self.decoder.begin();
        if let Some(several) = &mut self.several {
            several.begin();
        }
    }

    /// Takes a frame. Frames come in order, each once, and count on from one exposure to the next.
    ///
    /// # Errors
    /// A frame out of order, of another size or grey scale; with the last frame of an exposure, frames that give no phase.
    pub fn push(&mut self, frame: usize, view: &FrameView<'_>) -> Result<(), ViewError> {
        self.take(frame, view, |decoder, index| decoder.push(index, view))
    }

    /// As [`Self::push`], without a copy of the frame ([`Decoder::push_shared`]).
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn push_shared(&mut self, number: usize, frame: &SharedFrame) -> Result<(), ViewError> {
        self.take(number, &frame.view(), |decoder, index| decoder.push_shared(index, frame))
    }

    /// Takes a frame in one of both ways.
    fn take(
        &mut self,
        frame: usize,
        view: &FrameView<'_>,
        push: impl FnOnce(&mut Decoder, usize) -> Result<(), DecodeError>,
    ) -> Result<(), ViewError> {
        let Self { decoder, method, frames, several, evidence } = self;
        // After the last frame of an exposure the method is applied.
        let land = |decoder: &mut Decoder, index: usize| -> Result<(), ViewError> {
            push(decoder, index)?;
            frames.add(index, view);
            if index + 1 == decoder.frames() {
                method.apply(decoder, frames)?;
            }
            Ok(())
        };
        let Some(several) = several else { return land(decoder, frame) };
        let index = several.place(decoder, frame)?;
        let exposure_ms = several.exposure_ms();
        let of = |source| ViewError::Exposure { exposure_ms, source: Box::new(source) };
        land(decoder, index).map_err(of)?;
        several.landed(decoder, *evidence).map_err(|error| of(error.into()))
    }

    /// The axes of which the sequence gives a phase, x before y.
    pub fn axes(&self) -> Vec<Axis> {
        self.decoder.axes()
    }

    /// Size and period of an axis' phase map.
    ///
    /// # Errors
    /// An axis that the sequence does not tell.
    pub fn info(&self, axis: Axis) -> Result<PhaseInfo, DecodeError> {
        self.decoder.info(axis)
    }

    /// Writes the phase map of an axis whose frames have all landed.
    ///
    /// # Errors
    /// As [`Decoder::finish`].
    pub fn finish(&mut self, axis: Axis, out: &mut PhaseViewMut<'_>) -> Result<DecodeReport, DecodeError> {
        match &mut self.several {
            None => self.decoder.finish(axis, out),
            Some(several) => several.merge(&self.decoder, axis, out),
        }
    }

    /// The phase map of an axis with all that is known of it.
    ///
    /// # Errors
    /// As [`Self::finish`].
    pub fn decoded(&mut self, axis: Axis) -> Result<Decoded, DecodeError> {
        let mut map = PhaseMap::new(self.info(axis)?);
        let report = self.finish(axis, &mut map.view_mut())?;
        if let Some(several) = &self.several {
            let (expected, best_of) = several.evidence(axis);
            return Ok(Decoded { map, report, diagnosis: Vec::new(), expected, threshold: None, best_of });
        }
        let diagnosis = self.decoder.diagnose(axis)?;
        let (expected, threshold) = (Expected::of(&map, &diagnosis), Threshold::of(&map, &diagnosis));
        Ok(Decoded { map, report, diagnosis, expected, threshold, best_of: Vec::new() })
    }

    /// What the order of each pixel rests on.
    ///
    /// # Errors
    /// As [`Decoder::diagnose`].
    pub fn diagnose(&self, axis: Axis) -> Result<Vec<Diagnosis>, DecodeError> {
        self.decoder.diagnose(axis)
    }

    /// Probability that noise makes the order of each pixel wrong, from its σ in rad; `None` where no order is decided.
    ///
    /// # Errors
    /// An axis that the sequence does not tell.
    pub fn order_risk(&self, axis: Axis, sigma_rad: &[f32]) -> Result<Option<Vec<f64>>, DecodeError> {
        let risk = self.decoder.order_risk(axis)?;
        Ok(risk.map(|risk| risk.probabilities(sigma_rad.iter().copied())))
    }
}

/// The decoder of a camera of a cell under a projector.
///
/// # Errors
/// A sequence that gives no absolute phase, or settings out of range.
pub fn decoder(cell: &Cell, projector: usize, camera: usize) -> Result<ViewDecoder, CellError> {
    let node = &cell.graph.cameras[camera];
    decoder_of_size(cell, projector, camera, [node.width_px, node.height_px])
}

/// The decoder of a part of the camera's picture, columns × rows in px.
///
/// # Errors
/// As [`decoder`].
pub fn decoder_of_size(
    cell: &Cell,
    projector: usize,
    camera: usize,
    size_px: [u32; 2],
) -> Result<ViewDecoder, CellError> {
    let (light, node) = (&cell.config.projectors[projector], &cell.graph.cameras[camera]);
    let view = View {
        sequence: &light.sequence,
        extent_px: [light.width_px, light.height_px],
        size_px,
        full_scale_dn: cell.format(projector, camera)?.full_scale_dn,
        exposures_ms: &light.exposures_ms,
    };
    let settings = cell.config.settings.decode.of_camera(cell.config.rig.sensor(&node.name));
    ViewDecoder::new(&view, &settings, PhaseMethod::default())
        .map_err(|source| CellError::Decode { projector: light.name.clone(), source })
}

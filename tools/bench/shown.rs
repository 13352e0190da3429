//! Frames in memory, decoded by a chosen method and compared with the truth: for the tables of methods and errors.

use crate::simulate::Buffer;
use anyhow::{Context, Result};
use cell::executor::{PhaseMethod, ViewDecoder};
use fringe::decode::DecodeSettings;
use fringe::frame::{Frame, PixelBuffer};
use fringe::geometry::rig::Rig;
use fringe::math::statistics::median;
use fringe::pattern::{Axis, PatternSet, frame_count};
use fringe::phase::PhaseMap;
use ipc::os::Usage;
use serde::Serialize;
use std::f64::consts::{PI, TAU};
use twin::{Twin, View};

/// The frames that one camera took of one projector.
pub struct Taken {
    /// In the order of the sequence.
    pub frames: Vec<Frame>,
    /// Pattern sets in the order of projection.
    pub sequence: Vec<PatternSet>,
    /// Columns and rows of the projector.
    pub extent_px: [u32; 2],
}

/// What one camera of the twin sees of one projector.
pub struct Shown {
    view: View,
    taken: Taken,
    projector: String,
}

/// A phase map compared with the truth.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Evaluated {
    /// Valid pixels of those that the projector lights.
    pub valid_share: f64,
    /// Root mean square phase error of the finest sine, wrong orders left out, rad; NaN without valid pixels.
    pub rms_rad: f64,
    /// Mean phase error, rad.
    pub mean_rad: f64,
    /// Median of the predicted uncertainty, rad.
    pub sigma_rad: f64,
    /// Valid pixels off by half a period or more, of all valid ones.
    pub wrong_orders: f64,
    /// Processor time of all threads from frames in memory to the phase map, seconds per megapixel of one camera.
    pub seconds_per_mpx: f64,
}

/// A method on a surface.
#[derive(Serialize)]
pub struct Cell {
    /// Method: the row of the table.
    pub method: &'static str,
    /// Surface and condition: the column of the table.
    pub case: String,
    /// Why there is no result.
    pub refused: Option<String>,
    /// The result of the method on the case.
    #[serde(flatten)]
    pub evaluated: Option<Evaluated>,
}

/// Settings that refuse no map for its wrong orders, so that they are counted.
pub fn counting() -> DecodeSettings {
    DecodeSettings { max_contradiction: 1e6, max_bounce_rad: 0.0, ..DecodeSettings::default() }
}

impl Shown {
    /// Renders all frames of the sequence.
    pub fn new(
        twin: &Twin,
        rig: &Rig,
        camera: &str,
        projector: &str,
        sequence: &[PatternSet],
    ) -> Result<Self> {
        let view = twin.view_lit_by(camera, &[projector], 0)?;
        let mut renderer = twin.renderer(projector, sequence)?;
        let mut buffer = Buffer::new(&view);
        let mut frames = Vec::new();
        for number in 0..frame_count(sequence) {
            renderer.render(&view, number, buffer.pixels_mut())?;
            let pixels = match &buffer {
                Buffer::Narrow(values) => PixelBuffer::Mono8(values.clone()),
                Buffer::Wide(values) => PixelBuffer::Mono16(values.clone()),
            };
            let (width_px, height_px, full_scale_dn) =
                (view.width_px(), view.height_px(), view.full_scale_dn());
            frames.push(Frame { width_px, height_px, full_scale_dn, pixels });
        }
        let lamp = rig.projector(projector).context("the twin's rig has the projector")?;
        let extent_px = [lamp.width_px, lamp.height_px];
        let taken = Taken { frames, sequence: sequence.to_vec(), extent_px };
        Ok(Self { view, taken, projector: projector.to_owned() })
    }

    /// Decodes along x; also returns the processor time in seconds.
    pub fn decode(&self, settings: &DecodeSettings, method: PhaseMethod) -> Result<(PhaseMap, f64)> {
        self.taken.decode(Axis::X, settings, method)
    }

    /// Error of each pixel, rad; NaN where the map is not valid or the projector does not light.
    pub fn errors_rad(&self, map: &PhaseMap) -> Result<(Vec<f32>, usize)> {
        let scale = TAU / map.info.period_px;
        let mut lit = 0;
        let mut errors = vec![f32::NAN; map.info.len()];
        for (index, error) in errors.iter_mut().enumerate() {
            let Some(at) = self.view.truth_coordinate(&self.projector, index)? else { continue };
            lit += 1;
            if map.valid[index] == 1 {
                *error = (f64::from(map.phase_rad[index]) - at.x * scale) as f32;
            }
        }
        Ok((errors, lit))
    }

    /// Decodes along x and compares with the truth.
    pub fn evaluate(&self, settings: &DecodeSettings, method: PhaseMethod) -> Result<Evaluated> {
        let (map, seconds) = self.decode(settings, method)?;
        let (errors, lit) = self.errors_rad(&map)?;
        Ok(Evaluated::new(&map, &errors, lit, seconds))
    }
}

impl Taken {
    /// Decodes one axis; also returns the processor time in seconds.
    pub fn decode(
        &self,
        axis: Axis,
        settings: &DecodeSettings,
        method: PhaseMethod,
    ) -> Result<(PhaseMap, f64)> {
        let start = Usage::now();
        let first = self.frames.first().context("a sequence has frames")?;
        let view = cell::executor::View {
            sequence: &self.sequence,
            extent_px: self.extent_px,
            size_px: [first.width_px, first.height_px],
            full_scale_dn: first.full_scale_dn,
            exposures_ms: &[],
        };
        let mut decoder = ViewDecoder::new(&view, settings, method)?;
        for (number, frame) in self.frames.iter().enumerate() {
            decoder.push(number, &frame.view())?;
        }
        let mut map = PhaseMap::new(decoder.info(axis)?);
        decoder.finish(axis, &mut map.view_mut())?;
        Ok((map, Usage::now().since(start).cpu_ns as f64 * 1e-9))
    }
}

impl Evaluated {
    /// From the error of each pixel, rad, NaN where there is none, and the number of pixels that could have one.
    pub fn new(map: &PhaseMap, errors: &[f32], lit: usize, seconds: f64) -> Self {
        let valid: Vec<f64> = errors.iter().filter(|e| !e.is_nan()).map(|e| f64::from(*e)).collect();
        let right: Vec<f64> = valid.iter().copied().filter(|e| e.abs() < PI).collect();
        let n = right.len().max(1) as f64;
        let mut sigma: Vec<f32> = map.sigma_rad.iter().copied().filter(|s| s.is_finite()).collect();
        Self {
            valid_share: valid.len() as f64 / lit.max(1) as f64,
            rms_rad: (right.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
            mean_rad: right.iter().sum::<f64>() / n,
            sigma_rad: median(&mut sigma).map_or(f64::NAN, f64::from),
            wrong_orders: (valid.len() - right.len()) as f64 / valid.len().max(1) as f64,
            seconds_per_mpx: seconds / (map.info.len() as f64 * 1e-6),
        }
    }
}

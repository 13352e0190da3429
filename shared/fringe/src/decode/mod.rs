//! Decoding: from the frames of one camera to absolute phase.
//!
//! ```text
//! frames, block by block ─▶ Σ I, Σ I cos δ, Σ I sin δ ─▶ wrapped phase, B, A, σ ─▶ order ─▶ neighbours ─▶ phase map
//! ```
//!
//! [`Decoder::new`] reads the sequence once, decides what every frame is for and reserves all memory. [`Decoder::push`]
//! copies a frame and, with the last of a sine set, estimates the camera's noise; [`Decoder::finish`] takes all frames block by block,
//! so that what a block needs stays in the first cache: a frame is read twice, and no sum is ever written to memory. Neither
//! allocates.
//!
//! # Convention
//! I = A + B cos(2πx/p − δ), δᵢ = ±(2πi/N + first step), gives φ = 2πx/p (mod 2π) in [0, 2π), so x = φ p/2π + m p. The order m is
//! an integer of any size and sign; phase 0 is as good as any other, only the mask marks what is usable.
//!
//! # One rule for the order
//! Every method of the fringe order gives a coarse coordinate c, and m = round((c − x_w) / p):
//! stripe k of a code gives c = k s + s/2 − 1/2 (its centre: a code edge lies half a column before the phase zero), a
//! longer period or a beat gives its own coordinate ([`chain`]). With stripes of half a period the two differ by at most
//! p/4 where p/2 would be harmful, so neither blur nor noise at the code's edges makes a jump. With stripes of a whole
//! period no margin is left at the edges; pixels there are settled by their neighbours or masked (`neighbours`).
//!
//! The result is the phase of the finest sine of an axis; the coarser ones only give its order. A code without
//! sines gives what lies between the edges of its stripes (`edges`), or the centre of a stripe with the uncertainty s/√12 where
//! there are none. Sets that are not needed (stair, ramp, random,
//! superfluous codes) are named in the report.
//!
//! # Uncertainty
//! σ_φ = √(2/N) σ_I / B with σ_I² = read² + gain · A from the residuals of the fit (`noise_estimate`), from neighbouring pixels
//! where there are too few steps (`neighbour_noise`), from the settings, or assumed where there is too little light. For N = 3 shot noise adds a term that alternates with 3φ; its mean is zero and it is left out.

mod apply_neighbours;
pub mod arctan;
mod axis_noise;
mod between_steps;
mod bits;
mod block;
mod blocks;
mod borders;
mod bounce;
mod bounce_cells;
mod bounce_window;
mod carrier;
pub mod chain;
mod clipped;
mod coarse;
mod code_check;
mod code_frames;
mod code_shift;
mod continuity;
mod contrast_bins;
mod copied_steps;
mod diagnose;
mod dirt;
mod edge_sag;
mod edges;
mod error;
mod exposures;
mod finish;
mod footprint;
mod frame_check;
mod identity;
mod limits;
mod linearity;
mod micro;
mod micro_order;
mod motion;
mod neighbour_noise;
mod neighbours;
mod noise_estimate;
mod noise_line;
mod noise_model;
pub mod number;
mod order;
mod plan;
mod probing;
mod rasters;
mod replace;
mod report;
mod ripples;
mod risk;
mod roles;
mod runs_on;
mod sensor_test;
mod sets;
mod settings;
mod single;
mod small_part;
mod spectrum;
mod sums;
mod survey;
#[cfg(test)]
mod tests;

pub use crate::frame::MAX_PIXELS;
pub use crate::sensor::CameraNoise;
pub use bounce::Bounced;
pub use code_shift::CodeShift;
pub use continuity::Continuity;
pub use diagnose::Diagnosis;
pub use dirt::{Fault, Finding, Remedy};
pub use error::DecodeError;
pub use exposures::{Exposed, merge_exposures};
pub use identity::{FrameOrder, OrderEvent, prove as prove_order};
pub use limits::{MAX_FRAMES, MAX_SINES};
pub use linearity::Linearity;
pub use motion::Motion;
pub use noise_line::QUANTISATION_DN2;
pub use noise_model::{NoiseModel, NoiseSource};
pub use plan::decoded_axes;
pub use replace::SineSet;
pub use report::DecodeReport;
pub use risk::OrderRisk;
pub use sensor_test::{FootprintTest, NoiseTest, SensorTest};
pub use settings::{DecodeSettings, OrderMethod};

use crate::frame::{FrameView, SharedFrame};
use crate::math::simd::best_level;
use crate::pattern::{Axis, PatternSet};
use crate::phase::PhaseInfo;
use apply_neighbours::Corrections;
use axis_noise::AxisState;
use bounce::Bounce;
use edges::Edges;
use fearless_simd::Level;
use footprint::Footprint;
use identity::Identity;
use motion::StepMotion;
use rasters::Rasters;
use roles::{Plan, Role};
use sums::Sums;

/// Decodes the frames of one camera under one projector, sequence after sequence.
#[derive(Debug)]
pub struct Decoder {
    width_px: u32,
    height_px: u32,
    /// Pixels of a frame.
    pixels: usize,
    full_scale_dn: u16,
    clipped_dn: u16,
    settings: DecodeSettings,
    plan: Plan,
    steps: Vec<u32>,
    periods_px: Vec<f64>,
    sums: Vec<Sums>,
    /// What was found in the frames of each set.
    findings: Vec<Vec<Finding>>,
    /// How the fringes moved during each set.
    motions: Vec<Option<StepMotion>>,
    rasters: Rasters,
    axes: Vec<AxisState>,
    /// Of each axis: what proves the order of the frames, where the sequence has a check.
    identities: Vec<Option<Identity>>,
    corrections: Corrections,
    footprint: Footprint,
    bounce: Bounce,
    /// Of codes without sines.
    edges: Option<Edges>,
    next: usize,
    /// Instructions that may be used.
    level: Level,
}

impl Decoder {
    /// Prepares for a sequence.
    ///
    /// `extent_px` is the projector's size in columns and rows: it decides whether a period or a code covers it.
    /// Memory per pixel: 1 (8 bits) or 2 bytes per frame that is used, and 8.7 bytes for what neighbours, footprint and bounced light say.
    ///
    /// # Errors
    /// Names the set or setting that cannot be used, or what is missing for an absolute order.
    pub fn new(
        sequence: &[PatternSet],
        width_px: u32,
        height_px: u32,
        full_scale_dn: u16,
        extent_px: [u32; 2],
        settings: &DecodeSettings,
    ) -> Result<Self, DecodeError> {
        settings.check()?;
        let pixels = u64::from(width_px) * u64::from(height_px);
        if pixels == 0 || pixels > MAX_PIXELS as u64 {
            return Err(DecodeError::Size { width_px, height_px });
        }
        if full_scale_dn == 0 {
            return Err(DecodeError::FullScale);
        }
        let pixels = pixels as usize;
        let mut plan = Plan::new(sequence, extent_px, settings)?;
        let identities = plan.identities(sequence, extent_px, pixels);
        let clipped_dn = (settings.saturation_fraction * f64::from(full_scale_dn)).ceil() as u16;
        let axes = plan
            .axes
            .iter()
            .map(|axis| AxisState::new(axis, &plan, width_px as usize, pixels, clipped_dn))
            .collect();
        let mut decoder = Self {
            width_px,
            height_px,
            full_scale_dn,
            clipped_dn,
            settings: settings.clone(),
            steps: plan.sines.iter().map(|s| s.steps).collect(),
            periods_px: plan.sines.iter().map(|s| s.period_px).collect(),
            sums: plan.sines.iter().map(Sums::new).collect(),
            findings: vec![Vec::new(); plan.sines.len()],
            motions: vec![None; plan.sines.len()],
            rasters: Rasters::new(plan.stored, pixels, full_scale_dn),
            axes,
            identities,
            corrections: Corrections::new(width_px as usize, pixels),
            pixels,
            footprint: Footprint::new(width_px as usize, pixels),
            bounce: Bounce::new(width_px as usize, pixels),
            edges: plan
                .axes
                .iter()
                .any(|axis| axis.chain.is_none())
                .then(|| Edges::new(width_px as usize, pixels)),
            plan,
            next: 0,
            level: best_level(),
        };
        decoder.begin();
        Ok(decoder)
    }

    /// Starts a new sequence; what has landed is forgotten.
    pub fn begin(&mut self) {
        self.next = 0;
        self.motions.fill(None);
        for ((sums, found), plan) in self.sums.iter_mut().zip(&mut self.findings).zip(&self.plan.sines) {
            sums.replaced = None;
            if !found.is_empty() {
                *sums = Sums::new(plan);
                found.clear();
            }
        }
        for (axis, plan) in self.axes.iter_mut().zip(&self.plan.axes) {
            axis.probe.begin();
            axis.open_sets = plan.sines.len();
            axis.estimate = None;
            axis.settled = false;
            axis.asked_small_part = false;
            axis.code = None;
        }
    }

    /// Number of frames of the sequence.
    pub fn frames(&self) -> usize {
        self.plan.roles.len()
    }

    /// Takes frame `index` of the sequence. Frames come in order, each once.
    ///
    /// # Errors
    /// A frame out of turn, of another size or grey scale, or with a value beyond full scale is refused and changes nothing.
    pub fn push(&mut self, index: usize, frame: &FrameView) -> Result<(), DecodeError> {
        self.take(index, frame, |rasters, raster| rasters.keep(raster, frame.pixels))
    }

    /// As [`Self::push`], without a copy: the frame stays where it is until the next sequence. One whose values are stored in another width is copied.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn push_shared(&mut self, index: usize, frame: &SharedFrame) -> Result<(), DecodeError> {
        self.take(index, &frame.view(), |rasters, raster| rasters.hold(raster, &frame.pixels))
    }

    fn take(
        &mut self,
        index: usize,
        frame: &FrameView,
        keep: impl FnOnce(&mut Rasters, usize),
    ) -> Result<(), DecodeError> {
        self.check_frame(index, frame)?;
        self.identities.iter_mut().flatten().for_each(|identity| identity.keep(index, frame));
        match self.plan.roles[index] {
            Role::Ignored => {}
            Role::Stored(raster) => keep(&mut self.rasters, raster),
            Role::Sine { slot, step } => {
                keep(&mut self.rasters, self.plan.sines[slot].first + step);
                self.probe_frame(slot, step);
                if step + 1 == self.plan.sines[slot].rasters().len() {
                    self.inspect(slot);
                    if self.settings.camera_noise.is_none() {
                        self.probe_noise(slot);
                    }
                }
            }
        }
        self.next += 1;
        Ok(())
    }

    /// The axes of which the sequence gives a phase, x before y.
    pub fn axes(&self) -> Vec<Axis> {
        self.plan.axes.iter().map(|a| a.axis).collect()
    }

    /// Size and period of an axis' phase map.
    ///
    /// # Errors
    /// [`DecodeError::NoSuchAxis`].
    pub fn info(&self, axis: Axis) -> Result<PhaseInfo, DecodeError> {
        let plan = self.plan.axes.iter().find(|a| a.axis == axis).ok_or(DecodeError::NoSuchAxis { axis })?;
        Ok(PhaseInfo { width_px: self.width_px, height_px: self.height_px, axis, period_px: plan.period_px })
    }
}

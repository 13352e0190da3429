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
mod bits;
mod block;
mod blocks;
mod borders;
mod bounce;
mod bounce_window;
mod carrier;
pub mod chain;
mod clipped;
mod coarse;
mod code_check;
mod code_frames;
mod continuity;
mod contrast_bins;
mod diagnose;
mod dirt;
mod edges;
mod error;
mod exposures;
mod footprint;
mod frame_check;
mod identity;
mod limits;
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
mod risk;
mod roles;
mod sensor_test;
mod sets;
mod settings;
mod single;
mod spectrum;
mod sums;
mod survey;
#[cfg(test)]
mod tests;

pub use crate::sensor::CameraNoise;
pub use bounce::Bounced;
pub use continuity::Continuity;
pub use diagnose::Diagnosis;
pub use dirt::{Fault, Finding, Remedy};
pub use error::DecodeError;
pub use exposures::{Exposed, merge_exposures};
pub use identity::{FrameOrder, OrderEvent, prove as prove_order};
pub use limits::{MAX_FRAMES, MAX_PIXELS, MAX_SINES};
pub use motion::Motion;
pub use noise_model::{NoiseModel, NoiseSource};
pub use plan::decoded_axes;
pub use replace::SineSet;
pub use report::DecodeReport;
pub use risk::OrderRisk;
pub use sensor_test::{FootprintTest, NoiseTest, SensorTest};
pub use settings::{DecodeSettings, OrderMethod};

use crate::frame::FrameView;
use crate::math::simd::best_level;
use crate::pattern::{Axis, PatternSet};
use crate::phase::{PhaseInfo, PhaseViewMut};
use apply_neighbours::{Corrections, Verdicts};
use axis_noise::AxisState;
use blocks::decode_blocks;
use bounce::Bounce;
use edges::Edges;
use fearless_simd::Level;
use footprint::Footprint;
use identity::Identity;
use motion::StepMotion;
use neighbours::Field;
use order::Kernel;
use rasters::Rasters;
use roles::{AxisPlan, Plan, Role};
use std::sync::Arc;
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
    /// Memory per pixel: 1 (8 bits) or 2 bytes per frame that is used, and 6 bytes for what neighbours say.
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
        self.check_frame(index, frame)?;
        self.identities.iter_mut().flatten().for_each(|identity| identity.keep(index, frame));
        match self.plan.roles[index] {
            Role::Ignored => {}
            Role::Stored(raster) => self.rasters.keep(raster, frame.pixels),
            Role::Sine { slot, step } => {
                self.rasters.keep(self.plan.sines[slot].first + step, frame.pixels);
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

    /// Writes the phase map of an axis whose frames have all landed. May be called again, with the same result.
    ///
    /// # Errors
    /// Refuses an axis that is unknown or incomplete, and planes of another size.
    pub fn finish(&mut self, axis: Axis, out: &mut PhaseViewMut) -> Result<DecodeReport, DecodeError> {
        let info = self.info(axis)?;
        let home = self.complete(axis)?;
        let n = info.len();
        let sizes = [out.phase_rad.len(), out.sigma_rad.len(), out.modulation.len(), out.valid.len()];
        if out.info != info || sizes != [n; 4] {
            return Err(DecodeError::Output);
        }
        // First of all: a slip explains what other checks would only notice.
        let order = self.identities[home].as_ref().map_or(Ok(FrameOrder::Unchecked), Identity::verify)?;
        self.check_sets(home)?;
        if let Some(residual) = self.axes[home].probe.disorder(self.full_scale_dn) {
            return Err(DecodeError::Disorder { axis, residual });
        }
        let by_map = self.can_ask_the_map(home);
        if !by_map {
            self.estimate_from_neighbours(home);
        }
        if self.plan.axes[home].sines.is_empty() {
            self.mend_code(home, out)?;
        }
        let mut report = self.pass(home, out);
        if by_map && let Some(settled) = self.settle_by_map(home, out) {
            report = settled;
        }
        let mut frames = None;
        if self.suspects_code(home, &report, out) || self.axes[home].has_wrong_frames() {
            let proven = matches!(order, FrameOrder::Proven { .. }) && self.axes[home].code.is_none();
            frames = proven.then(|| self.rasters.clone());
            decode_blocks(&self.kernel(home, &self.plan.axes[home]), self.level, out);
            self.mend_code(home, out)?;
            report = self.pass(home, out);
        }
        self.mask_undemanded(home, &mut report, out);
        if !self.plan.axes[home].sines.is_empty()
            && let Err(contradiction) = self.check_code(home, &report, out)
        {
            report = self.as_they_came(home, out, frames.ok_or(contradiction)?)?;
        }
        let of_code = self.axes[home].code.iter().flat_map(|verdict| &verdict.findings);
        let of_sines = self.plan.axes[home].sines.iter().flat_map(|s| &self.findings[*s]);
        report.findings = of_sines.chain(of_code).copied().collect();
        report.order = order;
        report.sensor.noise = self.noise_test(&self.axes[home]);
        report.motion = self.motion(home, out);
        (report.footprint_px, report.sensor.footprint) = self.remove_footprint(home, out)?;
        report.bounced = self.find_bounce(home, report.footprint_px, out);
        report.valid -= report.bounced.masked;
        Ok(report)
    }

    /// Decodes an axis from the stored frames, pixels first, then with their neighbours.
    fn pass(&mut self, home: usize, out: &mut PhaseViewMut) -> DecodeReport {
        let plan = &self.plan.axes[home];
        let axis = plan.axis;
        let kernel = self.kernel(home, plan);
        let (mut tally, noise) = (decode_blocks(&kernel, self.level, out), kernel.noise);
        let verdicts = if plan.chain.is_some() {
            let field = Field {
                width: self.width_px as usize,
                height: self.height_px as usize,
                phase_rad: out.phase_rad,
                state: out.valid,
                along: if axis == Axis::X { (0, 1) } else { (1, 0) },
                reach: self.settings.neighbour_reach_px as usize,
                spikes: self.settings.repair_spikes,
            };
            self.corrections.ask(&field, self.level);
            self.corrections.apply(plan, out)
        } else {
            if let Some((edges, code)) = self.edges.as_mut().zip(plan.code.as_ref())
                && plan.shifted.is_none()
            {
                tally.noisy += edges.interpolate(&self.rasters, code, out);
            }
            Verdicts::of_mask(out.valid)
        };
        let mut report = verdicts.report(tally, noise, Arc::clone(&self.axes[home].ignored));
        if !self.plan.axes[home].sines.is_empty() {
            report.continuity = Continuity::of(out, report.valid, self.level);
        }
        report
    }

    /// Number of an axis whose frames have all landed.
    fn complete(&self, axis: Axis) -> Result<usize, DecodeError> {
        let home =
            self.plan.axes.iter().position(|a| a.axis == axis).ok_or(DecodeError::NoSuchAxis { axis })?;
        let needed = self.plan.axes[home].needed;
        if self.next < needed {
            Err(DecodeError::Incomplete { axis, landed: self.next, needed })
        } else {
            Ok(home)
        }
    }

    fn kernel<'a>(&'a self, home: usize, plan: &'a AxisPlan) -> Kernel<'a> {
        let gathered = &self.axes[home];
        let kernel = Kernel {
            plan,
            pixels: self.pixels,
            sums: &self.sums,
            steps: &self.steps,
            periods_px: &self.periods_px,
            rasters: &self.rasters,
            clipping: &gathered.clipping,
            noise: self.noise(gathered),
            settings: &self.settings,
            least_modulation_dn: self.least_modulation_dn() as f32,
            single: None,
        };
        let single = kernel.single();
        Kernel { single, ..kernel }
    }

    fn least_modulation_dn(&self) -> f64 {
        self.settings.min_modulation_fraction * f64::from(self.full_scale_dn)
    }
}

//! What the frames of one axis say of faults, motion and noise, and which noise model its phases get.

use super::borders::Borders;
use super::code_frames::{Levels, code_frames};
use super::dirt::code::{CodeFrame, CodeVerdict};
use super::dirt::{self, Look, Samples};
use super::micro::Micro;
use super::neighbour_noise::{Places, sample_code, sample_map, sample_phase};
use super::noise_estimate::Probe;
use super::noise_line::QUANTISATION_DN2;
use super::probing::ProbeLimits;
use super::roles::{AxisPlan, Plan, SinePlan};
use super::sensor_test::{self, NoiseTest};
use super::sums::{Clipping, Sums};
use super::{DecodeReport, Decoder, NoiseModel, NoiseSource, Remedy};
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use std::sync::Arc;

/// Distance of pixels that share no noise, px: neighbours share it behind a mosaic of colours.
const APART_PX: usize = 3;

/// What an axis gathers beside its sums.
#[derive(Debug)]
pub(super) struct AxisState {
    pub clipping: Clipping,
    pub probe: Probe,
    pub open_sets: usize,
    pub estimate: Option<NoiseModel>,
    /// Whether neighbours were asked about it.
    pub settled: bool,
    /// Whether all pixels of a small part were asked about it.
    pub asked_small_part: bool,
    /// What was found in the frames of the code, where they were looked at.
    pub code: Option<CodeVerdict>,
    /// The frames of the code, with room to compare their levels and their fringes.
    pub code_frames: Vec<CodeFrame>,
    pub levels: Levels,
    pub borders: Borders,
    pub ignored: Arc<[String]>,
}

impl AxisState {
    /// Nothing gathered yet of an axis of a plan, in images of `pixels` in rows of `width`.
    pub fn new(axis: &AxisPlan, plan: &Plan, width: usize, pixels: usize, clipped_dn: u16) -> Self {
        let code_frames = code_frames(axis, &plan.homes);
        let sets: Vec<_> = axis.sines.iter().map(|slot| &plan.sines[*slot]).collect();
        Self {
            clipping: Clipping {
                rasters: plan
                    .sines
                    .iter()
                    .filter(|sine| sine.axis == axis.axis)
                    .flat_map(SinePlan::rasters)
                    .chain(axis.micro.iter().flat_map(Micro::rasters))
                    .collect(),
                clipped_dn,
            },
            probe: Probe::new(width, pixels, &sets),
            open_sets: sets.len(),
            estimate: None,
            settled: false,
            asked_small_part: false,
            code: None,
            levels: Levels::of(code_frames.len()),
            code_frames,
            borders: Borders::of(axis, width),
            ignored: axis.ignored.as_slice().into(),
        }
    }
}

impl AxisState {
    /// Whether a frame of the code is wrong that nothing makes up for.
    pub fn has_wrong_frames(&self) -> bool {
        let wrong = |verdict: &CodeVerdict| verdict.findings.iter().any(|found| found.remedy == Remedy::None);
        self.code.as_ref().is_some_and(wrong)
    }
}

impl Decoder {
    /// Keeps the grey values of the probed pixels in a frame that has just landed.
    pub(super) fn probe_frame(&mut self, slot: usize, step: usize) {
        let axis = self.axes.iter_mut().zip(&self.plan.axes).find(|(_, plan)| plan.sines.contains(&slot));
        if let Some((axis, _)) = axis {
            let raster = self.plan.sines[slot].first + step;
            axis.probe.keep(step, raster, &self.rasters);
        }
    }

    /// Looks for frames of a complete sine set that do not show what the others show, and for motion.
    pub(super) fn inspect(&mut self, slot: usize) {
        let least_modulation_dn = self.least_modulation_dn();
        let axis = self.axes.iter_mut().zip(&self.plan.axes).find(|(_, plan)| plan.sines.contains(&slot));
        let Some((axis, _)) = axis else { return };
        let Probe { positions, frames, chosen, columns, .. } = &mut axis.probe;
        let look = Look {
            positions,
            width: self.width_px as usize,
            pixels: self.pixels,
            values: frames,
            least_modulation_dn,
            clipped_dn: self.clipped_dn,
        };
        let room = (chosen, columns.as_mut_slice());
        let Some(samples) = Samples::new(&self.plan.sines[slot], &look, room, self.level) else { return };
        let (repair, motion) = dirt::inspect(&samples);
        self.motions[slot] = motion;
        if let Some(repair) = repair {
            self.sums[slot].refit(&repair.fit, repair.steadied);
            self.findings[slot] = repair.findings;
        }
    }

    /// What the frames of a sine set are held against.
    pub(super) fn probe_limits(&self) -> ProbeLimits {
        ProbeLimits {
            least_modulation_dn: self.least_modulation_dn(),
            clipped_dn: self.clipped_dn,
            level: self.level,
        }
    }

    /// Whether settings or calibration state the noise.
    pub(super) fn is_noise_given(&self) -> bool {
        self.settings.camera_noise.is_some() || self.settings.sensor.noise.is_some()
    }

    /// Samples the noise of a complete sine set; with the last set of its axis, the noise model.
    pub(super) fn probe_noise(&mut self, slot: usize) {
        let limits = self.probe_limits();
        for (axis, plan) in self.axes.iter_mut().zip(&self.plan.axes) {
            // Stairs are no sine of the axis: their phase jumps.
            let Some(set) = plan.sines.iter().position(|s| *s == slot) else { continue };
            // What faulty frames leave is no noise.
            if self.findings[slot].is_empty() {
                axis.probe.close_set(set, &self.sums[slot], limits);
            }
            axis.open_sets -= 1;
            if axis.open_sets == 0 {
                axis.estimate = axis.probe.model();
            }
        }
    }

    /// The noise model where neither settings nor residuals give it, and where residuals show too much.
    pub(super) fn estimate_from_neighbours(&mut self, home: usize) {
        let least_dn = self.least_modulation_dn();
        let (plan, axis) = (&self.plan.axes[home], &mut self.axes[home]);
        if axis.settled || self.settings.camera_noise.is_some() {
            return;
        }
        axis.settled = true;
        let lag = if axis.estimate.is_some() { APART_PX } else { 1 };
        let AxisState { probe, clipping, .. } = axis;
        let gather = |positions: &[usize], samples: &mut Vec<_>| {
            let places = Places {
                positions,
                width: self.width_px as usize,
                pixels: self.pixels,
                rasters: &self.rasters,
                clipping,
                lag,
            };
            match (plan.sines.first(), &plan.code) {
                (Some(finest), _) if self.steps[*finest] > 1 => {
                    let steps = self.steps[*finest] as usize;
                    let sums = &self.sums[*finest];
                    vectorised!(self.level, sample_phase(&places, sums, steps, least_dn, samples));
                }
                (_, Some(code)) => sample_code(&places, code, least_dn, samples),
                (_, None) => {}
            }
        };
        axis.estimate = match axis.estimate {
            Some(model) => Some(probe.lessen(model, gather)),
            None => probe.model_of_neighbours(gather),
        };
    }

    /// Whether the decoded map itself tells if its pixels scatter as the residuals of the steps have it: they state its uncertainty, and nobody
    /// else was asked.
    pub(super) fn can_ask_the_map(&self, home: usize) -> bool {
        let (plan, axis) = (&self.plan.axes[home], &self.axes[home]);
        let finest = plan.sines.first().map(|slot| &self.sums[*slot]);
        let open = !axis.settled && axis.estimate.is_some() && !self.is_noise_given();
        open && !plan.fused && plan.chain.is_some() && finest.is_some_and(Sums::are_even_steps)
    }

    /// Decodes anew where the pixels of the map scatter less than stated: neighbours are then asked in the frames.
    pub(super) fn settle_by_map(&mut self, home: usize, out: &mut PhaseViewMut) -> Option<DecodeReport> {
        let AxisState { probe, clipping, .. } = &mut self.axes[home];
        let as_stated = probe.scatters_as_stated(|positions, samples| {
            let places = Places {
                positions,
                width: self.width_px as usize,
                pixels: self.pixels,
                rasters: &self.rasters,
                clipping,
                lag: APART_PX,
            };
            sample_map(&places, out, samples);
        });
        if as_stated {
            self.axes[home].settled = true;
            return None;
        }
        let before = self.axes[home].estimate;
        self.estimate_from_neighbours(home);
        (self.axes[home].estimate != before).then(|| self.pass(home, out))
    }

    /// Compares the calibration's noise with that of the frames, where both are known.
    pub(super) fn noise_test(&self, axis: &AxisState) -> Option<NoiseTest> {
        let known = self.settings.sensor.noise.filter(|_| self.settings.camera_noise.is_none())?;
        let (seen, background_dn) = (axis.estimate?, axis.probe.background_dn);
        let seen_dn = (seen.read_variance_dn2 + seen.gain_dn * background_dn).sqrt();
        Some(sensor_test::noise(known, seen_dn, background_dn))
    }

    /// The noise model of an axis: settings, then calibration unless contradicted, then frames, then an assumption.
    pub(super) fn noise(&self, axis: &AxisState) -> NoiseModel {
        if let Some(noise) = self.settings.camera_noise {
            let read_variance_dn2 = noise.read_noise_dn * noise.read_noise_dn;
            return NoiseModel { read_variance_dn2, gain_dn: noise.gain_dn, source: NoiseSource::Settings };
        }
        // Frames that contradict the calibration show their own noise.
        let contradicted = self.noise_test(axis).is_some_and(|test| test.contradicts);
        if let Some(noise) = self.settings.sensor.noise.filter(|_| !contradicted) {
            let read_variance_dn2 = noise.read_noise_dn * noise.read_noise_dn;
            let source = NoiseSource::Calibration;
            return NoiseModel { read_variance_dn2, gain_dn: noise.gain_dn, source };
        }
        let read_dn = self.settings.assumed_read_noise_fraction * f64::from(self.full_scale_dn);
        axis.estimate.unwrap_or(NoiseModel {
            read_variance_dn2: QUANTISATION_DN2 + read_dn * read_dn,
            gain_dn: 0.0,
            source: NoiseSource::Assumed,
        })
    }
}

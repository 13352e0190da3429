//! When the frames of a code are looked at more closely, and with what.

use super::axis_noise::AxisState;
use super::block::state;
use super::code_frames::Levels;
use super::continuity::{Continuity, MANY};
use super::dirt::code::{self, CodeLook, CodeVerdict, Shown};
use super::rasters::Rasters;
use super::report::DecodeReport;
use super::roles::{AxisPlan, CodePlan, Reference, SineKind};
use super::{DecodeError, Decoder, Remedy};
use crate::math::statistics::median;
use crate::phase::PhaseViewMut;

/// Levels of a frame that are off by more of the usual contrast make it suspect.
const LEVEL: f64 = 0.2;
const CONTRAST: f64 = 0.6;
/// Off by more of it, light is nearer to dark.
const NEARER: f64 = 0.5;
/// Clear of an edge by this part of a stripe a sample shows its level.
const CLEAR_STRIPES: f64 = 0.3;
/// Fewest samples of a level.
const LEAST: f64 = 100.0;
/// So many samples, of which a fifth are clear of edges on either side, tell the levels of dark and light to a fiftieth of the contrast,
/// whatever the noise of a pixel that is valid.
const ENOUGH: usize = 1024;
/// Where the frames confirm the order of less than this share of the pixels …
const CONFIRMED: f64 = 0.5;
/// … jumps and open orders are no edges of a part from this share on.
const MOST_UNCONFIRMED: f64 = 0.1;

impl Decoder {
    /// Whether code and phase, or the levels of the code, differ from what clean frames give; asked once for each sequence.
    pub(super) fn suspects_code(&mut self, home: usize, report: &DecodeReport, out: &PhaseViewMut) -> bool {
        let plan = &self.plan.axes[home];
        if plan.code.is_none() || plan.sines.is_empty() || self.axes[home].code.is_some() {
            return false;
        }
        report.contradiction() > MANY
            || self.axes[home].borders.are_strange(out, self.level)
            || self.levels_differ(home, out)
    }

    /// Looks at the frames of a code and mends the stored ones. The map must hold every pixel's own phase.
    ///
    /// # Errors
    /// [`DecodeError::WrongCode`] where a frame is wrong that nothing makes up for.
    pub(super) fn mend_code(&mut self, home: usize, out: &PhaseViewMut) -> Result<(), DecodeError> {
        if self.axes[home].code.is_none() {
            let verdict = self.look_at_code(home, out);
            self.axes[home].code = Some(verdict);
        }
        let axis = self.plan.axes[home].axis;
        let mut findings = self.axes[home].code.iter().flat_map(|verdict| &verdict.findings);
        match findings.find(|finding| finding.remedy == Remedy::None) {
            Some(finding) => Err(DecodeError::WrongCode { axis, finding: Box::new(*finding) }),
            None => Ok(()),
        }
    }

    /// Refuses orders that contradict the phase, the more strictly where the frames do not confirm them.
    ///
    /// # Errors
    /// [`DecodeError::Contradiction`].
    pub(super) fn check_code(
        &mut self,
        home: usize,
        report: &DecodeReport,
        out: &PhaseViewMut,
    ) -> Result<(), DecodeError> {
        let most = self.settings.max_contradiction;
        let unconfirmed = self.axes[home].code.as_ref().is_some_and(|verdict| verdict.confirmed < CONFIRMED);
        let strange = unconfirmed && self.axes[home].borders.are_strange(out, self.level);
        let limit = if strange {
            0.0
        } else if unconfirmed {
            most.min(MOST_UNCONFIRMED)
        } else {
            most
        };
        report.check_orders(self.plan.axes[home].axis, limit)
    }

    /// Decodes an axis from the frames before anything was mended: a check proves that each of them shows its pattern, and what was mended contradicts
    /// the phase. A bit that is dark wherever the part is looks like a black frame.
    ///
    /// # Errors
    /// [`DecodeError::Contradiction`]; the proof confirms the frames.
    pub(super) fn as_they_came(
        &mut self,
        home: usize,
        out: &mut PhaseViewMut,
        frames: Rasters,
    ) -> Result<DecodeReport, DecodeError> {
        self.rasters = frames;
        let nothing = CodeVerdict { findings: Vec::new(), confirmed: 1.0, demanded_px: Vec::new() };
        self.axes[home].code = Some(nothing);
        let report = self.pass(home, out);
        self.check_code(home, &report, out)?;
        Ok(report)
    }

    /// Masks pixels whose order is not the one that their region demands, where a frame of the code was wrong.
    pub(super) fn mask_undemanded(&self, home: usize, report: &mut DecodeReport, out: &mut PhaseViewMut) {
        let Some(verdict) = &self.axes[home].code else { return };
        let turns_px = self.plan.axes[home].period_px;
        let scale_px = (turns_px / std::f64::consts::TAU) as f32;
        for (place, demanded_px) in verdict.demanded_px.iter().enumerate() {
            let off_px = (out.phase_rad[place] * scale_px - demanded_px).abs();
            if out.valid[place] == state::SURE && off_px > 0.5 * turns_px as f32 {
                out.valid[place] = state::INVALID;
                out.phase_rad[place] = f32::NAN;
                out.sigma_rad[place] = f32::NAN;
                report.valid -= 1;
                report.ambiguous += 1;
            }
        }
        if !verdict.demanded_px.is_empty() {
            report.continuity = Continuity::of(out, report.valid, self.level);
        }
    }

    fn look_at_code(&mut self, home: usize, out: &PhaseViewMut) -> CodeVerdict {
        let plan = &self.plan.axes[home];
        let frames = self.axes[home].code_frames.clone();
        let (middle_dn, contrast_dn) = self.code_levels(plan, out);
        let look = CodeLook {
            width: self.width_px as usize,
            phase_rad: out.phase_rad,
            middle_dn: &middle_dn,
            contrast_dn: &contrast_dn,
            period_px: plan.period_px,
            extent_px: plan.extent_px,
            frames: &frames,
        };
        if plan.sines.is_empty() {
            code::mend_alone(&look, &mut self.rasters)
        } else {
            code::mend(&look, &mut self.rasters)
        }
    }

    /// Grey value between light and dark, and half their difference: of the finest sine, which no frame of the code touches; of the code
    /// where there is none.
    fn code_levels(&self, plan: &AxisPlan, out: &PhaseViewMut) -> (Vec<f32>, Vec<f32>) {
        let pixels = out.phase_rad.len();
        let sine = plan
            .sines
            .first()
            .filter(|slot| self.plan.sines[**slot].kind == SineKind::Plain && self.steps[**slot] >= 3);
        if let Some(slot) = sine {
            let steps = self.steps[*slot] as f32;
            let middle = (0..pixels).map(|place| self.sums[*slot].sum_at(&self.rasters, place) / steps);
            return (middle.collect(), out.modulation.to_vec());
        }
        let mut scratch = Vec::new();
        let levels = (0..pixels)
            .map(|place| plan.code.map_or((0.0, 0.0), |code| self.code_level(&code, place, &mut scratch)));
        levels.unzip()
    }

    /// The same of one pixel, from white and black or, bit by bit, from frame and inverse.
    fn code_level(&self, code: &CodePlan, place: usize, scratch: &mut Vec<f64>) -> (f32, f32) {
        let pair = |one, other| {
            let (a, b) = self.rasters.pair(one, other, place);
            (f64::from(a), f64::from(b))
        };
        let least_dn = self.least_modulation_dn();
        let (middle, contrast) = match code.reference {
            Reference::WhiteBlack(white, black) => {
                let (white, black) = pair(white, black);
                (0.5 * (white + black), 0.5 * (white - black))
            }
            Reference::Complement(first) => {
                let pairs = || (0..code.bits).map(|bit| pair(code.first + bit, first + bit));
                scratch.clear();
                scratch.extend(pairs().map(|(a, b)| 0.5 * (a + b)));
                let middle = median(scratch).unwrap_or(0.0);
                scratch.clear();
                scratch.extend(pairs().map(|(a, b)| 0.5 * (a - b).abs()));
                (middle, median(scratch).unwrap_or(0.0))
            }
            Reference::SineMean(_) => (0.0, 0.0),
        };
        (middle as f32, if contrast > least_dn { contrast as f32 } else { 0.0 })
    }

    /// Whether a frame is brighter or darker as a whole than the others, or has less contrast, at some pixels of the decoded map.
    fn levels_differ(&mut self, home: usize, out: &PhaseViewMut) -> bool {
        let (plan, mut levels) = (&self.plan.axes[home], std::mem::take(&mut self.axes[home].levels));
        let axis = &self.axes[home];
        let differ = self.compare_levels((plan, axis), out, &mut levels);
        self.axes[home].levels = levels;
        differ
    }

    fn compare_levels(
        &self,
        (plan, axis): (&AxisPlan, &AxisState),
        out: &PhaseViewMut,
        levels: &mut Levels,
    ) -> bool {
        let Some(slot) = plan.sines.first().filter(|slot| self.plan.sines[**slot].kind == SineKind::Plain)
        else {
            return false;
        };
        let steps = f64::from(self.steps[*slot]);
        if steps < 3.0 {
            return false;
        }
        let scale_px = plan.period_px / std::f64::consts::TAU;
        let frames = &axis.code_frames;
        levels.sums.clear();
        levels.sums.extend(frames.iter().map(|_| [(0.0, 0.0); 2]));
        for place in axis.probe.sure(out.valid, ENOUGH) {
            let x_px = f64::from(out.phase_rad[place]) * scale_px;
            let middle = f64::from(self.sums[*slot].sum_at(&self.rasters, place)) / steps;
            let inverse = 1.0 / f64::from(out.modulation[place]);
            for (frame, sums) in frames.iter().zip(&mut levels.sums) {
                let stripe_px = if let Shown::Bit { code, .. } = frame.shown { code.stripe_px } else { 0.0 };
                let (light, edge_px) = frame.shown.at(x_px);
                if edge_px > CLEAR_STRIPES * stripe_px {
                    let value = f64::from(self.rasters.value(frame.raster, place));
                    let (sum, count) = &mut sums[usize::from(light)];
                    *sum += (value - middle) * inverse;
                    *count += 1.0;
                }
            }
        }
        levels.own.clear();
        let mean = |(sum, count): (f64, f64)| (count >= LEAST).then(|| sum / count);
        levels.own.extend(levels.sums.iter().map(|sums| sums.map(mean)));
        let Levels { own, scratch, .. } = levels;
        // What defocus does to the contrast of narrow stripes is no fault; it does nothing to their level.
        let wide = || frames.iter().map(|frame| frame.is_wide(plan.period_px));
        let mut usual = |class: usize| {
            scratch.clear();
            scratch
                .extend(own.iter().zip(wide()).filter(|(_, wide)| *wide).filter_map(|(own, _)| own[class]));
            median(scratch)
        };
        let (Some(dark), Some(light)) = (usual(0), usual(1)) else { return false };
        own.iter().zip(wide()).any(|([own_dark, own_light], wide)| {
            // One level alone is off by defocus too, but not nearer to the other one; neither is white or black.
            let most = if wide || own_dark.and(*own_light).is_some() { LEVEL } else { NEARER };
            let off = [own_dark.map(|own| own - dark), own_light.map(|own| own - light)];
            let level = off.iter().flatten().sum::<f64>() / off.iter().flatten().count().max(1) as f64;
            let contrast = own_dark.zip(*own_light).map_or(1.0, |(a, b)| (b - a) / (light - dark));
            level.abs() > most * (light - dark) || (wide && contrast < CONTRAST)
        })
    }
}

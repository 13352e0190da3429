//! From the frames that have landed to the phase map of an axis: pixels first, then their neighbours, then what the whole map shows.

use super::apply_neighbours::Verdicts;
use super::blocks::decode_blocks;
use super::identity::Identity;
use super::neighbours::Field;
use super::order::Kernel;
use super::roles::AxisPlan;
use super::{Continuity, DecodeError, DecodeReport, Decoder, FrameOrder};
use crate::pattern::Axis;
use crate::phase::PhaseViewMut;
use std::sync::Arc;

impl Decoder {
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
        self.refuse_copied_steps(home)?;
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
        if self.ask_small_part(home, out) {
            report = self.pass(home, out);
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
        self.take_ripple_of_motion(home, report.motion, out);
        self.take_ripples(home, out);
        report.code_shift = self.code_shift(home, &report, out);
        report.linearity = self.linearity(home, out);
        let removed = self.remove_footprint(home, out)?;
        (report.footprint_px, report.footprint_left_px2) = (removed.sigma_px, removed.left_px2);
        report.footprint_assumed = removed.assumed;
        report.sensor.footprint = removed.test;
        report.bounced = removed.bounced;
        report.valid -= report.bounced.masked;
        Ok(report)
    }

    /// Decodes an axis from the stored frames, pixels first, then with their neighbours.
    pub(super) fn pass(&mut self, home: usize, out: &mut PhaseViewMut) -> DecodeReport {
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
            let periods = self.footprint.scratch();
            self.corrections.ask(&field, periods, self.level);
            self.corrections.apply(plan, periods, out)
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
    pub(super) fn complete(&self, axis: Axis) -> Result<usize, DecodeError> {
        let home =
            self.plan.axes.iter().position(|a| a.axis == axis).ok_or(DecodeError::NoSuchAxis { axis })?;
        let needed = self.plan.axes[home].needed;
        if self.next < needed {
            Err(DecodeError::Incomplete { axis, landed: self.next, needed })
        } else {
            Ok(home)
        }
    }

    pub(super) fn kernel<'a>(&'a self, home: usize, plan: &'a AxisPlan) -> Kernel<'a> {
        let gathered = &self.axes[home];
        let kernel = Kernel {
            plan,
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

    pub(super) fn least_modulation_dn(&self) -> f64 {
        self.settings.min_modulation_fraction * f64::from(self.full_scale_dn)
    }
}

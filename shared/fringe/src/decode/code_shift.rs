//! Whether the frames of the code show what the fringes show: where part, camera or projector moved between them, the stripes stand beside the
//! fringes.
//!
//! An edge of a bit is asked by the pixels within D of it, by the coordinate of their phase. Of a still part those on the dark side are dark: half
//! of them show what lies D further on, whatever the side. Where the code stands off by δ, (D − δ) / 2D of them do. Levels that are off move
//! edges from dark to light and those from light to dark against each other, so that they leave the mean alone. A code whose stripes are a whole
//! period takes the orders with it: then these jump, which other checks see.

use super::Remedy;
use super::axis_noise::AxisState;
use super::dirt::code::Shown;
use super::order::CODE_EDGE_PERIODS;
use super::roles::{AxisPlan, SineKind};
use super::{DecodeReport, Decoder};
use crate::phase::PhaseViewMut;
use std::f64::consts::TAU;

/// How far from an edge a pixel is asked, at most, in periods of the sine that the code numbers, and in stripes.
const REACH_PERIODS: f64 = 0.25;
const REACH_STRIPES: f64 = 0.45;
/// Pixels that are asked, about.
const ASKED: usize = 1024;
/// Fewest of them beside an edge.
const LEAST: u32 = 100;
/// Beyond this part of what an edge may be off by, orders are in danger.
const ENDANGERED: f64 = 0.5;
/// Standard uncertainties beyond which a shift is one.
const CERTAIN: f64 = 5.0;

/// How far the code stands from the fringes.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CodeShift {
    /// Projector pixels; no more than the reach of the comparison, a quarter of a period.
    pub shift_px: f64,
    /// Standard uncertainty of the former, px.
    pub u_px: f64,
    /// Whether it is beyond doubt, and more than half of what the order can bear.
    pub moved: bool,
}

impl CodeShift {
    /// What a person should know, where something moved; `camera` is named.
    pub(super) fn warning(&self, camera: &str) -> Option<String> {
        let Self { shift_px, u_px, moved } = self;
        moved.then(|| {
            format!(
                "camera \"{camera}\": the frames of the code stand {shift_px:+.1} projector px (u {u_px:.1}) beside the fringes: the part, the camera \
                 or the projector moved between them, and orders may be wrong; measure again, clamp it, or wait longer"
            )
        })
    }
}

impl Decoder {
    /// How far the code stands from the fringes, where a plain sine and frames that are all right tell.
    pub(super) fn code_shift(
        &self,
        home: usize,
        report: &DecodeReport,
        out: &PhaseViewMut,
    ) -> Option<CodeShift> {
        let (plan, axis) = (&self.plan.axes[home], &self.axes[home]);
        let (code, chain) = (plan.code.as_ref()?, plan.chain.as_ref()?);
        let slot = *plan.sines.first().filter(|slot| self.plan.sines[**slot].kind == SineKind::Plain)?;
        // Sine frames that are left out leave the phase of the others.
        let left_out = report.findings.iter().all(|found| found.remedy == Remedy::LeftOut);
        if self.steps[slot] < 3 || !left_out {
            return None;
        }
        let period_px = chain.stages.first()?.period_px;
        let reach_px = (REACH_PERIODS * period_px).min(REACH_STRIPES * code.stripe_px);
        let (asked, further) = self.beside_edges((plan, axis), slot, reach_px, out);
        if asked < LEAST {
            return None;
        }
        let share = f64::from(further) / f64::from(asked);
        let shift_px = reach_px * (1.0 - 2.0 * share);
        // As if chance decided on each of them.
        let u_px = reach_px / f64::from(asked).sqrt();
        let moved =
            shift_px.abs() > ENDANGERED * CODE_EDGE_PERIODS * period_px && shift_px.abs() > CERTAIN * u_px;
        Some(CodeShift { shift_px, u_px, moved })
    }

    /// Pixels beside an edge of a bit, over all bits, and how many of them show what lies further on.
    fn beside_edges(
        &self,
        (plan, axis): (&AxisPlan, &AxisState),
        slot: usize,
        reach_px: f64,
        out: &PhaseViewMut,
    ) -> (u32, u32) {
        let (steps, scale_px) = (self.steps[slot] as f32, plan.period_px / TAU);
        let (mut asked, mut further) = (0, 0);
        for place in axis.probe.sure(out.valid, ASKED) {
            let x_px = f64::from(out.phase_rad[place]) * scale_px;
            let middle = self.sums[slot].sum_at(&self.rasters, place) / steps;
            for frame in axis.code_frames.iter().filter(|frame| matches!(frame.shown, Shown::Bit { .. })) {
                let [before, behind] = [x_px - reach_px, x_px + reach_px].map(|x_px| frame.shown.at(x_px).0);
                if before != behind {
                    let light = f32::from(self.rasters.value(frame.raster, place)) > middle;
                    asked += 1;
                    further += u32::from(light == behind);
                }
            }
        }
        (asked, further)
    }
}

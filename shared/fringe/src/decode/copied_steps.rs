//! Frames of a set that are the same, bit by bit.
//!
//! The noise of a camera never repeats: two equal frames of different steps are one frame and its copy. Where neither was found to be wrong by what it
//! shows, such a copy looks like fringes that moved, and the part is off by a tenth of a fringe.

use super::rasters::Rasters;
use super::roles::{SineKind, SinePlan};
use super::{DecodeError, Decoder};
use crate::math::{atan2, cos, hypot, sincos};

/// Pixels that are asked what the two steps should differ by.
const ASKED: usize = 4096;
/// So many of them have to differ: fewer may have light of one phase, which two steps show alike.
const LEAST: usize = 24;
/// By so many grey values of 255, many times what rounding hides in pictures without noise.
const DIFFERENT: f64 = 10.0;

impl Decoder {
    /// Refuses equal frames of different steps of the sets of an axis, but for those of which one is left out already.
    pub(super) fn refuse_copied_steps(&self, home: usize) -> Result<(), DecodeError> {
        for slot in &self.plan.axes[home].sines {
            let plan = &self.plan.sines[*slot];
            if plan.kind != SineKind::Plain {
                continue;
            }
            let is_found =
                |step: usize| self.findings[*slot].iter().any(|finding| finding.step == Some(step));
            let pixels = self.width_px as usize * self.height_px as usize;
            let equal = |one: usize, other: usize| {
                !is_found(one)
                    && !is_found(other)
                    && self.rasters.show_the_same(plan.first + one, plan.first + other)
                    && !self.show_alike(plan, pixels, [one, other])
            };
            let steps = 0..plan.shifts_rad.len();
            let found = steps.clone().find_map(|one| {
                steps.clone().find(|other| *other > one && equal(one, *other)).map(|other| (one, other))
            });
            if let Some((one, other)) = found {
                return Err(DecodeError::CopiedStep {
                    set: plan.index,
                    axis: plan.axis,
                    first: one + 1,
                    second: other + 1,
                });
            }
        }
        Ok(())
    }

    /// Whether two steps may show the same: by the phases that all steps say together.
    fn show_alike(&self, plan: &SinePlan, pixels: usize, [one, other]: [usize; 2]) -> bool {
        let least = DIFFERENT / 255.0 * f64::from(self.full_scale_dn);
        let every = (pixels / ASKED).max(1) | 1;
        let differ = |pixel: &usize| {
            let (phase, modulation) = of_pixel(&self.rasters, plan, *pixel);
            let at = |step: usize| modulation * cos(phase - plan.shifts_rad[step]);
            (at(one) - at(other)).abs() > least
        };
        (0..pixels).step_by(every).filter(differ).take(LEAST).count() < LEAST
    }
}

/// Phase and modulation of a pixel, DN, by the sums that suffice where steps are even, and about where they are not.
fn of_pixel(rasters: &Rasters, plan: &SinePlan, pixel: usize) -> (f64, f64) {
    let (mut sine, mut cosine) = (0.0, 0.0);
    for (step, shift) in plan.shifts_rad.iter().enumerate() {
        let value = f64::from(rasters.value(plan.first + step, pixel));
        let (s, c) = sincos(*shift);
        sine += value * s;
        cosine += value * c;
    }
    (atan2(sine, cosine), 2.0 / plan.shifts_rad.len() as f64 * hypot(sine, cosine))
}

//! The stored frames that the code of an axis rests on, and their levels.

use super::dirt::code::{CodeFrame, Shown};
use super::roles::{AxisPlan, Reference};

/// Stripes of less than this part of a fringe are not looked at.
const LEAST_STRIPE_PERIODS: f64 = 0.4;

/// Levels of dark and light of each frame, where it has them, and room for their median.
#[derive(Debug, Default)]
pub(super) struct Levels {
    /// Means of dark and light of each frame.
    pub own: Vec<[Option<f64>; 2]>,
    /// Of each frame, of dark and light: sum of the levels and number of pixels.
    pub sums: Vec<[(f64, f64); 2]>,
    /// Memory for a median.
    pub scratch: Vec<f64>,
}

impl Levels {
    /// Room for so many frames.
    pub fn of(frames: usize) -> Self {
        Self {
            own: Vec::with_capacity(frames),
            sums: Vec::with_capacity(frames),
            scratch: Vec::with_capacity(frames),
        }
    }
}

/// All stored frames that the code of an axis rests on.
pub(super) fn code_frames(plan: &AxisPlan, homes: &[(usize, usize)]) -> Vec<CodeFrame> {
    let mut frames = Vec::new();
    let mut levels = plan.levels.map(|levels| (levels.white, levels.black));
    let mut add = |raster: usize, shown: Shown| {
        let (set, step) = homes[raster];
        frames.push(CodeFrame { raster, set, step, shown });
    };
    for code in plan.code.iter().chain(&plan.shifted) {
        // Stripes finer than the cells of a fringe are edges everywhere.
        let wide = |bit: &usize| {
            let stripe_px = code.stripe_px * f64::from(1_u32 << (code.bits - 1 - bit));
            plan.sines.is_empty() || stripe_px > LEAST_STRIPE_PERIODS * plan.period_px
        };
        for bit in (0..code.bits).filter(wide) {
            add(code.first + bit, Shown::Bit { code: *code, bit, inverse: false });
        }
        match code.reference {
            Reference::Complement(first) => {
                for bit in (0..code.bits).filter(wide) {
                    add(first + bit, Shown::Bit { code: *code, bit, inverse: true });
                }
            }
            Reference::WhiteBlack(white, black) => levels = Some((white, black)),
            Reference::SineMean(_) => {}
        }
    }
    if let Some((white, black)) = levels {
        add(white, Shown::White);
        add(black, Shown::Black);
    }
    frames
}

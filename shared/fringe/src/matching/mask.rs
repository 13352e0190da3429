//! The phase that may be used.

use crate::math::simd::{best_level, vectorised};
use crate::phase::PhaseView;
use rayon::prelude::*;

/// Pixels of one parallel job of the mask.
const MASK_CHUNK: usize = 16_384;

/// Copies the phase, with NaN where the mask, the phase or its uncertainty forbids its use.
pub(crate) fn mask(map: &PhaseView, out: &mut [f32]) {
    let level = best_level();
    let planes = map.phase_rad.par_chunks(MASK_CHUNK).zip(map.sigma_rad.par_chunks(MASK_CHUNK));
    let planes = planes.zip(map.valid.par_chunks(MASK_CHUNK)).zip(out.par_chunks_mut(MASK_CHUNK));
    planes.for_each(|(((phase, sigma), valid), out)| vectorised!(level, mask_part(phase, sigma, valid, out)));
}

#[inline(always)]
#[allow(clippy::needless_bitwise_bool, reason = "without branches a loop vectorises")]
fn mask_part(phase_rad: &[f32], sigma_rad: &[f32], valid: &[u8], out: &mut [f32]) {
    for (((phase, sigma), valid), out) in phase_rad.iter().zip(sigma_rad).zip(valid).zip(out) {
        let usable = (*valid != 0) & phase.is_finite() & sigma.is_finite();
        *out = if usable { *phase } else { f32::NAN };
    }
}

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

/// The phase with NaN where it may not be used: that of the map where it is so already, as a decoder leaves it; else a copy.
pub(super) fn masked<'a>(map: &PhaseView<'a>, copy: &'a mut Vec<f32>) -> &'a [f32] {
    let level = best_level();
    let planes = map.phase_rad.par_chunks(MASK_CHUNK).zip(map.sigma_rad.par_chunks(MASK_CHUNK));
    let planes = planes.zip(map.valid.par_chunks(MASK_CHUNK));
    if planes.all(|((phase, sigma), valid)| vectorised!(level, is_masked(phase, sigma, valid))) {
        return map.phase_rad;
    }
    copy.resize(map.phase_rad.len(), f32::NAN);
    mask(map, copy);
    copy
}

#[inline(always)]
#[allow(clippy::needless_bitwise_bool, reason = "without branches a loop vectorises")]
fn is_usable(phase_rad: f32, sigma_rad: f32, valid: u8) -> bool {
    (valid != 0) & phase_rad.is_finite() & sigma_rad.is_finite()
}

#[inline(always)]
#[allow(clippy::needless_bitwise_bool, reason = "without branches a loop vectorises")]
fn is_masked(phase_rad: &[f32], sigma_rad: &[f32], valid: &[u8]) -> bool {
    let pixels = phase_rad.iter().zip(sigma_rad).zip(valid);
    let odd = pixels.fold(0_u32, |odd, ((phase, sigma), valid)| {
        odd | u32::from(!(is_usable(*phase, *sigma, *valid) | phase.is_nan()))
    });
    odd == 0
}

#[inline(always)]
fn mask_part(phase_rad: &[f32], sigma_rad: &[f32], valid: &[u8], out: &mut [f32]) {
    for (((phase, sigma), valid), out) in phase_rad.iter().zip(sigma_rad).zip(valid).zip(out) {
        *out = if is_usable(*phase, *sigma, *valid) { *phase } else { f32::NAN };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Axis;
    use crate::phase::{PhaseInfo, PhaseMap};

    #[test]
    fn a_map_is_copied_only_where_it_shows_a_phase_that_may_not_be_used() {
        let mut map = PhaseMap::new(PhaseInfo { width_px: 5, height_px: 3, axis: Axis::X, period_px: 16.0 });
        for i in 0..15 {
            let phase = if i % 4 == 0 { f32::NAN } else { i as f32 };
            (map.phase_rad[i], map.sigma_rad[i], map.valid[i]) = (phase, 0.01, u8::from(i % 4 != 0));
        }
        let mut copy = Vec::new();
        assert!(
            std::ptr::eq(masked(&map.view(), &mut copy).as_ptr(), map.phase_rad.as_ptr()) && copy.is_empty()
        );
        for (pixel, sigma_rad, valid) in [(1, 0.01, 0), (2, f32::NAN, 1)] {
            let mut wrong = map.clone();
            (wrong.sigma_rad[pixel], wrong.valid[pixel]) = (sigma_rad, valid);
            let mut copy = Vec::new();
            assert!(masked(&wrong.view(), &mut copy)[pixel].is_nan());
            assert_eq!(copy[3], 3.0);
        }
    }
}

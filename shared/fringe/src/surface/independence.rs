//! Whether the noise of a phase map differs from pixel to pixel, as smoothing supposes.
//!
//! It does where each pixel was measured by itself. It does not where phases were interpolated or filtered, or where pictures come from a
//! mosaic or from lossy compression: neighbours share their noise there, and smoothing takes little of it out. A kernel that
//! takes every quadratic out (see the noise of neighbours in the decoder) shows this: on independent noise it scatters alike
//! whether its nine pixels lie beside each other or some pixels apart; noise that neighbours share shows only between pixels apart.

use crate::math::statistics::median;
use crate::phase::PhaseView;

/// Scatter of neighbours over that of pixels apart above which noise counts as independent: estimates scatter, and shape adds to
/// the latter.
const INDEPENDENT: f64 = 0.7;
/// Distance of pixels that share no noise, px.
const APART_PX: usize = 4;
/// Below this scatter, in stated uncertainties, the map holds no noise at all, as computed ones do: nothing can be said.
const EXACT: f64 = 0.01;
/// Fewer windows say nothing.
pub(super) const LEAST: usize = 200;
/// At most so many windows are asked.
pub(crate) const WINDOWS: usize = 16_384;
/// Median magnitude of a standard normal variable.
const MEDIAN_NORMAL: f64 = 0.674_49;

/// How far the noise of a phase map belongs to its pixels by themselves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Independence {
    /// Share of the variance that differs from pixel to pixel, 0 to 1.
    pub share: f64,
    /// Whether neighbours agree far better than their uncertainties say: then they were interpolated from the same values. The texture of a part
    /// makes pixels apart differ by more than is stated, and its neighbours as stated.
    pub interpolated: bool,
}

impl Independence {
    /// Each pixel was measured by itself.
    pub const WHOLE: Self = Self { share: 1.0, interpolated: false };

    /// What holds for both of two maps.
    pub fn worse(self, other: Self) -> Self {
        Self { share: self.share.min(other.share), interpolated: self.interpolated || other.interpolated }
    }
}

/// Whether noise differs from pixel to pixel. `masked` is the phase with NaN where it may not be used; `scratch` has
/// a capacity of [`WINDOWS`] values.
pub(crate) fn independence(map: &PhaseView, masked: &[f32], scratch: &mut Vec<f32>) -> Independence {
    let mut scatter = |lag| scatter(map, masked, lag, scratch).filter(|scatter| *scatter >= EXACT);
    let Some((near, apart)) = scatter(1).zip(scatter(APART_PX)) else { return Independence::WHOLE };
    let ratio = near / apart;
    if ratio >= INDEPENDENT {
        return Independence::WHOLE;
    }
    Independence { share: ratio * ratio, interpolated: near < INDEPENDENT }
}

/// Scatter of pixels `lag` apart over the stated uncertainty; `None` from too few windows.
fn scatter(map: &PhaseView, masked: &[f32], lag: usize, scratch: &mut Vec<f32>) -> Option<f64> {
    let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
    scratch.clear();
    let stride = masked.len().div_ceil(WINDOWS).max(1);
    for pixel in (0..masked.len()).step_by(stride) {
        let (column, row) = (pixel % width, pixel / width);
        if column < lag || row < lag || column + lag >= width || row + lag >= height {
            continue;
        }
        let step = lag as isize;
        let at = |dx: isize, dy: isize| masked[(pixel as isize + (dy * width as isize + dx) * step) as usize];
        let high_pass = (at(-1, -1) - 2.0 * at(0, -1) + at(1, -1))
            - 2.0 * (at(-1, 0) - 2.0 * at(0, 0) + at(1, 0))
            + (at(-1, 1) - 2.0 * at(0, 1) + at(1, 1));
        let ratio = high_pass.abs() / (6.0 * map.sigma_rad[pixel]);
        if ratio.is_finite() {
            scratch.push(ratio);
        }
    }
    if scratch.len() < LEAST {
        return None;
    }
    median(scratch).map(|median| f64::from(median) / MEDIAN_NORMAL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::{Key, normal_quantile};
    use crate::pattern::Axis;
    use crate::phase::{PhaseInfo, PhaseMap};

    const SIDE: usize = 160;

    fn found(stated: f32, value: impl Fn(&[f64], usize) -> f64) -> Independence {
        let noise: Vec<f64> = (0..SIDE * SIDE).map(|i| normal_quantile(Key::new(5).open(i as u64))).collect();
        let info =
            PhaseInfo { width_px: SIDE as u32, height_px: SIDE as u32, axis: Axis::X, period_px: 16.0 };
        let mut map = PhaseMap::new(info);
        map.sigma_rad.fill(stated);
        let masked: Vec<f32> = (0..SIDE * SIDE).map(|i| value(&noise, i) as f32).collect();
        independence(&map.view(), &masked, &mut Vec::new())
    }

    /// The mean of 3 × 3 neighbours, scaled to the scatter of one.
    fn spread(noise: &[f64], i: usize) -> f64 {
        let (column, row) = (i % SIDE, i / SIDE);
        if column == 0 || row == 0 || column + 1 == SIDE || row + 1 == SIDE {
            return 0.0;
        }
        (0..9).map(|k| noise[i + k / 3 * SIDE + k % 3 - SIDE - 1]).sum::<f64>() / 3.0
    }

    /// Noise that is stated too large is still noise of single pixels; noise that neighbours share is not, whatever is stated.
    #[test]
    fn shared_noise_is_told_from_noise_that_is_stated_wrong() {
        for stated in [0.01, 0.03, 0.005] {
            let alone = found(stated, |noise, i| 0.01 * noise[i]);
            assert_eq!(alone, Independence::WHOLE, "{stated}");
            let shared = found(stated, |noise, i| 0.01 * spread(noise, i));
            assert!(shared.share < 0.2, "{stated}: {}", shared.share);
        }
        assert_eq!(found(0.01, |_, i| 1e-3 * i as f64), Independence::WHOLE, "no noise at all");
    }

    /// Neighbours that agree far better than stated were interpolated; those that scatter as stated beside a slower texture that differs by more were not.
    #[test]
    fn interpolated_pixels_are_told_from_a_part_with_texture() {
        assert!(found(0.01, |noise, i| 0.01 * spread(noise, i)).interpolated);
        let grain = |i: usize| {
            let [x, y] = [i % SIDE, i / SIDE].map(|place| place as f64);
            crate::math::sin(0.7 * x) * crate::math::sin(0.75 * y)
        };
        let texture = found(0.01, |noise, i| 0.01 * noise[i] + 0.02 * grain(i));
        assert!(texture.share < 1.0 && !texture.interpolated, "{texture:?}");
    }
}

//! Whether the noise of a phase map differs from pixel to pixel, as smoothing supposes.
//!
//! It does where each pixel was measured by itself. It does not where phases were interpolated or filtered, or where pictures come from a
//! mosaic or from lossy compression: neighbours share their noise there, and smoothing takes little of it out. A kernel that
//! takes every quadratic out (see the noise of neighbours in the decoder) tells: on independent noise its scatter is that of the
//! stated uncertainty.

use crate::phase::PhaseView;

/// Scatter over stated uncertainty above which noise counts as independent: estimates of noise scatter too.
const INDEPENDENT: f64 = 0.7;
/// Below this the map holds no noise at all, as computed ones do: nothing can be said.
const EXACT: f64 = 0.01;
/// Fewer windows say nothing.
const LEAST: usize = 200;
/// At most so many windows are asked.
pub(crate) const WINDOWS: usize = 16_384;
/// Median magnitude of a standard normal variable.
const MEDIAN_NORMAL: f64 = 0.674_49;

/// Share of the variance that differs from pixel to pixel, 0 to 1. `masked` is the phase with NaN where it may not be used; `scratch` has
/// room for [`WINDOWS`] values.
pub(crate) fn independent_share(map: &PhaseView, masked: &[f32], scratch: &mut Vec<f32>) -> f64 {
    let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
    scratch.clear();
    if width < 3 || height < 3 {
        return 1.0;
    }
    let stride = masked.len().div_ceil(WINDOWS).max(1);
    for pixel in (0..masked.len()).step_by(stride) {
        let (column, row) = (pixel % width, pixel / width);
        if column == 0 || row == 0 || column + 1 >= width || row + 1 >= height {
            continue;
        }
        let at = |dx: isize, dy: isize| masked[(pixel as isize + dy * width as isize + dx) as usize];
        let high_pass = (at(-1, -1) - 2.0 * at(0, -1) + at(1, -1))
            - 2.0 * (at(-1, 0) - 2.0 * at(0, 0) + at(1, 0))
            + (at(-1, 1) - 2.0 * at(0, 1) + at(1, 1));
        let ratio = high_pass.abs() / (6.0 * map.sigma_rad[pixel]);
        if ratio.is_finite() {
            scratch.push(ratio);
        }
    }
    if scratch.len() < LEAST {
        return 1.0;
    }
    let middle = scratch.len() / 2;
    let scatter = f64::from(*scratch.select_nth_unstable_by(middle, f32::total_cmp).1) / MEDIAN_NORMAL;
    if (EXACT..INDEPENDENT).contains(&scatter) { scatter * scatter } else { 1.0 }
}

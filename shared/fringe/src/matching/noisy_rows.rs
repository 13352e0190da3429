//! Rows in which noise exceeds the step of the phase from cell to cell: the search sees means.

use super::epipolar_rows::Row;
use crate::math::simd::{taken, vectorised};
use fearless_simd::Level;

/// Noise of a cell beyond this share of the phase step per cell would cut a row into pieces.
const QUIET_SHARE: f64 = 0.25;

/// A mean over w cells differs from the next one by √2 σ/w: so many of these may reach the step.
const SENSE_SIGMAS: f64 = 4.2;

/// Largest half width of the mean.
const MAX_HALF: usize = 15;

/// Shorter stretches do not show their noise.
const LEAST_CELLS: usize = 8;

/// The slope is taken over so many cells.
const SLOPE_CELLS: usize = 7;

/// Standard deviation over the mean magnitude of second differences: 1/√6 · √(π/2).
const SIGMA_OF_SECOND: f64 = 0.511_663;

/// Cells that are summed side by side.
const SIDE: usize = 8;

impl Row {
    /// Averages noise out of a continuous stretch that has so much of it that neighbouring cells change places.
    ///
    /// Noise and slope are those of the stretch itself. Means are symmetric and get narrower towards its ends, so that a slope
    /// stays what it is. Only the search sees them.
    pub(super) fn smooth_stretch(&mut self, start: usize, end: usize, level: Level) {
        let (cells, sums) = (&mut self.phase_rad[start..end], &mut self.sums);
        if cells.len() >= LEAST_CELLS {
            self.smoothed |= vectorised!(level, smoothed(cells, sums));
        }
    }
}

/// Whether a stretch had to be averaged, which it then is; `sums` is memory.
#[inline(always)]
fn smoothed(cells: &mut [f32], sums: &mut Vec<f64>) -> bool {
    let (second, across) = magnitudes(cells);
    let noise = SIGMA_OF_SECOND * second / (cells.len() - 2) as f64;
    let slope = across / ((cells.len() - SLOPE_CELLS) * SLOPE_CELLS) as f64;
    if noise <= QUIET_SHARE * slope {
        return false;
    }
    let wanted = 0.5 * SENSE_SIGMAS * noise / slope.max(1e-12);
    let half = if wanted < MAX_HALF as f64 { wanted.ceil() as usize } else { MAX_HALF };
    let origin = cells[0];
    let mut sum = 0.0;
    sums.clear();
    sums.push(0.0);
    sums.extend(cells.iter().map(|v| {
        sum += f64::from(v - origin);
        sum
    }));
    let count = cells.len();
    let half = half.min((count - 1) / 2);
    for i in (0..half).chain(count - half..count) {
        let half = i.min(count - 1 - i);
        let total = sums[i + half + 1] - sums[i - half];
        cells[i] = origin + (total / (2 * half + 1) as f64) as f32;
    }
    let width = 2 * half + 1;
    let inner = cells[half..count - half].iter_mut();
    for (value, (to, from)) in inner.zip(sums[width..].iter().zip(&*sums)) {
        *value = origin + ((to - from) / width as f64) as f32;
    }
    true
}

/// Sums of the magnitudes of second differences, and of differences across [`SLOPE_CELLS`] cells.
#[inline(always)]
fn magnitudes(cells: &[f32]) -> (f64, f64) {
    let second = |i: usize| f64::from((cells[i] - cells[i + 1]) - (cells[i + 1] - cells[i + 2])).abs();
    let across = |i: usize| f64::from(cells[i + SLOPE_CELLS] - cells[i]).abs();
    let (mut seconds, mut acrosses) = ([0.0; SIDE], [0.0; SIDE]);
    let whole = (cells.len() - SLOPE_CELLS) / SIDE * SIDE;
    for first in (0..whole).step_by(SIDE) {
        let near: [f32; SIDE + SLOPE_CELLS] = taken(cells, first);
        for l in 0..SIDE {
            let (before, behind) = (near[l] - near[l + 1], near[l + 1] - near[l + 2]);
            seconds[l] += f64::from(before - behind).abs();
            acrosses[l] += f64::from(near[l + SLOPE_CELLS] - near[l]).abs();
        }
    }
    let rest = |sums: [f64; SIDE], more: f64| sums.iter().sum::<f64>() + more;
    (
        rest(seconds, (whole..cells.len() - 2).map(second).sum()),
        rest(acrosses, (whole..cells.len() - SLOPE_CELLS).map(across).sum()),
    )
}

//! Rows in which noise exceeds the step of the phase from cell to cell: the search sees means.

use super::epipolar_rows::Row;

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

impl Row {
    /// Averages noise out of a continuous stretch that has so much of it that neighbouring cells change places.
    ///
    /// Noise and slope are those of the stretch itself. Means are symmetric and get narrower towards its ends, so that a slope
    /// stays what it is. Only the search sees them.
    pub(super) fn smooth_stretch(&mut self, start: usize, end: usize) {
        let cells = &mut self.phase_rad[start..end];
        if cells.len() < LEAST_CELLS {
            return;
        }
        let second: f64 =
            cells.windows(3).map(|w| f64::from((w[0] - w[1]) - (w[1] - w[2])).abs()).sum::<f64>()
                / (cells.len() - 2) as f64;
        let across = |w: &[f32]| f64::from(w[w.len() - 1] - w[0]).abs();
        let slope = cells.windows(SLOPE_CELLS + 1).map(across).sum::<f64>()
            / ((cells.len() - SLOPE_CELLS) * SLOPE_CELLS) as f64;
        let noise = SIGMA_OF_SECOND * second;
        if noise <= QUIET_SHARE * slope {
            return;
        }
        let wanted = 0.5 * SENSE_SIGMAS * noise / slope.max(1e-12);
        let half = if wanted < MAX_HALF as f64 { wanted.ceil() as usize } else { MAX_HALF };
        let origin = cells[0];
        let mut sum = 0.0;
        self.sums.clear();
        self.sums.push(0.0);
        self.sums.extend(cells.iter().map(|v| {
            sum += f64::from(v - origin);
            sum
        }));
        let count = cells.len();
        for (i, value) in cells.iter_mut().enumerate() {
            let half = half.min(i).min(count - 1 - i);
            let total = self.sums[i + half + 1] - self.sums[i - half];
            *value = origin + (total / (2 * half + 1) as f64) as f32;
        }
        self.smoothed = true;
    }
}

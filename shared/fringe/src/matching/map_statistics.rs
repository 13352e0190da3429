//! What samples of a phase map tell before it is matched: its noise and its slope.

use crate::math::statistics::median;
use crate::phase::PhaseView;
use crate::surface::{Independence, WINDOWS, independence};

/// Noise and slope of a map.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapStatistics {
    /// How far the noise belongs to the pixels by themselves.
    pub independence: Independence,
    /// Median of its stated noise, rad.
    pub noise_rad: f32,
    /// Median difference of neighbours, the larger of that along rows and that along columns, rad.
    pub step_rad: f32,
}

impl MapStatistics {
    /// Of a map, from at most [`WINDOWS`] pixels each. `masked` is its phase with NaN where it may not be used; `scratch` has a capacity of
    /// so many values.
    pub fn of(map: &PhaseView, masked: &[f32], scratch: &mut Vec<f32>) -> Self {
        let independence = independence(map, masked, scratch);
        let stride = masked.len().div_ceil(WINDOWS).max(1);
        let mut middle = |value: &dyn Fn(usize) -> f32, count: usize| {
            scratch.clear();
            scratch.extend((0..count).step_by(stride).map(value).filter(|value| !value.is_nan()));
            median(scratch).unwrap_or(0.0)
        };
        let noise = |i: usize| if masked[i].is_nan() { f32::NAN } else { map.sigma_rad[i] };
        let noise_rad = middle(&noise, masked.len());
        let step_rad = [1, map.info.width_px as usize]
            .map(|next| middle(&|i| (masked[i + next] - masked[i]).abs(), masked.len().saturating_sub(next)));
        Self { independence, noise_rad, step_rad: step_rad[0].max(step_rad[1]) }
    }

    /// What holds for both maps: the more of the noise, of its reach and of the slope.
    pub fn worse(self, other: Self) -> Self {
        Self {
            independence: self.independence.worse(other.independence),
            noise_rad: self.noise_rad.max(other.noise_rad),
            step_rad: self.step_rad.max(other.step_rad),
        }
    }
}

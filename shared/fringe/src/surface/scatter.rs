//! Whether what smoothing leaves scatters as it is stated to: noise that reaches over many pixels stays.
//!
//! Smoothing takes out what differs from pixel to pixel. Noise with patches (dither of the projector, texture with a bent response, light that
//! wanders) is small beside the noise of single pixels and is what remains of it. Smoothed points so far apart that they share
//! no pixel tell how much: the kernel that takes every quadratic out, over nine of them.

use super::buffers::{SCATTER_WINDOWS, SurfaceBuilder};
use super::independence::LEAST;
use super::normals::Link;
use super::sample::{Sample, View};
use super::smooth::smoothed;

/// Of the magnitudes the lowest third is asked, not the median: shape adds most to the others.
const QUANTILE: f64 = 1.0 / 3.0;
/// The same quantile of the magnitude of a standard normal variable.
const NORMAL_QUANTILE: f64 = 0.430_727;
/// A smaller excess is within the scatter of the estimate …
const EXCESS: f64 = 1.08;
/// … and within what is known of the noise of another camera, whose share smoothing leaves to ± 14 % (see [`super::smooth`]).
const OTHER_EXCESS: f64 = 0.14;
/// A second distance separates shape from noise: so many pixels more.
const FARTHER_PX: usize = 2;
/// Scatter that grows more between both distances is shape, and gives no information of the noise.
const SHAPE: f64 = 1.25;
/// Noise that neighbours share reaches so far, px.
const SHARED_PX: usize = 10;

impl SurfaceBuilder {
    /// Factor on the stated uncertainty of smoothed samples, 1 or more.
    pub(super) fn excess(&mut self, view: &View, samples: &[Sample], link: Link) -> f64 {
        let half = self.settings.smoothing_half();
        let alone = view.independent >= 1.0;
        if half == 0 && alone {
            return 1.0;
        }
        let lag = if alone { 2 * half + 2 } else { SHARED_PX };
        let filled = |pixel: &usize| samples[*pixel].inverse_depth.is_finite();
        let stride = (0..samples.len()).filter(filled).count().div_ceil(SCATTER_WINDOWS).max(1);
        let asked = || (0..samples.len()).filter(filled).step_by(stride);
        let mut scatter = |lag| {
            self.ratios.clear();
            self.ratios.extend(asked().filter_map(|pixel| window(view, samples, pixel, link, (lag, half))));
            let at = (QUANTILE * self.ratios.len() as f64) as usize;
            (self.ratios.len() >= LEAST)
                .then(|| *self.ratios.select_nth_unstable_by(at, f64::total_cmp).1 / NORMAL_QUANTILE)
        };
        let Some((near, far)) = scatter(lag).zip(scatter(lag + FARTHER_PX)) else { return 1.0 };
        if far > SHAPE * near {
            return 1.0;
        }
        // What the kernel leaves of a smooth shape grows with the fourth power of the distance, noise does not.
        let growth = (lag + FARTHER_PX) as f64 / lag as f64;
        let power8 = growth.powi(8);
        let shape = (far * far - near * near).max(0.0) / (power8 - 1.0);
        let ratio = (near * near - shape).max(0.0).sqrt();
        let others = asked().any(|pixel| samples[pixel].own_share < 1.0);
        let limit = if others { EXCESS + OTHER_EXCESS } else { EXCESS };
        if ratio > limit { ratio } else { 1.0 }
    }
}

/// Magnitude of what the kernel leaves of nine smoothed samples, over its stated uncertainty.
fn window(
    view: &View,
    samples: &[Sample],
    pixel: usize,
    link: Link,
    (lag, half): (usize, usize),
) -> Option<f64> {
    let (column, row) = (pixel % view.width, pixel / view.width);
    let inner = column >= lag && row >= lag && column + lag < view.width && row + lag < view.height;
    if !inner {
        return None;
    }
    let size = ((view.width, view.height), view.independent);
    let (mut high_pass, mut variance) = (0.0, 0.0);
    for (v, by_row) in [1.0, -2.0, 1.0].into_iter().enumerate() {
        for (u, by_column) in [1.0, -2.0, 1.0].into_iter().enumerate() {
            let at = pixel + v * lag * view.width + u * lag - lag * (view.width + 1);
            if !link.joins(&samples[pixel], &samples[at], lag) {
                return None;
            }
            let (sample, _) = smoothed(size, samples, at, link.max_step, half);
            let (weight, sigma) = (by_row * by_column, f64::from(sample.sigma));
            high_pass += weight * sample.inverse_depth;
            variance += weight * weight * sigma * sigma;
        }
    }
    (variance > 0.0).then(|| high_pass.abs() / variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::SurfaceSettings;
    use super::*;
    use crate::math::random::{Key, normal_quantile};

    const SIDE: usize = 160;
    const SIGMA: f64 = 1e-6;

    /// Excess of noise of single pixels with patches of `side` px, of so many stated sigmas, below it.
    fn excess(patches: f64, side: usize) -> f64 {
        let draw = |seed, i: usize| normal_quantile(Key::new(seed).open(i as u64));
        let sample = |i: usize| {
            let patch = i / SIDE / side * SIDE + i % SIDE / side;
            let noise = draw(3, i) + patches * draw(4, patch);
            Sample {
                inverse_depth: 2e-3 + SIGMA * noise,
                sigma: SIGMA as f32,
                modulation: 1.0,
                ..Sample::without(crate::surface::Cause::Point)
            }
        };
        let samples: Vec<Sample> = (0..SIDE * SIDE).map(sample).collect();
        let directions = vec![[0.0; 2]; samples.len()];
        let view = View::along_the_axes([SIDE, SIDE], &directions, 0.001);
        let mut builder = SurfaceBuilder::new(SIDE, SIDE, SurfaceSettings::default());
        builder.excess(&view, &samples, Link { max_step: 0.01 })
    }

    /// Smoothing over 5 × 5 leaves 0.39 σ of single pixels and all of the patches.
    #[test]
    fn patches_of_noise_are_found_and_noise_of_pixels_is_no_excess() {
        assert!((excess(0.0, 1) - 1.0).abs() < 1e-12);
        let found = excess(0.4, 5);
        assert!((1.2..1.6).contains(&found), "{found}");
    }
}

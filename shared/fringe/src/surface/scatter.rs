//! Whether what smoothing leaves scatters as it is stated to: noise that reaches over many pixels stays.
//!
//! Smoothing takes out what differs from pixel to pixel. Noise with patches (dither of the projector, texture with a bent response, light that
//! wanders) is small beside the noise of single pixels and is what remains of it. Smoothed points so far apart that they share
//! no pixel tell how much: the kernel that takes every quadratic out, over nine of them. What it leaves of a ball follows from slopes and curvatures of
//! the same nine ([`super::curved`]), whose noise is independent of the kernel's.

use super::buffers::{SCATTER_WINDOWS, SurfaceBuilder};
use super::curved::{Derivatives, fourth_order};
use super::independence::LEAST;
use super::normals::Link;
use super::point::View;
use super::quick;
use super::raster::Raster;
use super::smooth::smoothed;
use super::windows::{HALF, LANES};
use crate::math::simd::vectorised;
use rayon::prelude::*;

/// Of the magnitudes the lowest third is asked, not the median: shape adds most to the others.
const QUANTILE: f64 = 1.0 / 3.0;
/// The same quantile of the magnitude of a standard normal variable.
const NORMAL_QUANTILE: f64 = 0.430_727;
/// Relative standard deviation of the estimate from one window; from n windows it is this over √n.
const ONE_WINDOW: f64 = 1.5;
/// What the estimate may exceed by chance, in its standard deviations, and is none.
const CHANCE: f64 = 1.0;
/// Windows that overlap tell the same: one at every pixel tells as much as one for so many squared sides of the noise that they share (sum of the
/// correlations of being below the quantile; 0.18 to 0.26 for windows of 5 pixels, by which share of the noise is the other view's).
const OVERLAP: f64 = 0.22;
/// What raises an uncertainty by less is not looked at twice, and is none.
const LEAST_EXCESS: f64 = 1.01;
/// A second distance separates shape from noise: so many pixels more.
const FARTHER_PX: usize = 2;
/// Scatter that grows more between both distances is shape, and gives no information of the noise.
const SHAPE: f64 = 1.25;
/// Noise that neighbours share reaches so far, px.
const SHARED_PX: usize = 10;

impl SurfaceBuilder {
    /// Factor on the stated uncertainty of smoothed samples: what their scatter shows beyond chance, and 1 or more, since an uncertainty may hold what
    /// does not scatter; of so many samples there are any.
    pub(super) fn excess(&mut self, view: &View, link: Link, count: usize) -> f64 {
        let half = self.settings.smoothing_half();
        let alone = view.independence.share >= 1.0;
        if half == 0 && alone {
            return 1.0;
        }
        let lag = if alone { 2 * half + 2 } else { SHARED_PX };
        let Self { raster, asked, ratios, level, .. } = self;
        asked.clear();
        vectorised!(*level, every(&raster.depths, count.div_ceil(SCATTER_WINDOWS).max(1), asked));
        let windows = Windows { view, samples: raster, link, half };
        let mut scatter = |lag| {
            ratios.resize(asked.len(), f64::NAN);
            let parts = ratios.par_chunks_mut(LANES).zip(asked.par_chunks(LANES));
            parts.for_each(|(ratios, pixels)| vectorised!(*level, windows.ratios(pixels, lag, ratios)));
            ratios.retain(|ratio| !ratio.is_nan());
            let (at, count) = ((QUANTILE * ratios.len() as f64) as usize, ratios.len());
            (count >= LEAST)
                .then(|| (*ratios.select_nth_unstable_by(at, f64::total_cmp).1 / NORMAL_QUANTILE, count))
        };
        let Some((near, _)) = scatter(lag) else { return 1.0 };
        // So many of all samples are asked, and the noise of a sample reaches so far.
        let side = if alone { 2 * half + 1 } else { SHARED_PX };
        let overlap = 1.0 + OVERLAP * (side * side) as f64 * asked.len() as f64 / count as f64;
        // The other distance only lowers what is found here, and less than this is not worth it.
        if beyond_chance(near, asked.len() as f64 / overlap) <= LEAST_EXCESS {
            return 1.0;
        }
        let Some((far, windows)) = scatter(lag + FARTHER_PX).filter(|(far, _)| *far <= SHAPE * near) else {
            return 1.0;
        };
        // What the kernel leaves of a smooth shape grows with the fourth power of the distance, noise does not.
        let growth = (lag + FARTHER_PX) as f64 / lag as f64;
        let power8 = growth.powi(8);
        let shape = (far * far - near * near).max(0.0) / (power8 - 1.0);
        let ratio = (near * near - shape).max(0.0).sqrt();
        beyond_chance(ratio, windows as f64 / overlap)
    }
}

/// What a ratio of scatter over what is stated, from so many independent windows, shows beyond chance: 1 where chance explains it, nearly all of it where it
/// is far beyond (the non-negative garrote of Breiman 1995).
fn beyond_chance(ratio: f64, windows: f64) -> f64 {
    let (excess, chance) = (ratio - 1.0, CHANCE * ONE_WINDOW / windows.sqrt() * ratio);
    if excess > chance { 1.0 + excess - chance * chance / excess } else { 1.0 }
}

/// Pixels that are passed over together.
const GROUP: usize = 16;

/// Takes the first of each so many pixels that have a sample.
#[inline(always)]
fn every(depths: &[f64], stride: usize, pixels: &mut Vec<u32>) {
    let mut between = 0;
    for (number, group) in depths.chunks(GROUP).enumerate() {
        let count = group.iter().fold(0_u64, |count, depth| count + u64::from(depth.is_finite())) as usize;
        if count <= between {
            between -= count;
            continue;
        }
        for (place, _) in group.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
            if between == 0 {
                pixels.push((number * GROUP + place) as u32);
                between = stride;
            }
            between -= 1;
        }
    }
}

/// Weights of the kernel, by row and by column.
const KERNEL: [f64; 3] = [1.0, -2.0, 1.0];
/// Those of a slope, and those of a mean.
const SLOPE: [f64; 3] = [-0.5, 0.0, 0.5];
const MEAN: [f64; 3] = [1.0 / 3.0; 3];
/// Where a ball's shape is more than this many standard deviations of what the kernel leaves, what is of still higher order counts as well.
const MOST_SHAPE: f64 = 1.0;

/// What the kernel leaves of a ball that has such differences of slope and curvature over samples so far apart.
#[inline(always)]
fn shape([u, v, uu, uv, vv]: [f64; 5], lag: f64, scale: f64) -> f64 {
    let (slope, bend) = (1.0 / lag, 1.0 / (lag * lag));
    let derivatives = Derivatives { u: u * slope, v: v * slope, uu: uu * bend, uv: uv * bend, vv: vv * bend };
    let [_, fuuvv] = fourth_order(derivatives, scale, 0.0);
    fuuvv * scale * (lag * lag) * (lag * lag)
}

/// What the kernel is applied to.
struct Windows<'a> {
    view: &'a View<'a>,
    samples: &'a Raster,
    link: Link,
    /// Half the side of the smoothing window.
    half: usize,
}

impl Windows<'_> {
    /// Magnitude of what the kernel leaves of nine smoothed samples `lag` apart, over its stated uncertainty, about each of up to [`LANES`]
    /// pixels; NaN where they are not one surface.
    #[inline(always)]
    fn ratios(&self, pixels: &[u32], lag: usize, ratios: &mut [f64]) {
        let mut middles = [0; LANES];
        let mut whole = [false; LANES];
        for (l, pixel) in pixels.iter().enumerate() {
            middles[l] = *pixel as usize;
            whole[l] = self.reaches(middles[l], lag);
        }
        let (mut high_pass, mut variance) = ([0.0; LANES], [0.0; LANES]);
        let mut filled = [0.0; LANES];
        for l in (0..LANES).filter(|l| whole[*l]) {
            filled[l] = self.filled(middles[l], lag);
        }
        let mut bends = [[0.0; LANES]; 5];
        for (v, by_row) in KERNEL.into_iter().enumerate() {
            for (u, by_column) in KERNEL.into_iter().enumerate() {
                let mut places = [0; LANES];
                for l in 0..LANES {
                    if !whole[l] {
                        continue;
                    }
                    places[l] =
                        middles[l] + v * lag * self.view.width + u * lag - lag * (self.view.width + 1);
                    whole[l] =
                        self.link.joins(&self.samples.at(middles[l]), &self.samples.at(places[l]), lag);
                }
                if whole == [false; LANES] {
                    ratios.fill(f64::NAN);
                    return;
                }
                let (values, sigmas) = self.smoothed((&places, &filled), whole);
                let weight = by_row * by_column;
                let of_bends = [
                    MEAN[v] * SLOPE[u],
                    SLOPE[v] * MEAN[u],
                    MEAN[v] * by_column,
                    SLOPE[v] * SLOPE[u],
                    by_row * MEAN[u],
                ];
                for (bend, weight) in bends.iter_mut().zip(of_bends) {
                    for l in 0..LANES {
                        bend[l] += weight * values[l];
                    }
                }
                for l in 0..LANES {
                    let sigma = f64::from(sigmas[l]);
                    high_pass[l] += weight * values[l];
                    variance[l] += weight * weight * sigma * sigma;
                }
            }
        }
        for (l, ratio) in ratios.iter_mut().enumerate() {
            let sigma = variance[l].sqrt();
            let scale = self.samples.depths[middles[l]].abs() * self.view.pitch;
            let shape = shape(bends.map(|bend| bend[l]), lag as f64, scale);
            let known = whole[l] && sigma > 0.0 && shape.abs() <= MOST_SHAPE * sigma;
            *ratio = if known { (high_pass[l] - shape).abs() / sigma } else { f64::NAN };
        }
    }

    /// How many pixels of the other view a sample fills in the mean of those so far from it.
    #[inline(never)]
    fn filled(&self, pixel: usize, lag: usize) -> f64 {
        let slope = |to: usize| {
            (self.samples.depths[pixel + to] - self.samples.depths[pixel - to]) / (2.0 * lag as f64)
        };
        let slopes = [slope(lag), slope(lag * self.view.width)];
        self.view.filled(pixel, self.samples.depths[pixel], slopes)
    }

    /// Whether nine pixels `lag` apart lie in the image.
    fn reaches(&self, pixel: usize, lag: usize) -> bool {
        let (column, row) = (pixel % self.view.width, pixel / self.view.width);
        column >= lag && row >= lag && column + lag < self.view.width && row + lag < self.view.height
    }

    /// The smoothed samples of those places that are asked.
    #[inline(always)]
    fn smoothed(
        &self,
        (places, filled): (&[usize; LANES], &[f64; LANES]),
        asked: [bool; LANES],
    ) -> ([f64; LANES], [f32; LANES]) {
        let (mut values, mut sigmas) = ([f64::NAN; LANES], [f32::NAN; LANES]);
        let inner: [bool; LANES] = std::array::from_fn(|l| asked[l] && self.reaches(places[l], HALF));
        if self.half == HALF
            && let Some(any) = (0..LANES).find(|l| inner[*l])
        {
            let places = std::array::from_fn(|l| places[if inner[l] { l } else { any }]);
            (values, sigmas) =
                quick::smoothed(self.view, self.samples, (&places, filled), self.link.max_step);
        }
        for l in (0..LANES).filter(|l| asked[*l]) {
            if !inner[l] || values[l].is_nan() {
                let (sample, _) = smoothed(self.view, self.samples, places[l], self.link.max_step, self.half);
                (values[l], sigmas[l]) = (sample.inverse_depth, sample.sigma);
            }
        }
        (values, sigmas)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Sample, SurfaceSettings};
    use super::*;
    use crate::math::random::{Key, normal_quantile};
    use crate::rectify::Directions;

    const SIDE: usize = 160;
    const SIGMA: f64 = 1e-6;

    /// A ball of 50 pixels radius, seen by lines of sight that are nearly parallel: what the kernel leaves of it up to 50°, and what is expected.
    #[test]
    fn the_shape_of_a_ball_is_known() {
        let (radius, away, lag) = (50.0_f64, 2000.0, 6.0);
        let inverse = |x: f64, y: f64| 1.0 / (away - (radius * radius - x * x - y * y).sqrt());
        for (degrees, turn) in [(0.0_f64, 0.0_f64), (20.0, 0.4), (35.0, 0.8), (45.0, 0.0), (50.0, 1.2)] {
            let at = radius * crate::math::sin(degrees.to_radians());
            let (x, y) = (at * crate::math::cos(turn), at * crate::math::sin(turn));
            let sum = |by_row: [f64; 3], by_column: [f64; 3]| {
                let term = |i: usize| {
                    let [v, u] = [i / 3, i % 3].map(|k| (k as f64 - 1.0) * lag);
                    by_row[i / 3] * by_column[i % 3] * inverse(x + u, y + v)
                };
                (0..9).map(term).sum::<f64>()
            };
            let left = sum(KERNEL, KERNEL);
            let bends = [(MEAN, SLOPE), (SLOPE, MEAN), (MEAN, KERNEL), (SLOPE, SLOPE), (KERNEL, MEAN)]
                .map(|(v, u)| sum(v, u));
            let scale = inverse(x, y) / away;
            let found = shape(bends, lag, scale);
            // Where there is no slope there is no way to turn to, and hardly a shape.
            let limit = 0.12 * left.abs() + 0.011 * scale;
            assert!((found - left).abs() < limit, "{degrees}: {} of {} px", found / scale, left / scale);
        }
    }

    /// Excess of noise of single pixels with patches of `side` px, of so many stated sigmas, below it, on a disc.
    fn excess((patches, side): (f64, usize), radius: f64, seed: u64) -> f64 {
        let draw = |seed, i: usize| normal_quantile(Key::new(seed).open(i as u64));
        let sample = |i: usize| {
            let from_middle = [i % SIDE, i / SIDE].map(|at| (at as f64 - 0.5 * SIDE as f64).powi(2));
            if from_middle[0] + from_middle[1] > radius * radius {
                return Sample::NONE;
            }
            let patch = i / SIDE / side * SIDE + i % SIDE / side;
            let noise = draw(2 * seed, i) + patches * draw(2 * seed + 1, patch);
            Sample {
                inverse_depth: 2e-3 + SIGMA * noise,
                sigma: SIGMA as f32,
                modulation: 1.0,
                ..Sample::without(crate::surface::Cause::Point)
            }
        };
        let samples: Vec<Sample> = (0..SIDE * SIDE).map(sample).collect();
        let directions = Directions::kept(SIDE, vec![[0.0; 2]; samples.len()]);
        let view = View::along_the_axes([SIDE, SIDE], &directions, 0.001);
        let mut builder = SurfaceBuilder::new(SIDE, SIDE, SurfaceSettings::default());
        builder.load(&samples);
        let count = samples.iter().filter(|sample| sample.inverse_depth.is_finite()).count();
        builder.excess(&view, Link { max_step: 0.01 }, count)
    }

    #[test]
    fn one_of_so_many_samples_is_asked() {
        let depths: Vec<f64> = (0..500).map(|i| if i % 7 < 3 || i > 450 { f64::NAN } else { 1.0 }).collect();
        for stride in [1, 2, 15, 16, 40, 1000] {
            let (mut found, filled) = (Vec::new(), (0..500).filter(|i| depths[*i as usize].is_finite()));
            every(&depths, stride, &mut found);
            assert_eq!(found, filled.step_by(stride).collect::<Vec<u32>>(), "{stride}");
        }
    }

    /// Smoothing over 5 × 5 leaves 0.39 σ of single pixels and all of the patches.
    #[test]
    fn patches_of_noise_are_found_and_noise_of_pixels_is_no_excess() {
        let none = excess((0.0, 1), f64::INFINITY, 2);
        assert!((1.0..1.02).contains(&none), "{none}");
        let found = excess((0.4, 5), f64::INFINITY, 2);
        assert!((1.2..1.6).contains(&found), "{found}");
    }

    /// Windows of a small disc overlap: what chance makes of them passes for no excess, patches of noise still show.
    #[test]
    fn chance_is_no_excess_of_a_small_part() {
        let mean = |patches| (1..=40).map(|seed| excess(patches, 35.0, seed)).sum::<f64>() / 40.0;
        let (none, found) = (mean((0.0, 1)), mean((0.8, 5)));
        assert!((1.0..1.02).contains(&none) && (1.5..2.4).contains(&found), "{none} {found}");
    }
}

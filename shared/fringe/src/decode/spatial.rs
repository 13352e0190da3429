//! Noise of the camera from neighbouring pixels, where the steps leave no residual to estimate it from.
//!
//! Three steps leave no residual, four leave one that the second harmonic owns, and a code has none. But the phase of a
//! surface is smooth over 3 × 3 pixels and noise is not. The kernel
//!
//! ```text
//!  1 −2  1
//! −2  4 −2        (Immerkær, Comput. Vis. Image Underst. 64, 300, 1996)
//!  1 −2  1
//! ```
//!
//! takes every quadratic out. It is applied to the phase, not to the grey values: texture cancels in a phase. Its variance is
//! Σ k² (2/N) σ_I²/B² over the nine pixels, which each window solves for σ_I². For a code it is applied to the
//! difference of two frames where both show the same level. Noise that neighbours share (a Bayer mosaic that was
//! interpolated, lossy compression) is underestimated.
//!
//! The residuals of many steps hold more than noise: harmonics that differ from place to place, light that flickers. Where pixels some distance
//! apart scatter less than they tell, the scatter counts ([`super::noise::Probe::lessen`]).

use super::accumulate::{Rasters, Sums};
use super::arctan::angle_positive_rad;
use super::noise::Sample;
use super::roles::{CodePlan, Reference};
use crate::math::wrap_rad;

/// Weights of the kernel, row by row.
const KERNEL: [f64; 9] = [1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0];
/// Sum of their squares.
const KERNEL_POWER: f64 = 36.0;
/// Larger differences of phase in a window are an edge, rad.
const EDGE_RAD: f64 = 1.2;
/// Frames of a code show the same level where they differ by less than this share of the contrast.
const SAME_LEVEL: f64 = 0.25;

/// The pixels that are asked: places in an image of this width, and where a frame was clipped.
#[derive(Debug, Clone, Copy)]
pub struct Places<'a> {
    pub positions: &'a [usize],
    pub width: usize,
    pub saturated: &'a [u8],
    /// Distance of the pixels of a window, px.
    pub lag: usize,
}

impl Places<'_> {
    /// The 3 × 3 windows inside the image without clipped pixels, by their centre.
    fn windows(&self) -> impl Iterator<Item = [usize; 9]> {
        let (width, lag, pixels) = (self.width, self.lag, self.saturated.len());
        let inner = move |p: &usize| {
            let column = p % width;
            column >= lag && column + lag < width && *p >= lag * width && p + lag * width < pixels
        };
        let around = move |p: usize| {
            let first = p - lag * width - lag;
            std::array::from_fn(|k| first + k / 3 * lag * width + k % 3 * lag)
        };
        let windows = self.positions.iter().copied().filter(inner).map(around);
        windows.filter(|window: &[usize; 9]| window.iter().all(|p| self.saturated[*p] == 0))
    }
}

/// Samples of σ_I² from the phase of one sine set with `steps` frames.
pub fn sample_phase(
    places: &Places,
    sums: &Sums,
    steps: usize,
    least_modulation_dn: f64,
    samples: &mut Vec<Sample>,
) {
    let n = steps as f64;
    for window in places.windows().take(samples.capacity()) {
        let centre = window[4];
        let middle = angle_positive_rad(sums.sin[centre], sums.cos[centre]);
        let (mut high_pass, mut power, mut usable) = (0.0, 0.0, true);
        for (weight, pixel) in KERNEL.iter().zip(window) {
            let (c, s) = (f64::from(sums.cos[pixel]), f64::from(sums.sin[pixel]));
            let length = (c * c + s * s).sqrt();
            let modulation_dn = 2.0 / n * length;
            if modulation_dn < least_modulation_dn || modulation_dn <= 0.0 {
                usable = false;
                break;
            }
            let difference = wrap_rad(angle_positive_rad(sums.sin[pixel], sums.cos[pixel]) - middle);
            usable &= difference.abs() < EDGE_RAD;
            high_pass += weight * difference;
            let unit = sums.uneven.as_ref().map_or((2.0 / n).sqrt(), |fit| fit.noise(c / length, s / length));
            let factor = weight * unit / modulation_dn;
            power += factor * factor;
        }
        if usable {
            let background_dn = f64::from(sums.sum[centre]) / n;
            let variance_dn2 = high_pass * high_pass / power;
            samples.push(Sample { background_dn, variance_dn2, freedom: 1.0 });
        }
    }
}

/// Samples of σ_I² from the two coarsest frames of a code, or from its only one and white.
pub fn sample_code(
    places: &Places,
    rasters: &Rasters,
    code: &CodePlan,
    least_contrast_dn: f64,
    samples: &mut Vec<Sample>,
) {
    let pixels = places.saturated.len();
    let read = |one: usize, other: usize, pixel: usize| {
        let (a, b) = rasters.pair(one, other, pixels, pixel);
        (f64::from(a), f64::from(b))
    };
    let (light, dark) = match code.reference {
        Reference::Complement(first) => (code.first, first),
        Reference::WhiteBlack(white, black) => (white, black),
        Reference::SineMean(_) => return,
    };
    let (one, other) = match code.reference {
        Reference::WhiteBlack(white, _) if code.bits == 1 => (code.first, white),
        _ => (code.first, code.first + code.bits.min(2) - 1),
    };
    if one == other {
        return;
    }
    for window in places.windows().take(samples.capacity()) {
        let (mut high_pass, mut usable) = (0.0, true);
        for (weight, pixel) in KERNEL.iter().zip(window) {
            let (a, b) = read(one, other, pixel);
            let (l, d) = read(light, dark, pixel);
            let contrast_dn = (l - d).abs();
            usable &= 0.5 * contrast_dn >= least_contrast_dn && (a - b).abs() < SAME_LEVEL * contrast_dn;
            usable &= a > 0.0 && b > 0.0;
            high_pass += weight * (a - b);
        }
        if usable {
            let (a, b) = read(one, other, window[4]);
            let variance_dn2 = high_pass * high_pass / (2.0 * KERNEL_POWER);
            samples.push(Sample { background_dn: 0.5 * (a + b), variance_dn2, freedom: 1.0 });
        }
    }
}

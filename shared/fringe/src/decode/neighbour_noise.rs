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
//! apart scatter less than they tell, the scatter counts ([`super::noise_estimate::Probe::lessen`]).

use super::arctan::angle_positive_rad;
use super::block::{BLOCK, state};
use super::noise_line::Sample;
use super::rasters::Rasters;
use super::roles::{CodePlan, Reference};
use super::sums::{BlockSums, Clipping, Sums};
use crate::math::wrap_rad;
use crate::phase::PhaseViewMut;

/// Weights of the kernel, row by row.
const KERNEL: [f64; 9] = [1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0];
/// Sum of their squares.
const KERNEL_POWER: f64 = 36.0;
/// Larger differences of phase in a window are an edge, rad.
const EDGE_RAD: f64 = 1.2;
/// Frames of a code show the same level where they differ by less than this share of the contrast.
const SAME_LEVEL: f64 = 0.25;

/// The pixels that are asked: places in an image of this width, and where a frame is clipped.
#[derive(Debug, Clone, Copy)]
pub struct Places<'a> {
    pub positions: &'a [usize],
    pub width: usize,
    pub pixels: usize,
    pub rasters: &'a Rasters,
    pub clipping: &'a Clipping,
    /// Distance of the pixels of a window, px.
    pub lag: usize,
}

impl Places<'_> {
    /// The pixels whose 3 × 3 windows lie inside the image.
    fn middles(&self) -> impl Iterator<Item = usize> {
        let (width, lag, pixels) = (self.width, self.lag, self.pixels);
        let inner = move |p: &usize| {
            let column = p % width;
            column >= lag && column + lag < width && *p >= lag * width && p + lag * width < pixels
        };
        self.positions.iter().copied().filter(inner)
    }

    /// The window about a pixel.
    fn window(&self, middle: usize) -> [usize; 9] {
        let first = middle - self.lag * self.width - self.lag;
        std::array::from_fn(|k| first + k / 3 * self.lag * self.width + k % 3 * self.lag)
    }
}

/// Windows that are worked on at once: a block of their pixels.
const WINDOWS: usize = BLOCK / 9;

/// Samples of σ_I² from the phase of one sine set with `steps` frames.
#[inline(always)]
pub fn sample_phase(
    places: &Places,
    sums: &Sums,
    steps: usize,
    least_modulation_dn: f64,
    samples: &mut Vec<Sample>,
) {
    let mut middles = places.middles();
    let (mut pixels, mut block) = ([0_usize; 9 * WINDOWS], BlockSums::ZERO);
    let (mut clipped, mut phases) = ([0_u8; BLOCK], [0.0_f64; BLOCK]);
    let mut lit = [0_usize; BLOCK];
    loop {
        let mut asked = 0;
        for middle in middles.by_ref().take(BLOCK) {
            lit[asked] = middle;
            asked += 1;
        }
        if asked == 0 {
            return;
        }
        // Where the middle is dark, the rest of the window need not be fetched.
        sums.gather(places.rasters, &lit[..asked], &mut block);
        let mut count = 0;
        for i in 0..asked {
            if modulation_dn(&block, i, steps).1 >= least_modulation_dn {
                lit[count] = lit[i];
                count += 1;
            }
        }
        for middles in lit[..count].chunks(WINDOWS) {
            let count = 9 * middles.len();
            for (pixels, middle) in pixels.chunks_exact_mut(9).zip(middles) {
                pixels.copy_from_slice(&places.window(*middle));
            }
            sums.gather(places.rasters, &pixels[..count], &mut block);
            places.clipping.gather(places.rasters, &pixels[..count], &mut clipped);
            for ((phase, s), c) in phases[..count].iter_mut().zip(&block.sin).zip(&block.cos) {
                *phase = angle_positive_rad(*s, *c);
            }
            for first in (0..count).step_by(9) {
                if clipped[first..first + 9].iter().all(|c| *c == 0) && samples.len() < samples.capacity() {
                    samples.extend(window_sample(sums, &block, &phases, first, steps, least_modulation_dn));
                }
            }
        }
    }
}

/// Length of (Σ I cos δ, Σ I sin δ) of a pixel of a block, and its modulation, DN.
#[inline(always)]
fn modulation_dn(block: &BlockSums, pixel: usize, steps: usize) -> (f64, f64) {
    let (c, s) = (f64::from(block.cos[pixel]), f64::from(block.sin[pixel]));
    let length = (c * c + s * s).sqrt();
    (length, 2.0 / steps as f64 * length)
}

/// The sample of the window whose pixels stand from `first` on in a block.
#[inline(always)]
fn window_sample(
    sums: &Sums,
    block: &BlockSums,
    phases_rad: &[f64; BLOCK],
    first: usize,
    steps: usize,
    least_modulation_dn: f64,
) -> Option<Sample> {
    let n = steps as f64;
    let middle = phases_rad[first + 4];
    let (mut high_pass, mut power, mut usable) = (0.0, 0.0, true);
    for (weight, pixel) in KERNEL.iter().zip(first..first + 9) {
        let (c, s) = (f64::from(block.cos[pixel]), f64::from(block.sin[pixel]));
        let (length, modulation_dn) = modulation_dn(block, pixel, steps);
        if modulation_dn < least_modulation_dn || modulation_dn <= 0.0 {
            return None;
        }
        let difference = wrap_rad(phases_rad[pixel] - middle);
        usable &= difference.abs() < EDGE_RAD;
        high_pass += weight * difference;
        let unit = sums.unit_noise(n, (c / length, s / length));
        let factor = weight * unit / modulation_dn;
        power += factor * factor;
    }
    usable.then(|| Sample {
        background_dn: f64::from(block.sum[first + 4]) / n,
        variance_dn2: high_pass * high_pass / power,
        freedom: 1.0,
    })
}

/// Samples of the variance of a map's phase over the stated one, where all of a window is known; the map's uncertainty is that of one set of
/// steps.
pub fn sample_map(places: &Places, map: &PhaseViewMut, samples: &mut Vec<Sample>) {
    for middle in places.middles().filter(|middle| map.valid[*middle] == state::SURE) {
        let (mut high_pass, mut power, mut usable) = (0.0, 0.0, true);
        for (weight, pixel) in KERNEL.iter().zip(places.window(middle)) {
            let difference = f64::from(map.phase_rad[pixel] - map.phase_rad[middle]);
            let noise = weight * f64::from(map.sigma_rad[pixel]);
            // The phase of a masked pixel is NaN, which is below nothing.
            usable &= difference.abs() < EDGE_RAD;
            high_pass += weight * difference;
            power += noise * noise;
        }
        if usable && power > 0.0 && samples.len() < samples.capacity() {
            let variance_dn2 = high_pass * high_pass / power;
            samples.push(Sample { background_dn: 0.0, variance_dn2, freedom: 1.0 });
        }
    }
}

/// Samples of σ_I² from the two coarsest frames of a code, or from its only one and white.
pub fn sample_code(places: &Places, code: &CodePlan, least_contrast_dn: f64, samples: &mut Vec<Sample>) {
    let read = |one: usize, other: usize, pixel: usize| {
        let (a, b) = places.rasters.pair(one, other, pixel);
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
    let clipped = |p: &usize| places.clipping.at(places.rasters, *p);
    let windows = places.middles().map(|middle| places.window(middle));
    let windows = windows.filter(|window| !window.iter().any(clipped));
    for window in windows.take(samples.capacity()) {
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

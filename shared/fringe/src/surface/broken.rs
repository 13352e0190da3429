//! Windows of 5 × 5 samples that are not all of one surface, as at rims: a row of the window is one step on vectors, and a sample that is
//! not joined to the middle one counts as nothing. To a branch a rim is chance.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::normals::Link;
use super::raster::Raster;
use super::windows::{HALF, LANES, Lanes, taken};
use crate::math::simd::{best_level, vectorised};

/// Rows of the window.
const SIDE: usize = 2 * HALF + 1;

/// Sums over the samples that are joined to the middle one, u columns and v rows from it: of their number, u, v, u², uv and v², and of their
/// differences q of the inverse depth, q, uq and vq.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Joined {
    pub n: f64,
    pub su: f64,
    pub sv: f64,
    pub suu: f64,
    pub suv: f64,
    pub svv: f64,
    pub sq: f64,
    pub suq: f64,
    pub svq: f64,
}

/// Whether the rows of the window of a pixel can be read: they are read a little beyond the window.
pub(super) fn is_readable((width, height): (usize, usize), pixel: usize) -> bool {
    let (column, row) = (pixel % width, pixel / width);
    column >= HALF && column - HALF + LANES <= width && row >= HALF && row + HALF < height
}

/// The sums over the window of a pixel that [`is_readable`].
pub(super) fn joined(width: usize, samples: &Raster, pixel: usize, link: Link) -> Joined {
    vectorised!(best_level(), sums(width, samples, pixel, link))
}

/// How many samples of the window of a pixel that [`is_readable`] are neither joined to it nor in a gap (`gaps` not zero).
pub(super) fn missing(width: usize, samples: &Raster, gaps: &[u8], pixel: usize, link: Link) -> u16 {
    vectorised!(best_level(), count(width, samples, gaps, pixel, link))
}

/// Row `r` of the window: which samples are joined, as 1 or 0, and their differences from the middle one.
#[inline(always)]
fn row(width: usize, samples: &Raster, pixel: usize, link: Link, r: usize) -> (Lanes, Lanes) {
    let first = pixel - HALF * width - HALF + r * width;
    let depths: Lanes = taken(&samples.depths, first);
    let sigmas: [f32; LANES] = taken(&samples.sigmas, first);
    let (middle, sigma) = (samples.depths[pixel], samples.sigmas[pixel]);
    let (mut one, mut q) = ([0.0; LANES], [0.0; LANES]);
    for k in 0..LANES {
        let distance = k.abs_diff(HALF).max(r.abs_diff(HALF));
        let difference = depths[k] - middle;
        let joined = (difference.abs() <= link.limit(middle, sigma + sigmas[k], distance)) & (k < SIDE);
        one[k] = if joined { 1.0 } else { 0.0 };
        q[k] = if joined { difference } else { 0.0 };
    }
    (one, q)
}

#[inline(always)]
fn sums(width: usize, samples: &Raster, pixel: usize, link: Link) -> Joined {
    let zero = [0.0; LANES];
    // Over each column.
    let (mut n, mut nv, mut nvv, mut cq, mut cvq) = (zero, zero, zero, zero, zero);
    for r in 0..SIDE {
        let v = r as f64 - HALF as f64;
        let (one, q) = row(width, samples, pixel, link, r);
        for k in 0..LANES {
            n[k] += one[k];
            nv[k] += one[k] * v;
            nvv[k] += one[k] * (v * v);
            cq[k] += q[k];
            cvq[k] += v * q[k];
        }
    }
    let mut sums = Joined::default();
    for k in 0..SIDE {
        let u = k as f64 - HALF as f64;
        sums.n += n[k];
        sums.su += u * n[k];
        sums.sv += nv[k];
        sums.suu += u * u * n[k];
        sums.suv += u * nv[k];
        sums.svv += nvv[k];
        sums.sq += cq[k];
        sums.suq += u * cq[k];
        sums.svq += cvq[k];
    }
    sums
}

#[inline(always)]
fn count(width: usize, samples: &Raster, gaps: &[u8], pixel: usize, link: Link) -> u16 {
    let mut missing = [0.0; LANES];
    for r in 0..SIDE {
        let (one, _) = row(width, samples, pixel, link, r);
        let gaps: [u8; LANES] = taken(gaps, pixel - HALF * width - HALF + r * width);
        for k in 0..LANES {
            missing[k] += if gaps[k] == 0 { 1.0 - one[k] } else { 0.0 };
        }
    }
    missing[..SIDE].iter().sum::<f64>() as u16
}

#[cfg(test)]
mod tests {
    use super::super::Sample;
    use super::super::normals::joined_one_by_one;
    use super::*;
    use crate::math::random::{Key, normal_quantile};

    /// Steps, holes and noise: what is joined is what the rule says pixel by pixel.
    #[test]
    fn rows_of_a_window_count_what_single_samples_do() {
        let (width, height) = (31, 17);
        let key = Key::new(11);
        let sample = |i: usize| {
            let step = if i % width > 14 { 4e-5 } else { 0.0 };
            let noise = 2e-6 * normal_quantile(key.open(2 * i as u64));
            let missing = key.open(2 * i as u64 + 1) < 0.2;
            let inverse_depth = if missing { f64::NAN } else { 2e-3 + step + noise };
            Sample { inverse_depth, sigma: 1e-6 * (1.0 + 0.1 * (i % 7) as f32), ..Sample::NONE }
        };
        let samples: Vec<Sample> = (0..width * height).map(sample).collect();
        let gaps: Vec<u8> = (0..samples.len()).map(|i| u8::from(i % 13 == 0)).collect();
        let (raster, link) = (Raster::from(&samples[..]), Link { max_step: 3e-3 });
        let (mut asked, mut broken) = (0, 0);
        for pixel in (0..samples.len()).filter(|i| samples[*i].inverse_depth.is_finite()) {
            if !is_readable((width, height), pixel) {
                continue;
            }
            let expected = joined_one_by_one((width, height), &raster, pixel, link, HALF);
            let places = (0..SIDE).flat_map(|r| (0..SIDE).map(move |k| (r, k)));
            let absent = places.filter(|(r, k)| {
                let place = pixel + r * width + k - HALF * width - HALF;
                let distance = k.abs_diff(HALF).max(r.abs_diff(HALF));
                gaps[place] == 0 && !link.joins(&samples[pixel], &samples[place], distance)
            });
            let absent = absent.count() as u16;
            let found = joined(width, &raster, pixel, link);
            let whole = |s: &Joined| [s.n, s.su, s.sv, s.suu, s.suv, s.svv];
            assert_eq!(whole(&found), whole(&expected), "{pixel}");
            for (found, expected) in
                [(found.sq, expected.sq), (found.suq, expected.suq), (found.svq, expected.svq)]
            {
                assert!((found - expected).abs() < 1e-17, "{pixel}: {found} {expected}");
            }
            assert_eq!(missing(width, &raster, &gaps, pixel, link), absent, "{pixel}");
            (asked, broken) = (asked + 1, broken + usize::from(absent > 0));
        }
        assert!(asked > 200 && broken > 100, "{asked} {broken}");
    }
}

//! Less noise in single points: the least-squares quadratic of the inverse depth over a window, read at its middle.
//!
//! Exact where the inverse depth is quadratic, so that it takes no curvature away; what it takes of a ball seen steeply, of fourth order, is given
//! back ([`super::curved`]). A window that is not all one smooth
//! surface (an edge, a crease, a hole) is not used; a smaller one is tried, then the sample stays as it is.
//!
//! Smoothed neighbours share noise: nothing that is fitted to many points gets more certain by it, and the correlation
//! has to be looked after there, as with [`metrology::fit::Correlation`].

use super::curved::{Derivatives, missing};
use super::normals::Link;
use super::point::{Sample, View};
use super::raster::Raster;
use super::rim::DROPPED;
use super::shares::{OWN_SHARE, shared};
use nalgebra::{Matrix6, Vector6};

/// Residuals beyond this many sigmas are not noise of one surface. Nineteen degrees of freedom scatter by ± 0.16.
pub(super) const MAX_NOISE: f64 = 1.5;

/// Residual beyond the noise that one surface may have, as a share of the change of the inverse depth per pixel: balls
/// have 0.01, an edge of 90° 0.04 and more.
pub(super) const MAX_ROUGHNESS: f64 = 0.02;

/// The sample with less noise, from the largest window up to `half` that shows one smooth surface.
#[inline]
pub(super) fn smoothed(
    view: &View,
    samples: &Raster,
    pixel: usize,
    max_step: f64,
    half: usize,
) -> (Sample, usize) {
    let View { width, height, pitch, .. } = *view;
    let (column, row) = (pixel % width, pixel / width);
    let border = column.min(row).min(width - 1 - column).min(height - 1 - row);
    for half in (1..=half.min(border)).rev() {
        let value = match half {
            3 => middle::<3>((width, pitch), samples, pixel, max_step),
            2 => middle::<2>((width, pitch), samples, pixel, max_step),
            _ => middle::<1>((width, pitch), samples, pixel, max_step),
        };
        if let Some((inverse_depth, slopes)) = value {
            let own = f64::from(samples.own_shares[pixel]);
            let filled = view.filled(pixel, inverse_depth, slopes);
            let left = shared(view.shares.left(half, own, filled), view.independence.share);
            let sigma = (f64::from(samples.sigmas[pixel]) * left.sqrt()) as f32;
            return (Sample { inverse_depth, sigma, ..samples.at(pixel) }, half);
        }
    }
    (alone(view, samples, pixel), 0)
}

/// The sample as it is, with the uncertainty of a point.
pub(super) fn alone(view: &View, samples: &Raster, pixel: usize) -> Sample {
    let sample = samples.at(pixel);
    let left = shared(view.shares.left(0, f64::from(sample.own_share), 0.0), view.independence.share);
    Sample { sigma: (f64::from(sample.sigma) * left.sqrt()) as f32, ..sample }
}

/// Fewer samples of a window do not make a quadratic; of the smallest one may be missing.
const LEAST_SHARE: f64 = 0.6;

/// Most samples that a window may lack.
fn most_missing(half: usize) -> usize {
    let side = 2 * half + 1;
    if half == 1 { 1 } else { side * side - (LEAST_SHARE * (side * side) as f64).ceil() as usize }
}

/// A partial window may leave so much more noise than a full one.
const MOST_EXTRA_NOISE: f64 = 2.0;

/// The same over a window that lacks the samples of narrow gaps or of a rim: the largest one beyond half width `none` up to `half`. The sample is
/// left alone where more than gaps is missing.
pub(super) fn smoothed_partly(
    view: &View,
    samples: &Raster,
    gaps: &[u8],
    pixel: usize,
    link: Link,
    (none, half): (usize, usize),
) -> Option<Sample> {
    let View { width, height, pitch, .. } = *view;
    let (column, row) = (pixel % width, pixel / width);
    let border = column.min(row).min(width - 1 - column).min(height - 1 - row);
    (none + 1..=half.min(border)).rev().find_map(|half| {
        let fit = Partial::gather((width, half), samples, gaps, pixel, link)?;
        let (inverse_depth, slopes, own) = fit.solve((&samples.at(pixel), pitch), half)?;
        let extra = own / OWN_SHARE[half];
        let independent = f64::from(samples.own_shares[pixel]);
        let other = view.shares.other_left(half, view.filled(pixel, inverse_depth, slopes));
        let left = independent * view.shares.own_left(half) * extra
            + (1.0 - independent) * (other * extra).min(view.shares.other_left(0, 0.0));
        let left = shared(left, view.independence.share);
        let sigma = (f64::from(samples.sigmas[pixel]) * left.sqrt()) as f32;
        (extra <= MOST_EXTRA_NOISE).then_some(Sample { inverse_depth, sigma, ..samples.at(pixel) })
    })
}

/// Normal equations of a quadratic over part of a window.
struct Partial {
    normal: Matrix6<f64>,
    moments: Vector6<f64>,
    squares: f64,
    count: f64,
    /// Whether it lacks samples at a rim, so that it is not alike on both sides.
    lopsided: bool,
}

/// The equations of a window of which every sample is there.
pub(super) fn whole(half: usize) -> Matrix6<f64> {
    let power = |n: i32| (1..=half).map(|u| 2.0 * (u as f64).powi(n)).sum::<f64>();
    let (side, square) = ((2 * half + 1) as f64, power(2));
    let (line, quartic, cross) = (side * square, side * power(4), square * square);
    let mut normal = Matrix6::from_diagonal(&Vector6::new(side * side, line, line, quartic, cross, quartic));
    for (i, j, sum) in [(0, 3, line), (0, 5, line), (3, 5, cross)] {
        (normal[(i, j)], normal[(j, i)]) = (sum, sum);
    }
    normal
}

impl Partial {
    /// The samples on the surface of the middle one; `None` where none is missing, or another surface or more than gaps lies in the window.
    fn gather(
        (width, half): (usize, usize),
        samples: &Raster,
        gaps: &[u8],
        pixel: usize,
        link: Link,
    ) -> Option<Self> {
        let side = 2 * half + 1;
        let first = pixel - half * (width + 1);
        let (mut missing, mut lopsided) = (0, false);
        for start in (0..side).map(|v| first + v * width) {
            let line = samples.depths[start..start + side].iter().zip(&gaps[start..start + side]);
            for (_, gap) in line.filter(|(depth, _)| depth.is_nan()) {
                if *gap == 0 {
                    return None;
                }
                (missing, lopsided) = (missing + 1, lopsided || *gap == DROPPED);
            }
        }
        // A whole one has been tried, and is rough.
        if missing == 0 || missing > most_missing(half) {
            return None;
        }
        let centre = &samples.at(pixel);
        let count = (side * side - missing) as f64;
        let mut sums = Self { normal: whole(half), moments: Vector6::zeros(), squares: 0.0, count, lopsided };
        for v in -(half as isize)..=half as isize {
            for u in -(half as isize)..=half as isize {
                let at = (pixel as isize + v * width as isize + u) as usize;
                let sample = &samples.at(at);
                let (x, y) = (u as f64, v as f64);
                let terms = Vector6::new(1.0, x, y, x * x, x * y, y * y);
                if sample.inverse_depth.is_nan() {
                    // Whole numbers: their sums are exact in any order.
                    sums.normal -= terms * terms.transpose();
                    continue;
                }
                if !link.joins(centre, sample, u.unsigned_abs().max(v.unsigned_abs())) {
                    return None;
                }
                let difference = sample.inverse_depth - centre.inverse_depth;
                sums.moments += terms * difference;
                sums.squares += difference * difference;
            }
        }
        Some(sums)
    }

    /// Inverse depth at the middle, its derivatives and the share of independent noise that is left; `None` where the samples are rougher
    /// than noise and one smooth surface explain.
    fn solve(&self, (centre, pitch): (&Sample, f64), half: usize) -> Option<(f64, [f64; 2], f64)> {
        let factors = self.normal.cholesky()?;
        let (fit, own) = (factors.solve(&self.moments), factors.solve(&Vector6::x())[0]);
        let residual = (self.squares - fit.dot(&self.moments)) / (self.count - 6.0).max(1.0);
        let noise = MAX_NOISE * f64::from(centre.sigma);
        let slope2 = fit[1] * fit[1] + fit[2] * fit[2];
        let limit = noise * noise + MAX_ROUGHNESS * MAX_ROUGHNESS * slope2 + 1e-12 * self.squares;
        // Of a surface that curves, a lopsided window leaves an error of third order, which counts where the noise does not hide even the second.
        let even = !self.lopsided || fit[3].abs() + fit[5].abs() <= f64::from(centre.sigma);
        let (by_uu, by_vv) = (2.0 * fit[3], 2.0 * fit[5]);
        let derivatives = Derivatives { u: fit[1], v: fit[2], uu: by_uu, uv: fit[4], vv: by_vv };
        let missing = missing(half, derivatives, of(centre), pitch);
        let smooth = centre.inverse_depth + (fit[0] + missing);
        (even && residual <= limit).then_some((smooth, [fit[1], fit[2]], own))
    }
}

/// What [`missing`] asks of a sample.
fn of(sample: &Sample) -> [f64; 3] {
    [sample.inverse_depth, f64::from(sample.sigma), f64::from(sample.own_share)]
}

/// The quadratic over (2 HALF + 1)² samples at its middle, and its slopes there; `None` where they are not one smooth surface.
///
/// By orthogonal polynomials 1, u, v, u² − m, uv, v² − m with m the mean of u².
#[inline]
fn middle<const HALF: usize>(
    (width, pitch): (usize, f64),
    samples: &Raster,
    pixel: usize,
    max_step: f64,
) -> Option<(f64, [f64; 2])> {
    if !samples.has_corners(width, pixel, HALF) {
        return None;
    }
    let centre = &samples.at(pixel);
    let side = (2 * HALF + 1) as f64;
    let mean_square = (HALF * (HALF + 1)) as f64 / 3.0;
    let (mut sum, mut by_u, mut by_v, mut by_uu, mut by_uv, mut by_vv, mut squares) =
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let mut worst = 0.0_f64;
    let mut start = pixel - HALF * width - HALF;
    let mut v = -(HALF as f64);
    for _ in 0..=2 * HALF {
        let (mut line, mut line_u, mut line_uu) = (0.0, 0.0, 0.0);
        let mut u = -(HALF as f64);
        for depth in &samples.depths[start..=start + 2 * HALF] {
            let difference = depth - centre.inverse_depth;
            worst = worst.max(difference.abs());
            line += difference;
            line_u += u * difference;
            line_uu += (u * u - mean_square) * difference;
            squares += difference * difference;
            u += 1.0;
        }
        sum += line;
        by_u += line_u;
        by_uu += line_uu;
        by_v += v * line;
        by_uv += v * line_u;
        by_vv += (v * v - mean_square) * line;
        v += 1.0;
        start += width;
    }
    // Norms of the polynomials.
    let (ones, linear) = (side * side, side * side * mean_square);
    let quartic: f64 = (1..=HALF).map(|u| 2.0 * (u * u * u * u) as f64).sum();
    let square = side * (quartic - side * mean_square * mean_square);
    let cross = (side * mean_square) * (side * mean_square);
    let slope2 = (by_u * by_u + by_v * by_v) / (linear * linear);
    let explained = sum * sum / ones
        + (by_u * by_u + by_v * by_v) / linear
        + (by_uu * by_uu + by_vv * by_vv) / square
        + by_uv * by_uv / cross;
    let residual = (squares - explained) / (ones - 6.0);
    let noise = MAX_NOISE * f64::from(centre.sigma);
    let limit = noise * noise + MAX_ROUGHNESS * MAX_ROUGHNESS * slope2 + 1e-12 * squares;
    let connected = worst <= max_step * HALF as f64 * centre.inverse_depth.abs() + 2.0 * noise;
    let derivatives = Derivatives {
        u: by_u / linear,
        v: by_v / linear,
        uu: 2.0 * by_uu / square,
        uv: by_uv / cross,
        vv: 2.0 * by_vv / square,
    };
    let missing = missing(HALF, derivatives, of(centre), pitch);
    // An absent sample makes the sums NaN, and the comparison false.
    (residual <= limit && connected).then(|| {
        let off = sum / ones - mean_square * (by_uu + by_vv) / square + missing;
        (centre.inverse_depth + off, [derivatives.u, derivatives.v])
    })
}

#[cfg(test)]
mod tests {
    use super::super::shares::MAX_HALF;
    use super::*;
    use crate::rectify::Directions;

    const SIDE: usize = 9;
    const MIDDLE: usize = SIDE * SIDE / 2;
    const STEP: f64 = 1e-2;

    fn raster(f: impl Fn(f64, f64) -> f64, sigma: f32) -> Vec<Sample> {
        let at = |i: usize| f((i % SIDE) as f64 - 4.0, (i / SIDE) as f64 - 4.0);
        (0..SIDE * SIDE)
            .map(|i| Sample { inverse_depth: at(i), sigma, modulation: 1.0, ..Sample::NONE })
            .collect()
    }

    fn at_middle(samples: &[Sample], half: usize) -> (Sample, usize) {
        // Wide pixels: what is bent here is hardly bent for them.
        at_middle_of_pixels(samples, half, 1e3)
    }

    fn at_middle_of_pixels(samples: &[Sample], half: usize, pitch: f64) -> (Sample, usize) {
        let directions = Directions::kept(SIDE, vec![[0.0; 2]; SIDE * SIDE]);
        let view = View::along_the_axes([SIDE, SIDE], &directions, pitch);
        smoothed(&view, &samples.into(), MIDDLE, STEP, half)
    }

    #[test]
    fn quadratics_stay_what_they_are() {
        let f = |u: f64, v: f64| 2e-3 + 1e-6 * u - 2e-6 * v + 3e-8 * u * u - 4e-8 * u * v + 5e-8 * v * v;
        for half in 0..=MAX_HALF {
            let (sample, window) = at_middle(&raster(f, 0.0), half);
            assert!((sample.inverse_depth - 2e-3).abs() < 1e-17, "{half}");
            assert_eq!(window, half);
        }
    }

    /// What is left of independent noise is the sum of squared responses to unit impulses.
    #[test]
    fn the_share_of_noise_is_the_sum_of_squared_weights() {
        for (half, share) in OWN_SHARE.into_iter().enumerate().skip(1) {
            let mut sum = 0.0;
            for pixel in 0..SIDE * SIDE {
                let mut samples = raster(|_, _| 2e-3, 1e-3);
                samples[pixel].inverse_depth += 1e-6;
                let (sample, window) = at_middle(&samples, half);
                assert_eq!(window, half);
                sum += ((sample.inverse_depth - 2e-3) / 1e-6).powi(2);
            }
            assert!((sum - share).abs() < 1e-4, "{half}: {sum}");
            let (sample, _) = at_middle(&raster(|_, _| 2e-3, 1e-6), half);
            assert!((f64::from(sample.sigma) / 1e-6 - share.sqrt()).abs() < 1e-6);
        }
    }

    /// A ball of 11 mm at 0.21 mm per pixel and 450 mm, from the front to 65°: what smoothing takes away.
    #[test]
    fn a_small_ball_keeps_its_curvature() {
        let (radius, pixel_mm, away_mm) = (5.5_f64, 0.21, 450.0);
        for degrees in [0.0_f64, 30.0, 50.0, 65.0] {
            let (sine, cosine) =
                (crate::math::sin(degrees.to_radians()), crate::math::cos(degrees.to_radians()));
            let depth = |u: f64, v: f64| {
                let (x, y) = (radius * sine + pixel_mm * u, pixel_mm * v);
                away_mm - (radius * radius - x * x - y * y).max(0.0).sqrt()
            };
            let ball = raster(|u, v| 1.0 / depth(u, v), 5e-8);
            let (sample, window) = at_middle_of_pixels(&ball, 2, pixel_mm / away_mm);
            let off_um = 1e3 * (1.0 / sample.inverse_depth - depth(0.0, 0.0)) * cosine;
            // Next to the limb no quadratic holds the slope: the window shrinks by itself.
            assert!(
                (window == 2 || degrees > 60.0) && off_um.abs() < 0.1,
                "{degrees}: {off_um} over {window}"
            );
        }
    }

    #[test]
    fn edges_creases_and_holes_are_left_alone() {
        let per_pixel = 1e-6;
        let sharp = raster(|u, _| 2e-3 + per_pixel * u.abs(), 1e-8);
        let (sample, window) = at_middle(&sharp, 2);
        assert!(window < 2 && (sample.inverse_depth - 2e-3).abs() < 1e-17, "a crease through the middle");
        let beside = raster(|u, _| 2e-3 + per_pixel * (u - 2.0).max(0.0), 1e-8);
        assert_eq!(at_middle(&beside, 3).1, 2, "a crease two pixels away");
        let step = raster(|u, _| if u > 1.0 { 2.2e-3 } else { 2e-3 }, 1e-8);
        assert_eq!(at_middle(&step, 2).1, 1);
        let mut hole = raster(|_, _| 2e-3, 1e-8);
        hole[MIDDLE - 1] = Sample::NONE;
        let (sample, window) = at_middle(&hole, 2);
        assert_eq!((sample.inverse_depth, window), (hole[MIDDLE].inverse_depth, 0));
    }
}

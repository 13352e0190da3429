//! Where two faces meet.
//!
//! A pixel there sees some of both faces, and shows a phase between theirs: a crease in which the depth changes its slope by Δ appears blunt, by up to
//! 0.4 s Δ of a footprint of the standard deviation s. What the correction of the footprint leaves of that, or adds beside the crease, is known in its
//! size, not in its sign, for the place of the crease within a pixel is not known. Such points are not smoothed over the crease, and state it.
//!
//! Noise hides from the residuals of a single window a crease that bends the smoothed depth by three times its uncertainty. More is seen by its neighbours: at a
//! crease the second derivative is large in one window and nothing in those beside it, while surfaces that curve do so in all.

use super::curved::{BENT, variance};
use super::normals::Link;
use super::raster::Raster;
use super::windows::HALF;

/// Pixels to either side that say how much the slope changes.
const BESIDE: usize = 2;

/// What the correction leaves of a crease, root mean square within 1.5 px of it, over the second difference of depths [`BESIDE`] pixels away: 0.03 of a footprint
/// of 0.4 px, 0.06 of one of 0.7 px.
const SHARE: f64 = 0.06;

/// The second derivatives are more than those beside them: the same of two degrees of freedom, 0.15 % by noise.
const ALONE: f64 = 13.0;

/// Pixels to the windows beside, which share no sample with it.
const APART: usize = 2 * HALF + 1;

/// Variance of a second derivative over that of the samples.
const SPREAD: f64 = 4.0 / 70.0;

/// Whether the window of a sample with this uncertainty bends where those beside it do not.
pub(super) fn is_crease(
    (width, height): (usize, usize),
    samples: &Raster,
    pixel: usize,
    sigma: f64,
    link: Link,
) -> bool {
    let (column, row, middle) = (pixel % width, pixel / width, samples.at(pixel));
    let variance = variance(sigma, f64::from(middle.own_share));
    let second = |at: usize| second_derivatives((width, height), samples, at, link);
    let Some([uu, vv, uv]) = second(pixel) else { return false };
    // NaN fails the comparison.
    if (uu * uu + vv * vv) / SPREAD + 100.0 * uv * uv <= BENT * variance {
        return false;
    }
    let beyond = |own: f64, axis: usize, sides: [Option<usize>; 2]| {
        let joined = |at: &usize| link.joins(&middle, &samples.at(*at), APART);
        let (mut sum, mut count) = (0.0, 0.0);
        for beside in sides.into_iter().flatten().filter(joined).filter_map(second) {
            (sum, count) = (sum + beside[axis], count + 1.0);
        }
        // Of a bend alone, of the same sense or none.
        let off = if count > 0.0 { own.abs() - own.signum() * sum / count } else { 0.0 };
        off.max(0.0).powi(2) / (SPREAD * variance * (1.0 + 1.0 / count.max(1.0)))
    };
    let columns = [(column >= APART).then(|| pixel - APART), (column + APART < width).then(|| pixel + APART)];
    let rows = [
        (row >= APART).then(|| pixel - APART * width),
        (row + APART < height).then(|| pixel + APART * width),
    ];
    beyond(uu, 0, columns) + beyond(vv, 1, rows) > ALONE
}

/// Second derivatives of the inverse depth by columns, by rows and by both, of the quadratic over the window of a pixel; `None` where it is not whole.
fn second_derivatives(
    (width, height): (usize, usize),
    samples: &Raster,
    pixel: usize,
    link: Link,
) -> Option<[f64; 3]> {
    if !samples.is_whole((width, height), pixel, HALF) {
        return None;
    }
    let (centre, first) = (samples.at(pixel), pixel - HALF * width - HALF);
    let (mut uu, mut vv, mut uv, mut worst) = (0.0, 0.0, 0.0, 0.0_f64);
    for r in 0..=2 * HALF {
        let v = r as f64 - HALF as f64;
        for (k, depth) in samples.depths[first + r * width..][..=2 * HALF].iter().enumerate() {
            let (u, off) = (k as f64 - HALF as f64, depth - centre.inverse_depth);
            uu += (u * u - 2.0) * off;
            vv += (v * v - 2.0) * off;
            uv += u * v * off;
            worst = worst.max(off.abs());
        }
    }
    let joined = worst <= link.limit(centre.inverse_depth, 2.0 * centre.sigma, HALF);
    joined.then_some([uu * (2.0 / 70.0), vv * (2.0 / 70.0), uv * 0.01])
}

/// Uncertainty that the blunt crease adds to the inverse depth of a sample, 1/mm; 0 where no samples lie on both sides of it.
pub(super) fn error((width, height): (usize, usize), samples: &Raster, pixel: usize, link: Link) -> f64 {
    let (column, row, middle) = (pixel % width, pixel / width, samples.at(pixel));
    let bend = |inside: bool, step: usize| {
        let (before, after) = if inside { (pixel - step, pixel + step) } else { return 0.0 };
        let [before, after] = [before, after].map(|at| samples.at(at));
        let joined = [before, after].iter().all(|beside| link.joins(&middle, beside, BESIDE));
        if joined { before.inverse_depth - 2.0 * middle.inverse_depth + after.inverse_depth } else { 0.0 }
    };
    let along = bend(column >= BESIDE && column + BESIDE < width, BESIDE);
    let across = bend(row >= BESIDE && row + BESIDE < height, BESIDE * width);
    SHARE * (along * along + across * across).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::Sample;
    use super::*;
    use crate::math::random::{Key, normal_quantile};

    /// A crease of |t|/2, blurred by a Gaussian, by sums over it.
    fn blunt(t: f64, sigma: f64) -> f64 {
        let steps = || (-400..=400).map(|i| f64::from(i) * 0.01);
        let weight = |x: f64| crate::math::exp(-0.5 * x * x);
        steps().map(|x| weight(x) * 0.5 * (t + sigma * x).abs()).sum::<f64>()
            / steps().map(weight).sum::<f64>()
    }

    /// Half the Laplacian times the square of the footprint, by a quadratic over five pixels, as [`crate::decode`] takes it off.
    fn corrected(t: f64, sigma: f64) -> f64 {
        let fitted = (-2..=2).map(f64::from).map(|k| (k * k - 2.0) * blunt(t + k, sigma)).sum::<f64>();
        blunt(t, sigma) - 0.5 * sigma * sigma * 2.0 * fitted / 14.0
    }

    #[test]
    fn the_share_is_what_the_correction_leaves() {
        for (sigma, least, most) in [(0.4, 0.02, 0.04), (0.53, 0.03, 0.05), (0.7, 0.05, SHARE)] {
            let (mut left, mut bend) = (0.0, 0.0);
            for t in (-15..=15).map(|i| 0.1 * f64::from(i)) {
                let reach = BESIDE as f64;
                let second = blunt(t - reach, sigma) - 2.0 * blunt(t, sigma) + blunt(t + reach, sigma);
                left += (corrected(t, sigma) - 0.5 * t.abs()).powi(2);
                bend += second * second;
            }
            let share = (left / bend).sqrt();
            assert!((least..=most).contains(&share), "{sigma} px: {share}");
        }
    }

    /// Proves: of creases that one window hardly sees most are found, whichever way they run; of planes and balls next to none are.
    #[test]
    fn a_crease_is_told_from_a_curved_surface() {
        let (width, height, sigma) = (40, 40, 1e-7);
        let bent = |depth: &dyn Fn(f64, f64) -> f64, at: &dyn Fn(f64, f64) -> bool| {
            let (mut found, mut asked) = (0, 0);
            for seed in 0..12 {
                let key = Key::new(seed);
                let place = |i: usize| ((i % width) as f64 - 19.3, (i / width) as f64 - 19.6);
                let sample = |i: usize| {
                    let noise = sigma * normal_quantile(key.open(i as u64));
                    let (x, y) = place(i);
                    Sample {
                        inverse_depth: depth(x, y) + noise,
                        sigma: sigma as f32,
                        own_share: 1.0,
                        ..Sample::NONE
                    }
                };
                let raster = Raster::from(&(0..width * height).map(sample).collect::<Vec<_>>()[..]);
                for pixel in (0..width * height)
                    .filter(|i| (8..32).contains(&(i % width)) && (8..32).contains(&(i / width)))
                {
                    let (x, y) = place(pixel);
                    if at(x, y) {
                        asked += 1;
                        found += usize::from(is_crease(
                            (width, height),
                            &raster,
                            pixel,
                            sigma,
                            Link { max_step: 1e-2 },
                        ));
                    }
                }
            }
            (f64::from(u32::try_from(found).unwrap()) / f64::from(u32::try_from(asked).unwrap()), asked)
        };
        for turn in [0.0_f64, 0.4, 0.785] {
            let across = |x: f64, y: f64| crate::math::cos(turn) * x + crate::math::sin(turn) * y;
            let crease = |x: f64, y: f64| 2e-3 + 6.0 * sigma * 0.5 * across(x, y).abs();
            let (share, asked) = bent(&crease, &|x, y| across(x, y).abs() < 0.5);
            assert!(share > 0.6 && asked > 200, "turn {turn}: {share} of {asked}");
        }
        let anywhere = |_: f64, _: f64| true;
        let (plane, _) = bent(&|x, y| 2e-3 + 1e-6 * (x + y), &anywhere);
        // A ball of 40 pixels radius of 5 sigma each, seen from in front to some 40 degrees.
        let ball = |x: f64, y: f64| 2e-3 + 5.0 * sigma * (1600.0 - x * x - y * y).sqrt();
        let (ball, _) = bent(&ball, &anywhere);
        assert!(plane < 0.005 && ball < 0.01, "{plane} {ball}");
    }

    /// Proves: the uncertainty follows the change of the slope whichever way the crease runs, and is 0 on planes, at borders and beside a jump.
    #[test]
    fn a_crease_adds_what_its_slopes_say() {
        let (width, height, slope) = (15, 15, 1e-6);
        let raster = |depth: &dyn Fn(f64, f64) -> f64| {
            let at = |i: usize| depth((i % width) as f64 - 7.0, (i / width) as f64 - 7.0);
            let sample = |i: usize| Sample { inverse_depth: at(i), sigma: 0.0, ..Sample::NONE };
            Raster::from(&(0..width * height).map(sample).collect::<Vec<_>>()[..])
        };
        let ask =
            |raster: &Raster, pixel: usize| error((width, height), raster, pixel, Link { max_step: 1e-2 });
        let middle = 7 * width + 7;
        let expected = SHARE * 4.0 * slope;
        for turn in [0.0_f64, 0.4, 0.785, 1.571] {
            let (c, s) = (crate::math::cos(turn), crate::math::sin(turn));
            let found = ask(&raster(&|x, y| 2e-3 + slope * (c * x + s * y).abs()), middle);
            assert!((found / expected - 1.0).abs() < 1e-6, "{turn}: {found} {expected}");
        }
        let plane = raster(&|x, y| 2e-3 + slope * (x - 0.3 * y));
        assert!((0..width * height).all(|pixel| ask(&plane, pixel) < 1e-12));
        let crease = raster(&|x, _| 2e-3 + slope * (x + 7.0).abs());
        assert!(ask(&crease, 7 * width) < 1e-12);
        let jump = raster(&|x, _| if x > 1.0 { 4e-3 } else { 2e-3 + slope * x.abs() });
        assert!(ask(&jump, middle) < 1e-12);
    }
}

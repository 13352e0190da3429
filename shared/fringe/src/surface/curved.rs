//! What a quadratic over a window takes off a curved surface.
//!
//! Read at its middle, the least-squares quadratic misses what is of fourth order: (m₄₀ (f_uuuu + f_vvvv) + 6 m₂₂ f_uuvv)/24, m the moments of the
//! weights that it gives the samples. Seen steeply, a ball has a depth of large fourth derivatives: over 5 × 5 pixels a ball of 33 pixels radius
//! becomes 0.03 pixels too large in diameter, over 7 × 7 pixels 0.1. They follow from the first and second derivatives where the curvature does not change
//! over the window: in a frame along the slope, with c the cosine and s the sine of the incidence, α the second derivative along the slope and β the
//! one across,
//!
//! ```text
//! f₁₁₁₁ = 3 α³ c² (1 + 4 s²),      f₁₁₂₂ = α² β c² (1 + 2 s²),      f₂₂₂₂ = 3 α β² c²
//! ```
//!
//! (a paraboloid about the normal and the fourth order of the ball on it; the slope and the curvatures are taken to have the same directions). Of
//! balls of 33 and 48 pixels, up to 65°, and of 24, up to 60°, a twenty-fifth of what was missed is left at most. Noise makes cubes of curvatures too large: the mean of α³ is
//! that of the surface and 3 α times the variance, which is taken off, and alike of the other products.

/// What the window takes off of the biharmonic and of f_uuvv, by its half width: −m₄₀/24 and (2 m₄₀ − 6 m₂₂)/24.
const SHARES: [[f64; 2]; 4] = [
    [0.0, 0.0],
    [0.0, 1.0 / 9.0],
    [0.085_714_285_714_285_72, 0.828_571_428_571_428_6],
    [0.428_571_428_571_428_55, 3.142_857_142_857_143],
];

/// Variance of a second derivative by a window's half width, over that of independent samples: mean over all directions.
const BENDS: [f64; 4] = [0.0, 1.6, 0.048, 0.0058];

/// Noise of the other view is interpolated: what is left of it at the periods of such windows is so much more than of independent samples of its variance
/// (spectrum of a Gaussian that leaves a mean of the windows' shares in [`super::shares`]).
const OF_OTHER: f64 = 2.3;

/// A window whose second derivatives are more than noise: their squares over their variances, of three degrees of freedom, 0.3 % by noise.
pub(super) const BENT: f64 = 14.0;

/// With more depth noise than this, in pixels on the surface, derivatives say less of the curvature than noise hides of it.
const MOST_NOISE: f64 = 0.5;

/// Variance of a second derivative's sample, of which a share is its own: see [`OF_OTHER`].
#[inline(always)]
pub(super) fn variance(sigma: f64, own: f64) -> f64 {
    sigma * sigma * (own + OF_OTHER * (1.0 - own))
}

/// Derivatives of the inverse depth by columns and rows, 1/mm per pixel and per squared pixel.
#[derive(Clone, Copy)]
pub(super) struct Derivatives {
    pub u: f64,
    pub v: f64,
    pub uu: f64,
    pub uv: f64,
    pub vv: f64,
}

/// What to add to the quadratic's inverse depth at the middle of a window of a half width. Of the sample: its inverse depth, its uncertainty and the
/// share of its variance that is its own; and the length of a pixel in the image plane.
#[inline(always)]
pub(super) fn missing(half: usize, d: Derivatives, [inverse_depth, sigma, own]: [f64; 3], pitch: f64) -> f64 {
    let [of_all, of_cross] = SHARES[half];
    let scale = inverse_depth.abs() * pitch;
    let noise = sigma * (1.0 / scale);
    let variance = BENDS[half] * noise * noise * (own + OF_OTHER * (1.0 - own));
    let [biharmonic, fuuvv] = fourth_order(d, scale, variance);
    let missing = of_all * biharmonic + of_cross * fuuvv;
    // NaN fails the comparison.
    if sigma <= MOST_NOISE * scale { missing * scale } else { 0.0 }
}

/// The biharmonic and f_uuvv, in pixels of depth, of which one is so much inverse depth; second derivatives have such a variance by noise.
#[inline(always)]
pub(super) fn fourth_order(d: Derivatives, scale: f64, variance: f64) -> [f64; 2] {
    let per_pixel = 1.0 / scale;
    let (gu, gv) = (d.u * per_pixel, d.v * per_pixel);
    let (huu, huv, hvv) = (d.uu * per_pixel, d.uv * per_pixel, d.vv * per_pixel);
    let (gu2, gv2, guv) = (gu * gu, gv * gv, gu * gv);
    // Never zero: where there is no slope, nothing is missed.
    let slope2 = gu2 + gv2 + 1e-9;
    // One quotient for 1/slope² and c².
    let both = 1.0 / (slope2 * (1.0 + slope2));
    let (over_slope2, cosine2) = (both * (1.0 + slope2), both * slope2);
    let sine2 = slope2 * cosine2;
    let along = (gu2 * huu + 2.0 * guv * huv + gv2 * hvv) * over_slope2;
    let across = (gv2 * huu - 2.0 * guv * huv + gu2 * hvv) * over_slope2;
    let f1111 = 3.0 * along * (along * along - 3.0 * variance) * cosine2 * (1.0 + 4.0 * sine2);
    let f1122 = across * (along * along - variance) * cosine2 * (1.0 + 2.0 * sine2);
    let f2222 = 3.0 * along * (across * across - variance) * cosine2;
    // Turned from the slope to columns and rows.
    let oblique = guv * guv * over_slope2 * over_slope2;
    let fuuvv = f1122 + oblique * (f1111 + f2222 - 6.0 * f1122);
    [f1111 + 2.0 * f1122 + f2222, fuuvv]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weights by which a least-squares quadratic gives its value at the middle: constant and square terms alone count there.
    fn moments(half: i32) -> [f64; 2] {
        let places: Vec<(f64, f64)> =
            (-half..=half).flat_map(|v| (-half..=half).map(move |u| (f64::from(u), f64::from(v)))).collect();
        let sum = |f: &dyn Fn(f64, f64) -> f64| places.iter().map(|(u, v)| f(*u, *v)).sum::<f64>();
        // a + b (u² + v²): of weight one, and without squares.
        let (ones, squares) = (sum(&|_, _| 1.0), sum(&|u, v| u * u + v * v));
        let (first, second) = (sum(&|u, _| u * u), sum(&|u, v| u * u * (u * u + v * v)));
        let b = 1.0 / (squares - ones * second / first);
        let weight = |u: f64, v: f64| b * (u * u + v * v - second / first);
        [sum(&|u, v| weight(u, v) * u.powi(4)), sum(&|u, v| weight(u, v) * u * u * v * v)]
    }

    #[test]
    fn the_shares_are_those_of_the_weights() {
        for half in 1..=3 {
            let [m40, m22] = moments(half);
            let [of_all, of_cross] = SHARES[half as usize];
            assert!((of_all + m40 / 24.0).abs() < 1e-12, "{half}: {m40}");
            assert!((of_cross - (2.0 * m40 - 6.0 * m22) / 24.0).abs() < 1e-12, "{half}: {m22}");
        }
    }

    /// A ball of 48 pixels at 0.21 mm per pixel: exact derivatives at any slope, in any direction, give the weights' own error.
    #[test]
    fn what_a_ball_loses_is_given_back() {
        let (radius, pitch, away_mm) = (48.0_f64, 4e-4, 500.0);
        let pixel_mm = pitch * away_mm;
        let inverse = |x: f64, y: f64| 1.0 / (away_mm - pixel_mm * (radius * radius - x * x - y * y).sqrt());
        // Over 7 × 7 pixels what is of sixth order counts as well.
        for (half, left) in [(1_usize, 0.12), (2, 0.12), (3, 0.3)] {
            for (degrees, turn) in [(0.0_f64, 0.0_f64), (30.0, 0.3), (50.0, 0.8), (60.0, 1.2), (60.0, 0.0)] {
                let at = radius * crate::math::sin(degrees.to_radians());
                let (x, y) = (at * crate::math::cos(turn), at * crate::math::sin(turn));
                let f = |u: f64, v: f64| inverse(x + u, y + v);
                let [m40, m22] = moments(half as i32);
                let reach = half as i32;
                let mut read = 0.0;
                // The quadratic's value at the middle, by its weights: b (u² + v² − q), b and q from the moments' sums.
                let sums = |power: i32| (-reach..=reach).map(|u| f64::from(u).powi(power)).sum::<f64>();
                let side = sums(0);
                let q = (side * sums(4) + sums(2) * sums(2)) / (side * sums(2));
                let b = 1.0 / (2.0 * side * sums(2) - side * side * q);
                for v in -reach..=reach {
                    for u in -reach..=reach {
                        let (u, v) = (f64::from(u), f64::from(v));
                        read += b * (u * u + v * v - q) * f(u, v);
                    }
                }
                let step = 1e-2;
                let second = |a: f64, c: f64, e: f64| (a - 2.0 * c + e) / (step * step);
                let derivatives = Derivatives {
                    u: (f(step, 0.0) - f(-step, 0.0)) / (2.0 * step),
                    v: (f(0.0, step) - f(0.0, -step)) / (2.0 * step),
                    uu: second(f(step, 0.0), f(0.0, 0.0), f(-step, 0.0)),
                    vv: second(f(0.0, step), f(0.0, 0.0), f(0.0, -step)),
                    uv: (f(step, step) - f(step, -step) - f(-step, step) + f(-step, -step))
                        / (4.0 * step * step),
                };
                let truth = f(0.0, 0.0);
                let added = missing(half, derivatives, [truth, 0.0, 1.0], pitch);
                let (before, after) = (read - truth, read + added - truth);
                let scale = truth * pitch;
                assert!(
                    after.abs() < left * before.abs() + 1e-4 * scale,
                    "{half}, {degrees}°, {turn}: {} became {} px ({m40}, {m22})",
                    before / scale,
                    after / scale
                );
            }
        }
    }

    #[test]
    fn noise_and_absent_samples_add_nothing() {
        let steep = Derivatives { u: 1e-6, v: 0.0, uu: 1e-7, uv: 0.0, vv: 1e-7 };
        let scale = 2e-3 * 4e-4;
        assert!(missing(2, steep, [2e-3, 0.1 * scale, 1.0], 4e-4) > 0.0);
        assert_eq!(missing(2, steep, [2e-3, 0.6 * scale, 1.0], 4e-4), 0.0);
        assert_eq!(missing(2, steep, [f64::NAN, 0.0, 1.0], 4e-4), 0.0);
    }
}

//! Local models of the phase over a 2 × 2 cell.

#![allow(
    clippy::inline_always,
    reason = "patches passed through memory cost 20 ns per point in stalled loads"
)]

use serde::{Deserialize, Serialize};

/// How the right phase is read between pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Least-squares quadratic over 4 × 4 pixels, bilinear where there is no such neighbourhood.
    #[default]
    Quadratic,
    /// Third-degree Lagrange polynomials over 4 × 4 pixels, bilinear where there is no such neighbourhood.
    Cubic,
    /// Bilinear between the four nearest pixels, everywhere.
    Bilinear,
}

/// Residual of the quadratic beyond the noise that one surface may have, as a share of the phase step per pixel.
///
/// A depth step of h pixels of phase leaves a residual of 0.22 h; creases of real parts leave 0.02.
pub(super) const MAX_ROUGHNESS: f32 = 0.1;

/// Residuals of this many phase sigmas are noise: 16 samples less 6 parameters scatter by a factor of 1 ± 0.22.
pub(super) const MAX_NOISE: f32 = 2.0;

/// The local model of the phase minus the wanted one, around the centre of a 2 × 2 cell, in pixels (ξ, η):
/// a + bξ ξ + bη η + cξξ (ξ² − 5/4) + cξη ξη + cηη (η² − 5/4); a bilinear patch has no square terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Patch {
    pub(super) a: f32,
    pub(super) b: [f32; 2],
    pub(super) c: [f32; 3],
    pub(super) kind: Interpolation,
}

impl Patch {
    /// Least-squares quadratic over 4 × 4 samples at ±1/2, ±3/2 by orthogonal polynomials; `None` where the samples
    /// are not all valid, or rougher than noise and one smooth surface explain.
    #[inline(always)]
    pub(super) fn quadratic(samples: &[[f32; 4]; 4], sigma: f32) -> Option<Patch> {
        // Sums over the lines first, four columns at a time; then along them.
        let [l0, l1, l2, l3] = samples;
        let (mut zeroth, mut first, mut second, mut squares) =
            ([0.0_f32; 4], [0.0_f32; 4], [0.0_f32; 4], [0.0_f32; 4]);
        for i in 0..4 {
            let (inner, outer) = (l1[i] + l2[i], l0[i] + l3[i]);
            zeroth[i] = inner + outer;
            first[i] = 1.5 * (l3[i] - l0[i]) + 0.5 * (l2[i] - l1[i]);
            second[i] = outer - inner;
            squares[i] = l0[i] * l0[i] + l1[i] * l1[i] + l2[i] * l2[i] + l3[i] * l3[i];
        }
        let sum = |v: [f32; 4]| (v[0] + v[3]) + (v[1] + v[2]);
        let slope = |v: [f32; 4]| 1.5 * (v[3] - v[0]) + 0.5 * (v[2] - v[1]);
        let (a, bx, cxx) = (sum(zeroth), slope(zeroth), (zeroth[0] + zeroth[3]) - (zeroth[1] + zeroth[2]));
        let (by, cxy, cyy, squares) = (sum(first), slope(first), sum(second), sum(squares));
        // Norms of the polynomials: Σ1 = 16, Σξ² = 20, Σ(ξ² − 5/4)² = 16, Σξ²η² = 25.
        let explained =
            a * a / 16.0 + (bx * bx + by * by) / 20.0 + (cxx * cxx + cyy * cyy) / 16.0 + cxy * cxy / 25.0;
        let (a, bx, by, cxx, cxy, cyy) = (a / 16.0, bx / 20.0, by / 20.0, cxx / 16.0, cxy / 25.0, cyy / 16.0);
        let residual = (squares - explained) / 10.0;
        let noise = MAX_NOISE * sigma;
        // The cancellation in `residual` is good to 1e-6 of the squares: allow for it.
        let limit = noise * noise + MAX_ROUGHNESS * MAX_ROUGHNESS * (bx * bx + by * by) + 1e-6 * squares;
        // NaN (a masked sample) fails the comparison.
        let patch = Patch { a, b: [bx, by], c: [cxx, cxy, cyy], kind: Interpolation::Quadratic };
        (residual <= limit).then_some(patch)
    }

    /// Third-degree Lagrange interpolation, expanded to second order around the place where it is read.
    pub(super) fn cubic(samples: &[[f32; 4]; 4], offset: [f64; 2]) -> Patch {
        let (wx, sx) = lagrange(offset[0] as f32);
        let (wy, sy) = lagrange(offset[1] as f32);
        let sum = |columns: &[f32; 4], rows: &[f32; 4]| -> f32 {
            let line = |values: &[f32; 4]| values.iter().zip(columns).map(|(v, w)| v * w).sum::<f32>();
            samples.iter().zip(rows).map(|(values, w)| w * line(values)).sum()
        };
        let (value, gx, gy) = (sum(&wx, &wy), sum(&sx, &wy), sum(&wx, &sy));
        let (xi, eta) = (offset[0] as f32, offset[1] as f32);
        Patch { a: value - gx * xi - gy * eta, b: [gx, gy], c: [0.0; 3], kind: Interpolation::Cubic }
    }

    /// Value and slope along a tangent. Single precision: the values are differences below 2π, good to 1e-6.
    #[inline(always)]
    fn along(&self, [xi, eta]: [f32; 2], tangent: [f32; 2]) -> (f32, f32) {
        let [bx, by] = self.b;
        let [cxx, cxy, cyy] = self.c;
        let square = 1.25;
        let value =
            self.a + xi * (bx + cxy * eta) + by * eta + cxx * (xi * xi - square) + cyy * (eta * eta - square);
        let gx = bx + 2.0 * cxx * xi + cxy * eta;
        let gy = by + 2.0 * cyy * eta + cxy * xi;
        (value, gx * tangent[0] + gy * tangent[1])
    }

    /// Second derivative along a tangent.
    #[inline(always)]
    fn bend(&self, [tx, ty]: [f32; 2]) -> f32 {
        let [cxx, cxy, cyy] = self.c;
        2.0 * (cxx * tx * tx + cxy * tx * ty + cyy * ty * ty)
    }

    /// Newton steps along a tangent to where the model vanishes (along a line it is a parabola), and the slope there.
    #[inline(always)]
    pub(super) fn step(&self, offset: [f64; 2], tangent: [f64; 2], pitch: f64) -> (f64, f64) {
        // In pixels, to keep the numbers of single precision near one.
        let tangent = tangent.map(|t| (t * pitch) as f32);
        let (value, slope) = self.along(offset.map(|o| o as f32), tangent);
        let bend = self.bend(tangent);
        let inverse = 1.0 / slope;
        let mut step = -value * inverse;
        step -= 0.5 * bend * step * step * inverse;
        // The second step removes what the first leaves on strongly curved phase.
        step -= (value + step * (slope + 0.5 * bend * step)) / (slope + bend * step);
        (f64::from(step) * pitch, f64::from(slope + bend * step) / pitch)
    }

    /// The sum of squared weights of the quadratic.
    #[inline(always)]
    pub(super) fn quadratic_variance(xi: f64, eta: f64) -> f64 {
        let (x2, y2) = (xi * xi, eta * eta);
        let (px, py) = (x2 - 1.25, y2 - 1.25);
        0.0625 * (1.0 + px * px + py * py) + 0.05 * (x2 + y2) + 0.04 * x2 * y2
    }

    /// Sum of squared weights: the variance of the read phase over that of a pixel.
    ///
    /// Means over the cell: quadratic 0.242, bilinear 4/9, cubic 0.60.
    #[inline]
    pub(super) fn variance_factor(&self, xi: f64, eta: f64) -> f64 {
        let (x2, y2) = (xi * xi, eta * eta);
        match self.kind {
            Interpolation::Quadratic => Self::quadratic_variance(xi, eta),
            Interpolation::Bilinear => (0.5 + 2.0 * x2) * (0.5 + 2.0 * y2),
            Interpolation::Cubic => {
                let squares = |t: f64| lagrange(t as f32).0.iter().map(|w| f64::from(w * w)).sum::<f64>();
                squares(xi) * squares(eta)
            }
        }
    }
}

/// Lagrange weights over −3/2, −1/2, 1/2, 3/2 and their derivatives.
fn lagrange(t: f32) -> ([f32; 4], [f32; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    let weights = [
        (-1.0 / 16.0) + t / 24.0 + t2 / 4.0 - t3 / 6.0,
        (9.0 / 16.0) - 9.0 * t / 8.0 - t2 / 4.0 + t3 / 2.0,
        (9.0 / 16.0) + 9.0 * t / 8.0 - t2 / 4.0 - t3 / 2.0,
        (-1.0 / 16.0) - t / 24.0 + t2 / 4.0 + t3 / 6.0,
    ];
    let slopes = [
        1.0 / 24.0 + t / 2.0 - t2 / 2.0,
        -9.0 / 8.0 - t / 2.0 + 1.5 * t2,
        9.0 / 8.0 - t / 2.0 - 1.5 * t2,
        -1.0 / 24.0 + t / 2.0 + t2 / 2.0,
    ];
    (weights, slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled(f: impl Fn(f64, f64) -> f64) -> [[f32; 4]; 4] {
        let mut samples = [[0.0; 4]; 4];
        for (row, line) in samples.iter_mut().enumerate() {
            for (column, value) in line.iter_mut().enumerate() {
                *value = f(column as f64 - 1.5, row as f64 - 1.5) as f32;
            }
        }
        samples
    }

    const PLACES: [[f64; 2]; 5] = [[0.0, 0.0], [0.5, -0.5], [-0.31, 0.2], [0.1, 0.47], [-0.5, -0.5]];

    #[test]
    fn quadratics_are_reproduced_exactly() {
        let f = |x: f64, y: f64| 0.3 + 0.25 * x - 0.03 * y + 0.004 * x * x - 0.003 * x * y + 0.002 * y * y;
        let patch = Patch::quadratic(&sampled(f), 0.0).unwrap();
        for [xi, eta] in PLACES {
            let (value, slope) = patch.along([xi as f32, eta as f32], [1.0, 0.0]);
            assert!((f64::from(value) - f(xi, eta)).abs() < 1e-7);
            assert!((f64::from(slope) - (0.25 + 0.008 * xi - 0.003 * eta)).abs() < 1e-6);
        }
    }

    #[test]
    fn cubics_are_reproduced_by_lagrange() {
        let f = |x: f64, y: f64| 0.3 + 0.25 * x - 0.03 * y + 0.004 * x * x * x - 0.003 * x * y * y;
        for [xi, eta] in PLACES {
            let patch = Patch::cubic(&sampled(f), [xi, eta]);
            let (value, slope) = patch.along([xi as f32, eta as f32], [1.0, 0.0]);
            assert!((f64::from(value) - f(xi, eta)).abs() < 1e-6);
            assert!((f64::from(slope) - (0.25 + 0.012 * xi * xi - 0.003 * eta * eta)).abs() < 1e-5);
        }
    }

    /// The factor equals the sum of squared responses to unit impulses, computed from the model itself.
    #[test]
    fn the_variance_factor_is_the_sum_of_squared_weights() {
        for kind in [Interpolation::Quadratic, Interpolation::Cubic] {
            for [xi, eta] in PLACES {
                let mut sum = 0.0;
                for pixel in 0..16 {
                    let mut samples = [[0.0; 4]; 4];
                    samples[pixel / 4][pixel % 4] = 1.0;
                    let patch = match kind {
                        Interpolation::Cubic => Patch::cubic(&samples, [xi, eta]),
                        _ => Patch::quadratic(&samples, 10.0).unwrap(),
                    };
                    let weight = f64::from(patch.along([xi as f32, eta as f32], [0.0, 0.0]).0);
                    sum += weight * weight;
                }
                let patch = Patch { a: 0.0, b: [0.0; 2], c: [0.0; 3], kind };
                assert!((sum - patch.variance_factor(xi, eta)).abs() < 1e-5, "{kind:?} at {xi}, {eta}");
            }
        }
    }

    #[test]
    fn mean_noise_of_the_three_ways_is_as_documented() {
        for (kind, wanted) in [
            (Interpolation::Quadratic, 0.242),
            (Interpolation::Bilinear, 4.0 / 9.0),
            (Interpolation::Cubic, 0.602),
        ] {
            let patch = Patch { a: 0.0, b: [0.0; 2], c: [0.0; 3], kind };
            let n = 100;
            let place = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
            let mean = (0..n * n).map(|i| patch.variance_factor(place(i % n), place(i / n))).sum::<f64>()
                / (n * n) as f64;
            assert!((mean - wanted).abs() < 0.002, "{kind:?}: {mean}");
        }
    }

    #[test]
    fn jumps_and_masks_are_refused_while_noise_passes() {
        let ramp = |x: f64, _: f64| 0.25 * x;
        let step = |x: f64, y: f64| ramp(x, y) + if x > 0.0 { 0.25 } else { 0.0 };
        assert!(Patch::quadratic(&sampled(ramp), 0.01).is_some());
        assert!(Patch::quadratic(&sampled(step), 0.01).is_none(), "one pixel of depth step");
        let mut masked = sampled(ramp);
        masked[3][0] = f32::NAN;
        assert!(Patch::quadratic(&masked, 0.01).is_none());
        let crease = |x: f64, _: f64| if x > 0.0 { 0.3 * x } else { 0.2 * x };
        assert!(Patch::quadratic(&sampled(crease), 0.0).is_some(), "a crease is one surface");
    }
}

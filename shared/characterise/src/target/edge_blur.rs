//! The blur of the two edges through a corner, with its tails.
//!
//! A point spread is no Gaussian: a pixel is a box, a lens has tails. What shifts a phase is the second moment of what a pixel
//! averages, and a Gaussian fitted to tails misses it (0.50 px for 0.58 px where the excess is 2). So the profile gets a
//! second parameter, the excess κ of Gram and Charlier: P(t) = erf(t/√2) − κ/12 (t³ − 3t) φ(t), whose second moment is σ² for any κ.

use super::crossing::{Crossing, Edge, Line, SHARED};
use super::normal::{Model, Pixels, Range};
use super::solve::{Ending, fit};
use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use fringe::math::sincos;
use nalgebra::{Point2, SVector, Vector2};

/// Parameters of a corner: place, angles, blurs, levels.
const PARAMETERS: usize = 12;
/// Those of a corner, then κ₁ and κ₂.
const WITH_TAILS: usize = PARAMETERS + 2;
/// No profile is sharper, px: less than a pixel's own width.
const SHARPEST_PX: f64 = 0.2;
/// The fit starts at least here, px.
const START_PX: f64 = 0.4;

/// A straight edge in the image and its blur.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlurredEdge {
    /// Root of the second moment of the line spread, px; the pixel's own area is part of it.
    pub sigma_px: f64,
    /// Its standard uncertainty from the noise left by the fit, px.
    pub u_px: f64,
    /// Excess κ of the line spread: 0 of a Gaussian, positive with tails.
    pub excess: f64,
    /// Unit normal of the edge in the image.
    pub normal: Vector2<f64>,
    /// Where it was looked at, px.
    pub pixel: Point2<f64>,
}

/// Both edges of a corner that has been fitted, by its reach (px) and the curvatures of its edges (1/px); `None` where the window does not determine their tails.
pub(crate) fn blurred_edges(
    (reach_px, curvature): (f64, [f64; 2]),
    corner: &SVector<f64, PARAMETERS>,
    pixel: Point2<f64>,
    pixels: &Pixels,
    (range, ending): (Range, Ending),
) -> Option<[BlurredEdge; 2]> {
    let mut start = SVector::<f64, WITH_TAILS>::zeros();
    start.fixed_rows_mut::<PARAMETERS>(0).copy_from(corner);
    for sigma in [4, 5] {
        start[sigma] = start[sigma].max(START_PX);
    }
    let tails = Tails { reach_px, half_curvature: curvature.map(|c| 0.5 * c) };
    let solved = fit(&tails, start, pixels, range, ending)?;
    let edge = |i: usize| {
        let (sin, cos) = sincos(solved.parameters[2 + i]);
        BlurredEdge {
            sigma_px: solved.parameters[4 + i].max(SHARPEST_PX),
            u_px: solved.covariance(4 + i)[4 + i].sqrt(),
            excess: solved.parameters[PARAMETERS + i],
            normal: Vector2::new(-sin, cos),
            pixel,
        }
    };
    Some([edge(0), edge(1)])
}

/// The model of a corner with tails; the blur of the light's slopes is of second order here.
struct Tails {
    reach_px: f64,
    half_curvature: [f64; 2],
}

/// An edge at one set of parameters.
struct TailedEdge {
    line: Line,
    excess: f32,
}

impl Edge<5> for TailedEdge {
    /// The fifth derivative is by κ.
    #[inline(always)]
    fn at<S: Simd>(&self, dx: f32x16<S>, dy: f32x16<S>) -> (f32x16<S>, [f32x16<S>; 5]) {
        let line = &self.line;
        let [along, straight, s] = line.place(dx, dy);
        let t = s * line.sharpness;
        let (value, density) = line.profile.at(t);
        // The table's density is 2 φ.
        let (t2, cubic) = (t * t, t * (t * t - 3.0));
        let by_excess = cubic * density * (-1.0 / 24.0);
        let quartic = t2 * t2 - 6.0 * t2 + 3.0;
        let by_s = density * (1.0 + self.excess / 24.0 * quartic) * line.sharpness;
        let bend = 2.0 * line.half_curvature * along;
        let by = [
            by_s * (line.sin + bend * line.cos),
            -by_s * (line.cos - bend * line.sin),
            -by_s * (along + bend * straight),
            // By σ: sharpness is 1/σ, and by_s holds one of them already.
            -t * by_s,
            by_excess,
        ];
        (value + self.excess * by_excess, by)
    }
}

impl Model<WITH_TAILS> for Tails {
    type Prepared = ([TailedEdge; 2], SVector<f32, WITH_TAILS>);

    fn prepare(&self, p: &SVector<f64, WITH_TAILS>) -> Self::Prepared {
        let edge = |i: usize| TailedEdge {
            line: Line::new(p[2 + i], p[4 + i].max(SHARPEST_PX), self.half_curvature[i]),
            excess: p[PARAMETERS + i] as f32,
        };
        ([edge(0), edge(1)], p.cast())
    }

    #[inline(always)]
    fn evaluate<S: Simd>(
        &self,
        (edges, p): &Self::Prepared,
        x: f32x16<S>,
        y: f32x16<S>,
    ) -> (f32x16<S>, [f32x16<S>; WITH_TAILS]) {
        let crossing = Crossing::new(edges, p, (1.0 / self.reach_px) as f32, [x, y]);
        let ([(_, d1), (_, d2)], [u, v], [a, b]) = (&crossing.edges, crossing.place, crossing.weights);
        let own = [u * crossing.product, v * crossing.product, a * d1[4], b * d2[4]];
        let mut slope = [u; WITH_TAILS];
        slope[..SHARED].copy_from_slice(&crossing.shared());
        slope[SHARED..].copy_from_slice(&own);
        (crossing.ground + crossing.contrast * crossing.product, slope)
    }
}

#[cfg(test)]
mod tests {
    use super::super::normal::evaluated;
    use super::*;

    /// The derivatives are those of the value, and a flat profile has none.
    #[test]
    fn derivatives_agree_with_differences() {
        let tails = Tails { reach_px: 8.0, half_curvature: [1e-3, -2e-3] };
        let p = SVector::<f64, WITH_TAILS>::from_row_slice(&[
            0.2, -0.3, 0.1, 1.7, 0.6, 0.5, 100.0, 3.0, -2.0, -60.0, 4.0, 5.0, 0.8, -0.3,
        ]);
        for (x, y) in [(0.4, 0.1), (-1.0, 0.7), (2.0, -0.2)] {
            let (_, by) = evaluated(&tails, &p, x, y);
            for (i, by) in by.iter().enumerate() {
                let value = |step: f64| {
                    let mut q = p;
                    q[i] += step;
                    f64::from(evaluated(&tails, &q, x, y).0)
                };
                let (difference, by) = ((value(2e-3) - value(-2e-3)) / 4e-3, f64::from(*by));
                // Values of some 100 are single precision: their differences have three digits.
                let room = 2e-3 * by.abs().max(5.0);
                assert!((difference - by).abs() < room, "{i} at ({x}, {y}): {difference} and {by}");
            }
        }
    }
}

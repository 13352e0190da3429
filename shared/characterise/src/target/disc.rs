//! One circle to the noise limit: a blurred ellipse on an uneven ground.
//!
//! I(x) = (1 + g·x)·(m + A·P(s/σ)) with P(t) = erf(t/√2) and s the distance from the ellipse dᵀMd = 1, positive outside, to first
//! order: s = (q − 1)·q/|Md| with q² = dᵀMd. The inside of a small circle is too small to show how light falls on it, so one
//! slope g of the light serves disc and ground; blurred, it moves the edge by σ²·g, as for a corner.

use super::normal::{Model, Pixels, Range, Sample};
use super::profile::Profile;
use super::raster::{Grey, Image};
use super::solve::{Ending, SETTLED_SIGMAS, fit};
use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use nalgebra::{Matrix2, Point2, SVector, Vector2};

/// cx, cy, M₁₁, M₁₂, M₂₂, σ, m, gx, gy, A.
const PARAMETERS: usize = 10;
const START_BLUR_PX: f64 = 1.0;
/// As for corners: an edge that was sharpened is fitted with this blur held.
const LEAST_BLUR_PX: f64 = 0.4;
/// Smallest semi-axis that leaves an inside, px.
const LEAST_RADIUS_PX: f64 = 1.5;

/// A circle with its uncertainty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Disc {
    pub pixel: Point2<f64>,
    pub covariance_px2: Matrix2<f64>,
    pub blur_px: f64,
    /// Positive when the disc is darker than the ground.
    pub contrast_dn: f64,
    pub residual_dn: f64,
    /// Matrix of the ellipse, 1/px²: dᵀMd = 1.
    pub shape: Matrix2<f64>,
}

impl Disc {
    /// Radius of the circle of equal area, px. Blur moves a curved edge inwards by σ²/(2r), which is given back here.
    pub fn radius_px(&self) -> f64 {
        let seen = 1.0 / self.shape.determinant().sqrt().sqrt();
        seen + self.blur_px * self.blur_px / (2.0 * seen)
    }
}

struct Ellipse {
    reach_px: f64,
}

impl Model<PARAMETERS> for Ellipse {
    type Prepared = (&'static Profile, SVector<f32, PARAMETERS>);

    fn prepare(&self, p: &SVector<f64, PARAMETERS>) -> Self::Prepared {
        (Profile::table(), p.cast())
    }

    #[inline(always)]
    fn evaluate<S: Simd>(
        &self,
        (profile, p): &Self::Prepared,
        x: f32x16<S>,
        y: f32x16<S>,
    ) -> (f32x16<S>, [f32x16<S>; PARAMETERS]) {
        let (dx, dy) = (x - p[0], y - p[1]);
        let (mx, my) = (p[2] * dx + p[3] * dy, p[3] * dx + p[4] * dy);
        let q = (mx * dx + my * dy).max(1e-12).sqrt();
        let length = (mx * mx + my * my).max(1e-24).sqrt();
        let sigma = p[5].max(LEAST_BLUR_PX as f32);
        let t = (q - 1.0) * q / length / sigma;
        let (profile, density) = profile.at(t);
        let density = density / sigma;
        let scale = (1.0 / self.reach_px) as f32;
        let (u, v) = (x * scale, y * scale);
        let (nx, ny) = (mx / length, my / length);
        let (light, base) = (1.0 + p[7] * u + p[8] * v, p[6] + p[9] * profile);
        // x and y through the blur.
        let blurred = sigma * sigma * p[9] * scale * density;
        let (by_gx, by_gy) = (u * base + blurred * nx, v * base + blurred * ny);
        // By s, whose scale q/|Md| is taken as constant: its change is of the order of s, where the density ends.
        let by_s = light * p[9] * density;
        let by_m = by_s / (2.0 * length);
        let by_sigma = by_s * t * -f32::from(p[5] > LEAST_BLUR_PX as f32);
        let slope = [
            -by_s * nx,
            -by_s * ny,
            by_m * dx * dx,
            by_m * (2.0 * dx * dy),
            by_m * dy * dy,
            by_sigma,
            light,
            by_gx,
            by_gy,
            light * profile,
        ];
        (light * base + (p[7] * nx + p[8] * ny) * blurred, slope)
    }
}

/// Fits an ellipse, started from a centre and the second moments of its area, px². The window reaches `margin_px` beyond it.
pub(crate) fn refine(
    image: &Image,
    full_scale_dn: f64,
    centre: Point2<f64>,
    moments: &Matrix2<f64>,
    margin_px: f64,
) -> Option<Disc> {
    // Of a full ellipse the second moments are a quarter of its inverse matrix.
    let shape = (moments * 4.0).try_inverse()?;
    let origin = Point2::new(centre.x.round(), centre.y.round());
    let samples = samples(image, origin, centre, &(moments * 4.0), &shape, margin_px)?;
    let reach_px = 2.0 * moments.trace().sqrt() + margin_px;
    let (levels, count) =
        samples.iter().fold(([0.0; 2], [0.0; 2]), |(mut sum, mut count), (sample, inside)| {
            sum[usize::from(*inside)] += f64::from(sample.value);
            count[usize::from(*inside)] += 1.0;
            (sum, count)
        });
    let (outside, inside) = (levels[0] / f64::max(count[0], 1.0), levels[1] / f64::max(count[1], 1.0));
    let offset = centre - origin;
    let start = SVector::from([
        offset.x,
        offset.y,
        shape[(0, 0)],
        shape[(0, 1)],
        shape[(1, 1)],
        START_BLUR_PX,
        0.5 * (outside + inside),
        0.0,
        0.0,
        0.5 * (outside - inside),
    ]);
    let pixels: Pixels = samples.into_iter().map(|(sample, _)| sample).collect();
    // Further off than its own size it is another one.
    let ending = Ending { settled_sigmas: SETTLED_SIGMAS, leash_px: reach_px };
    let solved = fit(&Ellipse { reach_px }, start, &pixels, Range::of(&pixels, full_scale_dn), ending)?;
    let p = solved.parameters;
    let shape = Matrix2::new(p[2], p[3], p[3], p[4]);
    let positive = shape.determinant() > 0.0 && shape.trace() > 0.0;
    positive.then(|| Disc {
        pixel: Point2::new(origin.x + p[0], origin.y + p[1]),
        covariance_px2: solved.covariance_px2(),
        blur_px: p[5].max(LEAST_BLUR_PX),
        contrast_dn: p[9],
        residual_dn: solved.residual_dn,
        shape,
    })
}

/// Pixels of the ellipse and its margin, and whether each lies inside; `None` where they leave the image or are too many.
fn samples(
    image: &Image,
    origin: Point2<f64>,
    centre: Point2<f64>,
    inverse: &Matrix2<f64>,
    shape: &Matrix2<f64>,
    margin_px: f64,
) -> Option<Vec<(Sample, bool)>> {
    let half = Vector2::new(inverse[(0, 0)].max(0.0).sqrt(), inverse[(1, 1)].max(0.0).sqrt())
        .map(|h| (h + margin_px).ceil());
    let smaller =
        (shape.trace() * 0.5 + (0.25 * shape.trace().powi(2) - shape.determinant()).max(0.0).sqrt()).sqrt();
    let inside_image = origin.x - half.x >= 0.0
        && origin.y - half.y >= 0.0
        && origin.x + half.x < image.width as f64
        && origin.y + half.y < image.height as f64;
    // A shape that is not finite is in no range.
    let sound = (LEAST_RADIUS_PX..200.0).contains(&(1.0 / smaller)) && (0.0..200.0).contains(&half.amax());
    if !inside_image || !sound {
        return None;
    }
    let mut samples = Vec::new();
    for row in (origin.y - half.y) as usize..=(origin.y + half.y) as usize {
        for column in (origin.x - half.x) as usize..=(origin.x + half.x) as usize {
            let at = Point2::new(column as f64, row as f64);
            let d = at - centre;
            let m = shape * d;
            let q = d.dot(&m).max(1e-12).sqrt();
            let distance = (q - 1.0) * q / m.norm().max(1e-12);
            if distance <= margin_px {
                let sample = Sample {
                    x: (at.x - origin.x) as f32,
                    y: (at.y - origin.y) as f32,
                    value: image.get(column, row),
                };
                samples.push((sample, q < 1.0));
            }
        }
    }
    Some(samples)
}

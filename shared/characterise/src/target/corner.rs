//! One corner of a checkerboard to the noise limit: two blurred edges through a point.
//!
//! I(x) = m + g·x + (A + h·x)·P(s₁/σ₁)·P(s₂/σ₂) with P(t) = erf(t/√2) and sᵢ the distance from edge i. Levels and
//! their slopes (light that falls unevenly, on dark as on light squares) are part of the model: without the slope h of the
//! contrast, uneven light would pull the corner: blurred, a slope of the light moves an edge by σ²·h/A, so the model takes
//! h·x through the blur as h·x + σ²·h·∇. The product is exact for edges at right angles under Gaussian blur;
//! for others it errs symmetrically about the corner, which leaves the corner's position alone.

use super::crossing::{Crossing, Edge, Line, SHARED};
use super::edge_blur::{BlurredEdge, blurred_edges};
use super::normal::{Model, Pixels, Range, normal};
use super::raster::Image;
use super::solve::{Ending, SETTLED_SIGMAS, fit};
use super::window::{Cross, Window};
use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use fringe::math::atan2;
use nalgebra::{Matrix2, Point2, SVector, Vector2};

/// cx, cy, θ₁, θ₂, σ₁, σ₂, m, gx, gy, A, hx, hy.
const PARAMETERS: usize = 12;
/// Where a first fit ends, in standard deviations: a second one follows.
const ROUGHLY_SIGMAS: f64 = 1.0;
/// With more pixels than this a first fit takes half of them.
const ENOUGH: usize = 200;
/// The blur of the optics starts here, px.
const START_BLUR_PX: f64 = 1.0;
/// A pixel's own width blurs an edge by 0.29 px, and some optics follow; an edge that was sharpened is fitted with this
/// blur held.
const LEAST_BLUR_PX: f64 = 0.4;
/// Largest change of the contrast and of the light from the middle of a window to its rim, as a part of the contrast.
const STEEPEST: f64 = 0.6;

/// The image and how it is looked at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub image: &'a Image<'a>,
    pub full_scale_dn: f64,
    pub min_contrast_dn: f64,
    pub window: Window,
    /// Whether the blur of the edges is told as well.
    pub edge_blur: bool,
}

/// Where a corner is expected.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    pub pixel: Point2<f64>,
    /// To the next corner along the first and the second edge, px.
    pub along: [Vector2<f64>; 2],
    /// Curvature of the two edges through the lens, 1/px: the edge is at sᵢ = κᵢ tᵢ²/2.
    pub curvature: [f64; 2],
    /// Whether the square between the first and the second edge is light.
    pub light: bool,
    /// A corner further from here than this, px, is another one.
    pub leash_px: f64,
}

/// A corner with its uncertainty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    pub pixel: Point2<f64>,
    pub covariance_px2: Matrix2<f64>,
    /// Mean of σ₁ and σ₂.
    pub blur_px: f64,
    /// −A: positive when the square between the first and the second edge is light.
    pub contrast_dn: f64,
    pub residual_dn: f64,
    /// Both edges, each with its own blur, of a second fit that tells them.
    pub edges: Option<[BlurredEdge; 2]>,
    /// Directions of the edges, rad, turned by less than a quarter from those expected.
    pub angle_rad: [f64; 2],
    /// Of the model, for a second fit to start from.
    parameters: SVector<f64, PARAMETERS>,
}

struct TwoEdges {
    /// Scale of the slopes, px: makes all linear parameters range values.
    reach_px: f64,
    curvature: [f64; 2],
}

/// An edge at one set of parameters.
struct PlainEdge {
    line: Line,
    /// 1, or 0 where σ is held at its least value.
    free: f32,
}

impl PlainEdge {
    /// σ²·∂P/∂n of the derivatives that [`Edge::at`] gives, along x and y.
    #[inline(always)]
    fn blurred_slope<S: Simd>(&self, derivatives: &[f32x16<S>; 4]) -> [f32x16<S>; 2] {
        let variance = -1.0 / (self.line.sharpness * self.line.sharpness);
        [derivatives[0] * variance, derivatives[1] * variance]
    }
}

impl Edge<4> for PlainEdge {
    #[inline(always)]
    fn at<S: Simd>(&self, dx: f32x16<S>, dy: f32x16<S>) -> (f32x16<S>, [f32x16<S>; 4]) {
        let line = &self.line;
        let [along, _, s] = line.place(dx, dy);
        let scaled = s * line.sharpness;
        let (value, density) = line.profile.at(scaled);
        let by_s = density * line.sharpness;
        let by_sigma = scaled * by_s * -self.free;
        // ds/dc = −n: the curvature's part is a thousandth of it.
        (value, [by_s * line.sin, by_s * -line.cos, -by_s * along, by_sigma])
    }
}

impl Model<PARAMETERS> for TwoEdges {
    type Prepared = ([PlainEdge; 2], SVector<f32, PARAMETERS>);

    fn prepare(&self, p: &SVector<f64, PARAMETERS>) -> Self::Prepared {
        let edge = |i: usize| PlainEdge {
            line: Line::new(p[2 + i], p[4 + i].max(LEAST_BLUR_PX), 0.5 * self.curvature[i]),
            free: f32::from(p[4 + i] > LEAST_BLUR_PX),
        };
        ([edge(0), edge(1)], p.cast())
    }

    #[inline(always)]
    fn evaluate<S: Simd>(
        &self,
        (edges, p): &Self::Prepared,
        x: f32x16<S>,
        y: f32x16<S>,
    ) -> (f32x16<S>, [f32x16<S>; PARAMETERS]) {
        let scale = (1.0 / self.reach_px) as f32;
        let crossing = Crossing::new(edges, p, scale, [x, y]);
        let ([(first, d1), (second, d2)], [u, v]) = (&crossing.edges, crossing.place);
        // x and y through the blur, over P₁P₂; their change with the shape parameters is of second order.
        let (b1, b2) = (edges[0].blurred_slope(d1), edges[1].blurred_slope(d2));
        let by_hx = u * crossing.product + (b1[0] * *second + b2[0] * *first) * scale;
        let by_hy = v * crossing.product + (b1[1] * *second + b2[1] * *first) * scale;
        let value = crossing.ground + p[9] * crossing.product + p[10] * by_hx + p[11] * by_hy;
        let mut slope = [by_hx; PARAMETERS];
        slope[..SHARED].copy_from_slice(&crossing.shared());
        slope[SHARED + 1] = by_hy;
        (value, slope)
    }
}

/// Fits the model around an expected corner; `None` when the image holds no such corner there.
///
/// From scratch the fit ends near the place. With `first`, the corner that this gave, it starts there, with the
/// curvature that is now known, and ends at the noise limit.
pub(crate) fn refine(
    view: &View,
    expected: &Expected,
    window: Window,
    first: Option<&Corner>,
) -> Option<Corner> {
    let (image, full_scale_dn) = (view.image, view.full_scale_dn);
    let origin = Point2::new(expected.pixel.x.round(), expected.pixel.y.round());
    let cross = Cross::about(expected.pixel, expected.along, window, image)?;
    let reach_px = cross.reach_px;
    let thinned = first.is_none() && cross.count() > ENOUGH;
    let pixels = cross.pixels(image, origin, thinned);
    let range = Range::of(&pixels, full_scale_dn);
    let model = TwoEdges { reach_px, curvature: expected.curvature };
    let offset = expected.pixel - origin;
    let start = match first {
        Some(corner) => {
            let mut start = corner.parameters;
            start.fixed_rows_mut::<2>(0).copy_from(&offset);
            start
        }
        None => from_scratch(&model, expected, offset, &pixels)?,
    };
    let settled_sigmas = if first.is_some() { SETTLED_SIGMAS } else { ROUGHLY_SIGMAS };
    let ending = Ending { settled_sigmas, leash_px: expected.leash_px };
    let solved = fit(&model, start, &pixels, range, ending)?;
    let p = solved.parameters;
    // Where the contrast ends within the window there is a corner of one square, not of four.
    // The same where the light would have to change that much: one dark square whose opposite is beyond full scale.
    let steep = |x: f64, y: f64| x * x + y * y > (STEEPEST * p[9]).powi(2);
    if steep(p[10], p[11]) || steep(p[7], p[8]) {
        return None;
    }
    let pixel = Point2::new(origin.x + p[0], origin.y + p[1]);
    // Where the fit ends, the blur is told once more, with its tails.
    let edges = first
        .filter(|_| view.edge_blur)
        .and_then(|_| blurred_edges((reach_px, expected.curvature), &p, pixel, &pixels, (range, ending)));
    Some(Corner {
        pixel,
        edges,
        covariance_px2: solved.covariance_px2(),
        blur_px: 0.5 * (p[4].max(LEAST_BLUR_PX) + p[5].max(LEAST_BLUR_PX)),
        // Between the first and the second edge s₁ is positive and s₂ negative. Light beyond full scale is a guess.
        contrast_dn: (-p[9]).clamp(-0.5 * full_scale_dn, 0.5 * full_scale_dn),
        residual_dn: solved.residual_dn,
        angle_rad: [p[2], p[3]],
        parameters: p,
    })
}

/// Start parameters by the expectation; `None` when light and dark lie the other way round.
fn from_scratch(
    model: &TwoEdges,
    expected: &Expected,
    offset: Vector2<f64>,
    pixels: &Pixels,
) -> Option<SVector<f64, PARAMETERS>> {
    let angles = expected.along.map(|e| atan2(e.y, e.x));
    let mut start = SVector::<f64, PARAMETERS>::zeros();
    start.fixed_rows_mut::<6>(0).copy_from_slice(&[
        offset.x,
        offset.y,
        angles[0],
        angles[1],
        START_BLUR_PX,
        START_BLUR_PX,
    ]);
    start_levels(model, &mut start, pixels);
    ((start[9] < 0.0) == expected.light).then_some(start)
}

/// Mean and signed contrast of the pixels for the start: a regression on P₁P₂.
fn start_levels(model: &TwoEdges, start: &mut SVector<f64, PARAMETERS>, pixels: &Pixels) {
    // Without light yet, the residuals are the range values.
    let sums = normal(model, start, pixels, Range::OPEN);
    let (sum, sum_p, sum_pp, sum_pv) =
        (sums.vector[6], sums.matrix[(9, 6)], sums.matrix[(9, 9)], sums.vector[9]);
    let count = sums.count.max(1) as f64;
    let spread = (sum_pp - sum_p * sum_p / count).max(1e-9);
    start[9] = (sum_pv - sum_p * sum / count) / spread;
    start[6] = (sum - start[9] * sum_p) / count;
}

//! Two blurred edges that cross under uneven light: what the models of a corner share.

use super::profile::Profile;
use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use fringe::math::sincos;
use nalgebra::SVector;

/// Where an edge lies at one set of parameters, and how sharp it is.
pub(super) struct Line {
    pub profile: &'static Profile,
    pub sin: f32,
    pub cos: f32,
    /// Inverse of σ, 1/px.
    pub sharpness: f32,
    pub half_curvature: f32,
}

impl Line {
    /// At an angle, rad, blurred by σ, px, with half a curvature, 1/px.
    pub fn new(angle_rad: f64, sigma_px: f64, half_curvature: f64) -> Self {
        let (sin, cos) = sincos(angle_rad);
        Self {
            profile: Profile::table(),
            sin: sin as f32,
            cos: cos as f32,
            sharpness: (1.0 / sigma_px) as f32,
            half_curvature: half_curvature as f32,
        }
    }

    /// How far along the edge points relative to the corner are, px, how far from the straight edge, and from the bent one.
    #[inline(always)]
    pub fn place<S: Simd>(&self, dx: f32x16<S>, dy: f32x16<S>) -> [f32x16<S>; 3] {
        let along = self.cos * dx + self.sin * dy;
        let straight = self.cos * dy - self.sin * dx;
        [along, straight, straight - self.half_curvature * (along * along)]
    }
}

/// The profile of an edge and its derivatives, by cx, cy, θ, σ and what else the model has.
pub(super) trait Edge<const D: usize> {
    /// At points relative to the corner.
    fn at<S: Simd>(&self, dx: f32x16<S>, dy: f32x16<S>) -> (f32x16<S>, [f32x16<S>; D]);
}

/// Parameters that all models have before those of their own: cx, cy, θ₁, θ₂, σ₁, σ₂, m, gx, gy, A.
pub(super) const SHARED: usize = 10;

/// Sixteen pixels about a corner.
pub(super) struct Crossing<S: Simd, const D: usize> {
    /// P of each edge, and its derivatives.
    pub edges: [(f32x16<S>, [f32x16<S>; D]); 2],
    /// x and y over the reach of the window.
    pub place: [f32x16<S>; 2],
    /// Derivatives of the value by P₁ and P₂.
    pub weights: [f32x16<S>; 2],
    pub contrast: f32x16<S>,
    /// P₁P₂: 1 in two opposite quadrants, −1 in the others.
    pub product: f32x16<S>,
    /// Light without the edges.
    pub ground: f32x16<S>,
}

impl<S: Simd, const D: usize> Crossing<S, D> {
    /// At pixels relative to the window, whose scale is the inverse of its reach, 1/px.
    #[inline(always)]
    pub fn new<const N: usize>(
        edges: &[impl Edge<D>; 2],
        p: &SVector<f32, N>,
        scale: f32,
        [x, y]: [f32x16<S>; 2],
    ) -> Self {
        let (dx, dy) = (x - p[0], y - p[1]);
        let edges = [edges[0].at(dx, dy), edges[1].at(dx, dy)];
        let place = [x * scale, y * scale];
        let contrast = p[9] + p[10] * place[0] + p[11] * place[1];
        Self {
            edges,
            place,
            weights: [contrast * edges[1].0, contrast * edges[0].0],
            contrast,
            product: edges[0].0 * edges[1].0,
            ground: p[6] + p[7] * place[0] + p[8] * place[1],
        }
    }

    /// Derivatives by the parameters that all models have.
    #[inline(always)]
    pub fn shared(&self) -> [f32x16<S>; SHARED] {
        let ([(_, d1), (_, d2)], [a, b], [u, v]) = (&self.edges, self.weights, self.place);
        [
            a * d1[0] + b * d2[0],
            a * d1[1] + b * d2[1],
            a * d1[2],
            b * d2[2],
            a * d1[3],
            b * d2[3],
            f32x16::splat(u.simd, 1.0),
            u,
            v,
            self.product,
        ]
    }
}

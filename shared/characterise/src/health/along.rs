//! Residuals along the epipolar lines: where a view sees a place that two others fix in space.

use super::matches::{Lit, Match};
use super::parameters::{COUNT, step};
use super::rows::{CAUSES, LEAST_SIGMA_PX, Row, own_causes, tile};
use crate::calibration::{Ideal, PARAMETERS, moved};
use fringe::geometry::camera::Camera;
use fringe::geometry::triangulate::{midpoint, project_with_jacobian};
use nalgebra::{Point3, RowVector2, RowVector3, Vector2};
use rayon::prelude::*;

/// A residual of three views: the partner, the projector, the view.
pub(super) type AlongRow = Row<{ CAUSES.len() }, { 3 * COUNT }>;

/// How far the projector's pixel is moved for the residual's slope, px.
const PIXEL_STEP: f64 = 0.05;

/// A camera with each parameter lower and higher, and the difference of both values.
fn sides(camera: &Camera) -> Vec<(Camera, Camera, f64)> {
    let side = |place: usize| {
        let size = step(PARAMETERS[place]);
        let with = |by: f64| {
            let mut steps = [0.0; COUNT];
            steps[place] = by;
            moved(camera, &steps)
        };
        (with(-size), with(size), 2.0 * size)
    };
    (0..COUNT).map(side).collect()
}

/// Three views, of which two fix places in space.
struct Three<'a> {
    left: &'a Camera,
    projector: &'a Camera,
    view: &'a Camera,
    /// Of the left view, the projector and the view.
    sides: [Vec<(Camera, Camera, f64)>; 3],
}

impl Three<'_> {
    fn row(&self, m: &Match, lit: &Lit) -> Option<AlongRow> {
        let (seen_by_left, lit_by) = (Ideal::new(self.left, m.left)?, Ideal::new(self.projector, lit.pixel)?);
        let (left, beam) = (self.left.ray_through(seen_by_left.at), self.projector.ray_through(lit_by.at));
        let place = midpoint(&left, &beam)?;
        let (seen, jacobian) = project_with_jacobian(self.view, &place)?;
        // The place moves along the ray of the left view where its depth is wrong.
        let along: RowVector2<f64> = (jacobian * left.direction).try_normalize(1e-12)?.transpose();
        let by_place: RowVector3<f64> = -along * jacobian;
        let change = |low: Point3<f64>, high: Point3<f64>| (by_place * (high - low))[0];
        let mut file = [0.0; 3 * COUNT];
        let [of_left, of_projector, of_view] = &self.sides;
        for k in 0..COUNT {
            // Another lens shows another ideal point at the same pixel.
            let moved = |sides: &(Camera, Camera, f64), ideal: &Ideal| {
                let (low, high, width) = sides;
                let beside = ideal.by[k] * (0.5 * width);
                (low.ray_through(ideal.at - beside), high.ray_through(ideal.at + beside), *width)
            };
            let (low, high, width) = moved(&of_left[k], &seen_by_left);
            file[k] = change(midpoint(&low, &beam)?, midpoint(&high, &beam)?) / width;
            let (low, high, width) = moved(&of_projector[k], &lit_by);
            file[COUNT + k] = change(midpoint(&left, &low)?, midpoint(&left, &high)?) / width;
            let (low, high, width) = &of_view[k];
            file[2 * COUNT + k] = -(along * (high.project(&place)? - low.project(&place)?))[0] / width;
        }
        let beside = |axis: usize| {
            let step = lit_by.by_pixel.column(axis) * PIXEL_STEP;
            let at = |ideal: Vector2<f64>| midpoint(&left, &self.projector.ray_through(ideal));
            Some(change(at(lit_by.at - step)?, at(lit_by.at + step)?) / (2.0 * PIXEL_STEP))
        };
        let by_pixel = RowVector2::new(beside(0)?, beside(1)?);
        let variance = along * m.covariance_px2 * along.transpose()
            + along * lit.with_right_px2 * by_pixel.transpose() * 2.0
            + by_pixel * lit.covariance_px2 * by_pixel.transpose();
        let sigma_px = variance[0].max(0.0).sqrt().max(LEAST_SIGMA_PX);
        let error_px = (along * (m.right - seen))[0];
        let own: [f64; COUNT] = std::array::from_fn(|k| file[2 * COUNT + k]);
        let cause = own_causes(&own, self.view).map(|by| by / sigma_px);
        (error_px / sigma_px).is_finite().then(|| AlongRow {
            error: error_px / sigma_px,
            by: cause,
            cause,
            file: file.map(|by| by / sigma_px),
            sigma_px,
            tile: tile(m.left),
        })
    }
}

/// Residuals along the epipolar lines of the left view, with derivatives, in the order of the matches.
pub(super) fn along_rows(
    left: &Camera,
    projector: &Camera,
    view: &Camera,
    matches: &[Match],
) -> Vec<AlongRow> {
    let three = Three { left, projector, view, sides: [left, projector, view].map(sides) };
    let row = |m: &Match| three.row(m, m.lit.as_ref()?);
    // Collected in order: no result depends on the number of threads.
    matches.par_iter().map(row).collect::<Vec<_>>().into_iter().flatten().collect()
}

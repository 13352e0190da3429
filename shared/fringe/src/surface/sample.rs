//! The raster of inverse depths, and the point of a pixel.

use crate::cloud::Point;
use nalgebra::{Matrix3, Point3, Vector3};

/// What a view knows of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    /// Inverse depth, 1/mm; NaN where there is no point.
    pub inverse_depth: f64,
    /// Its standard uncertainty, 1/mm.
    pub sigma: f32,
    /// Share of its variance that comes from the pixel itself and is independent of its neighbours'; the rest comes from
    /// the other view.
    pub own_share: f32,
    /// Modulation, DN.
    pub modulation: f32,
}

impl Sample {
    pub const NONE: Sample =
        Sample { inverse_depth: f64::NAN, sigma: f32::NAN, own_share: 1.0, modulation: 0.0 };
}

/// The geometry of the raster.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub width: usize,
    pub height: usize,
    /// (x, y) of the line of sight (x, y, 1) of each pixel.
    pub directions: &'a [[f64; 2]],
    /// Length of a pixel in these coordinates.
    pub pitch: f64,
    pub world_from_sight: Matrix3<f64>,
    pub origin_mm: Point3<f64>,
    /// Optical centre of the other view, mm, seen from this one.
    pub other_mm: Vector3<f64>,
}

impl View<'_> {
    /// Whether the normal is too far from the line of sight of either view.
    #[inline]
    pub(super) fn is_steep(
        &self,
        sample: &Sample,
        pixel: usize,
        normal: &Vector3<f64>,
        min_cosine: f64,
    ) -> bool {
        let [x, y] = self.directions[pixel];
        let own = Vector3::new(x, y, 1.0);
        // The direction from the other view, scaled by the inverse depth.
        let other = own - self.other_mm * sample.inverse_depth;
        let beyond = |sight: &Vector3<f64>| -normal.dot(sight) < min_cosine * sight.norm();
        beyond(&own) || beyond(&other)
    }

    /// The point of a pixel. Its uncertainty is along the normal, or along the ray where there is no normal.
    #[inline]
    pub(super) fn point(
        &self,
        sample: &Sample,
        pixel: usize,
        pair: u32,
        normal: Option<Vector3<f64>>,
    ) -> Point {
        let [x, y] = self.directions[pixel];
        let direction = Vector3::new(x, y, 1.0);
        let depth = 1.0 / sample.inverse_depth;
        let position = self.origin_mm + self.world_from_sight * (direction * depth);
        // dX = (x, y, 1) dZ with dZ = Z² dq; along the normal, |n·(x, y, 1)| of it.
        let share = normal.map_or(direction.norm(), |n| n.dot(&direction).abs());
        let world = normal.map_or(Vector3::zeros(), |n| self.world_from_sight * n);
        Point {
            position_mm: position.into(),
            normal: [world.x as f32, world.y as f32, world.z as f32],
            sigma_mm: (share * depth * depth * f64::from(sample.sigma)) as f32,
            modulation: sample.modulation,
            pair,
            pixel: pixel as u32,
            reserved: 0,
        }
    }
}

//! From inverse depth on the pixel grid of a view to points: support, normal, uncertainty, world coordinates.
//!
//! Both matching approaches end here. The raster holds q = 1/Z, because the inverse depth of a plane n·X = c seen along
//! (x, y, 1) is q = n·(x, y, 1)/c, affine in the image: neighbours are compared, and planes fitted, without bias.

mod support;

use crate::cloud::Point;
use crate::normals;
use crate::parallel::for_parts;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Rows per part of parallel work; fixed, so that no result depends on the number of threads.
const PART_ROWS: usize = 16;

/// What counts as a surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceSettings {
    /// Neighbouring pixels whose points are connected more steeply than this (from the plane across the line of
    /// sight) lie on different surfaces, degrees.
    pub max_slope_deg: f64,
    /// Of its eight neighbours, so many have to lie on the same surface, or the point is dropped as a spike.
    pub min_neighbours: u32,
    /// Patches of fewer connected points are dropped: wrong fringe orders come in such crumbs.
    pub min_patch_points: u32,
    /// Side of the window of the normal's plane fit, px: 3 or 5.
    pub normal_window_px: u32,
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        // 80°: 1.2 mm per pixel of 0.21 mm. A corner pixel of a surface has three neighbours.
        Self { max_slope_deg: 80.0, min_neighbours: 3, min_patch_points: 30, normal_window_px: 5 }
    }
}

impl SurfaceSettings {
    /// The first setting out of its limits: key, value, limits.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64, &'static str)> {
        let slope = self.max_slope_deg;
        if !(slope > 0.0 && slope < 90.0) {
            return Some(("surface.max_slope_deg", slope, "between 0 and 90"));
        }
        if self.min_neighbours > 8 {
            return Some(("surface.min_neighbours", f64::from(self.min_neighbours), "0 … 8"));
        }
        if self.normal_window_px != 3 && self.normal_window_px != 5 {
            return Some(("surface.normal_window_px", f64::from(self.normal_window_px), "3 or 5"));
        }
        None
    }
}

/// What a view knows of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    /// Inverse depth, 1/mm; NaN where there is no point.
    pub inverse_depth: f64,
    /// Its standard uncertainty, 1/mm.
    pub sigma: f32,
    /// Modulation, DN.
    pub modulation: f32,
}

impl Sample {
    pub const NONE: Sample = Sample { inverse_depth: f64::NAN, sigma: f32::NAN, modulation: 0.0 };
}

/// How many points were dropped, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct SurfaceReport {
    /// Too few neighbours on the same surface.
    pub spikes: u32,
    /// In patches that are too small.
    pub crumbs: u32,
    /// Points written.
    pub points: u32,
    /// Of these, without a normal.
    pub without_normal: u32,
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
}

/// Buffers, allocated once.
#[derive(Debug, Clone)]
pub(crate) struct SurfaceBuilder {
    settings: SurfaceSettings,
    /// Largest relative change of q per pixel on one surface, over the pitch.
    max_tangent: f64,
    /// First pixel of each part.
    row_parts: Vec<usize>,
    counts: Vec<PartCount>,
    point_parts: Vec<usize>,
    keep: Vec<u8>,
    parents: Vec<u32>,
    sizes: Vec<u32>,
}

#[derive(Debug, Clone, Copy, Default)]
struct PartCount {
    spikes: u32,
    points: u32,
    without_normal: u32,
}

impl SurfaceBuilder {
    pub fn new(width: usize, height: usize, settings: SurfaceSettings) -> Self {
        let parts = height.div_ceil(PART_ROWS);
        let pixels = width * height;
        Self {
            settings,
            max_tangent: crate::math::tan(settings.max_slope_deg.to_radians()),
            row_parts: (0..=parts).map(|part| (part * PART_ROWS).min(height) * width).collect(),
            counts: vec![PartCount::default(); parts],
            point_parts: vec![0; parts + 1],
            keep: vec![0; pixels],
            parents: vec![0; pixels],
            sizes: vec![0; pixels],
        }
    }

    /// Drops spikes and crumbs from `samples`, then writes the points in pixel order; `out` has room for all pixels.
    pub fn build(
        &mut self,
        view: &View,
        samples: &mut [Sample],
        pair: u32,
        out: &mut [Point],
    ) -> SurfaceReport {
        let link = normals::Link { max_step: self.max_tangent * view.pitch };
        let spikes = self.drop_spikes(view, samples, link);
        let crumbs = self.drop_crumbs(view.width, samples, link);
        let (points, without_normal) = self.write(view, samples, link, pair, out);
        SurfaceReport { spikes, crumbs, points, without_normal }
    }

    fn write(
        &mut self,
        view: &View,
        samples: &[Sample],
        link: normals::Link,
        pair: u32,
        out: &mut [Point],
    ) -> (u32, u32) {
        for_parts(&self.row_parts, &mut self.keep, &mut self.counts, &|part, keep, count| {
            let first = self.row_parts[part];
            let cells = &samples[first..first + keep.len()];
            count.points = cells.iter().filter(|s| s.inverse_depth.is_finite()).count() as u32;
        });
        let mut total = 0;
        for (start, count) in self.point_parts.iter_mut().zip(&self.counts) {
            *start = total;
            total += count.points as usize;
        }
        if let Some(end) = self.point_parts.last_mut() {
            *end = total;
        }
        let half = self.settings.normal_window_px as usize / 2;
        for_parts(&self.point_parts, &mut out[..total], &mut self.counts, &|part, points, count| {
            let pixels = self.row_parts[part]..self.row_parts[part + 1];
            let filled = pixels.filter(|pixel| samples[*pixel].inverse_depth.is_finite());
            count.without_normal = 0;
            for (point, pixel) in points.iter_mut().zip(filled) {
                *point = view.point(samples, pixel, pair, link, half);
                count.without_normal += u32::from(point.normal == [0.0; 3]);
            }
        });
        (total as u32, self.counts.iter().map(|c| c.without_normal).sum())
    }
}

impl View<'_> {
    /// The point of a pixel. Its uncertainty is along the normal, or along the ray where there is no normal.
    #[inline]
    fn point(&self, samples: &[Sample], pixel: usize, pair: u32, link: normals::Link, half: usize) -> Point {
        let sample = samples[pixel];
        let [x, y] = self.directions[pixel];
        let direction = Vector3::new(x, y, 1.0);
        let depth = 1.0 / sample.inverse_depth;
        let position = self.origin_mm + self.world_from_sight * (direction * depth);
        let normal = normals::normal(self, samples, pixel, link, half);
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

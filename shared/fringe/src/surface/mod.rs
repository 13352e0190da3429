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
    /// Points that either view (camera or projector) sees more steeply than this from the normal are dropped, degrees.
    /// Towards a limb a pixel covers ever more surface: on a sphere of 22 mm at 0.21 mm per pixel the error of exact
    /// phase is below 0.4 µm up to 65°, 1 µm at 70°, 3 µm at 75°, 8 µm at 80°.
    pub max_incidence_deg: f64,
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        // 80°: 1.2 mm per pixel of 0.21 mm. A corner pixel of a surface has three neighbours.
        Self {
            max_slope_deg: 80.0,
            min_neighbours: 3,
            min_patch_points: 30,
            normal_window_px: 5,
            max_incidence_deg: 70.0,
        }
    }
}

impl SurfaceSettings {
    /// The first setting out of its limits: key, value, limits.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64, &'static str)> {
        let slope = self.max_slope_deg;
        if !(slope > 0.0 && slope < 90.0) {
            return Some(("surface.max_slope_deg", slope, "between 0 and 90"));
        }
        let incidence = self.max_incidence_deg;
        if !(incidence > 0.0 && incidence <= 90.0) {
            return Some(("surface.max_incidence_deg", incidence, "above 0, up to 90"));
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
    /// Seen too steeply.
    pub steep: u32,
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
    /// Optical centre of the other view, mm, seen from this one.
    pub other_mm: Vector3<f64>,
}

/// Buffers, allocated once.
#[derive(Debug, Clone)]
pub(crate) struct SurfaceBuilder {
    settings: SurfaceSettings,
    /// Largest relative change of q per pixel on one surface, over the pitch.
    max_tangent: f64,
    /// Smallest cosine between normal and lines of sight.
    min_cosine: f64,
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
    steep: u32,
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
            min_cosine: crate::math::cos(settings.max_incidence_deg.to_radians()),
            row_parts: (0..=parts).map(|part| (part * PART_ROWS).min(height) * width).collect(),
            counts: vec![PartCount::default(); parts],
            point_parts: vec![0; parts + 1],
            keep: vec![0; pixels],
            parents: vec![0; pixels],
            sizes: vec![0; pixels],
        }
    }

    /// Drops spikes, crumbs and steep points from `samples`, then writes the points in pixel order; `out` has room for all pixels.
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
        let written = self.write(view, samples, link, pair, out);
        SurfaceReport { spikes, crumbs, ..written }
    }

    fn write(
        &mut self,
        view: &View,
        samples: &[Sample],
        link: normals::Link,
        pair: u32,
        out: &mut [Point],
    ) -> SurfaceReport {
        let filled = |pixel: &usize| samples[*pixel].inverse_depth.is_finite();
        let mut total = 0;
        for (part, start) in self.point_parts.iter_mut().enumerate() {
            *start = total;
            if let Some(end) = self.row_parts.get(part + 1) {
                total += (self.row_parts[part]..*end).filter(filled).count();
            }
        }
        let half = self.settings.normal_window_px as usize / 2;
        for_parts(&self.point_parts, &mut out[..total], &mut self.counts, &|part, points, count| {
            *count = PartCount::default();
            let mut room = points.iter_mut();
            for pixel in (self.row_parts[part]..self.row_parts[part + 1]).filter(filled) {
                let normal = normals::normal(view, samples, pixel, link, half);
                if normal.is_some_and(|n| view.is_steep(&samples[pixel], pixel, &n, self.min_cosine)) {
                    count.steep += 1;
                } else if let Some(point) = room.next() {
                    *point = view.point(&samples[pixel], pixel, pair, normal);
                    count.points += 1;
                    count.without_normal += u32::from(normal.is_none());
                }
            }
        });
        self.close_gaps(out)
    }

    /// Moves the points of all parts together and adds up their counts.
    fn close_gaps(&self, out: &mut [Point]) -> SurfaceReport {
        let mut report = SurfaceReport::default();
        for (start, count) in self.point_parts.iter().zip(&self.counts) {
            let end = report.points as usize;
            if *start != end {
                out.copy_within(*start..*start + count.points as usize, end);
            }
            report.points += count.points;
            report.steep += count.steep;
            report.without_normal += count.without_normal;
        }
        report
    }
}

impl View<'_> {
    /// Whether the normal is too far from the line of sight of either view.
    #[inline]
    fn is_steep(&self, sample: &Sample, pixel: usize, normal: &Vector3<f64>, min_cosine: f64) -> bool {
        let [x, y] = self.directions[pixel];
        let own = Vector3::new(x, y, 1.0);
        // The direction from the other view, scaled by the inverse depth.
        let other = own - self.other_mm * sample.inverse_depth;
        let beyond = |sight: &Vector3<f64>| -normal.dot(sight) < min_cosine * sight.norm();
        beyond(&own) || beyond(&other)
    }

    /// The point of a pixel. Its uncertainty is along the normal, or along the ray where there is no normal.
    #[inline]
    fn point(&self, sample: &Sample, pixel: usize, pair: u32, normal: Option<Vector3<f64>>) -> Point {
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

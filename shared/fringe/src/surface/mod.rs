//! From inverse depth on the pixel grid of a view to points: support, normal, uncertainty, world coordinates.
//!
//! Both matching approaches end here. The raster holds q = 1/Z, because the inverse depth of a plane n·X = c seen along
//! (x, y, 1) is q = n·(x, y, 1)/c, affine in the image: neighbours are compared, and planes fitted, without bias.

mod buffers;
mod build;
mod normals;
mod sample;
mod support;

pub(crate) use buffers::SurfaceBuilder;
pub(crate) use sample::{Sample, View};

use serde::{Deserialize, Serialize};

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

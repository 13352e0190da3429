//! From inverse depth on the pixel grid of a view to points: support, normal, uncertainty, world coordinates.
//!
//! Both matching approaches end here. The raster holds q = 1/Z, because the inverse depth of a plane n·X = c seen along
//! (x, y, 1) is q = n·(x, y, 1)/c, affine in the image: neighbours are compared, and planes fitted, without bias.

mod broken;
mod buffers;
mod build;
mod cause;
mod crease;
mod curved;
mod gaps;
mod independence;
mod joints;
mod limb;
mod marks;
mod normals;
mod patches;
mod point;
mod quick;
mod raster;
mod rim;
mod scatter;
mod shares;
mod smooth;
mod support;
mod windows;

pub(crate) use buffers::SurfaceBuilder;
pub use cause::Cause;
pub(crate) use independence::{Independence, WINDOWS, independence};
pub(crate) use limb::{Reach, mark_limbs, reach_px};
pub(crate) use marks::{OTHER, OWN, RIM};
pub(crate) use point::{Sample, View, axis_of, rim_is_hidden};
pub(crate) use raster::Samples;
pub(crate) use rim::{mark_missing, mark_rims};
pub(crate) use shares::Shares;
pub(crate) use windows::{LANES, taken};

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
    /// Points that either view (camera or projector) sees more steeply than this from the normal are dropped, degrees; only beyond more where the
    /// error of the footprint is small beside the noise of the point. At less too where a curved surface turns away from a camera and ends nearby in its
    /// picture (half a window of derivatives and four footprints, some five pixels): there phases of something else take part, and what the
    /// correction of the footprint leaves is −1 to −12 µm on spheres at 0.21 mm per pixel. Flat faces have no limb and keep their points.
    pub max_incidence_deg: f64,
    /// Points nearer than this many pixels to where their surface ends in the picture are dropped: the footprint of
    /// their pixels reaches over the rim and shifts their phase. A footprint of 0.58 px (standard deviation) moves
    /// points at a distance of 1 px by 0.05 px, of 2 px by nothing. 0 keeps all.
    pub edge_px: u32,
    /// Side of the window over which the inverse depth is smoothed by a quadratic, px: 1 (not at all), 3, 5 or 7. On
    /// the surface this is the finest detail; it leaves 1, 0.79, 0.47 or 0.34 of the scatter of single points.
    pub smoothing_px: u32,
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
            edge_px: 2,
            smoothing_px: 5,
        }
    }
}

impl SurfaceSettings {
    /// Variance that smoothing leaves of the points' noise, of which the share `own` is independent from point to point, where both views see
    /// the surface at the same scale.
    pub fn noise_share(&self, own: f64) -> f64 {
        Shares::new([0.0; 2]).left(self.smoothing_half(), own, 1.0)
    }

    /// Least cosine of the incidence at which points are kept whose depth noise is so many pixels on the surface.
    pub fn least_cosine(&self, noise_px: f64) -> f64 {
        point::steepest(crate::math::cos(self.max_incidence_deg.to_radians()), noise_px)
    }

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
        if self.edge_px > 8 {
            return Some(("surface.edge_px", f64::from(self.edge_px), "0 … 8"));
        }
        if self.smoothing_px.is_multiple_of(2) || self.smoothing_half() > shares::MAX_HALF {
            return Some(("surface.smoothing_px", f64::from(self.smoothing_px), "1, 3, 5 or 7"));
        }
        None
    }

    fn smoothing_half(&self) -> usize {
        self.smoothing_px as usize / 2
    }
}

/// How many points were dropped, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct SurfaceReport {
    /// Too few neighbours on the same surface.
    pub spikes: u32,
    /// In patches that are too small.
    pub crumbs: u32,
    /// Points dropped because the surface is seen too steeply, or ends in a limb nearby.
    pub steep: u32,
    /// At the rim of their surface.
    pub rims: u32,
    /// Too uncertain after smoothing.
    pub uncertain: u32,
    /// Points written to the cloud.
    pub points: u32,
    /// Of these, without a normal.
    pub without_normal: u32,
}

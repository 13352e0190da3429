//! How a camera is matched with its projector.

use crate::matching::{MatchError, check_depth};
use crate::surface::SurfaceSettings;
use serde::{Deserialize, Serialize};

/// Settings of the intersection of camera rays with projector planes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProjectorSettings {
    /// Nearest and farthest depth along the optical axis of the camera, mm; absent: everything in front of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_mm: Option<[f64; 2]>,
    /// Largest disagreement of the two axes, projector pixels: beyond it one fringe order is wrong.
    pub max_epipolar_px: f64,
    /// Projector coordinates may exceed its image by this, px.
    pub margin_px: f64,
    /// What counts as a surface.
    pub surface: SurfaceSettings,
}

impl Default for ProjectorSettings {
    fn default() -> Self {
        Self { depth_mm: None, max_epipolar_px: 2.0, margin_px: 0.5, surface: SurfaceSettings::default() }
    }
}

impl ProjectorSettings {
    /// Refuses settings out of range.
    pub(super) fn check(&self) -> Result<(), MatchError> {
        if let Some((key, value, limits)) = self.surface.fault() {
            return Err(MatchError::Setting { key, value, limits });
        }
        check_depth(self.depth_mm)?;
        for (key, value) in [("max_epipolar_px", self.max_epipolar_px), ("margin_px", self.margin_px)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(MatchError::Setting { key, value, limits: "zero or a positive number" });
            }
        }
        Ok(())
    }
}

//! Settings of the matching and their limits.

use super::epipolar_rows::StepLimits;
use super::error::MatchError;
use super::patch::Interpolation;
use crate::surface::SurfaceSettings;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Settings of the search for corresponding pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MatchSettings {
    /// Nearest and farthest depth along the optical axis of the left camera, mm; absent: everything in front of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_mm: Option<[f64; 2]>,
    /// How the right phase is read between pixels.
    pub interpolation: Interpolation,
    /// Neighbouring pixels whose phases differ by more than this, by more than noise and by more than three times the usual step lie on
    /// different surfaces, projector pixels.
    pub max_step_px: f64,
    /// Steps against the sense of the phase along a row beyond this end a surface, projector pixels.
    pub max_back_step_px: f64,
    /// Two places of equal phase this close in a row are one (noise), camera pixels.
    pub left_right_tolerance_px: f64,
    /// Points whose disparity is less certain after smoothing are dropped, camera pixels.
    pub max_disparity_sigma_px: f64,
    /// What counts as a surface.
    pub surface: SurfaceSettings,
}

/// Noise of so many standard deviations of a cell is no step: 4.2 of a difference.
const STEP_SIGMAS: f32 = 6.0;

/// A projector with many pixels for one of the camera makes large steps everywhere: so many times the usual one are an edge.
const STEP_RATIO: f32 = 3.0;

impl Default for MatchSettings {
    fn default() -> Self {
        Self {
            depth_mm: None,
            interpolation: Interpolation::default(),
            max_step_px: 6.0,
            max_back_step_px: 0.5,
            left_right_tolerance_px: 1.5,
            max_disparity_sigma_px: 1.0,
            surface: SurfaceSettings::default(),
        }
    }
}

impl MatchSettings {
    /// Checks every number against its limits.
    ///
    /// # Errors
    /// [`MatchError::Setting`] names key, value and limits.
    pub fn check(&self) -> Result<(), MatchError> {
        if let Some((key, value, limits)) = self.surface.fault() {
            return Err(MatchError::Setting { key, value, limits });
        }
        check_depth(self.depth_mm)?;
        let positive = [
            ("max_step_px", self.max_step_px),
            ("max_back_step_px", self.max_back_step_px),
            ("left_right_tolerance_px", self.left_right_tolerance_px),
            ("max_disparity_sigma_px", self.max_disparity_sigma_px),
        ];
        match positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            Some((key, value)) => {
                Err(MatchError::Setting { key, value: *value, limits: "a positive number" })
            }
            None => Ok(()),
        }
    }

    /// Limits on the steps of a row whose cells have this noise and these usual steps.
    pub(super) fn step_limits(&self, period_px: f64, noise_rad: f32, step_rad: f32) -> StepLimits {
        let rad = TAU / period_px;
        StepLimits {
            max_rad: ((self.max_step_px * rad) as f32).max(STEP_RATIO * step_rad) + STEP_SIGMAS * noise_rad,
            back_rad: (self.max_back_step_px * rad) as f32,
        }
    }
}

/// Checks the limits of the depth.
pub(crate) fn check_depth(depth_mm: Option<[f64; 2]>) -> Result<(), MatchError> {
    let Some([near, far]) = depth_mm else { return Ok(()) };
    if !(near.is_finite() && near > 0.0) {
        return Err(MatchError::Setting { key: "depth_mm[0]", value: near, limits: "a positive number" });
    }
    if !(far.is_finite() && far > near) {
        return Err(MatchError::Setting {
            key: "depth_mm[1]",
            value: far,
            limits: "larger than depth_mm[0]",
        });
    }
    Ok(())
}

//! Settings of the twin: every imperfection of projector, sensor and stand on its own.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A setting outside its range.
#[derive(Debug, Error, Clone, PartialEq)]
#[error("{key} = {value} must be {limit}")]
pub struct SettingError {
    /// Key of the setting.
    pub key: &'static str,
    /// Value given for the setting.
    pub value: f64,
    /// What it may be.
    pub limit: &'static str,
}

/// The imperfections. The default is a realistic cell, [`TwinSettings::ideal`] has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TwinSettings {
    /// Seed of pose scatter, vibration and noise: the same seed gives the same bytes.
    pub seed: u64,
    /// Seed of vibration and noise, for views of a part that stays where `seed` put it; absent: `seed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_seed: Option<u64>,
    /// Factor on all light. At 1 white Nylon (albedo 0.7) that faces the projector fills 60 % of the sensor's range in
    /// the middle of the part, and up to 80 % with its gloss on raised places; from about 1.2 on these saturate.
    pub exposure: f64,
    /// Bits per pixel: 8, 10, 12 or 16.
    pub bits: u8,
    /// Rays per pixel along each axis, averaged: 1 takes the pixel's centre; n > 1 is the true footprint, at n² the cost.
    /// Printed patterns are then averaged exactly over each ray's share of the pixel, outlines in n² steps.
    pub subsamples: u32,
    /// Uniform scatter of the part's position from cycle to cycle, ± mm per axis.
    pub position_scatter_mm: f64,
    /// Uniform scatter of the part's orientation from cycle to cycle, ± degrees about each axis.
    pub angle_scatter_deg: f64,
    /// Random displacement of the part from frame to frame, standard deviation per axis, µm.
    pub vibration_um: f64,
    /// Displacement of the part along the world's z axis from each frame to the next, µm: a part that moves.
    pub drift_um: f64,
    /// Projector response: light = level^gamma; 1 is linear.
    pub projector_gamma: f64,
    /// Projector blur, standard deviation of a Gaussian, projector pixels.
    pub projector_blur_px: f64,
    /// Further blur of the projector per mm of distance from its plane of focus, which runs through the middle of the part, standard
    /// deviation in projector pixels; added in quadrature.
    pub defocus_px_per_mm: f64,
    /// Whether levels are rounded to 8 bits.
    pub projector_8bit: bool,
    /// Whether the light is constant over a projector pixel, as from a DMD, or follows the formula in between.
    pub projector_pixels: bool,
    /// Light of the black level as a fraction of white.
    pub projector_leak: f64,
    /// Camera lens blur, standard deviation of a Gaussian, camera pixels.
    pub camera_blur_px: f64,
    /// Whether the pixel's area (variance 1/12 px²) blurs too; with `subsamples` > 1 the rays do that already.
    pub pixel_footprint: bool,
    /// Ambient light as a fraction of the projector's white at the part.
    pub ambient: f64,
    /// Rays per pixel that collect the light of the first bounce between surfaces; 0 is none. Few rays make a grainy, unbiased picture of it.
    pub bounce_rays: u32,
    /// Strength added to the specular lobe of every surface, in units of reflectance: a shiny part.
    pub gloss: f64,
    /// Signal of a dark pixel as a fraction of full scale.
    pub black_level: f64,
    /// Whether photons come at random.
    pub shot_noise: bool,
    /// Electrons at full scale; sets the shot noise.
    pub full_well_e: f64,
    /// Noise of the read-out, standard deviation in electrons.
    pub read_noise_e: f64,
}

impl Default for TwinSettings {
    fn default() -> Self {
        Self {
            seed: 1,
            noise_seed: None,
            exposure: 1.0,
            bits: 8,
            subsamples: 1,
            position_scatter_mm: 1.0,
            angle_scatter_deg: 1.0,
            vibration_um: 0.2,
            drift_um: 0.0,
            projector_gamma: 1.05,
            projector_blur_px: 0.6,
            defocus_px_per_mm: 0.0,
            projector_8bit: true,
            projector_pixels: true,
            projector_leak: 0.002,
            camera_blur_px: 0.5,
            pixel_footprint: true,
            ambient: 0.02,
            bounce_rays: 0,
            gloss: 0.0,
            black_level: 0.01,
            shot_noise: true,
            full_well_e: 10_500.0,
            read_noise_e: 7.0,
        }
    }
}

impl TwinSettings {
    /// Seed of what differs from frame to frame.
    pub(crate) fn seed_of_noise(&self) -> u64 {
        self.noise_seed.unwrap_or(self.seed)
    }

    /// No imperfection at all: 16 bits, no noise, no blur, continuous patterns, nominal pose.
    pub fn ideal() -> Self {
        Self {
            bits: 16,
            position_scatter_mm: 0.0,
            angle_scatter_deg: 0.0,
            vibration_um: 0.0,
            drift_um: 0.0,
            projector_gamma: 1.0,
            projector_blur_px: 0.0,
            defocus_px_per_mm: 0.0,
            projector_8bit: false,
            projector_pixels: false,
            projector_leak: 0.0,
            camera_blur_px: 0.0,
            pixel_footprint: false,
            ambient: 0.0,
            bounce_rays: 0,
            gloss: 0.0,
            black_level: 0.0,
            shot_noise: false,
            read_noise_e: 0.0,
            ..Self::default()
        }
    }

    /// Whether the part is displaced from frame to frame.
    pub(crate) fn moves(&self) -> bool {
        self.vibration_um > 0.0 || self.drift_um != 0.0
    }

    /// Grey value at which the sensor is full.
    pub fn full_scale_dn(&self) -> u16 {
        ((1_u32 << u32::from(self.bits.min(16))) - 1) as u16
    }

    /// Checks all ranges.
    ///
    /// # Errors
    /// The first key outside its range, with its value and limit.
    pub fn check(&self) -> Result<(), SettingError> {
        let unsigned = |key, value, least: f64, most: f64, limit| {
            if (least..=most).contains(&value) { Ok(()) } else { Err(SettingError { key, value, limit }) }
        };
        if ![8, 10, 12, 16].contains(&self.bits) {
            return Err(SettingError { key: "bits", value: self.bits.into(), limit: "8, 10, 12 or 16" });
        }
        unsigned("subsamples", self.subsamples.into(), 1.0, 16.0, "1 to 16")?;
        unsigned("exposure", self.exposure, 0.0, 1e6, "0 to 1e6")?;
        unsigned("position_scatter_mm", self.position_scatter_mm, 0.0, 1e4, "0 to 10000")?;
        unsigned("angle_scatter_deg", self.angle_scatter_deg, 0.0, 180.0, "0 to 180")?;
        unsigned("vibration_um", self.vibration_um, 0.0, 1000.0, "0 to 1000: larger moves need a new pose")?;
        unsigned("drift_um", self.drift_um, -1000.0, 1000.0, "-1000 to 1000: larger moves need a new pose")?;
        unsigned("defocus_px_per_mm", self.defocus_px_per_mm, 0.0, 1.0, "0 to 1")?;
        unsigned("bounce_rays", self.bounce_rays.into(), 0.0, 256.0, "0 to 256")?;
        unsigned("gloss", self.gloss, 0.0, 1e3, "0 to 1000")?;
        unsigned("projector_gamma", self.projector_gamma, 0.1, 10.0, "0.1 to 10")?;
        unsigned("projector_blur_px", self.projector_blur_px, 0.0, 20.0, "0 to 20")?;
        unsigned("projector_leak", self.projector_leak, 0.0, 1.0, "0 to 1")?;
        unsigned("camera_blur_px", self.camera_blur_px, 0.0, 20.0, "0 to 20")?;
        unsigned("ambient", self.ambient, 0.0, 1e6, "0 to 1e6")?;
        unsigned("black_level", self.black_level, 0.0, 1.0, "0 to 1")?;
        unsigned("full_well_e", self.full_well_e, 1.0, 1e12, "1 to 1e12")?;
        unsigned("read_noise_e", self.read_noise_e, 0.0, 1e9, "0 to 1e9")
    }
}

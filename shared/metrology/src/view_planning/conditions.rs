//! Light, noise and blur that a plan of views assumes.

use super::error::ViewPlanError;
use fringe::decode::DecodeSettings;
use fringe::math::cos;
use fringe::pattern::{Axis, PatternSet};
use fringe::planning::Brightness;
use fringe::sensor::CameraNoise;
use fringe::surface::SurfaceSettings;
use serde::Serialize;

/// The finest sine set of a projector along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fringes {
    /// Axis along which the fringes vary.
    pub axis: Axis,
    /// Their period, projector pixels.
    pub period_px: f64,
    /// Number of phase steps.
    pub steps: u32,
}

impl Fringes {
    /// The finest sine set of a sequence along each axis.
    pub fn of_sequence(sequence: &[PatternSet]) -> Vec<Self> {
        let finest = |wanted: Axis| {
            let sines = sequence.iter().filter_map(|set| match set {
                PatternSet::Sine { axis, period_px, steps, .. } if *axis == wanted => {
                    Some(Self { axis: *axis, period_px: *period_px, steps: *steps })
                }
                _ => None,
            });
            sines.min_by(|a, b| a.period_px.total_cmp(&b.period_px))
        };
        [Axis::X, Axis::Y].into_iter().filter_map(finest).collect()
    }
}

/// What is assumed of light, cameras and part.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Conditions {
    /// Longest side of an element, mm.
    pub element_mm: f64,
    /// Grey value of the part under white light where a face of it looks at the projector, at the distance of the part's middle, DN.
    pub white_dn: f64,
    /// The same with the projector black, DN.
    pub black_dn: f64,
    /// Largest grey value of the cameras, DN.
    pub full_scale_dn: f64,
    /// Noise of cameras of which the rig states none.
    pub noise: CameraNoise,
    /// Blur of the projectors on the part, standard deviation in their pixels.
    pub projector_blur_px: f64,
    /// Blur of the cameras, lens and area of the pixel together, standard deviation in their pixels.
    pub camera_blur_px: f64,
    /// Share of the light that the part reflects, for the light that bounces.
    pub albedo: f64,
    /// Directions that are followed per element for the light that bounces; 0: none.
    pub bounce_rays: u32,
    /// Limits of surfaces and smoothing, as the matcher applies them.
    pub surface: SurfaceSettings,
    /// Limits of the decoder.
    #[serde(skip)]
    pub decode: DecodeSettings,
}

impl Conditions {
    /// Checks every number against its limits.
    ///
    /// # Errors
    /// The first number outside its range.
    pub fn check(&self) -> Result<(), ViewPlanError> {
        let within = |key, value: f64, (least, most): (f64, f64), limit| {
            if value >= least && value <= most {
                Ok(())
            } else {
                Err(ViewPlanError::Condition { key, value, limit })
            }
        };
        within("element-mm", self.element_mm, (1e-3, 1e4), "0.001 to 10000 mm")?;
        within("full-scale-dn", self.full_scale_dn, (1.0, 65_535.0), "1 to 65535 DN")?;
        within("white-dn", self.white_dn, (1e-3, 1e6), "0.001 to 1000000 DN")?;
        within("black-dn", self.black_dn, (0.0, self.white_dn), "0 to less than white-dn")?;
        if self.black_dn >= self.white_dn {
            return Err(ViewPlanError::Condition {
                key: "black-dn",
                value: self.black_dn,
                limit: "less than white-dn",
            });
        }
        within("noise (read)", self.noise.read_noise_dn, (0.0, 65_535.0), "0 to 65535 DN")?;
        within("noise (gain)", self.noise.gain_dn, (0.0, 65_535.0), "0 to 65535 DN per electron")?;
        within("blur-px", self.projector_blur_px, (0.0, 100.0), "0 to 100 px")?;
        within("camera-blur-px", self.camera_blur_px, (0.0, 100.0), "0 to 100 px")?;
        within("albedo", self.albedo, (0.0, 1.0), "0 to 1")?;
        within("bounce-rays", self.bounce_rays.into(), (0.0, 4096.0), "0 to 4096")
    }

    /// Fringes on a face that receives `light` of what a face in the middle receives that looks at the projector; `across_px` is what a
    /// pixel of the camera covers, projector pixels.
    pub(super) fn brightness(&self, light: f64, across_px: f64, noise: CameraNoise) -> Brightness {
        let modulation_dn = 0.5 * (self.white_dn - self.black_dn) * light;
        let camera_px = self.camera_blur_px * across_px;
        Brightness {
            full_scale_dn: self.full_scale_dn,
            modulation_dn,
            background_dn: self.black_dn + modulation_dn,
            read_noise_dn: noise.read_noise_dn,
            gain_dn: noise.gain_dn,
            blur_px: (self.projector_blur_px * self.projector_blur_px + camera_px * camera_px).sqrt(),
        }
    }

    /// Least cosine of the incidence before noise hides the error of steep points.
    pub(super) fn usual_cosine(&self) -> f64 {
        cos(self.surface.max_incidence_deg.to_radians())
    }
}

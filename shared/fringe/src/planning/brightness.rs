//! How bright the fringes on a face are, and what noise their phase has.

use super::pattern::contrast;
use crate::decode::DecodeSettings;

/// What a camera sees of coarse fringes on a face, and how its grey values scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brightness {
    /// Largest grey value, DN.
    pub full_scale_dn: f64,
    /// Modulation of a coarse fringe: half the difference between white and black, DN.
    pub modulation_dn: f64,
    /// Background of the fringes, DN.
    pub background_dn: f64,
    /// Noise of a grey value in the dark, quantisation included, DN; less than that of whole DN, 1/√12, counts as it.
    pub read_noise_dn: f64,
    /// Grey values per photo-electron, DN.
    pub gain_dn: f64,
    /// Blur of projector and camera together, standard deviation in projector pixels.
    pub blur_px: f64,
}

impl Brightness {
    /// Standard deviation of a grey value at the background, DN.
    pub fn grey_noise_dn(&self) -> f64 {
        let read = (self.read_noise_dn * self.read_noise_dn).max(1.0 / 12.0);
        (read + self.gain_dn * self.background_dn).sqrt()
    }

    /// Whether the decoder's limits let such fringes pass.
    pub fn usable(&self, limits: &DecodeSettings, modulation_dn: f64, sigma_phase_rad: f64) -> bool {
        modulation_dn >= limits.min_modulation_fraction * self.full_scale_dn
            && self.background_dn + self.modulation_dn < limits.saturation_fraction * self.full_scale_dn
            && sigma_phase_rad <= limits.max_sigma_rad
    }

    /// Modulation and √(2/N) σ_I/B at a period.
    pub fn phase_noise(&self, period_px: f64, steps: u32) -> (f64, f64) {
        let modulation_dn = self.modulation_dn * contrast(self.blur_px, period_px, 1);
        (modulation_dn, (2.0 / f64::from(steps)).sqrt() * self.grey_noise_dn() / modulation_dn)
    }
}

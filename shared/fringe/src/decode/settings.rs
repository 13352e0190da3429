//! What a person may decide about decoding.

use super::DecodeError;
use crate::pattern::Code;
use crate::sensor::{CameraNoise, Sensor};
use serde::{Deserialize, Serialize};

/// Method of the fringe order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrderMethod {
    /// Of all ways through code and sines the one that survives the most noise; stairs where there is no code.
    #[default]
    Auto,
    /// Reflected Gray code: neighbouring stripes differ in one bit.
    Gray,
    /// Plain binary code: the bits are the stripe number.
    Binary,
    /// Two codes, half a stripe apart: no jumps.
    ShiftedGray,
    /// Stairs of phase or grey level (eq. 2.59 – 2.61).
    Stair,
    /// Sines alone, from long to short periods (eq. 2.50 – 2.53).
    Hierarchical,
    /// Sines alone, through their beats.
    Heterodyne,
    /// Sines alone, through a table of the residues by coprime periods (eq. 2.54 – 2.58).
    NumberTheoretical,
}

impl OrderMethod {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Gray => "gray",
            Self::Binary => "binary",
            Self::ShiftedGray => "shifted-gray",
            Self::Stair => "stair",
            Self::Hierarchical => "hierarchical",
            Self::Heterodyne => "heterodyne",
            Self::NumberTheoretical => "number-theoretical",
        }
    }

    /// Whether a code with this numbering is used.
    pub(super) fn takes(self, code: Code) -> bool {
        match self {
            Self::Auto | Self::ShiftedGray => true,
            Self::Gray => code == Code::Gray,
            Self::Binary => code == Code::Binary,
            Self::Stair | Self::Hierarchical | Self::Heterodyne | Self::NumberTheoretical => false,
        }
    }
}

/// Limits and assumptions of the decoder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DecodeSettings {
    /// Smallest modulation B that counts as light from the projector, as a fraction of full scale.
    pub min_modulation_fraction: f64,
    /// A sine frame at or above this fraction of full scale is clipped; its pixel is masked.
    pub saturation_fraction: f64,
    /// Whether a pixel that is clipped in some sine frames is decoded from the others, where these determine its phase.
    pub use_clipped: bool,
    /// Largest usable standard uncertainty of the phase, rad. At π/8 the wrap and its noise can no longer be distinguished.
    pub max_sigma_rad: f64,
    /// Noise of the camera where it is known. When absent it is estimated from the residuals of the sine sets with five
    /// or more steps, from neighbouring pixels where there are fewer or only a code, or assumed where too few pixels are lit
    /// (see [`Self::assumed_read_noise_fraction`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_noise: Option<CameraNoise>,
    /// Read noise as a fraction of full scale, used beside the quantisation noise 1/√12 DN where nothing better is known.
    pub assumed_read_noise_fraction: f64,
    /// How many standard deviations make a bit or a side of a code edge certain.
    pub certainty_sigmas: f64,
    /// Systematic disagreement between a code edge and the phase (blur, footprint), as a fraction of the period. An order
    /// decided closer than this to the next order needs a neighbour that confirms it.
    pub edge_tolerance: f64,
    /// How far, in camera pixels, an ambiguous pixel looks for neighbours that prove its order.
    pub neighbour_reach_px: u32,
    /// Largest fraction of order jumps per wrap of the phase, and of lit pixels whose code and phase disagree. Beyond it
    /// the frames do not follow the sequence. A part full of steps may need more.
    pub max_contradiction: f64,
    /// Standard deviation of a pixel's footprint (its area and the lens blur), camera pixels; 0 corrects nothing. When
    /// absent it is estimated from white, black and the modulation, and nothing is corrected where they do not determine it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub footprint_px: Option<f64>,
    /// Largest standard deviation that light from other faces may add to a phase, rad; its pixels are masked beyond it, and below it
    /// their uncertainty contains it. 0: it is not looked for. It shows only where the sequence has white and black, and no lines.
    pub max_bounce_rad: f64,
    /// What the calibration found of this camera. It counts where `camera_noise` and `footprint_px` are absent; the frames then only
    /// test it.
    #[serde(skip)]
    pub sensor: Sensor,
    /// Method of the fringe order.
    pub order: OrderMethod,
    /// Whether the result is the inverse-variance mean of all sine sets of an axis, not the finest alone.
    pub fuse: bool,
    /// Whether single pixels whose order all neighbours contradict are corrected.
    pub repair_spikes: bool,
}

impl Default for DecodeSettings {
    fn default() -> Self {
        Self {
            min_modulation_fraction: 0.02,
            saturation_fraction: 0.99,
            use_clipped: false,
            max_sigma_rad: 0.2,
            camera_noise: None,
            assumed_read_noise_fraction: 0.004,
            certainty_sigmas: 4.0,
            edge_tolerance: 0.05,
            neighbour_reach_px: 16,
            max_contradiction: 0.5,
            footprint_px: None,
            max_bounce_rad: 0.05,
            sensor: Sensor::default(),
            order: OrderMethod::Auto,
            fuse: false,
            repair_spikes: true,
        }
    }
}

impl DecodeSettings {
    /// The same settings for a camera of which the calibration found this.
    #[must_use]
    pub fn of_camera(&self, sensor: Sensor) -> Self {
        Self { sensor, ..self.clone() }
    }

    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`DecodeError::Setting`] names key, value and range.
    pub fn check(&self) -> Result<(), DecodeError> {
        within("min_modulation_fraction", self.min_modulation_fraction, 0.0, 0.5)?;
        within("saturation_fraction", self.saturation_fraction, 0.1, 1.0)?;
        within("max_sigma_rad", self.max_sigma_rad, 1e-6, std::f64::consts::FRAC_PI_2)?;
        within("assumed_read_noise_fraction", self.assumed_read_noise_fraction, 0.0, 0.5)?;
        within("certainty_sigmas", self.certainty_sigmas, 0.0, 20.0)?;
        within("edge_tolerance", self.edge_tolerance, 0.0, 0.25)?;
        within("neighbour_reach_px", f64::from(self.neighbour_reach_px), 1.0, 256.0)?;
        within("max_bounce_rad", self.max_bounce_rad, 0.0, std::f64::consts::FRAC_PI_2)?;
        within("max_contradiction", self.max_contradiction, 0.0, 1e6)?;
        if let Some(footprint_px) = self.footprint_px {
            within("footprint_px", footprint_px, 0.0, 1.0)?;
        }
        if let Some(noise) = self.camera_noise {
            within("camera_noise.read_noise_dn", noise.read_noise_dn, 0.0, 65535.0)?;
            within("camera_noise.gain_dn", noise.gain_dn, 0.0, 65535.0)?;
        }
        Ok(())
    }
}

fn within(key: &'static str, value: f64, least: f64, most: f64) -> Result<(), DecodeError> {
    if value >= least && value <= most {
        Ok(())
    } else {
        Err(DecodeError::Setting { key, value, least, most })
    }
}

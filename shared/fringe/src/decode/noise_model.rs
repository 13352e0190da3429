//! How the noise of a camera grows with its grey value.

/// Where the noise model comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseSource {
    /// Residuals of the sine sets, or differences of neighbouring pixels; so many pixels entered.
    Estimated {
        /// Pixels that entered the regression.
        pixels: usize,
    },
    /// `camera_noise` of the settings.
    Settings,
    /// What the calibration found of the camera.
    Calibration,
    /// Quantisation and the assumed read noise.
    Assumed,
}

/// Variance of a grey value: read² + gain · value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Variance in the dark, DN².
    pub read_variance_dn2: f64,
    /// Variance per DN of signal, DN.
    pub gain_dn: f64,
    /// Where it comes from.
    pub source: NoiseSource,
}

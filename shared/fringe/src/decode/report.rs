//! What a decoding did.

use std::sync::Arc;

/// Where the noise model comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseSource {
    /// Residuals of the sine sets; so many pixels entered.
    Estimated {
        /// Pixels that entered the regression.
        pixels: usize,
    },
    /// `camera_noise` of the settings.
    Settings,
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

/// Counts of one decoded axis. Pixels that fail several tests are counted at the first one in the order of the fields.
#[derive(Debug, Clone, PartialEq)]
pub struct DecodeReport {
    /// Pixels with a usable absolute phase.
    pub valid: usize,
    /// Masked: a sine frame is clipped.
    pub saturated: usize,
    /// Masked: too little modulation.
    pub dark: usize,
    /// Masked: phase noise beyond the limit.
    pub noisy: usize,
    /// Pixels whose own frames did not settle the order.
    pub ambiguous: usize,
    /// Of these, settled by their neighbours.
    pub resolved: usize,
    /// Single pixels whose order was corrected by whole periods because all neighbours agree on it.
    pub spikes_repaired: usize,
    /// Single pixels masked because all neighbours contradict them.
    pub spikes_masked: usize,
    /// Noise model behind the phase uncertainty.
    pub noise: NoiseModel,
    /// Standard deviation of the pixel's footprint whose bias was removed, camera pixels; `None` where nothing was.
    pub footprint_px: Option<f64>,
    /// Sets of the sequence that were not used; every set stands in the report of exactly one axis.
    pub ignored: Arc<[String]>,
}

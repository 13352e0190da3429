//! Filters of an absolute phase. All are off unless asked for: what is measured is worth more than what is smooth.
//!
//! | filter | does | leaves alone |
//! |---|---|---|
//! | [`Filter::Spikes`] | finds single wrong pixels with Sobel's kernels (thesis section 3.1.3.3), corrects or masks them | edges, corners, slopes |
//! | [`Filter::Gaussian`] | smooths | steps beyond `edge_rad`, slopes |
//! | [`Filter::Median`] | takes the median | steps, slopes |
//!
//! # Honesty
//! No filter gives a phase to a pixel that had none, and none reads a pixel that is not valid. Smoothing takes neighbours in pairs on
//! opposite sides of a pixel: a slope cancels in each pair, beside the border of the mask as well, so that a plane stays as it is to the last bit
//! of the sums. The standard uncertainty of a smoothed phase follows the weights, for noise that is independent from pixel to
//! pixel; neighbouring values of the result are then correlated.

mod smooth;
mod spikes;
#[cfg(test)]
mod tests;

use crate::phase::PhaseMap;
use serde::Serialize;
use thiserror::Error;

/// Largest radius, px: the work per pixel grows with its square.
const MOST_RADIUS_PX: u32 = 32;

/// A filter of phase maps with its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Filter {
    /// Corrects single pixels by whole turns where that puts them among their neighbours, and masks them otherwise.
    Spikes {
        /// Least height of a spike above its neighbours, rad.
        height_rad: f64,
    },
    /// Weighted mean, the weights a Gaussian.
    Gaussian {
        /// Standard deviation of the Gaussian, px.
        sigma_px: f64,
        /// Pairs of neighbours whose mean differs more than this from the pixel lie across an edge, rad.
        edge_rad: f64,
    },
    /// Median of a square.
    Median {
        /// Half its side, px: 1 is 3 × 3.
        radius_px: u32,
    },
}

/// A setting that cannot be used.
#[derive(Debug, Error, Clone, PartialEq)]
#[error("{key} = {value} must be {limit}")]
pub struct FilterError {
    /// Key of the setting.
    pub key: &'static str,
    /// The value that was given.
    pub value: f64,
    /// What it may be.
    pub limit: &'static str,
}

/// What a filter did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct FilterReport {
    /// Valid pixels before the filter.
    pub valid: usize,
    /// Spikes moved by whole turns.
    pub corrected: usize,
    /// Spikes that were masked.
    pub masked: usize,
    /// Pixels whose phase is now a mean or median with others.
    pub smoothed: usize,
}

impl Filter {
    /// The default spike filter: half a turn.
    pub const SPIKES: Self = Self::Spikes { height_rad: std::f64::consts::PI };

    /// Smooths by so many pixels, and keeps edges of a quarter of a turn.
    pub fn gaussian(sigma_px: f64) -> Self {
        Self::Gaussian { sigma_px, edge_rad: std::f64::consts::FRAC_PI_2 }
    }

    /// Checks the settings.
    ///
    /// # Errors
    /// The first one out of range.
    pub fn check(&self) -> Result<(), FilterError> {
        let within = |key, value: f64, least: f64, most: f64, limit| {
            if (least..=most).contains(&value) { Ok(()) } else { Err(FilterError { key, value, limit }) }
        };
        match *self {
            Self::Spikes { height_rad } => within("height_rad", height_rad, 1e-3, 1e3, "0.001 to 1000"),
            Self::Gaussian { sigma_px, edge_rad } => {
                within("edge_rad", edge_rad, 1e-6, 1e6, "above 0")?;
                within("sigma_px", sigma_px, 0.1, 10.0, "0.1 to 10")
            }
            Self::Median { radius_px } => {
                within("radius_px", f64::from(radius_px), 1.0, f64::from(MOST_RADIUS_PX), "1 to 32")
            }
        }
    }

    /// Filters a map in place.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn apply(&self, map: &mut PhaseMap) -> Result<FilterReport, FilterError> {
        self.check()?;
        let valid = map.valid.iter().map(|valid| usize::from(*valid == 1)).sum();
        let done = match *self {
            Self::Spikes { height_rad } => spikes::remove(map, height_rad as f32),
            Self::Gaussian { sigma_px, edge_rad } => smooth::gaussian(map, sigma_px, edge_rad as f32),
            Self::Median { radius_px } => smooth::median(map, radius_px as usize),
        };
        Ok(FilterReport { valid, ..done })
    }
}

/// A pixel's phase, if it has one.
fn value(map: &PhaseMap, x: i64, y: i64) -> Option<f32> {
    let (width, height) = (i64::from(map.info.width_px), i64::from(map.info.height_px));
    if !(0..width).contains(&x) || !(0..height).contains(&y) {
        return None;
    }
    let i = (y * width + x) as usize;
    (map.valid[i] == 1 && map.phase_rad[i].is_finite()).then(|| map.phase_rad[i])
}

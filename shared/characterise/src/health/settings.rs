//! What a person may decide about the check.

use super::HealthError;
use serde::{Deserialize, Serialize};

/// Settings of the check.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HealthSettings {
    /// Probability with which a healthy pair is called unhealthy.
    pub false_alarm: f64,
    /// Root mean square of the smooth errors that the phase itself carries into the residuals (footprint, blur, light that
    /// the parts throw on each other), px. It is no part of the noise, and no number of points averages it away.
    pub phase_error_px: f64,
    /// Fewest matches that carry a verdict.
    pub least_matches: usize,
}

impl Default for HealthSettings {
    fn default() -> Self {
        Self { false_alarm: 1e-3, phase_error_px: 0.002, least_matches: 200 }
    }
}

impl HealthSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Names key, value and limits.
    pub fn check(&self) -> Result<(), HealthError> {
        let refuse = |key, value, limits| Err(HealthError::Setting { key, value, limits });
        if !(1e-9..=0.1).contains(&self.false_alarm) {
            return refuse("false_alarm", self.false_alarm, "1e-9 … 0.1");
        }
        if !(0.0..=1.0).contains(&self.phase_error_px) {
            return refuse("phase_error_px", self.phase_error_px, "0 … 1");
        }
        if self.least_matches < 20 {
            return refuse("least_matches", self.least_matches as f64, "20 or more");
        }
        Ok(())
    }
}

//! What detection takes for a point.

use super::error::TargetError;
use serde::{Deserialize, Serialize};

/// Settings of the detection by [`super::detect`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TargetSettings {
    /// Least half difference of light and dark, as a fraction of full scale. Below 2 % of 8 bits a corner has 5 DN,
    /// which noise and texture reach too.
    pub min_contrast_fraction: f64,
    /// Fraction of the points that must be visible, 1 for the whole target. Whatever it is, the outermost rows and
    /// columns must each show a point: without them the rows cannot be numbered.
    pub min_visible_fraction: f64,
    /// Reach of the window around a corner along its edges, as a fraction of the distance to the next corner. Below a half,
    /// so that boards whose outer squares are cut in half (many are) keep their outer corners.
    pub window_fraction: f64,
    /// Largest reach of that window, px: longer edges average more noise, but take more time and are less straight.
    pub window_limit_px: f64,
    /// Whether the blur of the edges through each corner is told as well: that takes a third more time.
    pub edge_blur: bool,
}

impl Default for TargetSettings {
    fn default() -> Self {
        Self {
            min_contrast_fraction: 0.02,
            min_visible_fraction: 0.5,
            window_fraction: 0.45,
            window_limit_px: 14.0,
            edge_blur: false,
        }
    }
}

impl TargetSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the key, its value and its limits.
    pub fn check(&self) -> Result<(), TargetError> {
        let ranges = [
            ("min_contrast_fraction", self.min_contrast_fraction, 1e-4, 0.45),
            ("min_visible_fraction", self.min_visible_fraction, 0.25, 1.0),
            ("window_fraction", self.window_fraction, 0.3, 0.8),
            ("window_limit_px", self.window_limit_px, 4.0, 64.0),
        ];
        let bad = ranges.into_iter().find(|(_, value, least, most)| !(least..=most).contains(&value));
        bad.map_or(Ok(()), |(key, value, least, most)| Err(TargetError::Key { key, value, least, most }))
    }
}

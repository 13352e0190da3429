//! Grey levels of a ramp.

use super::PatternError;
use serde::{Deserialize, Serialize};

/// The levels of the even frames of a ramp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum GreyLevels {
    /// This many, evenly from black to white.
    Count(u32),
    /// 8-bit grey values 0 … 255, in the order of projection.
    Values(Vec<f64>),
}

/// Grey levels of a ramp that states neither how many nor along which axis: all that 8 bits have.
pub(super) const ALL_LEVELS: GreyLevels = GreyLevels::Count(256);

impl GreyLevels {
    /// Number of levels, each one frame.
    pub fn count(&self) -> usize {
        match self {
            Self::Count(count) => *count as usize,
            Self::Values(values) => values.len(),
        }
    }

    /// Level 0 … 1 of a frame.
    pub fn level(&self, frame: usize) -> f64 {
        match self {
            Self::Count(count) => frame as f64 / f64::from(count.saturating_sub(1).max(1)),
            Self::Values(values) => values.get(frame).map_or(0.0, |value| value / 255.0),
        }
    }

    pub(super) fn check(&self) -> Result<(), PatternError> {
        match self {
            Self::Count(count) if !(2..=1024).contains(count) => {
                Err(PatternError::Levels { count: *count as usize })
            }
            Self::Values(values) if !(2..=1024).contains(&values.len()) => {
                Err(PatternError::Levels { count: values.len() })
            }
            Self::Values(values) => match values.iter().find(|v| !(0.0..=255.0).contains(*v)) {
                Some(value) => Err(PatternError::Level { value: *value }),
                None => Ok(()),
            },
            Self::Count(_) => Ok(()),
        }
    }
}

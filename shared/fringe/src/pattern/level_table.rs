//! The table that pattern generation applies.

use super::PatternError;
use serde::{Deserialize, Serialize};

/// Most entries: all levels of 16 bits.
const MOST_ENTRIES: usize = 65_536;

/// From the wanted level to the level to project, both 0 … 1: entry i of n belongs to the wanted level i / (n − 1),
/// values between entries are interpolated linearly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
pub struct LevelTable(Vec<f64>);

impl LevelTable {
    /// A table.
    ///
    /// # Errors
    /// Fewer than 2 or more than 65 536 values, values outside 0 … 1, falling or all equal ones.
    pub fn new(values: Vec<f64>) -> Result<Self, PatternError> {
        let fault = |what: String| Err(PatternError::LevelTable(what));
        if !(2..=MOST_ENTRIES).contains(&values.len()) {
            return fault(format!("it has {}", values.len()));
        }
        if let Some((place, value)) = values.iter().enumerate().find(|(_, v)| !(0.0..=1.0).contains(*v)) {
            return fault(format!("value {place} is {value}"));
        }
        if let Some(place) = values.windows(2).position(|pair| pair[1] < pair[0]) {
            return fault(format!("value {} is smaller than value {place}", place + 1));
        }
        if values.first() == values.last() {
            return fault("all values are equal".into());
        }
        Ok(Self(values))
    }

    /// Samples a function of the wanted level; what it gives is limited to 0 … 1 and kept from falling.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn sample(entries: usize, function: impl Fn(f64) -> f64) -> Result<Self, PatternError> {
        if !(2..=MOST_ENTRIES).contains(&entries) {
            return Err(PatternError::LevelTable(format!("{entries} asked for")));
        }
        let mut highest = 0.0_f64;
        let value = |index: usize| {
            let value = function(index as f64 / (entries - 1) as f64);
            highest = highest.max(value.clamp(0.0, 1.0));
            highest
        };
        Self::new((0..entries).map(value).collect())
    }

    /// The level to draw for a wanted level.
    pub fn at(&self, wanted: f64) -> f64 {
        let last = self.0.len() - 1;
        let place = wanted.clamp(0.0, 1.0) * last as f64;
        let index = (place as usize).min(last - 1);
        let (low, high) = (self.0[index], self.0[index + 1]);
        low + (high - low) * (place - index as f64)
    }

    /// Levels to project, entry by entry.
    pub fn values(&self) -> &[f64] {
        &self.0
    }
}

impl TryFrom<Vec<f64>> for LevelTable {
    type Error = PatternError;

    fn try_from(values: Vec<f64>) -> Result<Self, PatternError> {
        Self::new(values)
    }
}

impl From<LevelTable> for Vec<f64> {
    fn from(table: LevelTable) -> Self {
        table.0
    }
}

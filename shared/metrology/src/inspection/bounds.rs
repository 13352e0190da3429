//! Boxes that hold regions and points: what lies in no common box needs no closer look.

use nalgebra::Vector3;

/// A box along the axes of the part frame, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Bounds {
    /// About a centre; a little wider than asked for, so that rounding leaves nothing out.
    pub fn about(center: &Vector3<f64>, half: &Vector3<f64>) -> Self {
        let half = half.map(|h| h + 1e-9 * (1.0 + h)) + center.map(|c| 1e-9 * c.abs());
        Self { low: center - half, high: center + half }
    }

    /// From the lowest to the highest coordinates.
    pub fn between(low: Vector3<f64>, high: Vector3<f64>) -> Self {
        Self { low, high }
    }

    /// Whether nothing is in both.
    pub fn misses(&self, other: &Self) -> bool {
        (0..3).any(|axis| other.low[axis] > self.high[axis] || other.high[axis] < self.low[axis])
    }
}

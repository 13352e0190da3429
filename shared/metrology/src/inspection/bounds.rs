//! Boxes that hold regions and points: what lies in no common box needs no closer look.

use nalgebra::Vector3;

/// A box along the axes of the part frame, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { low: Vector3::repeat(f64::INFINITY), high: Vector3::repeat(f64::NEG_INFINITY) }
    }
}

impl Bounds {
    /// About a centre; a little wider than asked for, so that rounding leaves nothing out.
    pub fn about(center: &Vector3<f64>, half: &Vector3<f64>) -> Self {
        let half = half.map(|h| h + 1e-9 * (1.0 + h)) + center.map(|c| 1e-9 * c.abs());
        Self { low: center - half, high: center + half }
    }

    /// Takes a position in. One that is no number is in no region either.
    #[inline]
    pub fn add(&mut self, position: &Vector3<f64>) {
        for axis in 0..3 {
            let value = position[axis];
            self.low[axis] = if value < self.low[axis] { value } else { self.low[axis] };
            self.high[axis] = if value > self.high[axis] { value } else { self.high[axis] };
        }
    }

    /// Whether nothing is in both.
    pub fn misses(&self, other: &Self) -> bool {
        (0..3).any(|axis| other.low[axis] > self.high[axis] || other.high[axis] < self.low[axis])
    }
}

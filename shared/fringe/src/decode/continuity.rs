//! Whether the orders of a map belong together: where the wrapped phase runs on, the absolute phase must not jump.
//!
//! A wrong order of single pixels is the neighbours' affair. Bits in the wrong order, a wrong stripe width or sense
//! give whole stripes a wrong order, each consistent in itself; what gives them away is that the phase jumps by
//! multiples of 2π about as often as it wraps. A part's own steps do so too, but only along its edges.

use crate::phase::PhaseViewMut;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// One of so many rows and columns is walked along.
const STRIDE: usize = 4;
/// With fewer wraps and jumps the sequence is not checked.
const LEAST: usize = 50;

/// Neighbours along rows and columns whose wrapped phases differ by less than π/2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Continuity {
    /// Pairs between which the wrapped phase passes 2π.
    pub wraps: usize,
    /// Pairs between which the absolute phase jumps by one or more periods.
    pub jumps: usize,
}

impl Continuity {
    /// Jumps per wrap; 0 with too few wraps.
    pub fn jump_fraction(&self) -> f64 {
        if self.wraps.max(self.jumps) < LEAST { 0.0 } else { self.jumps as f64 / self.wraps.max(1) as f64 }
    }

    /// Walks along every [`STRIDE`]th row and column.
    pub fn of(map: &PhaseViewMut) -> Self {
        let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
        let mut all = Self::default();
        for row in (0..height).step_by(STRIDE) {
            for column in 1..width {
                all.look(map, row * width + column - 1, row * width + column);
            }
        }
        for column in (0..width).step_by(STRIDE) {
            for row in 1..height {
                all.look(map, (row - 1) * width + column, row * width + column);
            }
        }
        all
    }

    fn look(&mut self, map: &PhaseViewMut, a: usize, b: usize) {
        if map.valid[a] & map.valid[b] == 0 {
            return;
        }
        let difference = map.phase_rad[b] - map.phase_rad[a];
        let periods = (difference / TAU).round();
        if (difference - periods * TAU).abs() < FRAC_PI_2 {
            self.jumps += usize::from(periods != 0.0);
            let wrapped = |index: usize| map.phase_rad[index].rem_euclid(TAU);
            self.wraps += usize::from((wrapped(b) - wrapped(a)).abs() > PI);
        }
    }
}

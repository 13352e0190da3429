//! Angles as 32-bit fractions of a turn: wrapping is what integers do anyway.
//!
//! φ = 2π (a / 2³² + whole turns). The wrapped difference ξ(φ_b − φ_a) of eq. 2.21–2.24 is the integer difference b − a
//! modulo 2³², read as a signed number: exact, without a branch, and a sum of differences round any loop is a whole
//! number of turns. Decisions are taken on a grid of 2⁻¹⁸ turns, 24 µrad: far below any noise, and coarse enough that whole
//! turns added to a phase in single precision, and the rounding that comes with them, change no decision.

use super::Wrapped;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Parts of a turn.
const UNITS: f64 = 4_294_967_296.0;

/// Bits of an angle below the grid on which decisions are taken.
const FINE_BITS: u32 = 14;

/// Pixels per piece of parallel work; each pixel's result depends on itself alone.
const CHUNK: usize = 16_384;

/// The wrapped phase of an image.
#[derive(Debug)]
pub struct Angles<'a> {
    /// Fraction of a turn in units of 2⁻³² turns; 0 where not valid.
    pub turn: Vec<u32>,
    /// Valid in the input and finite.
    pub valid: Vec<bool>,
    phase_rad: &'a [f32],
}

impl<'a> Angles<'a> {
    /// Reads a phase in any interval.
    pub fn new(wrapped: &Wrapped<'a>) -> Self {
        let (n, phase_rad) = (wrapped.phase_rad.len(), wrapped.phase_rad);
        let mut angles = Self { turn: vec![0; n], valid: vec![false; n], phase_rad };
        angles
            .turn
            .par_chunks_mut(CHUNK)
            .zip(angles.valid.par_chunks_mut(CHUNK))
            .zip(wrapped.phase_rad.par_chunks(CHUNK).zip(wrapped.valid.par_chunks(CHUNK)))
            .for_each(|((turn, valid), (phase_rad, usable))| {
                for i in 0..turn.len() {
                    if usable[i] != 0 && phase_rad[i].is_finite() {
                        turn[i] = split(f64::from(phase_rad[i]) / TAU).0;
                        valid[i] = true;
                    }
                }
            });
        angles
    }

    /// Fraction of a turn of a valid pixel in full resolution: 0 … 1, and below 0 by half a grid step at most where the grid
    /// rounds to 0.
    #[inline]
    pub fn fraction(&self, pixel: usize) -> f64 {
        split(f64::from(self.phase_rad[pixel]) / TAU).1
    }

    /// Fraction of a turn on the grid: what decisions may rest on.
    pub fn on_grid(&self, pixel: usize) -> f64 {
        f64::from(self.turn[pixel]) / UNITS
    }

    /// Wrapped difference from pixel a to pixel b, in units of 2⁻³² turns, within half a turn.
    #[inline]
    pub fn difference(&self, a: usize, b: usize) -> i32 {
        self.turn[b].wrapping_sub(self.turn[a]) as i32
    }

    /// Whole turns to be added to b, relative to a, so that both differ by the wrapped difference: −1, 0 or 1.
    #[inline]
    pub fn step(&self, a: usize, b: usize) -> i32 {
        step(self.turn[a], self.turn[b])
    }
}

/// [`Angles::step`] of two angles. b − a as it is lies within a turn; the wrapped difference is that plus a turn where b is the
/// smaller one, less a turn where it then is more than half a turn, which is to say negative.
#[inline]
pub fn step(a: u32, b: u32) -> i32 {
    i32::from(b < a) - i32::from((b.wrapping_sub(a) as i32) < 0)
}

/// The part after the point, on the grid and in full.
#[inline]
fn split(turns: f64) -> (u32, f64) {
    let steps = 1_u32 << (32 - FINE_BITS);
    let fraction = turns - floor(turns);
    let step = (fraction * f64::from(steps) + 0.5) as u32;
    if step >= steps { (0, fraction - 1.0) } else { (step << FINE_BITS, fraction) }
}

/// Next whole number below. The one of the standard library is a call on machines whose least common ground has no instruction for it.
#[inline]
fn floor(value: f64) -> f64 {
    // From 2⁵² on all numbers are whole.
    if value.abs() >= 4_503_599_627_370_496.0 {
        return value;
    }
    let whole = value as i64 as f64;
    if whole > value { whole - 1.0 } else { whole }
}

/// Units of 2⁻³² turns as turns.
#[inline]
pub fn turns(units: i32) -> f32 {
    units as f32 * (1.0 / UNITS as f32)
}

//! Angles as 32-bit fractions of a turn: wrapping is what integers do anyway.
//!
//! φ = 2π (a / 2³² + whole turns). The wrapped difference ξ(φ_b − φ_a) of eq. 2.21–2.24 is the integer difference b − a
//! modulo 2³², read as a signed number: exact, without a branch, and a sum of differences round any loop is a whole
//! number of turns. Decisions are taken on a grid of 2⁻¹⁸ turns, 24 µrad: far below any noise, and coarse enough that whole
//! turns added to a phase in single precision, and the rounding that comes with them, change no decision.

use super::{NO_COMPONENT, Wrapped};
use crate::math::simd::{best_level, vectorised};
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
        let (n, phase_rad, level) = (wrapped.phase_rad.len(), wrapped.phase_rad, best_level());
        let mut angles = Self { turn: vec![0; n], valid: vec![false; n], phase_rad };
        angles
            .turn
            .par_chunks_mut(CHUNK)
            .zip(angles.valid.par_chunks_mut(CHUNK))
            .zip(wrapped.phase_rad.par_chunks(CHUNK).zip(wrapped.valid.par_chunks(CHUNK)))
            .for_each(|((turn, valid), (phase_rad, usable))| {
                vectorised!(level, read(turn, valid, phase_rad, usable));
            });
        angles
    }

    /// Fraction of a turn of a valid pixel in full resolution: 0 … 1, and below 0 by half a grid step at most where the grid
    /// rounds to 0.
    #[inline(always)]
    pub fn fraction(&self, pixel: usize) -> f64 {
        split(f64::from(self.phase_rad[pixel]) / TAU).1
    }

    /// The phase with whole turns added, rad; NaN where a pixel is in no component.
    pub fn unwrapped(&self, turns: &[i32], component: &[u32]) -> Vec<f32> {
        let (mut phase_rad, level) = (vec![0.0; turns.len()], best_level());
        let input =
            self.phase_rad.par_chunks(CHUNK).zip(turns.par_chunks(CHUNK).zip(component.par_chunks(CHUNK)));
        phase_rad.par_chunks_mut(CHUNK).zip(input).for_each(|(out, (wrapped, (turns, component)))| {
            vectorised!(level, add_turns(out, wrapped, turns, component));
        });
        phase_rad
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
#[inline(always)]
pub fn step(a: u32, b: u32) -> i32 {
    i32::from(b < a) - i32::from((b.wrapping_sub(a) as i32) < 0)
}

#[inline(always)]
fn read(turn: &mut [u32], valid: &mut [bool], phase_rad: &[f32], usable: &[u8]) {
    let input = phase_rad.iter().zip(usable);
    for ((turn, valid), (phase, usable)) in turn.iter_mut().zip(valid).zip(input) {
        *valid = (*usable != 0) & phase.is_finite();
        let phase = if *valid { *phase } else { 0.0 };
        *turn = split(f64::from(phase) / TAU).0;
    }
}

#[inline(always)]
fn add_turns(out: &mut [f32], wrapped_rad: &[f32], turns: &[i32], component: &[u32]) {
    let input = wrapped_rad.iter().zip(turns.iter().zip(component));
    for (out, (wrapped, (turns, component))) in out.iter_mut().zip(input) {
        let whole = split(f64::from(*wrapped) / TAU).1 + f64::from(*turns);
        *out = if *component == NO_COMPONENT { f32::NAN } else { (whole * TAU) as f32 };
    }
}

/// The part after the point, on the grid and in full.
#[inline(always)]
fn split(turns: f64) -> (u32, f64) {
    let steps = 1_u32 << (32 - FINE_BITS);
    let fraction = turns - floor(turns);
    let step = floor(fraction * f64::from(steps) + 0.5);
    // The last bits of a number that is moved to where neighbours are 1 apart are those of an integer.
    let step = (step + WHOLE).to_bits() as u32;
    if step >= steps { (0, fraction - 1.0) } else { (step << FINE_BITS, fraction) }
}

/// From 2⁵² on all numbers are whole.
const WHOLE: f64 = 4_503_599_627_370_496.0;

/// Next whole number below. The one of the standard library is a call on machines whose least common ground has no instruction for it.
#[inline(always)]
fn floor(value: f64) -> f64 {
    let size = value.abs();
    let nearest = if size < WHOLE { ((size + WHOLE) - WHOLE).copysign(value) } else { value };
    if nearest > value { nearest - 1.0 } else { nearest }
}

/// Units of 2⁻³² turns as turns.
#[inline(always)]
pub fn turns(units: i32) -> f32 {
    units as f32 * (1.0 / UNITS as f32)
}

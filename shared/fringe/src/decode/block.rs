//! A block of pixels: how many, what is known of them, where they are written.

use std::ops::AddAssign;

/// Pixels of a block: what it needs, some 90 bytes a pixel, fits a first cache of 32 KiB.
pub const BLOCK: usize = 256;

/// Pixels of one parallel job in `finish`; fixed, so that the work is cut the same way on every machine.
pub const CHUNK: usize = 64 * BLOCK;

/// What is known of a pixel's order after its own frames; stands in the validity plane until the neighbours have spoken.
pub mod state {
    /// The pixel is masked: no phase.
    pub const INVALID: u8 = 0;
    /// The fringe order is certain.
    pub const SURE: u8 = 1;
    /// Order decided close to the limit: one neighbour must confirm it.
    pub const WEAK: u8 = 2;
    /// Order open: two neighbours must prove it.
    pub const OPEN: u8 = 3;
}

/// Counts of masked pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// A clipped sine frame.
    pub saturated: usize,
    /// Not masked: decoded from the sine frames that are not clipped.
    pub recovered: usize,
    /// Pixels with too little modulation.
    pub dark: usize,
    /// Pixels whose phase noise exceeds the limit.
    pub noisy: usize,
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.saturated += other.saturated;
        self.recovered += other.recovered;
        self.dark += other.dark;
        self.noisy += other.noisy;
    }
}

/// The part of the output planes that belongs to a block.
pub struct Planes<'a> {
    /// Absolute phase of each pixel, rad.
    pub phase_rad: &'a mut [f32],
    /// Its standard uncertainty, rad.
    pub sigma_rad: &'a mut [f32],
    /// Modulation B of each pixel, DN.
    pub modulation: &'a mut [f32],
    /// One value of [`state`] for each pixel.
    pub state: &'a mut [u8],
}

/// Sum of two counts, for a parallel reduction.
pub fn sum<T: AddAssign>(mut a: T, b: T) -> T {
    a += b;
    a
}

/// So many values from a place on, at most N, and another value behind them.
#[inline(always)]
pub fn filled<T: Copy, const N: usize>(values: &[T], first: usize, count: usize, rest: T) -> [T; N] {
    let mut filled = [rest; N];
    if count == N {
        filled.copy_from_slice(&values[first..first + N]);
    } else {
        filled[..count].copy_from_slice(&values[first..first + count]);
    }
    filled
}

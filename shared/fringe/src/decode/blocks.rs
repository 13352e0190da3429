//! All blocks of an image, in fixed chunks.

use super::block::{BLOCK, CHUNK, Planes, Tally, sum};
use super::order::{Kernel, Lanes};
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use fearless_simd::Level;
use rayon::prelude::*;
use std::ops::Range;

/// Decodes every pixel by its own frames.
pub fn decode_blocks(kernel: &Kernel, level: Level, out: &mut PhaseViewMut) -> Tally {
    let planes = out.phase_rad.par_chunks_mut(CHUNK).zip(out.sigma_rad.par_chunks_mut(CHUNK));
    let planes = planes.zip(out.modulation.par_chunks_mut(CHUNK)).zip(out.valid.par_chunks_mut(CHUNK));
    let tallies = planes.enumerate().map(|(chunk, (((phase_rad, sigma_rad), modulation), state))| {
        let mut planes = Planes { phase_rad, sigma_rad, modulation, state };
        decode_chunk(kernel, level, chunk * CHUNK, &mut planes)
    });
    tallies.reduce(Tally::default, sum)
}

/// Decodes the pixels in `range`, at most [`BLOCK`]. One function for all that decode: it is the longest of all to compile.
#[inline(never)]
pub fn decode_block(
    kernel: &Kernel,
    level: Level,
    range: &Range<usize>,
    lanes: &mut Lanes,
    planes: &mut Planes,
) -> Tally {
    vectorised!(level, kernel.block(range, lanes, planes))
}

fn decode_chunk(kernel: &Kernel, level: Level, chunk: usize, planes: &mut Planes) -> Tally {
    let mut tally = Tally::default();
    let mut lanes = Lanes::new();
    let Planes { phase_rad, sigma_rad, modulation, state } = planes;
    for first in (0..state.len()).step_by(BLOCK) {
        let part = first..(first + BLOCK).min(state.len());
        let start = chunk + first;
        tally += decode_block(
            kernel,
            level,
            &(start..start + part.len()),
            &mut lanes,
            &mut Planes {
                phase_rad: &mut phase_rad[part.clone()],
                sigma_rad: &mut sigma_rad[part.clone()],
                modulation: &mut modulation[part.clone()],
                state: &mut state[part],
            },
        );
    }
    tally
}

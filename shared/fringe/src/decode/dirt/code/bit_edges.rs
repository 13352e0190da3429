//! Edges of the bits of a code: whether the words on both sides of them belong to stripes side by side.
//!
//! Where a bit of a Gray code changes, the next finer one is light and all others are dark; where one of them is wrong, or the bit itself, nearly
//! all its edges are strange. Of a right code few are, also on a part of many faces and in noise: its bits change on surfaces, not between them.
//! Words are read some pixels beside the edge, where noise does not turn the bit itself.

use super::CodeLook;
use super::displaced::code_of;
use crate::decode::bits::resolve;
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;
use crate::pattern::Code;

/// Words are read so many pixels before and behind an edge.
const REACH_PX: usize = 2;
/// So many finer bits are asked beside a bit.
const FINER_BITS: usize = 6;
/// The finest bits change again within the reach: their edges tell nothing of themselves.
const FINEST_BITS: usize = 2;
/// Edges of a frame that are asked, at most.
const MOST: usize = 3000;
/// Fewer edges tell nothing.
const LEAST: usize = 100;
/// Places whose distance in stripes is looked at, about.
const SAMPLES: usize = 20_000;
/// A bit of whose edges so many are strange is contradicted.
const STRANGE: f64 = 0.85;

/// Words on both sides of the edges of each frame.
#[derive(Debug)]
pub struct BitEdges {
    code: Code,
    /// Number of bits, each with its frame.
    bits: usize,
    /// Of each frame, for each of its edges what all frames show on both sides: the first frame the most significant bit.
    of_frame: Vec<Vec<[u16; 2]>>,
    /// Finest stripes between both sides, in the median of all places.
    stripes_apart: i32,
}

/// How the frames are read.
#[derive(Debug, Clone)]
pub struct Reading {
    /// Frame of each bit.
    pub order: Vec<usize>,
    /// Bits that may be anything, and are not asked themselves.
    pub free: Option<usize>,
    /// A bit whose frame shows light and dark exchanged.
    pub inverted: Option<usize>,
}

/// Which bits contradict the others.
#[derive(Debug, Clone, PartialEq)]
pub struct Contradiction {
    /// Share of strange edges of each bit, 0 where there are too few edges.
    pub strange: Vec<f64>,
}

impl Contradiction {
    /// The bits nearly all of whose edges are strange.
    pub fn bits(&self) -> impl Iterator<Item = usize> + '_ {
        let asked = self.strange.len().saturating_sub(FINEST_BITS);
        (0..asked).filter(|bit| self.strange[*bit] >= STRANGE)
    }

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.bits().next().is_none()
    }

    /// Sum of the shares.
    pub fn sum(&self) -> f64 {
        self.strange.iter().sum()
    }
}

impl BitEdges {
    /// Reads the frames of a code's bits, in their order.
    pub fn new(look: &CodeLook, rasters: &Rasters, frames: &[usize]) -> Self {
        let code = code_of(look, frames);
        let word = |place: usize| {
            frames
                .iter()
                .fold(0, |word: u16, frame| word << 1 | u16::from(look.is_light(rasters, *frame, place)))
        };
        let of_frame = |(bit, frame): (usize, &usize)| {
            let mask = 1 << (frames.len() - 1 - bit);
            let sides = edges(look, rasters, *frame);
            let words = sides.into_iter().map(|sides| sides.map(word));
            words.filter(|[a, b]| (a ^ b) & mask != 0).collect()
        };
        let of_frame = frames.iter().enumerate().map(of_frame).collect();
        Self { code, bits: frames.len(), of_frame, stripes_apart: stripes_apart(look, code, word) }
    }

    /// The frames as they come.
    pub fn plain(&self) -> Reading {
        Reading { order: (0..self.bits).collect(), free: None, inverted: None }
    }

    /// What contradicts when the frames are read so.
    pub fn contradiction(&self, reading: &Reading) -> Contradiction {
        let strange = |bit: usize| {
            let of_bit = &self.of_frame[reading.order[bit]];
            if of_bit.len() < LEAST || reading.free == Some(bit) {
                return 0.0;
            }
            let asked = (bit + 1 + FINER_BITS).min(self.bits);
            let mask =
                |bit: Option<usize>| bit.filter(|bit| *bit < asked).map_or(0, |bit| 1 << (asked - 1 - bit));
            let (free, inverted) = (mask(reading.free), mask(reading.inverted));
            let apart = 1 + (self.stripes_apart >> (self.bits - asked));
            let order = &reading.order[..asked];
            let word = |seen: u16| {
                inverted
                    ^ order.iter().fold(0, |word, frame| word << 1 | (seen >> (self.bits - 1 - frame)) & 1)
            };
            let strange = of_bit.iter().filter(|sides| {
                let [a, b] = sides.map(word);
                !near(a, b, free, self.code, apart)
            });
            strange.count() as f64 / of_bit.len() as f64
        };
        Contradiction { strange: (0..self.bits).map(strange).collect() }
    }

    /// The same of the frames as they come, with one bit free.
    pub fn without(&self, bit: usize) -> Contradiction {
        self.contradiction(&Reading { free: Some(bit), ..self.plain() })
    }
}

/// Finest stripes that lie between both sides of an edge, in the median of all places, along the rows or the columns, where there are more.
fn stripes_apart(look: &CodeLook, code: Code, word: impl Fn(usize) -> u16) -> i32 {
    let (width, pixels) = (look.width, look.middle_dn.len());
    let apart = 2 * REACH_PX + 1;
    let every = (pixels / SAMPLES).max(1) | 1;
    let of_step = |step: usize| {
        let places = (0..pixels.saturating_sub(apart * step)).step_by(every);
        let lit = places.map(|place| [place, place + apart * step]);
        let lit = lit.filter(|sides| sides.iter().all(|side| look.contrast_dn[*side] > 0.0));
        let numbers = lit.map(|sides| sides.map(|side| i32::from(resolve(word(side), code))));
        let mut found: Vec<f64> = numbers.map(|[a, b]| f64::from((a - b).abs())).collect();
        median(&mut found).unwrap_or(0.0) as i32
    };
    of_step(1).max(of_step(width))
}

/// Whether two words may be stripes at most so many apart, whatever the free bits are.
pub fn near(a: u16, b: u16, free: u16, code: Code, apart: i32) -> bool {
    let fillings = |word: u16| {
        let mut flips = Some(free);
        std::iter::from_fn(move || {
            let now = flips?;
            flips = (now != 0).then(|| (now - 1) & free);
            Some(i32::from(resolve(word ^ now, code)))
        })
    };
    fillings(a).any(|a| fillings(b).any(|b| (a - b).abs() <= apart))
}

/// Places on both sides of the edges of a frame along the rows and the columns, evenly chosen.
fn edges(look: &CodeLook, rasters: &Rasters, frame: usize) -> Vec<[usize; 2]> {
    let (width, pixels) = (look.width, look.middle_dn.len());
    let lit = |place: usize| look.contrast_dn[place] > 0.0;
    let light = |place: usize| look.is_light(rasters, frame, place);
    let mut found = Vec::new();
    for place in (0..pixels).filter(|place| lit(*place)) {
        let (column, row) = (place % width, place / width);
        let here = light(place);
        let mut offer = |step: usize, before: usize, after: usize| {
            if before < REACH_PX || after < REACH_PX + 1 {
                return;
            }
            let sides = [place - REACH_PX * step, place + (REACH_PX + 1) * step];
            if lit(place + step) && light(place + step) != here && sides.iter().all(|side| lit(*side)) {
                found.push(sides);
            }
        };
        offer(1, column, width - 1 - column);
        offer(width, row, pixels / width - 1 - row);
    }
    let every = found.len().div_ceil(MOST).max(1);
    found.into_iter().step_by(every).collect()
}

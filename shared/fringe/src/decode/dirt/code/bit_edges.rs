//! Edges of the bits of a code: whether the words on both sides of them belong to stripes side by side.
//!
//! Where a bit of a Gray code changes, the next finer one is light and all others are dark; where one of them is wrong, or the bit itself, nearly
//! all its edges are strange. Of a right code few are, also on a part of many faces and in noise: its bits change on surfaces, not between them.
//! Words are read some pixels beside the edge, where noise does not turn the bit itself.

use super::CodeLook;
use super::steps::Steps;
use crate::decode::bits::resolve;
use crate::decode::rasters::Rasters;
use crate::pattern::Code;

/// Words are read so many pixels before and behind an edge.
pub const REACH_PX: usize = 2;
/// So many finer bits are asked beside a bit: noise in the finest would forbid it anywhere.
pub const FINER_BITS: usize = 6;
/// The finest bits change again within the reach: their edges tell nothing of themselves.
const FINEST_BITS: usize = 2;
/// Edges of a frame that are asked, at most.
const MOST: usize = 3000;
/// Fewer edges tell nothing.
const LEAST: usize = 100;
/// A bit of whose edges so many are strange is contradicted.
const STRANGE: f64 = 0.85;

/// How the bits of a code are read.
#[derive(Debug, Clone)]
pub struct Reading {
    /// Frame of each bit, and whether it shows the inverse.
    pub from: Vec<(usize, bool)>,
    /// Bits that may be anything.
    pub free: u16,
}

impl Reading {
    /// Each bit from its own frame.
    pub fn plain(frames: &[usize]) -> Self {
        Self { from: frames.iter().map(|frame| (*frame, false)).collect(), free: 0 }
    }
}

/// A place at which a frame changes between light and dark, and the neighbour to which it does.
#[derive(Debug, Clone, Copy)]
pub struct Change {
    /// Pixel before the change.
    pub place: usize,
    /// Pixel behind it, in the same row or column.
    pub beside: usize,
    /// Whether the first of both is light.
    pub light: bool,
}

/// Words on both sides of the edges of each frame.
#[derive(Debug)]
pub struct BitEdges {
    code: Code,
    /// The frame of each bit.
    frames: Vec<usize>,
    /// Of each frame, for each of its edges what all frames show on both sides: the first frame the most significant bit.
    of_frame: Vec<Vec<[u16; 2]>>,
    /// How the stripes run on over as many pixels as lie between both sides.
    steps: Steps,
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
        let code = frames.first().map_or(Code::Gray, |frame| look.code_of(*frame));
        let from = Reading::plain(frames).from;
        let words = |sides: [usize; 2]| {
            let [a, b] = sides.map(|place| look.word(rasters, &from, place));
            a.zip(b).map(|(a, b)| [a, b])
        };
        let of_frame = |(bit, frame): (usize, &usize)| {
            let mask = 1 << (frames.len() - 1 - bit);
            let words = edges(look, rasters, *frame).into_iter().filter_map(words);
            words.filter(|[a, b]| (a ^ b) & mask != 0).collect()
        };
        let of_frame = frames.iter().enumerate().map(of_frame).collect();
        let steps = Steps::new(look, rasters, &from);
        Self { code, frames: frames.to_vec(), of_frame, steps }
    }

    /// What contradicts when the frames are read so; free bits are not asked themselves.
    pub fn contradiction(&self, reading: &Reading) -> Contradiction {
        let bits = self.frames.len();
        let number = |frame: usize| self.frames.iter().position(|own| *own == frame).unwrap_or(0);
        let from: Vec<(usize, bool)> =
            reading.from.iter().map(|(frame, inverse)| (number(*frame), *inverse)).collect();
        let strange = |bit: usize| {
            let of_bit = &self.of_frame[from[bit].0];
            if of_bit.len() < LEAST || reading.free >> (bits - 1 - bit) & 1 == 1 {
                return 0.0;
            }
            let asked = (bit + 1 + FINER_BITS).min(bits);
            let left_out = bits - asked;
            let word = |seen: u16| {
                from[..asked].iter().fold(0, |word, (number, inverse)| {
                    word << 1 | (seen >> (bits - 1 - number) & 1) ^ u16::from(*inverse)
                })
            };
            let strange = of_bit.iter().filter(|sides| {
                let [a, b] = sides.map(word);
                !near(a, b, reading.free >> left_out, self.code, 1 + (self.steps.apart >> left_out))
            });
            strange.count() as f64 / of_bit.len() as f64
        };
        Contradiction { strange: (0..bits).map(strange).collect() }
    }
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
    let (width, height) = (look.width, look.middle_dn.len() / look.width);
    let sides = |Change { place, beside, .. }: Change| {
        let step = beside - place;
        let (before, size) = if step == 1 { (place % width, width) } else { (place / width, height) };
        let inner = before >= REACH_PX && before + REACH_PX + 1 < size;
        inner.then(|| [place - REACH_PX * step, beside + REACH_PX * step])
    };
    let lit = |sides: &[usize; 2]| sides.iter().all(|side| look.contrast_dn[*side] > 0.0);
    evenly(changes(look, rasters, frame).into_iter().filter_map(sides).filter(lit).collect())
}

/// Places at which a frame changes between light and dark.
pub fn changes(look: &CodeLook, rasters: &Rasters, frame: usize) -> Vec<Change> {
    let (width, pixels) = (look.width, look.middle_dn.len());
    let light = |place: usize| (look.contrast_dn[place] > 0.0).then(|| look.is_light(rasters, frame, place));
    let mut found = Vec::new();
    for place in 0..pixels {
        let Some(here) = light(place) else { continue };
        let right = (place + 1) % width != 0;
        for beside in [(right, place + 1), (place + width < pixels, place + width)] {
            if beside.0 && light(beside.1).is_some_and(|there| there != here) {
                found.push(Change { place, beside: beside.1, light: here });
            }
        }
    }
    found
}

/// So many of them as are asked, evenly chosen.
pub fn evenly<T>(found: Vec<T>) -> Vec<T> {
    let every = found.len().div_ceil(MOST).max(1);
    found.into_iter().step_by(every).collect()
}

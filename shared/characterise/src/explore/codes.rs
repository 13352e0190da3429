//! White, black and codes among frames that are no phase-stepped set.

use super::samples::Samples;
use super::{FrameFigures, Group, axis_of};
use fringe::math::statistics::median;
use fringe::pattern::{Axis, Code};
use std::ops::Range;

/// A frame is all bright, or all dark, when this share of the pixels is.
const UNIFORM: f64 = 0.995;

/// Complementary frames disagree at this share of the pixels at least: all but those at edges. The finest bits may blur away,
/// so the middle one of a code's frames counts.
const COMPLEMENT: f64 = 0.85;

/// Fewest bits before a new code is looked for: the widest stripes may have their only edge outside the picture.
const LEAST_BITS: usize = 3;

/// A new code begins where the edges become fewer by this factor.
const NEW_CODE: f64 = 0.5;

/// Most bits of a code.
const MAX_BITS: usize = 16;

/// A code: bit frames from the widest stripes to the finest.
pub(super) struct Coded {
    /// Frame numbers, most significant bit first.
    pub frames: Vec<usize>,
    /// Axis along which there are more edges.
    pub axis: Axis,
    /// Whether there are at least twice as many.
    pub clear: bool,
    /// Reflected or plain binary.
    pub code: Code,
    /// Whether the frames are the complement of an earlier code.
    pub inverse: bool,
    /// Stripe number at each pixel and, along the axis, at its neighbour.
    pub stripes: [Vec<i32>; 2],
    /// Change of the stripe number per camera pixel, mean over neighbours on the same or the next stripe.
    pub per_px: f64,
}

/// Explains a run of frames between phase-stepped sets.
pub(super) fn find(
    samples: &Samples,
    figures: &[FrameFigures],
    run: Range<usize>,
    groups: &mut Vec<Group>,
    unexplained: &mut Vec<usize>,
) {
    let (before, bits, after) = strip(figures, run);
    let uniform = |frame: usize| {
        if figures[frame].bright_share > 0.5 { Group::White(frame) } else { Group::Black(frame) }
    };
    groups.extend(before.map(uniform));
    for (number, block) in blocks(samples, figures, bits).into_iter().enumerate() {
        if block.len() > MAX_BITS || (block.len() < 2 && number == 0) {
            unexplained.extend(block);
            continue;
        }
        let earlier = groups.iter().find_map(|group| match group {
            Group::Coded(code) if !code.inverse && complements(samples, &code.frames, &block) => Some(code),
            _ => None,
        });
        let coded = Coded::new(samples, figures, block, earlier);
        groups.push(Group::Coded(coded));
    }
    groups.extend(after.map(uniform));
}

/// Uniform frames at both ends of a run, each kind once an end, and what is between them: uniform frames there are bits whose
/// edges lie outside the picture.
fn strip(figures: &[FrameFigures], run: Range<usize>) -> (Range<usize>, Range<usize>, Range<usize>) {
    let kind = |frame: usize| {
        let share = figures[frame].bright_share;
        if share > UNIFORM {
            Some(true)
        } else if share < 1.0 - UNIFORM {
            Some(false)
        } else {
            None
        }
    };
    let ends = |mut frames: Vec<usize>| {
        frames.truncate(2);
        let kinds: Vec<_> = frames.iter().map_while(|frame| kind(*frame)).collect();
        if kinds.len() == 2 && kinds[0] == kinds[1] { 1 } else { kinds.len() }
    };
    let before = ends(run.clone().collect());
    let after = ends((run.start + before..run.end).rev().collect());
    let (first, last) = (run.start + before, run.end - after);
    (run.start..first, first..last, last..run.end)
}

/// Splits bit frames into codes, each from the widest stripes to the finest.
fn blocks(samples: &Samples, figures: &[FrameFigures], bits: Range<usize>) -> Vec<Vec<usize>> {
    let frames: Vec<usize> = bits.collect();
    // Each bit followed by its complement: two codes that take turns.
    let turns = frames.len() >= 4
        && frames.len().is_multiple_of(2)
        && complementary(samples, frames.chunks(2).map(|pair| [pair[0], pair[1]]));
    if turns {
        let of = |first: usize| frames.iter().copied().skip(first).step_by(2).collect::<Vec<_>>();
        let (bits, inverse) = (split(figures, &of(0)), split(figures, &of(1)));
        return bits.into_iter().zip(inverse).flat_map(|(a, b)| [a, b]).collect();
    }
    split(figures, &frames)
}

/// Splits where the stripes become wide again, in the order of the frames or in the reverse one, whichever gives fewer codes.
fn split(figures: &[FrameFigures], frames: &[usize]) -> Vec<Vec<usize>> {
    let edges = |frame: usize| figures[frame].edges_x + figures[frame].edges_y;
    let cut = |frames: &[usize]| {
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for frame in frames {
            match parts.last_mut() {
                Some(part)
                    if part.len() < LEAST_BITS
                        || part.last().is_none_or(|last| edges(*frame) >= NEW_CODE * edges(*last)) =>
                {
                    part.push(*frame);
                }
                _ => parts.push(vec![*frame]),
            }
        }
        parts
    };
    let forward = cut(frames);
    let reversed: Vec<usize> = frames.iter().rev().copied().collect();
    let mut backward = cut(&reversed);
    if backward.len() < forward.len() {
        backward.reverse();
        backward
    } else {
        forward
    }
}

/// Whether a block is the complement of another, frame by frame.
fn complements(samples: &Samples, code: &[usize], block: &[usize]) -> bool {
    code.len() == block.len() && complementary(samples, code.iter().zip(block).map(|(a, b)| [*a, *b]))
}

/// Whether most of some pairs of frames are complementary.
fn complementary(samples: &Samples, pairs: impl Iterator<Item = [usize; 2]>) -> bool {
    let mut shares: Vec<f64> = pairs.map(|[a, b]| samples.contradiction(a, b)).collect();
    median(&mut shares).is_some_and(|share| share > COMPLEMENT)
}

impl Coded {
    fn new(samples: &Samples, figures: &[FrameFigures], frames: Vec<usize>, earlier: Option<&Self>) -> Self {
        let sum = |part: fn(&FrameFigures) -> f64| frames.iter().map(|f| part(&figures[*f])).sum::<f64>();
        let (axis, clear) = axis_of(sum(|f| f.edges_x), sum(|f| f.edges_y));
        let next = if axis == Axis::X { 1 } else { 2 };
        let plain = [0, next].map(|place| numbers(samples, &frames, place));
        let reflected = plain.clone().map(|numbers| numbers.into_iter().map(from_gray).collect::<Vec<i32>>());
        let near =
            |pair: &[Vec<i32>; 2]| pair[0].iter().zip(&pair[1]).filter(|(a, b)| a.abs_diff(**b) < 2).count();
        let code = match earlier {
            Some(earlier) => earlier.code,
            None if near(&plain) > near(&reflected) => Code::Binary,
            None => Code::Gray,
        };
        let stripes = if code == Code::Gray { reflected } else { plain };
        let steps: Vec<i32> =
            stripes[0].iter().zip(&stripes[1]).map(|(a, b)| b - a).filter(|step| step.abs() < 2).collect();
        let per_px = f64::from(steps.iter().sum::<i32>()) / steps.len().max(1) as f64;
        Self { frames, axis, clear, code, inverse: earlier.is_some(), stripes, per_px }
    }
}

/// Numbers whose bits the frames show, most significant first.
fn numbers(samples: &Samples, frames: &[usize], place: usize) -> Vec<i32> {
    let mut numbers = vec![0; samples.len()];
    for frame in frames {
        for (number, bright) in numbers.iter_mut().zip(samples.bright(*frame, place)) {
            *number = 2 * *number + i32::from(bright);
        }
    }
    numbers
}

/// Stripe number of a reflected binary one.
fn from_gray(gray: i32) -> i32 {
    let mut number = gray;
    for shift in [8, 4, 2, 1] {
        number ^= number >> shift;
    }
    number
}

//! Levels of the frames of a code: dark and light of each, and whether two frames show the same.

use super::CodeLook;
use crate::decode::rasters::Rasters;

/// Levels nearer to the middle than this are no bit.
const CLEAR: f32 = 0.3;
/// Frames that show the same in this share of the clear pixels are one.
const DOUBLED: f64 = 0.97;
/// Pixels that are looked at, about.
pub const SAMPLES: usize = 200_000;
/// Rounds of the search for the two levels of a frame.
const ROUNDS: usize = 12;

/// One of so many pixels is looked at.
pub fn every(look: &CodeLook) -> usize {
    (look.middle_dn.len() / SAMPLES).max(1) | 1
}

/// The levels of dark and light of a frame; none where it shows but one.
pub fn two_levels(look: &CodeLook, rasters: &Rasters, frame: usize) -> Option<[f64; 2]> {
    let places =
        (0..look.middle_dn.len()).step_by(every(look)).filter(|place| look.contrast_dn[*place] > 0.0);
    let levels: Vec<f64> = places.map(|place| f64::from(look.level(rasters, frame, place))).collect();
    let (mut dark, mut light) = (-1.0, 1.0);
    for _ in 0..ROUNDS {
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for level in &levels {
            let class = usize::from(*level > 0.5 * (dark + light));
            sums[class] += level;
            counts[class] += 1.0;
        }
        let least = 0.05 * (counts[0] + counts[1]);
        if counts[0] < least || counts[1] < least {
            return None;
        }
        (dark, light) = (sums[0] / counts[0], sums[1] / counts[1]);
    }
    (light - dark > 0.3).then_some([dark, light])
}

/// Share of clear pixels in which two frames show the same.
pub fn same(look: &CodeLook, rasters: &Rasters, one: usize, other: usize) -> f64 {
    let every = every(look);
    let (mut same, mut clear) = (0.0, 0.0);
    for place in (0..look.middle_dn.len()).step_by(every).filter(|place| look.contrast_dn[*place] > 0.0) {
        let (a, b) = (look.level(rasters, one, place), look.level(rasters, other, place));
        if a.abs() > CLEAR && b.abs() > CLEAR {
            clear += 1.0;
            same += f64::from(u8::from((a > 0.0) == (b > 0.0)));
        }
    }
    same / f64::max(clear, 1.0)
}

/// Whether another one of the frames shows the same.
pub fn is_doubled<'a>(
    look: &CodeLook,
    rasters: &Rasters,
    frames: impl IntoIterator<Item = &'a usize>,
    frame: usize,
) -> bool {
    frames.into_iter().any(|other| *other != frame && same(look, rasters, frame, *other) > DOUBLED)
}

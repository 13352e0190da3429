//! Frames of a code without fringes that stand beside the others: camera, part or pattern moved while one of them was taken.
//!
//! Where a bit changes from pixel to pixel, the words on both sides belong to stripes side by side. A frame that is shifted changes where
//! the other bits do not allow it; moved back, it changes where they do. The changes of a frame that is right are as often allowed
//! where they stand as anywhere else, also on a part of many faces: moving such a frame gains nothing.
//!
//! Of a Gray code a bit may change anywhere in two stripes. A shift of less than a stripe is therefore not seen, and the last bit, which every
//! pair of stripes has, is not asked.

use super::bit_edges::{Change, FINER_BITS, changes, evenly, near};
use super::frame_levels::{is_doubled, two_levels};
use super::{CodeLook, Fault, Finding, Remedy};
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;
use crate::pattern::Code;

/// Shifts that are tried reach so far, px.
const REACH_PX: i32 = 32;
/// Step between shifts that are tried, px.
const STEP_PX: usize = 2;
/// Frames with less of the largest contrast are too blurred to tell anything.
const CLEAR_CONTRAST: f64 = 0.5;
/// Fewer changes tell nothing.
const LEAST: usize = 60;
/// A bit is suspect when this share of its changes is not allowed.
const SUSPECT: f64 = 0.4;
/// A frame is shifted when so much larger a share of its changes is allowed at another place …
const GAIN: f64 = 0.3;
/// … and so many of them: the rest are edges of the part.
const LEAST_GAINED: f64 = 40.0;
/// So many of the changes must still be within the picture there.
const KEPT: f64 = 0.7;
/// Shifts with less than this part of the gain missing are as good as the best.
const AS_GOOD: f64 = 0.1;

/// Words of all pixels; `None` where the code has no contrast.
struct Words {
    seen: Vec<Option<u16>>,
    width: usize,
    code: Code,
}

/// Finds shifted frames among `frames`, which show the bits of a code in order (their inverses where `inverse`), and moves them back.
pub fn move_back(
    look: &CodeLook,
    frames: &[usize],
    inverse: bool,
    rasters: &mut Rasters,
    findings: &mut Vec<Finding>,
) {
    let frames = &frames[..clear_bits(look, frames, rasters, CLEAR_CONTRAST)];
    // From the finest on: a finer bit that is wrong makes coarser ones look so, not the other way round.
    for bit in (0..frames.len().saturating_sub(1)).rev() {
        let Some(by) = better_place(look, frames, bit, inverse, rasters) else { continue };
        // Narrow stripes tell that two frames stand apart, not which of them is wrong.
        let last_but_one = bit + 2 == frames.len();
        let remedy = if last_but_one { Remedy::Doubted } else { Remedy::MovedBack };
        name(look, frames[bit], by, remedy, findings);
        if !last_but_one {
            shift(look, frames[bit], by, rasters);
        }
    }
}

/// Says that a frame stands elsewhere, by so many columns and rows less: that explains what was doubted about it.
pub fn name(look: &CodeLook, frame: usize, by: [i32; 2], remedy: Remedy, findings: &mut Vec<Finding>) {
    let of_frame = look.frames[frame];
    findings.retain(|found| {
        (found.set, found.step) != (of_frame.set, Some(of_frame.step)) || found.remedy != Remedy::Doubted
    });
    findings.push(look.finding(frame, Fault::Displaced(-by[0] as i16, -by[1] as i16), remedy));
}

/// How far a bit must be moved, columns and rows, so that its changes are allowed by the other bits; none where it need not or nothing
/// is gained.
pub fn better_place(
    look: &CodeLook,
    frames: &[usize],
    bit: usize,
    inverse: bool,
    rasters: &Rasters,
) -> Option<[i32; 2]> {
    let changes = evenly(changes(look, rasters, frames[bit]));
    if changes.len() < LEAST {
        return None;
    }
    let asked = &frames[..(bit + 1 + FINER_BITS).min(frames.len())];
    let mask = 1 << (asked.len() - 1 - bit);
    let code = look.code_of(frames[bit]);
    let from: Vec<(usize, bool)> = asked.iter().map(|frame| (*frame, inverse)).collect();
    let word = |place: usize| look.word(rasters, &from, place);
    let here = strange(&changes, mask, code, word).map_or(0.0, |(share, _)| share);
    // A frame that shows what another one does is no shifted one.
    if here < SUSPECT || is_doubled(look, rasters, frames, frames[bit]) {
        return None;
    }
    let seen = (0..look.middle_dn.len()).map(word).collect();
    Words { seen, width: look.width, code }.better_place(&changes, mask, here)
}

/// Number of the first bits: the last ones have less than this share of the largest contrast.
pub fn clear_bits(look: &CodeLook, frames: &[usize], rasters: &Rasters, share: f64) -> usize {
    let contrast = |frame: &usize| two_levels(look, rasters, *frame).map(|[dark, light]| light - dark);
    let contrasts: Vec<Option<f64>> = frames.iter().map(contrast).collect();
    let most = contrasts.iter().flatten().copied().fold(0.0, f64::max);
    let blurred = |own: &Option<f64>| own.is_none_or(|own| own < share * most);
    frames.len() - contrasts.iter().rev().take_while(|own| blurred(own)).count()
}

/// Share of the changes that the other bits do not allow, and how many there are; `word` gives the bits at a place.
fn strange(
    changes: &[Change],
    mask: u16,
    code: Code,
    word: impl Fn(usize) -> Option<u16>,
) -> Option<(f64, usize)> {
    let (mut strange, mut seen) = (0_usize, 0_usize);
    for change in changes {
        let Some((a, b)) = word(change.place).zip(word(change.beside)) else { continue };
        let [a, b] = if change.light { [a | mask, b & !mask] } else { [a & !mask, b | mask] };
        seen += 1;
        strange += usize::from(!near(a, b, 0, code, 1));
    }
    (seen > 0).then(|| (strange as f64 / seen as f64, seen))
}

impl Words {
    /// The same of changes that are moved by so many columns and rows.
    fn strange(&self, changes: &[Change], mask: u16, by: [i32; 2]) -> Option<(f64, usize)> {
        strange(changes, mask, self.code, |place| self.moved(place, by))
    }

    fn moved(&self, place: usize, [right, down]: [i32; 2]) -> Option<u16> {
        let column = i64::try_from(place % self.width).ok()? + i64::from(right);
        let row = i64::try_from(place / self.width).ok()? + i64::from(down);
        let column = usize::try_from(column).ok().filter(|column| *column < self.width)?;
        *self.seen.get(usize::try_from(row).ok()? * self.width + column)?
    }

    /// The shift, columns and rows, after which the changes are allowed: of those that are about as good as the best the shortest, for a
    /// shift along the stripes cannot be seen.
    fn better_place(&self, changes: &[Change], mask: u16, here: f64) -> Option<[i32; 2]> {
        let mut tried = Vec::new();
        for down in (-REACH_PX..=REACH_PX).step_by(STEP_PX) {
            for right in (-REACH_PX..=REACH_PX).step_by(STEP_PX) {
                if let Some((share, seen)) = self.strange(changes, mask, [right, down])
                    && seen as f64 >= KEPT * changes.len() as f64
                {
                    tried.push((share, [right, down]));
                }
            }
        }
        let best = tried.iter().map(|(share, _)| *share).min_by(f64::total_cmp)?;
        let gained = here - best;
        if gained < GAIN || gained * (changes.len() as f64) < LEAST_GAINED {
            return None;
        }
        let good = tried.iter().filter(|(share, _)| *share <= best + AS_GOOD * gained).map(|(_, by)| *by);
        let shortest = good.min_by_key(|by| by[0] * by[0] + by[1] * by[1])?;
        Some(self.centred(changes, mask, shortest))
    }

    /// The shift after which changes stand in the middle of the two stripes in which they are allowed, along the rows or, where more of
    /// the changes lie so, along the columns.
    fn centred(&self, changes: &[Change], mask: u16, by: [i32; 2]) -> [i32; 2] {
        let mut off_px = [Vec::new(), Vec::new()];
        for change in changes {
            let along = usize::from(change.beside != change.place + 1);
            let at = |steps: i32| {
                let mut by = by;
                by[along] += steps;
                self.moved(change.place, by).map(|word| word & !mask)
            };
            if self.strange(std::slice::from_ref(change), mask, by).is_none_or(|(share, _)| share > 0.0) {
                continue;
            }
            let Some(here) = at(0) else { continue };
            let end =
                |sense: i32| (1..REACH_PX).find(|steps| at(sense * steps).is_none_or(|word| word != here));
            if let Some((before, after)) = end(-1).zip(end(1)) {
                off_px[along].push(0.5 * f64::from(after - before));
            }
        }
        let along = usize::from(off_px[1].len() > off_px[0].len());
        let mut centred = by;
        centred[along] += median(&mut off_px[along]).map_or(0, |off| off.round() as i32);
        centred
    }
}

/// Writes a frame anew, moved by so many columns and rows; what comes from beyond the picture stays.
pub fn shift(look: &CodeLook, frame: usize, [right, down]: [i32; 2], rasters: &mut Rasters) {
    let (width, pixels) = (look.width, look.middle_dn.len());
    let raster = look.frames[frame].raster;
    let values = rasters.taken(raster);
    rasters.put(raster, |place| {
        let column = (place % width) as i64 - i64::from(right);
        let row = (place / width) as i64 - i64::from(down);
        let inside = column >= 0 && row >= 0 && column < width as i64 && row < (pixels / width) as i64;
        if inside { values[row as usize * width + column as usize] } else { values[place] }
    });
}

//! Coordinates that the regions demand, and whether the bits that are seen confirm them.
//!
//! Two surfaces whose phases meet by chance along a stretch of a rim become one region, and the turns of one of them are counted wrong. A bit that
//! is lost leaves two stripes open, so that single pixels seem to confirm even then; but not those of the fringes around them. So a
//! coordinate counts where it is confirmed nearly everywhere along the row and along the column, as far as the phase runs on. Where it is not, the pixels
//! are looked at as regions of their own; what is not confirmed then either is masked.

use super::covers::Covers;
use super::regions::{NONE, Regions};
use super::strips::Strips;
use super::{CodeLook, Shown};
use crate::decode::bits::resolve;
use crate::decode::coarse::centre_px;
use crate::decode::order::CODE_EDGE_PERIODS;
use crate::decode::rasters::Rasters;
use crate::decode::roles::CodePlan;
use std::collections::BTreeMap;

/// So many turns around a pixel are asked.
const AROUND: i16 = 2;
/// Share of the pixels there that confirm; a wrong fringe is confirmed by six in ten at most, where one bit is lost.
const CONFIRMED: f64 = 0.8;
/// Fewest pixels that are asked along the row or the column.
const LEAST: u32 = 16;
/// A coordinate that is refused.
const REFUSED: f32 = f32::INFINITY;

/// What is seen of the frames of a code.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub look: &'a CodeLook<'a>,
    pub covers: &'a Covers,
    /// Frames that are wrong, as a whole or where something stands before them.
    pub lost: &'a [usize],
    /// Level between dark and light.
    pub middle: f64,
}

impl Seen<'_> {
    /// Whether a frame does not show a pixel's bit: it is wrong as a whole, or something stands before it there.
    pub fn is_lost(&self, frame: usize, place: usize) -> bool {
        self.lost.contains(&frame) && (!self.covers.any(frame) || self.covers.hides(frame, place))
    }

    /// Whether any frame does not show a pixel's bit.
    fn is_open(&self, place: usize) -> bool {
        self.lost.iter().any(|frame| self.is_lost(*frame, place))
    }

    /// Looks at what is not confirmed as regions of its own, and refuses what is not confirmed then; so it does where a bit is lost in no region.
    pub fn settle(&self, regions: &Regions, rasters: &Rasters, demanded_px: &mut [f32]) {
        let look = self.look;
        self.refuse(look, regions, rasters, demanded_px, |[row, column]| row.max(column));
        let alone = |at: usize| if demanded_px[at] == REFUSED { look.phase_rad[at] } else { f32::NAN };
        let phase_rad: Vec<f32> = (0..demanded_px.len()).map(alone).collect();
        let rest = CodeLook { phase_rad: &phase_rad, ..*look };
        let own = Regions::new(&rest);
        let begins = Strips::new(&rest, &own, rasters, self.covers).begins(&rest);
        let mut anew_px = self::demanded_px(&rest, &own, &begins);
        // A chance meeting is a stretch of a rim, narrow along the row or the column.
        self.refuse(&rest, &own, rasters, &mut anew_px, |[row, column]| row.min(column));
        for (place, own) in demanded_px.iter_mut().enumerate().filter(|(_, own)| !own.is_finite()) {
            // In a part that is too small to be a region its neighbours know no more than it does.
            let is_alone = *own == REFUSED || (regions.home[place] == NONE && self.is_open(place));
            *own = if anew_px[place].is_nan() && is_alone { REFUSED } else { anew_px[place] };
        }
    }

    /// Refuses the coordinates that are not confirmed along rows and columns, or by too few: the pixels along the row and along the column that count.
    fn refuse(
        &self,
        look: &CodeLook,
        regions: &Regions,
        rasters: &Rasters,
        demanded_px: &mut [f32],
        enough: fn([u32; 2]) -> u32,
    ) {
        let first = |frame: &usize| matches!(look.frames[*frame].shown, Shown::Bit { bit: 0, .. });
        let codes: Vec<Bits> =
            (0..look.frames.len()).filter(first).filter_map(|frame| Bits::of(self, frame)).collect();
        let confirms = |place: usize| {
            let x_px = f64::from(demanded_px[place]);
            x_px.is_finite().then(|| codes.iter().all(|bits| bits.nearest(rasters, x_px, place).is_some()))
        };
        let confirms: Vec<Option<bool>> = (0..demanded_px.len()).map(confirms).collect();
        let (width, pixels) = (look.width, confirms.len());
        let mut asked = vec![[0; 2]; pixels];
        let rows = (0..pixels / width).map(|row| (0, row * width, 1, width));
        let columns = (0..width).map(|column| (1, column, width, pixels / width));
        for (way, start, stride, count) in rows.chain(columns) {
            let places: Vec<usize> = (0..count).map(|i| start + i * stride).collect();
            for run in places.chunk_by(|at, next| regions.runs_on(look, *at, *next)) {
                refuse_run(run, regions, &confirms, demanded_px, |place, count| asked[place][way] = count);
            }
        }
        for (demanded, asked) in demanded_px.iter_mut().zip(asked) {
            if demanded.is_finite() && enough(asked) < LEAST {
                *demanded = REFUSED;
            }
        }
    }
}

/// Refuses the coordinates along a run of pixels that few confirm in the turns around them.
fn refuse_run(
    run: &[usize],
    regions: &Regions,
    confirms: &[Option<bool>],
    demanded_px: &mut [f32],
    mut count: impl FnMut(usize, u32),
) {
    // Of each turn, the pixels that confirm and all of them.
    let mut of_turn: BTreeMap<i16, [u32; 2]> = BTreeMap::new();
    let asked = || run.iter().filter_map(|place| Some((*place, confirms[*place]?)));
    for (place, confirmed) in asked() {
        let [own, all] = of_turn.entry(regions.turns[place]).or_default();
        *own += u32::from(confirmed);
        *all += 1;
    }
    let around = |turn: i16| {
        let turns = of_turn.range(turn.saturating_sub(AROUND)..=turn.saturating_add(AROUND));
        turns.fold([0, 0], |[own, all], (_, turn)| [own + turn[0], all + turn[1]])
    };
    let around: BTreeMap<i16, [u32; 2]> = of_turn.keys().map(|turn| (*turn, around(*turn))).collect();
    for (place, _) in asked() {
        let [own, all] = around[&regions.turns[place]];
        count(place, all);
        if f64::from(own) < CONFIRMED * f64::from(all) {
            demanded_px[place] = REFUSED;
        }
    }
}

/// The frames of one code, or of its inverse, of which some are lost at some pixels.
pub(super) struct Bits<'a> {
    seen: Seen<'a>,
    code: CodePlan,
    inverse: bool,
    /// The bit that is asked for.
    own: u16,
    /// The frames, and their bits.
    frames: Vec<(usize, u16)>,
    /// Bits that are in no frame.
    nowhere: u16,
}

impl<'a> Bits<'a> {
    /// Those beside a frame; none for white and black.
    pub fn of(seen: &Seen<'a>, frame: usize) -> Option<Self> {
        let look = seen.look;
        let Shown::Bit { code, bit, inverse } = look.frames[frame].shown else { return None };
        let mask = |bit: usize| 1_u16 << (code.bits - 1 - bit);
        let frames = look.frames.iter().enumerate().filter_map(|(other, seen)| match seen.shown {
            Shown::Bit { code: own, bit, inverse: turned } if own == code && turned == inverse => {
                Some((other, mask(bit)))
            }
            _ => None,
        });
        let frames: Vec<(usize, u16)> = frames.collect();
        let all = (0..code.bits).fold(0, |all, bit| all | mask(bit));
        let nowhere = frames.iter().fold(all, |left, (_, bit)| left & !bit);
        Some(Self { seen: *seen, code, inverse, own: mask(bit), frames, nowhere })
    }

    /// Whether a frame is light at a coordinate that the bits which are seen confirm.
    pub fn demanded(&self, rasters: &Rasters, x_px: f64, place: usize) -> Option<bool> {
        let word = self.nearest(rasters, x_px, place)?;
        Some(((word & self.own) != 0) ^ self.inverse ^ self.code.invert)
    }

    /// The bits of the stripe nearest to a coordinate of all that the bits which are seen leave open; `None` where the coordinate is not in it.
    fn nearest(&self, rasters: &Rasters, x_px: f64, place: usize) -> Option<u16> {
        let Self { seen: Seen { look, middle, .. }, code, inverse, .. } = self;
        let (mut seen, mut unknown) = (0_u16, self.nowhere);
        for (frame, bit) in &self.frames {
            if self.seen.is_lost(*frame, place) {
                unknown |= bit;
            } else if (f64::from(look.level(rasters, *frame, place)) > *middle) ^ inverse ^ code.invert {
                seen |= bit;
            }
        }
        let (mut best, mut flips) = ((f64::INFINITY, 0_u16), unknown);
        loop {
            let number = resolve(seen | flips, code.code);
            let apart = (centre_px(code.stripe_px, u32::from(number)) - code.shift_px - x_px).abs();
            if apart < best.0 {
                best = (apart, seen | flips);
            }
            if flips == 0 {
                break;
            }
            flips = (flips - 1) & unknown;
        }
        (best.0 < 0.5 * code.stripe_px + CODE_EDGE_PERIODS * look.period_px).then_some(best.1)
    }
}

/// Coordinates of all pixels of regions whose begin is known, projector pixels; NaN elsewhere.
pub(super) fn demanded_px(look: &CodeLook, regions: &Regions, begins: &[Option<i32>]) -> Vec<f32> {
    let at = |place| coordinate_px(look, regions, begins, place).map_or(f32::NAN, |x_px| x_px as f32);
    (0..look.phase_rad.len()).map(at).collect()
}

/// Coordinate of a pixel of a region whose begin is known, projector pixels.
fn coordinate_px(look: &CodeLook, regions: &Regions, begins: &[Option<i32>], place: usize) -> Option<f64> {
    let home = regions.home[place];
    if home == NONE {
        return None;
    }
    let begin = (*begins.get(usize::from(home))?)?;
    Some((f64::from(begin) + f64::from(regions.turns[place]) + look.turn(place)?) * look.period_px)
}

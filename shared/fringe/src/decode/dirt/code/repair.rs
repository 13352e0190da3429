//! Stored frames of a code written anew, where what is left determines them.

use super::covers::Covers;
use super::regions::{NONE, Regions};
use super::strips::{Judged, Verdict};
use super::{CodeLook, Fault, Finding, Remedy, Shown};
use crate::decode::bits::resolve;
use crate::decode::coarse::centre_px;
use crate::decode::order::CODE_EDGE_PERIODS;
use crate::decode::rasters::Rasters;
use crate::decode::roles::CodePlan;

/// The pixels, their regions, and with which fringe each of these begins.
type Known<'a> = (&'a CodeLook<'a>, &'a Regions, &'a [Option<i32>]);

/// Bits of one code that are written from the phase at once.
const MOST_WRITTEN: usize = 2;

/// Writes the wrong frames anew; what was found and done.
pub(super) fn repair(
    known: Known,
    verdict: &Verdict,
    covers: &Covers,
    rasters: &mut Rasters,
) -> Vec<Finding> {
    let look = known.0;
    let mut findings = Vec::new();
    let wrong: Vec<usize> = (0..look.frames.len()).filter(|f| verdict.frames[*f].fault.is_some()).collect();
    // Frames that show each other's patterns are copied before anything is written over them.
    let moved: Vec<(usize, Vec<u16>)> = wrong
        .iter()
        .filter_map(|frame| {
            Some((
                *frame,
                rasters.taken(look.frames[verdict.frames[*frame].shown_by?].raster, look.phase_rad.len()),
            ))
        })
        .collect();
    let mut unseen = Vec::new();
    for frame in wrong {
        let judged = verdict.frames[frame];
        let Some(fault) = judged.fault else { continue };
        let remedy = if let Some((_, values)) = moved.iter().find(|(to, _)| *to == frame) {
            rasters.put(look.frames[frame].raster, values.len(), |place| values[place]);
            Remedy::OtherFrame
        } else {
            match fault {
                Fault::Level(_) | Fault::Inverse => {
                    stretch(look, frame, &judged, verdict, rasters);
                    Remedy::Normalised
                }
                _ if inverse_of(look, frame).is_some_and(|other| verdict.frames[other].fault.is_none()) => {
                    mirror(look, frame, inverse_of(look, frame).unwrap_or(frame), verdict, rasters);
                    Remedy::Inverse
                }
                _ => {
                    unseen.push(frame);
                    Remedy::Phase
                }
            }
        };
        findings.push(look.finding(frame, fault, remedy));
    }
    for frame in &unseen {
        if !matches!(look.frames[*frame].shown, Shown::Bit { .. }) {
            flat(look, *frame, verdict, covers, rasters);
        }
    }
    let mut lost: Vec<usize> = unseen;
    lost.retain(|frame| matches!(look.frames[*frame].shown, Shown::Bit { .. }));
    if lost.len() > MOST_WRITTEN {
        for finding in &mut findings {
            finding.remedy = Remedy::None;
        }
        return findings;
    }
    write(known, (&lost, verdict), covers, rasters);
    findings
}

/// The frame that shows the same bit with light and dark exchanged.
fn inverse_of(look: &CodeLook, frame: usize) -> Option<usize> {
    let Shown::Bit { code, bit, inverse } = look.frames[frame].shown else { return None };
    let wanted = Shown::Bit { code, bit, inverse: !inverse };
    look.frames.iter().position(|other| other.shown == wanted)
}

/// Grey value of a level.
fn value_dn(look: &CodeLook, place: usize, level: f64) -> u16 {
    let value = f64::from(look.middle_dn[place]) + level * f64::from(look.contrast_dn[place].max(0.0));
    if value.is_finite() { value.round().clamp(0.0, f64::from(u16::MAX)) as u16 } else { 0 }
}

/// Gives a frame the usual levels of light and dark.
fn stretch(look: &CodeLook, frame: usize, judged: &Judged, verdict: &Verdict, rasters: &mut Rasters) {
    let values = rasters.taken(look.frames[frame].raster, look.phase_rad.len());
    let scale = (verdict.light - verdict.dark) / (judged.light - judged.dark);
    rasters.put(look.frames[frame].raster, values.len(), |place| {
        let contrast = f64::from(look.contrast_dn[place]);
        if contrast <= 0.0 || !contrast.is_finite() {
            return values[place];
        }
        let level = (f64::from(values[place]) - f64::from(look.middle_dn[place])) / contrast;
        value_dn(look, place, verdict.dark + (level - judged.dark) * scale)
    });
}

/// Writes a frame as the inverse of another.
fn mirror(look: &CodeLook, frame: usize, other: usize, verdict: &Verdict, rasters: &mut Rasters) {
    let values = rasters.taken(look.frames[other].raster, look.phase_rad.len());
    let sum = verdict.dark + verdict.light;
    rasters.put(look.frames[frame].raster, values.len(), |place| {
        let twice = 2.0 * f64::from(value_dn(look, place, 0.5 * sum));
        (twice - f64::from(values[place])).clamp(0.0, f64::from(u16::MAX)) as u16
    });
}

/// White or black, from the fringes.
fn flat(look: &CodeLook, frame: usize, verdict: &Verdict, covers: &Covers, rasters: &mut Rasters) {
    let level = if look.frames[frame].shown == Shown::White { verdict.light } else { verdict.dark };
    let values = rasters.taken(look.frames[frame].raster, look.phase_rad.len());
    rasters.put(look.frames[frame].raster, values.len(), |place| {
        let is_seen = covers.any(frame) && !covers.hides(frame, place);
        if is_seen { values[place] } else { value_dn(look, place, level) }
    });
}

/// Writes bits that no frame shows as the phase of their region demands, where the other bits confirm it.
fn write(
    (look, regions, begins): Known,
    (lost, verdict): (&[usize], &Verdict),
    covers: &Covers,
    rasters: &mut Rasters,
) {
    let pixels = look.phase_rad.len();
    for frame in lost {
        let Some(bits) = Bits::of(look, *frame, lost, covers) else { continue };
        let middle = 0.5 * (verdict.dark + verdict.light);
        let values = rasters.taken(look.frames[*frame].raster, pixels);
        let value = |place: usize| {
            if !bits.is_lost(*frame, place) {
                return values[place];
            }
            let x_px = coordinate_px(look, regions, begins, place);
            let light = x_px.and_then(|x_px| bits.demanded(rasters, x_px, place, middle));
            let level = light.map_or(middle, |light| if light { verdict.light } else { verdict.dark });
            value_dn(look, place, level)
        };
        let written: Vec<u16> = (0..pixels).map(value).collect();
        rasters.put(look.frames[*frame].raster, pixels, |place| written[place]);
    }
}

/// The frames of one code, or of its inverse, of which some are lost at some pixels.
struct Bits<'a> {
    look: &'a CodeLook<'a>,
    covers: &'a Covers,
    lost: &'a [usize],
    code: CodePlan,
    inverse: bool,
    /// The bit that is asked for.
    own: u16,
    /// The frames, and their bits.
    frames: Vec<(usize, u16)>,
}

impl<'a> Bits<'a> {
    /// Those beside a frame; none for white and black.
    fn of(look: &'a CodeLook, frame: usize, lost: &'a [usize], covers: &'a Covers) -> Option<Self> {
        let Shown::Bit { code, bit, inverse } = look.frames[frame].shown else { return None };
        let mask = |bit: usize| 1_u16 << (code.bits - 1 - bit);
        let frames = look.frames.iter().enumerate().filter_map(|(other, seen)| match seen.shown {
            Shown::Bit { code: own, bit, inverse: turned } if own == code && turned == inverse => {
                Some((other, mask(bit)))
            }
            _ => None,
        });
        Some(Self { look, covers, lost, code, inverse, own: mask(bit), frames: frames.collect() })
    }

    /// Whether a frame does not show a pixel's bit: it is wrong as a whole, or something stands before it there.
    fn is_lost(&self, frame: usize, place: usize) -> bool {
        self.lost.contains(&frame) && (!self.covers.any(frame) || self.covers.hides(frame, place))
    }

    /// Whether a frame is light at a coordinate that the bits which are seen confirm.
    fn demanded(&self, rasters: &Rasters, x_px: f64, place: usize, middle: f64) -> Option<bool> {
        let Self { look, code, inverse, .. } = self;
        let (mut seen, mut unknown) = (0_u16, 0_u16);
        for (frame, bit) in &self.frames {
            if self.is_lost(*frame, place) {
                unknown |= bit;
            } else if (f64::from(look.level(rasters, *frame, place)) > middle) ^ inverse ^ code.invert {
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
        let near = best.0 < 0.5 * code.stripe_px + CODE_EDGE_PERIODS * look.period_px;
        near.then_some(((best.1 & self.own) != 0) ^ inverse ^ code.invert)
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

//! Stored frames of a code written anew, where what is left determines them.

use super::covers::Covers;
use super::demanded::{Bits, Seen};
use super::regions::Regions;
use super::strips::{Judged, Verdict};
use super::{CodeLook, Fault, Finding, Remedy, Shown};
use crate::decode::rasters::Rasters;

/// Bits of one code that are written from the phase at once.
const MOST_WRITTEN: usize = 2;

/// Writes the wrong frames anew; what was found and done. Of the coordinates that are demanded, projector pixels, those are left that the bits
/// which are seen confirm.
pub(super) fn repair(
    (look, regions): (&CodeLook, &Regions),
    verdict: &Verdict,
    covers: &Covers,
    demanded_px: &mut [f32],
    rasters: &mut Rasters,
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let wrong: Vec<usize> = (0..look.frames.len()).filter(|f| verdict.frames[*f].fault.is_some()).collect();
    // Frames that show each other's patterns are copied before anything is written over them.
    let moved: Vec<(usize, Vec<u16>)> = wrong
        .iter()
        .filter_map(|frame| {
            Some((*frame, rasters.taken(look.frames[verdict.frames[*frame].shown_by?].raster)))
        })
        .collect();
    let mut unseen = Vec::new();
    for frame in wrong {
        let judged = verdict.frames[frame];
        let Some(fault) = judged.fault else { continue };
        let remedy = if let Some((_, values)) = moved.iter().find(|(to, _)| *to == frame) {
            rasters.put(look.frames[frame].raster, |place| values[place]);
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
    if !lost.is_empty() {
        let seen = Seen { look, covers, lost: &lost, middle: 0.5 * (verdict.dark + verdict.light) };
        seen.settle(regions, rasters, demanded_px);
        write(&seen, verdict, demanded_px, rasters);
    }
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
    let values = rasters.taken(look.frames[frame].raster);
    let scale = (verdict.light - verdict.dark) / (judged.light - judged.dark);
    rasters.put(look.frames[frame].raster, |place| {
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
    let values = rasters.taken(look.frames[other].raster);
    let sum = verdict.dark + verdict.light;
    rasters.put(look.frames[frame].raster, |place| {
        let twice = 2.0 * f64::from(value_dn(look, place, 0.5 * sum));
        (twice - f64::from(values[place])).clamp(0.0, f64::from(u16::MAX)) as u16
    });
}

/// White or black, from the fringes.
fn flat(look: &CodeLook, frame: usize, verdict: &Verdict, covers: &Covers, rasters: &mut Rasters) {
    let level = if look.frames[frame].shown == Shown::White { verdict.light } else { verdict.dark };
    let values = rasters.taken(look.frames[frame].raster);
    rasters.put(look.frames[frame].raster, |place| {
        let is_seen = covers.any(frame) && !covers.hides(frame, place);
        if is_seen { values[place] } else { value_dn(look, place, level) }
    });
}

/// Writes bits that no frame shows as the phase of their region demands, where the other bits confirm it.
fn write(seen: &Seen, verdict: &Verdict, demanded_px: &[f32], rasters: &mut Rasters) {
    let look = seen.look;
    let pixels = look.phase_rad.len();
    for frame in seen.lost {
        let Some(bits) = Bits::of(seen, *frame) else { continue };
        let values = rasters.taken(look.frames[*frame].raster);
        let value = |place: usize| {
            // Where no region says what it should show, nobody can tell whether a frame that is wrong elsewhere is right.
            if !seen.is_lost(*frame, place) && demanded_px[place].is_finite() {
                return values[place];
            }
            let light = bits.demanded(rasters, f64::from(demanded_px[place]), place);
            let level = light.map_or(seen.middle, |light| if light { verdict.light } else { verdict.dark });
            value_dn(look, place, level)
        };
        let written: Vec<u16> = (0..pixels).map(value).collect();
        rasters.put(look.frames[*frame].raster, |place| written[place]);
    }
}

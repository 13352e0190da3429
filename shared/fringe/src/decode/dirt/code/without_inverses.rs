//! Wrong frames of a code that has neither fringes nor inverses: only the bits themselves tell that one of them is wrong.
//!
//! A bit of whose edges nearly all are strange is wrong, or a finer one is. The frame is found whose bit, left open, lets the others agree; where
//! another order of the frames, or a shift of that one, does so as well, it is put back. Else nothing says what it should show.

use super::bit_edges::{BitEdges, Contradiction, Reading};
use super::displaced;
use super::toggles::{is_doubled, two_levels};
use super::{CodeLook, Fault, Finding, Remedy};
use crate::decode::rasters::Rasters;

/// The finest bits with less of the largest contrast are not resolved.
const FAINT: f64 = 0.15;
/// So much smaller a share of another bit's edges is strange without the wrong one.
const EXPLAINED: f64 = 0.3;
/// So many contradicted bits that no single frame explains are no part of many faces.
const MANY: usize = 3;

/// Looks for the wrong frame among `frames`, which show the bits of a code in order, and puts it back where it is there.
pub fn mend(look: &CodeLook, frames: &[usize], rasters: &mut Rasters, findings: &mut Vec<Finding>) {
    let frames = &frames[..displaced::clear_bits(look, frames, rasters, FAINT)];
    let edges = BitEdges::new(look, rasters, frames);
    let plain = edges.contradiction(&edges.plain());
    if plain.is_none() {
        return;
    }
    let suspects: Vec<usize> = (0..frames.len()).filter(|bit| edges.without(*bit).is_none()).collect();
    let blamed = |bit: &&usize| {
        let without = edges.without(**bit);
        plain.bits().any(|other| other != **bit && plain.strange[other] - without.strange[other] >= EXPLAINED)
    };
    // A frame of one level, or that shows what another one does, stands for no bit, wherever it is put.
    let flat = |bit: usize| two_levels(look, rasters, frames[bit], super::toggles::every(look)).is_none();
    let doubled = |bit: usize| is_doubled(look, rasters, frames, frames[bit]);
    if let Some(bit) = suspects.iter().filter(blamed).find(|bit| flat(**bit) || doubled(**bit)) {
        let fault = if flat(*bit) { Fault::Black } else { Fault::Strange };
        findings.push(look.finding(frames[*bit], fault, Remedy::None));
        return;
    }
    if let Some(reading) = read_otherwise(&edges, &plain) {
        put_back(look, frames, &reading, rasters, findings);
        return;
    }
    for bit in suspects.iter().rev() {
        if move_back(look, frames, *bit, rasters, findings) {
            return;
        }
    }
    let finding = if let Some(bit) = suspects.iter().find(blamed).or(suspects.first()) {
        // Its own edges alone may be those of a part of many faces.
        let remedy = if blamed(&bit) { Remedy::None } else { Remedy::Doubted };
        look.finding(frames[*bit], Fault::Strange, remedy)
    } else {
        let remedy = if plain.bits().count() >= MANY { Remedy::None } else { Remedy::Doubted };
        Finding { set: look.frames[frames[0]].set, step: None, fault: Fault::Strange, remedy }
    };
    findings.push(finding);
}

/// Two frames exchanged, or light and dark of one, so that nothing is contradicted.
fn read_otherwise(edges: &BitEdges, plain: &Contradiction) -> Option<Reading> {
    let as_they_come = edges.plain();
    let bits = as_they_come.order.len();
    let exchanged = (0..bits).flat_map(|a| (a + 1..bits).map(move |b| (a, b))).map(|(a, b)| {
        let mut reading = as_they_come.clone();
        reading.order.swap(a, b);
        reading
    });
    let inverted = (0..bits).map(|bit| Reading { inverted: Some(bit), ..as_they_come.clone() });
    let tried = exchanged.chain(inverted).map(|reading| (edges.contradiction(&reading), reading));
    let good = tried.filter(|(then, _)| then.is_none() && then.sum() + EXPLAINED < plain.sum());
    good.min_by(|a, b| a.0.sum().total_cmp(&b.0.sum())).map(|(_, reading)| reading)
}

/// Takes each frame from where it is, or for its inverse.
fn put_back(
    look: &CodeLook,
    frames: &[usize],
    reading: &Reading,
    rasters: &mut Rasters,
    findings: &mut Vec<Finding>,
) {
    let pixels = look.middle_dn.len();
    let moved = reading.order.iter().enumerate().filter(|(bit, from)| bit != *from);
    let taken: Vec<_> = moved
        .map(|(bit, from)| (bit, *from, rasters.taken(look.frames[frames[*from]].raster, pixels)))
        .collect();
    for (bit, from, values) in taken {
        let of_from = look.frames[frames[from]];
        rasters.put(look.frames[frames[bit]].raster, pixels, |place| values[place]);
        findings.push(look.finding(frames[bit], Fault::Shows(of_from.set, of_from.step), Remedy::OtherFrame));
    }
    if let Some(bit) = reading.inverted {
        put_inverse(look, look.frames[frames[bit]].raster, rasters);
        findings.push(look.finding(frames[bit], Fault::Inverse, Remedy::Inverse));
    }
}

/// Writes a frame anew with light and dark exchanged.
fn put_inverse(look: &CodeLook, raster: usize, rasters: &mut Rasters) {
    let values = rasters.taken(raster, look.middle_dn.len());
    rasters.put(raster, values.len(), |place| look.mirrored(place, values[place]));
}

/// Moves the frame of a bit to where the others allow it; whether nothing is contradicted there.
fn move_back(
    look: &CodeLook,
    frames: &[usize],
    bit: usize,
    rasters: &mut Rasters,
    findings: &mut Vec<Finding>,
) -> bool {
    let Some(by) = displaced::better_place(look, frames, bit, false, rasters) else { return false };
    let raster = look.frames[frames[bit]].raster;
    let before = rasters.taken(raster, look.middle_dn.len());
    displaced::shift(look, frames[bit], by, rasters);
    let edges = BitEdges::new(look, rasters, frames);
    if edges.contradiction(&edges.plain()).is_none() {
        displaced::name(look, frames[bit], by, Remedy::MovedBack, findings);
        return true;
    }
    rasters.put(raster, before.len(), |place| before[place]);
    false
}

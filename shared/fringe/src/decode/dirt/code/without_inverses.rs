//! Wrong frames of a code that has neither fringes nor inverses: only the bits themselves tell that one of them is wrong.
//!
//! A bit of whose edges nearly all are strange is wrong, or a finer one is. The frame is found whose bit, left open, lets the others agree; where
//! another order of the frames, or a shift of that one, does so as well, it is put back. Else nothing says what it should show.

use super::bit_edges::{BitEdges, Contradiction, Reading};
use super::frame_levels::{is_doubled, two_levels};
use super::{CodeLook, Fault, Finding, Remedy, displaced, edge_zones};
use crate::decode::rasters::Rasters;

/// The finest bits with less of the largest contrast are not resolved.
pub const FAINT: f64 = 0.15;
/// So much smaller a share of another bit's edges is strange without the wrong one.
const EXPLAINED: f64 = 0.3;
/// So many contradicted bits that no single frame explains are no part of many faces.
const MANY: usize = 3;

/// Looks for the wrong frame among `frames`, which show the bits of a code in order, and puts it back where it is there.
pub fn mend(look: &CodeLook, frames: &[usize], rasters: &mut Rasters, findings: &mut Vec<Finding>) {
    let frames = &frames[..displaced::clear_bits(look, frames, rasters, FAINT)];
    let edges = BitEdges::new(look, rasters, frames);
    let as_they_come = Reading::plain(frames);
    let plain = edges.contradiction(&as_they_come);
    if plain.is_none() {
        findings.extend(flat_bit(look, frames, rasters));
        return;
    }
    let suspects = suspects(&edges, &as_they_come, &plain);
    // A frame of one level, or that shows what another one does, stands for no bit, wherever it is put.
    let no_bit = |bit: usize| {
        let black = two_levels(look, rasters, frames[bit]).is_none().then_some(Fault::Black);
        black.or_else(|| is_doubled(look, rasters, frames, frames[bit]).then_some(Fault::Strange))
    };
    let blamed = || suspects.iter().filter(|suspect| suspect.explains);
    if let Some((bit, fault)) = blamed().find_map(|suspect| Some((suspect.bit, no_bit(suspect.bit)?))) {
        findings.push(look.finding(frames[bit], fault, Remedy::None));
        return;
    }
    if let Some(reading) = read_otherwise(&edges, &as_they_come, &plain) {
        put_back(look, frames, &reading, rasters, findings);
        return;
    }
    if let Some(flat) = flat_bit(look, frames, rasters) {
        findings.push(flat);
        return;
    }
    if suspects.iter().rev().any(|suspect| move_back(look, frames, suspect.bit, rasters, findings)) {
        return;
    }
    let finding = if let Some(suspect) = blamed().next().or(suspects.first()) {
        // Its own edges alone may be those of a part of many faces.
        let remedy = if suspect.explains { Remedy::None } else { Remedy::Doubted };
        look.finding(frames[suspect.bit], Fault::Strange, remedy)
    } else {
        let remedy = if plain.bits().count() >= MANY { Remedy::None } else { Remedy::Doubted };
        Finding { set: look.frames[frames[0]].set, step: None, fault: Fault::Strange, remedy }
    };
    findings.push(finding);
}

/// A frame of one level, though the finer bits say that its own changes in the picture.
fn flat_bit(look: &CodeLook, frames: &[usize], rasters: &Rasters) -> Option<Finding> {
    let edges = edge_zones::edges(look, rasters, frames, false);
    let changes = frames.iter().zip(edges).filter(|(_, edges)| edges.is_some_and(|edges| edges.is_flat));
    let mut flat = changes.filter(|(frame, _)| two_levels(look, rasters, **frame).is_none());
    flat.next().map(|(frame, _)| look.finding(*frame, Fault::Black, Remedy::None))
}

/// A bit without which nothing is contradicted.
#[derive(Debug)]
struct Suspect {
    bit: usize,
    /// Whether edges of other bits are strange because of it.
    explains: bool,
}

fn suspects(edges: &BitEdges, as_they_come: &Reading, plain: &Contradiction) -> Vec<Suspect> {
    let bits = as_they_come.from.len();
    let suspect = |bit: usize| {
        let without = edges.contradiction(&Reading { free: 1 << (bits - 1 - bit), ..as_they_come.clone() });
        let less = |other: usize| plain.strange[other] - without.strange[other] >= EXPLAINED;
        let explains = plain.bits().any(|other| other != bit && less(other));
        without.is_none().then_some(Suspect { bit, explains })
    };
    (0..bits).filter_map(suspect).collect()
}

/// Two frames exchanged, or light and dark of one, so that nothing is contradicted.
fn read_otherwise(edges: &BitEdges, as_they_come: &Reading, plain: &Contradiction) -> Option<Reading> {
    let bits = as_they_come.from.len();
    let exchanged = (0..bits).flat_map(|a| (a + 1..bits).map(move |b| (a, b))).map(|(a, b)| {
        let mut reading = as_they_come.clone();
        reading.from.swap(a, b);
        reading
    });
    let inverted = (0..bits).map(|bit| {
        let mut reading = as_they_come.clone();
        reading.from[bit].1 = true;
        reading
    });
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
    let bits = || frames.iter().zip(&reading.from);
    let moved = bits().filter(|(frame, (from, _))| *frame != from);
    let taken: Vec<_> =
        moved.map(|(frame, (from, _))| (*frame, *from, rasters.taken(look.frames[*from].raster))).collect();
    for (frame, from, values) in taken {
        let of_from = look.frames[from];
        rasters.put(look.frames[frame].raster, |place| values[place]);
        findings.push(look.finding(frame, Fault::Shows(of_from.set, of_from.step), Remedy::OtherFrame));
    }
    for (frame, _) in bits().filter(|(_, (_, inverse))| *inverse) {
        look.put_inverse(rasters, *frame, *frame);
        findings.push(look.finding(*frame, Fault::Inverse, Remedy::Inverse));
    }
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
    let before = rasters.taken(raster);
    displaced::shift(look, frames[bit], by, rasters);
    let edges = BitEdges::new(look, rasters, frames);
    if edges.contradiction(&Reading::plain(frames)).is_none() {
        displaced::name(look, frames[bit], by, Remedy::MovedBack, findings);
        return true;
    }
    rasters.put(raster, |place| before[place]);
    false
}

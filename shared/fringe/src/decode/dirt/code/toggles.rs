//! Wrong frames of a code without fringes: from their levels, and from inverses that contradict their frames.
//!
//! Neighbouring pixels stand in one stripe or in stripes side by side, but where a surface ends. Of words that differ, few then differ by more than
//! one stripe; a wrong frame makes many of them do so.

use super::bit_edges::{Reading, near};
use super::frame_levels::{SAMPLES, every, same, two_levels};
use super::steps::Steps;
use super::without_inverses::{self, FAINT};
use super::{CodeLook, CodeVerdict, Fault, Finding, Remedy, Shown, displaced, edge_zones};
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;
use crate::pattern::Code;

/// Share of clear pixels in which a frame and its inverse show the same.
const CONTRADICTION: f64 = 0.15;
/// A frame is right whose edges are strange by at most this part of those of its inverse.
const CLEARLY: f64 = 0.9;
/// Levels, as a share of the contrast.
const CHANGED: f64 = 0.2;
const MOST_CHANGED: f64 = 0.5;
/// A frame with less of the contrast of narrower stripes is blurred.
const BLURRED: f64 = 0.75;
/// A code of whose edges less than this share lead to the next stripe is doubted.
const CONFIRMED: f64 = 0.5;
/// Share of the steps from stripe to stripe that run the other way than most, from which on a bit is wrong in a part of the picture; a camera
/// that is turned about its axis may see as many on steep faces.
const TURNED_BACK: f64 = 0.1;
/// Share of the edges that lead to the next stripe when faults were made up for.
const EXPLAINS: f64 = 0.6;

/// Looks for wrong frames of a code without fringes, and writes the stored ones anew where what is left determines them.
pub fn mend(look: &CodeLook, rasters: &mut Rasters) -> CodeVerdict {
    let mut findings = levels(look, rasters);
    let bits = || look.frames.iter().enumerate();
    let frames: Vec<usize> = bits()
        .filter(|(_, f)| matches!(f.shown, Shown::Bit { inverse: false, .. }))
        .map(|(i, _)| i)
        .collect();
    let inverses: Vec<usize> =
        bits().filter(|(_, f)| matches!(f.shown, Shown::Bit { inverse: true, .. })).map(|(i, _)| i).collect();
    let plain = Reading::plain(&frames);
    if inverses.len() == frames.len() {
        contradictions(look, &frames, &inverses, rasters, &mut findings);
        displaced::move_back(look, &frames, false, rasters, &mut findings);
        displaced::move_back(look, &inverses, true, rasters, &mut findings);
    } else {
        without_inverses::mend(look, &frames, rasters, &mut findings);
    }
    soft(look, &frames, false, rasters, &mut findings);
    soft(look, &inverses, true, rasters, &mut findings);
    let strange = strange_edges(look, rasters, &plain);
    let confirmed = 1.0 - strange;
    let steps = Steps::new(look, rasters, &plain.from);
    let turns_back = steps.run_on() && steps.turned_back > TURNED_BACK;
    if (confirmed < CONFIRMED || turns_back) && findings.is_empty() {
        let set = frames.first().map_or(0, |frame| look.frames[*frame].set);
        findings.push(Finding { set, step: None, fault: Fault::Strange, remedy: Remedy::Doubted });
    }
    // What was done shall explain the code. Edges of a part are strange, but do not turn the order back.
    let is_wrong =
        |finding: &Finding| finding.remedy != Remedy::Doubted || (confirmed < CONFIRMED && turns_back);
    if confirmed < EXPLAINS {
        findings
            .iter_mut()
            .filter(|finding| is_wrong(finding))
            .for_each(|finding| finding.remedy = Remedy::None);
    }
    CodeVerdict { findings, confirmed, demanded_px: Vec::new() }
}

/// Frames that are brighter or darker as a whole: normalised.
fn levels(look: &CodeLook, rasters: &mut Rasters) -> Vec<Finding> {
    let seen: Vec<Option<[f64; 2]>> =
        (0..look.frames.len()).map(|frame| two_levels(look, rasters, frame)).collect();
    let usual = [0, 1].map(|class| {
        let mut levels: Vec<f64> = seen.iter().flatten().map(|levels| levels[class]).collect();
        median(&mut levels).unwrap_or([-1.0, 1.0][class])
    });
    let span = usual[1] - usual[0];
    let mut findings = Vec::new();
    for (frame, levels) in
        seen.iter().enumerate().filter(|(f, _)| matches!(look.frames[*f].shown, Shown::Bit { .. }))
    {
        let Some([dark, light]) = *levels else { continue };
        let level = (0.5 * (light + dark) - 0.5 * (usual[0] + usual[1])) / span;
        // Narrow stripes lose contrast by defocus; that is no fault of a frame.
        if level.abs() <= CHANGED {
            continue;
        }
        let fault = Fault::Level(level);
        let values = rasters.taken(look.frames[frame].raster);
        rasters.put(look.frames[frame].raster, |place| {
            let (middle, contrast) = (f64::from(look.middle_dn[place]), f64::from(look.contrast_dn[place]));
            if contrast.is_nan() || contrast <= 0.0 {
                return values[place];
            }
            let own = (f64::from(values[place]) - middle) / contrast;
            let level = usual[0] + (own - dark) * span / (light - dark);
            (middle + level * contrast).round().clamp(0.0, f64::from(u16::MAX)) as u16
        });
        let remedy = if level.abs() > MOST_CHANGED { Remedy::None } else { Remedy::Normalised };
        findings.push(look.finding(frame, fault, remedy));
    }
    findings.extend(blurred(look, &seen));
    findings
}

/// Frames with less contrast than one with narrower stripes: those lose it first. A blurred edge still stands where it should.
fn blurred<'a>(look: &'a CodeLook<'_>, seen: &'a [Option<[f64; 2]>]) -> impl Iterator<Item = Finding> + 'a {
    let contrast = |frame: usize| seen[frame].map(|[dark, light]| light - dark);
    let bit_of = move |frame: usize| match look.frames[frame].shown {
        Shown::Bit { bit, inverse, .. } => Some((bit, inverse)),
        Shown::White | Shown::Black => None,
    };
    (0..seen.len()).filter_map(move |frame| {
        let ((bit, inverse), own) = bit_of(frame).zip(contrast(frame))?;
        let finer = (0..seen.len())
            .filter(|other| bit_of(*other).is_some_and(|(finer, of)| finer > bit && of == inverse))
            .filter_map(contrast)
            .fold(0.0, f64::max);
        (own < BLURRED * finer).then(|| look.finding(frame, Fault::Blurred(own / finer), Remedy::Doubted))
    })
}

/// Frames whose edges are less steep than those of the others. Stripes that are much wider than the blur keep their contrast.
fn soft(look: &CodeLook, frames: &[usize], inverse: bool, rasters: &Rasters, findings: &mut Vec<Finding>) {
    let frames = &frames[..displaced::clear_bits(look, frames, rasters, FAINT)];
    let edges = edge_zones::edges(look, rasters, frames, inverse);
    for (bit, share) in edge_zones::soft(&edges) {
        let finding = look.finding(frames[bit], Fault::Blurred(share), Remedy::Doubted);
        let place = |found: &Finding| (found.set, found.step);
        if !findings.iter().any(|found| place(found) == place(&finding)) {
            findings.push(finding);
        }
    }
}

/// A frame and its inverse that show the same: the one whose words make fewer strange edges is right.
fn contradictions(
    look: &CodeLook,
    frames: &[usize],
    inverses: &[usize],
    rasters: &mut Rasters,
    findings: &mut Vec<Finding>,
) {
    let mut reading = Reading::plain(frames);
    let mut suspects = Vec::new();
    for (bit, (frame, inverse)) in frames.iter().zip(inverses).enumerate() {
        if same(look, rasters, *frame, *inverse) > CONTRADICTION {
            suspects.push(bit);
        }
    }
    // The bits that are not certain stand aside while each of them is asked.
    let mask = |bits: &[usize]| bits.iter().fold(0_u16, |mask, bit| mask | 1 << (frames.len() - 1 - bit));
    let mut open = suspects.clone();
    for bit in suspects {
        open.retain(|other| *other != bit);
        let cost = |from: (usize, bool), reading: &Reading| {
            let mut reading = reading.clone();
            reading.from[bit] = from;
            reading.free = mask(&open);
            strange_edges(look, rasters, &reading)
        };
        let (by_frame, by_inverse) =
            (cost((frames[bit], false), &reading), cost((inverses[bit], true), &reading));
        // A frame of one level alone is wrong whose inverse has two.
        let flat = [frames[bit], inverses[bit]].map(|frame| two_levels(look, rasters, frame).is_none());
        let by_frame_is_wrong = if flat[0] == flat[1] { by_frame > by_inverse } else { flat[0] };
        let (wrong, right) =
            if by_frame_is_wrong { (frames[bit], inverses[bit]) } else { (inverses[bit], frames[bit]) };
        let known = flat[0] != flat[1] || by_frame.min(by_inverse) < CLEARLY * by_frame.max(by_inverse);
        let fault = kind(look, rasters, wrong, right);
        findings.push(look.finding(wrong, fault, if known { Remedy::Inverse } else { Remedy::None }));
        look.put_inverse(rasters, wrong, right);
        reading.from[bit] = (right, right != frames[bit]);
    }
}

/// What a frame shows where its inverse is right.
fn kind(look: &CodeLook, rasters: &Rasters, wrong: usize, right: usize) -> Fault {
    let every = every(look);
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for place in (0..look.middle_dn.len()).step_by(every).filter(|place| look.contrast_dn[*place] > 0.0) {
        let class = usize::from(look.level(rasters, right, place) < 0.0);
        sums[class] += f64::from(look.level(rasters, wrong, place));
        counts[class] += 1.0;
    }
    let [dark, light] = [0, 1].map(|class| sums[class] / f64::max(counts[class], 1.0));
    if light < -0.6 && dark < -0.6 {
        Fault::Black
    } else if light - dark < -1.2 {
        Fault::Inverse
    } else {
        Fault::Strange
    }
}

/// Share of the edges between words that no neighbouring stripes have. The last bit may change anywhere: it is not asked alone.
fn strange_edges(look: &CodeLook, rasters: &Rasters, reading: &Reading) -> f64 {
    let code = reading.from.first().map_or(Code::Gray, |from| look.code_of(from.0));
    let (width, pixels) = (look.width, look.middle_dn.len());
    let lines = (pixels / SAMPLES).max(1);
    let (mut edges, mut strange) = (0.0, 0.0);
    for row in (0..pixels / width).step_by(lines) {
        let mut last = None;
        for place in row * width..(row + 1) * width {
            let here = look.word(rasters, &reading.from, place);
            if let (Some(a), Some(b)) = (last, here)
                && (a ^ b) & !(reading.free | 1) != 0
            {
                edges += 1.0;
                strange += if near(a, b, reading.free, code, 1) { 0.0 } else { 1.0 };
            }
            last = here;
        }
    }
    strange / f64::max(edges, 1.0)
}

//! Wrong frames of a code without fringes: from inverses that contradict their frames, and from edges that no code has.
//!
//! Neighbouring pixels stand in one stripe or in stripes side by side, but where a surface ends. Of words that differ, few then differ by more than
//! one stripe; a wrong frame makes many of them do so.

use super::{CodeLook, CodeVerdict, Fault, Finding, Remedy, Shown, displaced};
use crate::decode::bits::resolve;
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;

/// Levels nearer to the middle than this are no bit.
const CLEAR: f32 = 0.3;
/// Share of clear pixels in which a frame and its inverse show the same.
const CONTRADICTION: f64 = 0.15;
/// Without inverses, a frame is suspect that makes so many more of the edges strange.
const SUSPECT: f64 = 0.3;
/// Frames that show the same in this share of the clear pixels are one.
const DOUBLED: f64 = 0.97;
/// A frame is right whose edges are strange by at most this part of those of its inverse.
const CLEARLY: f64 = 0.9;
/// What is wrong is known when the share is at most this part without it.
const EXPLAINED: f64 = 0.5;
/// Pixels that are looked at, about.
const SAMPLES: usize = 200_000;
/// Rounds of the search for the two levels of a frame.
const ROUNDS: usize = 12;
/// Frames that change so often along a row and show the same are one: edges of the part alone are not so many.
const MANY_CHANGES: f64 = 4.0;
/// Levels below are dark beyond doubt; a frame is dark when this share of it is.
const DARK: f32 = -0.6;
const DARK_SHARE: f64 = 0.95;
/// Share of strange edges up to which a code without inverses shows where one of its bits belongs.
const CONSISTENT: f64 = 0.5;
/// Levels, as a share of the contrast.
const CHANGED: f64 = 0.2;
const MOST_CHANGED: f64 = 0.5;
/// A frame with less of the contrast of narrower stripes is blurred.
const BLURRED: f64 = 0.75;
/// A code of whose edges less than this share lead to the next stripe is doubted.
const CONFIRMED: f64 = 0.5;
/// Share of the edges that lead to the next stripe when faults were made up for.
const EXPLAINS: f64 = 0.6;

/// How the bits of a code are read.
#[derive(Debug, Clone)]
struct Reading {
    /// Frame of each bit, and whether it shows the inverse.
    from: Vec<(usize, bool)>,
    /// Bits that may be anything.
    free: u16,
}

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
    let plain = Reading { from: frames.iter().map(|f| (*f, false)).collect(), free: 0 };
    let strange = if inverses.len() == frames.len() {
        contradictions(look, &frames, &inverses, rasters, &mut findings);
        displaced::move_back(look, &frames, false, rasters, &mut findings);
        displaced::move_back(look, &inverses, true, rasters, &mut findings);
        strange_edges(look, rasters, &plain)
    } else {
        exchanged(look, &plain, rasters, &mut findings);
        let strange = strange_edges(look, rasters, &plain);
        // Where the bits contradict all over, a shift explains whatever is asked.
        let moved =
            strange < CONSISTENT && displaced::move_back(look, &frames, false, rasters, &mut findings);
        if moved { strange_edges(look, rasters, &plain) } else { strange }
    };
    let confirmed = 1.0 - strange;
    if confirmed < CONFIRMED && findings.is_empty() {
        let set = frames.first().map_or(0, |frame| look.frames[*frame].set);
        findings.push(Finding { set, step: None, fault: Fault::Strange, remedy: Remedy::Doubted });
    }
    // What was done shall explain the code.
    if confirmed < EXPLAINS {
        for finding in findings.iter_mut().filter(|finding| finding.remedy != Remedy::Doubted) {
            finding.remedy = Remedy::None;
        }
    }
    CodeVerdict { findings, confirmed, demanded_px: Vec::new() }
}

/// Frames that are brighter or darker as a whole: normalised.
fn levels(look: &CodeLook, rasters: &mut Rasters) -> Vec<Finding> {
    let every = every(look);
    let seen: Vec<Option<[f64; 2]>> =
        (0..look.frames.len()).map(|frame| two_levels(look, rasters, frame, every)).collect();
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
        let values = rasters.taken(look.frames[frame].raster, look.middle_dn.len());
        rasters.put(look.frames[frame].raster, values.len(), |place| {
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

/// One of so many pixels is looked at.
pub(super) fn every(look: &CodeLook) -> usize {
    (look.middle_dn.len() / SAMPLES).max(1) | 1
}

/// The levels of dark and light of a frame; none where it shows but one.
pub(super) fn two_levels(look: &CodeLook, rasters: &Rasters, frame: usize, every: usize) -> Option<[f64; 2]> {
    let places = (0..look.middle_dn.len()).step_by(every).filter(|place| look.contrast_dn[*place] > 0.0);
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

/// A frame and its inverse that show the same: the one whose words make fewer strange edges is right.
fn contradictions(
    look: &CodeLook,
    frames: &[usize],
    inverses: &[usize],
    rasters: &mut Rasters,
    findings: &mut Vec<Finding>,
) {
    let mut reading = Reading { from: frames.iter().map(|frame| (*frame, false)).collect(), free: 0 };
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
        let flat =
            [frames[bit], inverses[bit]].map(|frame| two_levels(look, rasters, frame, every(look)).is_none());
        let by_frame_is_wrong = if flat[0] == flat[1] { by_frame > by_inverse } else { flat[0] };
        let (wrong, right) =
            if by_frame_is_wrong { (frames[bit], inverses[bit]) } else { (inverses[bit], frames[bit]) };
        let known = flat[0] != flat[1] || by_frame.min(by_inverse) < CLEARLY * by_frame.max(by_inverse);
        let fault = kind(look, rasters, wrong, right);
        findings.push(look.finding(wrong, fault, if known { Remedy::Inverse } else { Remedy::None }));
        let values = rasters.taken(look.frames[right].raster, look.middle_dn.len());
        rasters.put(look.frames[wrong].raster, values.len(), |place| {
            (2.0 * look.middle_dn[place] - f32::from(values[place])).round().clamp(0.0, f32::from(u16::MAX))
                as u16
        });
        reading.from[bit] = (right, right != frames[bit]);
    }
}

/// Share of clear pixels in which two frames show the same.
fn same(look: &CodeLook, rasters: &Rasters, one: usize, other: usize) -> f64 {
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
pub(super) fn is_doubled<'a>(
    look: &CodeLook,
    rasters: &Rasters,
    frames: impl IntoIterator<Item = &'a usize>,
    frame: usize,
) -> bool {
    frames.into_iter().any(|other| *other != frame && same(look, rasters, frame, *other) > DOUBLED)
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

/// Without inverses: the first bits of a code are a code by themselves, with wider stripes. The frame with which edges become strange is
/// wrong; where another frame shows what it should, the two are put back.
fn exchanged(look: &CodeLook, plain: &Reading, rasters: &mut Rasters, findings: &mut Vec<Finding>) {
    let bits = plain.from.len();
    let dark = |bit: &usize| is_dark(look, rasters, plain.from[*bit].0);
    if let Some(bit) = (2..bits).find(|bit| dark(bit) && shows_less_than_others(look, rasters, plain, *bit)) {
        findings.push(look.finding(plain.from[bit].0, Fault::Black, Remedy::None));
        return;
    }
    let first_bits = |count: usize, last: usize| {
        let mut from = plain.from[..count].to_vec();
        from[count - 1] = plain.from[last];
        Reading { from, free: 0 }
    };
    let mut before = 0.0;
    for count in 2..=bits {
        let share = strange_edges(look, rasters, &first_bits(count, count - 1));
        if share < SUSPECT + before {
            before = f64::max(share, before);
            continue;
        }
        let others = (count..bits).map(|last| (strange_edges(look, rasters, &first_bits(count, last)), last));
        let best = others.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 < EXPLAINED * share);
        let frame = plain.from[count - 1].0;
        // A frame that is dark all over, or shows what another one does, stands for no bit, wherever it is put.
        let doubled = is_doubled(look, rasters, plain.from.iter().map(|(frame, _)| frame), frame);
        let flat = two_levels(look, rasters, frame, every(look)).is_none();
        let best = best.filter(|_| !doubled && !flat);
        // The whole code shall say so too: of a part of many faces a wide stripe has few edges.
        let best = best.filter(|(_, other)| {
            let mut from = plain.from.clone();
            from.swap(count - 1, *other);
            let exchanged = strange_edges(look, rasters, &Reading { from, free: 0 });
            exchanged < CLEARLY * strange_edges(look, rasters, plain)
        });
        if let Some((rest, other)) = best {
            let (a, b) = (frame, plain.from[other].0);
            let (of_a, of_b) = (look.frames[a], look.frames[b]);
            let [first, second] = [of_a, of_b].map(|frame| rasters.taken(frame.raster, look.middle_dn.len()));
            rasters.put(of_a.raster, second.len(), |place| second[place]);
            rasters.put(of_b.raster, first.len(), |place| first[place]);
            findings.push(look.finding(a, Fault::Shows(of_b.set, of_b.step), Remedy::OtherFrame));
            findings.push(look.finding(b, Fault::Shows(of_a.set, of_a.step), Remedy::OtherFrame));
            before = f64::max(before, rest);
            continue;
        }
        let fault = if flat { Fault::Black } else { Fault::Strange };
        // Edges alone do not tell a wrong frame from a part of many faces, which may also lie in the dark of a wide stripe.
        let impossible = doubled && changes_per_row(look, rasters, frame) > MANY_CHANGES;
        findings.push(look.finding(frame, fault, if impossible { Remedy::None } else { Remedy::Doubted }));
        return;
    }
}

/// Whether two bits with wider stripes show both light and dark, which lie at least two stripes of this bit apart: it must show both too.
fn shows_less_than_others(look: &CodeLook, rasters: &Rasters, plain: &Reading, bit: usize) -> bool {
    let coarser = plain.from[..bit].iter();
    coarser.filter(|(frame, _)| two_levels(look, rasters, *frame, every(look)).is_some()).count() >= 2
}

/// Whether a frame is dark nearly all over.
fn is_dark(look: &CodeLook, rasters: &Rasters, frame: usize) -> bool {
    let lit = (0..look.middle_dn.len()).step_by(every(look)).filter(|place| look.contrast_dn[*place] > 0.0);
    let (mut dark, mut seen) = (0_usize, 0_usize);
    for place in lit {
        dark += usize::from(look.level(rasters, frame, place) < DARK);
        seen += 1;
    }
    dark as f64 > DARK_SHARE * seen as f64
}

/// How often a frame changes between light and dark along a row, in the mean of the rows in which it does.
fn changes_per_row(look: &CodeLook, rasters: &Rasters, frame: usize) -> f64 {
    let pixels = look.middle_dn.len();
    let lines = (pixels / SAMPLES).max(1);
    let (mut rows, mut changes) = (0_usize, 0_usize);
    for row in (0..pixels / look.width).step_by(lines) {
        let places = row * look.width..(row + 1) * look.width;
        let lit = places.filter(|place| look.contrast_dn[*place] > 0.0);
        let levels: Vec<bool> = lit.map(|place| look.level(rasters, frame, place) > 0.0).collect();
        let of_row = levels.windows(2).filter(|pair| pair[0] != pair[1]).count();
        rows += usize::from(of_row > 0);
        changes += of_row;
    }
    changes as f64 / rows.max(1) as f64
}

/// Share of the edges between words that no neighbouring stripes have. The last bit may change anywhere: it is not asked alone.
fn strange_edges(look: &CodeLook, rasters: &Rasters, reading: &Reading) -> f64 {
    let Some(Shown::Bit { code, .. }) = reading.from.first().map(|from| look.frames[from.0].shown) else {
        return 0.0;
    };
    let (width, pixels) = (look.width, look.middle_dn.len());
    let word = |place: usize| -> Option<u16> {
        if look.contrast_dn[place].is_nan() || look.contrast_dn[place] <= 0.0 {
            return None;
        }
        reading.from.iter().try_fold(0_u16, |word, (frame, inverse)| {
            let level = look.level(rasters, *frame, place);
            Some(word << 1 | u16::from((level > 0.0) ^ inverse))
        })
    };
    let lines = (pixels / SAMPLES).max(1);
    let (mut edges, mut strange) = (0.0, 0.0);
    for row in (0..pixels / width).step_by(lines) {
        let mut last = None;
        for place in row * width..(row + 1) * width {
            let here = word(place);
            if let (Some(a), Some(b)) = (last, here)
                && (a ^ b) & !(reading.free | 1) != 0
            {
                edges += 1.0;
                strange += if beside(a, b, reading.free, code.code) { 0.0 } else { 1.0 };
            }
            last = here;
        }
    }
    strange / f64::max(edges, 1.0)
}

/// Whether two words may be stripes side by side, whatever the free bits are.
pub(super) fn beside(a: u16, b: u16, free: u16, code: crate::pattern::Code) -> bool {
    let (mut of_a, mut flips_a) = (false, free);
    loop {
        let mut flips_b = free;
        loop {
            let [a, b] = [a ^ flips_a, b ^ flips_b].map(|word| i32::from(resolve(word, code)));
            of_a |= (a - b).abs() <= 1;
            if flips_b == 0 {
                break;
            }
            flips_b = (flips_b - 1) & free;
        }
        if flips_a == 0 {
            return of_a;
        }
        flips_a = (flips_a - 1) & free;
    }
}

//! Ripples of the phases that the modulation shows as well: what frames leave whose light or place differs.
//!
//! Frame i of a pixel is brighter by L pᵢ, light of the room. What of p looks like a fringe, a complex q, adds to the phasor of the pixel: B e^iφ + L q.
//! No residual of the steps shows that: relative to the phasor it is e^−iφ, and the modulation varies with it, once with the phase. A lamp that scales frames,
//! or a fringe that moved, leaves e^−2iφ in the same way. With a + ib = L q, and m once or twice, the modulation is found as
//!
//! ```text
//! B + a cos mφ + b sin mφ,   and the phase too large by   (b cos mφ − a sin mφ) / B.
//! ```
//!
//! Each pixel is held against those before and behind it where this ripple has the other sign: a light that runs evenly over a fringe cancels. Modulations are
//! taken over the mean level of the pixel, which has the colours of the part as well but not the ripple; what they still differ by averages out over
//! thousands of pixels. L may grow with the modulation, as the light of the room on a part of several colours does, and across the picture.

use super::Decoder;
use super::block::{BLOCK, CHUNK};
use super::dirt::Fault;
use super::motion::ROUNDED;
use super::sums::BlockSums;
use crate::math::sincos;
use crate::pattern::Axis;
use crate::phase::PhaseViewMut;
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::f32::consts::PI;

/// So many lines of the map, and one of so many pixels of each, tell whether there is a ripple, and those how large it is where: of a map that is full …
const OF_FULL: [(usize, usize); 2] = [(48, 12), (128, 2)];
/// … and of one with a small part.
const OF_SPARSE: [(usize, usize); 2] = [(192, 3), (384, 1)];
/// Pieces of the map, down and along its lines: a ripple must stand out from what these differ by.
const BANDS: usize = 48;
const PIECES: usize = 6;
/// Fewest pixels of either, and fewest pieces.
const LEAST_PIXELS: [f64; 2] = [1024.0, 512.0];
const LEAST_PIECES: f64 = 8.0;
/// Standard errors beyond which there is one.
const CERTAIN: f64 = 5.0;
/// A ripple below this part of the noise of the modulation is left: smoothed points are a few times as certain as their pixels.
const LEAST: f64 = 0.05;
/// Half of a ripple is so long at most, px, and met so well by a pixel, as an angle of the ripple, rad.
const MOST_HALF_PX: usize = 96;
const MET_RAD: f32 = 1.0;
/// Modulations that differ by more beside the light that is known, as a part, belong to an edge of the part.
const EDGE: f64 = 0.05;
/// Rounds in which L is found.
const ROUNDS: usize = 2;
/// Terms of L: everywhere alike, with the modulation, across and down the picture.
const TERMS: usize = 4;

/// A pixel that is held against those half a ripple away.
struct Pixel {
    place: usize,
    /// How far its modulation stands above that of its place, DN: the ripple, where L is u + v B.
    above_dn: f64,
    /// The modulation to which this belongs, DN: the harmonic mean of its own and those half a ripple away.
    modulation_dn: f64,
    /// Cosine and sine of its ripple.
    unit: [f64; 2],
}

/// Sums over the pixels of a piece of the map.
#[derive(Clone, Copy, Default)]
struct Piece {
    count: f64,
    /// What the modulations have of the ripple's cosine and sine, as they are, DN, and as parts of themselves.
    shown: [[f64; 2]; 2],
    noise_dn: f64,
    modulation_dn: f64,
}

impl Piece {
    fn add(&mut self, pixel: &Pixel, noise_dn: f64) {
        for k in 0..2 {
            let shown_dn = pixel.above_dn * pixel.unit[k];
            self.shown[0][k] += shown_dn;
            self.shown[1][k] += shown_dn / pixel.modulation_dn;
        }
        self.count += 1.0;
        self.noise_dn += noise_dn;
        self.modulation_dn += pixel.modulation_dn;
    }
}

/// What some lines show all over the map.
struct Seen {
    /// a and b, DN.
    ripple_dn: [f64; 2],
    /// How large they are, or are where modulations are small, DN².
    size_dn2: f64,
    /// What a² + b² is by chance, times the number of pixels, DN².
    scatter_dn2: f64,
    /// Mean modulation of the pixels, DN.
    modulation_dn: f64,
}

/// Those of a map, band by band.
type Pieces = [[Piece; PIECES]; BANDS];

impl Seen {
    /// The ripple all over the map, where there is one and no smaller part of the modulation than the least, or where a light is told that changes by
    /// this part.
    fn of(pieces: &Pieces, told: f64, least: f64) -> Option<Self> {
        let filled = || pieces.iter().flatten().filter(|piece| piece.count > 0.0);
        let sum = |of: &dyn Fn(&Piece) -> f64| filled().map(of).sum::<f64>();
        let (count, number) = (sum(&|piece| piece.count), sum(&|_| 1.0));
        let modulation_dn = sum(&|piece| piece.modulation_dn) / count;
        let noise_dn = sum(&|piece| piece.noise_dn) / count;
        // In two ways, for a light may add to weak fringes what it takes from strong ones. The mean of cos² is a half.
        let [strong, weak] = [(0, 2.0), (1, 2.0 * modulation_dn)].map(|(way, unit_dn)| {
            let shown = |piece: &Piece, k: usize| unit_dn * piece.shown[way][k];
            let ripple_dn = [0, 1].map(|k| sum(&|piece| shown(piece, k)) / count);
            let off = |piece: &Piece, k: usize| shown(piece, k) - piece.count * ripple_dn[k];
            let square = |piece: &Piece| [0, 1].map(|k| off(piece, k) * off(piece, k)).iter().sum();
            let scatter_dn2 = sum(&square) / count * number / (number - 1.0);
            let size_dn2 = ripple_dn[0] * ripple_dn[0] + ripple_dn[1] * ripple_dn[1];
            Self { ripple_dn, size_dn2, scatter_dn2, modulation_dn }
        });
        let least_dn = (LEAST * noise_dn).max(least * modulation_dn);
        let told_dn = told * modulation_dn;
        let is_one = |seen: &Self| {
            let chance_dn2 = CERTAIN * CERTAIN * seen.scatter_dn2 / count;
            seen.size_dn2 > chance_dn2.max(least_dn * least_dn)
        };
        let size_dn2 = strong.size_dn2.max(weak.size_dn2).max(told_dn * told_dn);
        (told > 0.0 || is_one(&strong) || is_one(&weak)).then_some(Self { size_dn2, ..strong })
    }
}

/// a and b by the terms of L, DN.
struct Ripple {
    /// m: how often it comes in a fringe.
    times: f64,
    terms: [SVector<f64, TERMS>; 2],
    mean_dn: f64,
    size_px: (usize, usize),
}

impl Decoder {
    /// Takes such ripples off phases and modulations of a set of plain steps without frames left out, where they are beyond doubt and not nothing.
    pub(super) fn take_ripples(&self, home: usize, map: &mut PhaseViewMut) {
        let plan = &self.plan.axes[home];
        let Some(slot) = plan.sines.first() else { return };
        // Of steps that are not even the harmonics of a projector leave ripples whose phase has the other sign.
        let findings = &self.findings[*slot];
        let is_whole = self.plan.sines[*slot].even && findings.iter().all(|found| found.step.is_none());
        if plan.chain.is_none() || plan.fused || !is_whole || !self.sums[*slot].are_plain() {
            return;
        }
        let levels =
            |places: &[usize], sums: &mut BlockSums| self.sums[*slot].gather(&self.rasters, places, sums);
        // A light that changes this much was taken out of the frames as if it had fallen like the projector's.
        let part = |fault: &Fault| if let Fault::Flicker(part) = fault { *part } else { 0.0 };
        let told = findings.iter().map(|found| part(&found.fault)).fold(0.0, f64::max);
        // A pattern of eight bits makes ripples whose sign the modulation does not tell.
        let least = ROUNDED * (2.0 / f64::from(self.steps[*slot])).sqrt();
        for times in [1.0, 2.0] {
            let lines = Lines { map, levels, times };
            let mut ways = [OF_FULL, OF_SPARSE].into_iter().zip(LEAST_PIXELS);
            let found =
                ways.find_map(|([asked, measured], fewest)| Some((lines.pieces(asked, fewest)?, measured)));
            let seen = found.and_then(|(pieces, measured)| Some((Seen::of(&pieces, told, least)?, measured)));
            if let Some(ripple) = seen.and_then(|(seen, measured)| Ripple::of(&lines, &seen, measured)) {
                ripple.take_off(map);
            }
        }
    }
}

impl Ripple {
    fn take_off(&self, map: &mut PhaseViewMut) {
        let planes = map.phase_rad.par_chunks_mut(CHUNK).zip(map.modulation.par_chunks_mut(CHUNK));
        planes.zip(map.valid.par_chunks(CHUNK)).enumerate().for_each(
            |(chunk, ((phase_rad, modulation), valid))| {
                let pixels = phase_rad.iter_mut().zip(modulation).zip(valid).enumerate();
                for (n, ((phase, modulation), _)) in pixels.filter(|(_, (_, valid))| **valid == 1) {
                    let (found, dn) = (f64::from(*phase), f64::from(*modulation));
                    let [a, b] = self.at(chunk * CHUNK + n, dn);
                    let (sin, cos) = sincos(self.times * found);
                    let less = dn - (a * cos + b * sin);
                    // No ripple is as large as a fringe.
                    if less > 0.5 * dn {
                        *phase = (found - (b * cos - a * sin) / less) as f32;
                        *modulation = less as f32;
                    }
                }
            },
        );
    }

    /// That of a map by least squares over these lines and pixels, where this was seen all over it.
    fn of(lines: &Lines<'_, impl Levels>, seen: &Seen, measured: (usize, usize)) -> Option<Self> {
        let size_px = (lines.map.info.width_px as usize, lines.map.info.height_px as usize);
        let mut ripple =
            Self { times: lines.times, terms: [SVector::zeros(); 2], mean_dn: seen.modulation_dn, size_px };
        ripple.terms.iter_mut().zip(seen.ripple_dn).for_each(|(terms, even)| terms[0] = even);
        // Weak pixels of a large ripple are known only once some of it is.
        for _ in 0..ROUNDS {
            let mut normal = SMatrix::<f64, { 2 * TERMS }, { 2 * TERMS }>::zeros();
            let mut right = SVector::<f64, { 2 * TERMS }>::zeros();
            let told = |pixel: &Pixel| ripple.at(pixel.place, pixel.modulation_dn);
            lines.for_each_pixel(measured, told, |_, _, pixel| {
                let terms = ripple.terms_at(pixel.place, pixel.modulation_dn);
                let (mut row, [cos, sin]) = (SVector::<f64, { 2 * TERMS }>::zeros(), pixel.unit);
                row.fixed_rows_mut::<TERMS>(0).copy_from(&(terms * cos));
                row.fixed_rows_mut::<TERMS>(TERMS).copy_from(&(terms * sin));
                normal += row * row.transpose();
                right += row * pixel.above_dn;
            });
            // L is even unless the pixels say otherwise: its other terms are thought to be no larger than it.
            for k in (0..2 * TERMS).filter(|k| k % TERMS > 0) {
                normal[(k, k)] += seen.scatter_dn2 / seen.size_dn2;
            }
            let solved = normal.cholesky()?.solve(&right);
            for (k, terms) in ripple.terms.iter_mut().enumerate() {
                terms.copy_from(&solved.fixed_rows::<TERMS>(k * TERMS));
            }
        }
        Some(ripple)
    }

    fn terms_at(&self, place: usize, modulation_dn: f64) -> SVector<f64, TERMS> {
        let (width, height) = self.size_px;
        let part = |at: usize, of: usize| 2.0 * at as f64 / of as f64 - 1.0;
        let (across, down) = (part(place % width, width), part(place / width, height));
        SVector::from([1.0, modulation_dn / self.mean_dn - 1.0, across, down])
    }

    /// a and b of a pixel, DN.
    fn at(&self, place: usize, modulation_dn: f64) -> [f64; 2] {
        let terms = self.terms_at(place, modulation_dn);
        self.terms.each_ref().map(|own| own.dot(&terms))
    }
}

/// Gives the sums of the frames at some pixels.
trait Levels: Fn(&[usize], &mut BlockSums) {}

impl<F: Fn(&[usize], &mut BlockSums)> Levels for F {}

/// Pixels before, at and behind a place, and where it is on the map.
#[derive(Clone, Copy)]
struct Triple {
    places: [usize; 3],
    band: usize,
    piece: usize,
}

/// So many are looked at together.
const TOGETHER: usize = BLOCK / 3;

/// Lines of a map across its fringes, and the levels of its pixels in any unit.
struct Lines<'a, L> {
    map: &'a PhaseViewMut<'a>,
    levels: L,
    /// m: how often the ripple comes in a fringe.
    times: f64,
}

impl<L: Levels> Lines<'_, L> {
    /// What the pieces of the map show, where enough of them show something.
    fn pieces(&self, asked: (usize, usize), fewest: f64) -> Option<Pieces> {
        let mut pieces = [[Piece::default(); PIECES]; BANDS];
        let (dn, sigma_rad) = (&self.map.modulation, &self.map.sigma_rad);
        let noise_dn = |place: usize| f64::from(dn[place]) * f64::from(sigma_rad[place]);
        let even = |_: &Pixel| [0.0; 2];
        self.for_each_pixel(asked, even, |band, piece, pixel| {
            pieces[band][piece].add(pixel, noise_dn(pixel.place));
        });
        let filled = pieces.iter().flatten().filter(|piece| piece.count > 0.0);
        let (number, count) = filled.fold((0.0, 0.0), |(n, sum), piece| (n + 1.0, sum + piece.count));
        (count >= fewest && number >= LEAST_PIECES).then_some(pieces)
    }

    /// Gives pixels of some lines, evenly over the map, with the numbers of band and piece. Those whose modulation is not that of their place, beside the
    /// ripple that is told, are left out.
    fn for_each_pixel(
        &self,
        (lines, every): (usize, usize),
        told_dn: impl Fn(&Pixel) -> [f64; 2],
        mut give: impl FnMut(usize, usize, &Pixel),
    ) {
        let info = self.map.info;
        let (width, height) = (info.width_px as usize, info.height_px as usize);
        let ((length, ahead), (count, aside)) =
            if info.axis == Axis::X { ((width, 1), (height, width)) } else { ((height, width), (width, 1)) };
        let lines = lines.min(count);
        let mut triples = [Triple { places: [0; 3], band: 0, piece: 0 }; TOGETHER];
        let mut gathered = 0;
        let mut look_at = |triples: &[Triple]| {
            self.held_against(triples, |triple, pixel| {
                let [a, b] = told_dn(pixel);
                let told = a * pixel.unit[0] + b * pixel.unit[1];
                if (pixel.above_dn - told).abs() < EDGE * pixel.modulation_dn {
                    give(triple.band, triple.piece, pixel);
                }
            });
        };
        for line in 0..lines {
            let first = (2 * line + 1) * count / (2 * lines) * aside;
            let turn_rad = PI / self.times as f32;
            let mut ways = [Half { map: self.map, turn_rad, first, ahead, length, usual: 1 }; 2];
            for before in (0..length).step_by(every) {
                let Some(i) = ways[0].from(before) else { continue };
                let Some(behind) = ways[1].from(i) else { continue };
                let places = [before, i, behind].map(|i| first + i * ahead);
                triples[gathered] = Triple { places, band: line * BANDS / lines, piece: i * PIECES / length };
                gathered += 1;
                if gathered == TOGETHER {
                    look_at(&triples);
                    gathered = 0;
                }
            }
        }
        look_at(&triples[..gathered]);
    }

    /// Pixels against those half a ripple before and behind them.
    fn held_against(&self, triples: &[Triple], mut give: impl FnMut(&Triple, &Pixel)) {
        let (mut places, mut sums) = ([0; 3 * TOGETHER], BlockSums::ZERO);
        for (places, triple) in places.chunks_exact_mut(3).zip(triples) {
            places.copy_from_slice(&triple.places);
        }
        (self.levels)(&places[..3 * triples.len()], &mut sums);
        for (triple, levels) in triples.iter().zip(sums.sum.chunks_exact(3)) {
            let [before, own, behind] = triple.places.map(|place| f64::from(self.map.modulation[place]));
            let level = |k: usize| f64::from(levels[k]);
            // Own contrast and that of the others, times the three levels.
            let contrast = own * level(0) * level(2);
            let others = 0.5 * level(1) * (before * level(2) + behind * level(0));
            let both = 0.5 * (before + behind);
            let modulation_dn = 2.0 * own * both / (own + both);
            let place = triple.places[1];
            let (sin, cos) = sincos(self.times * f64::from(self.map.phase_rad[place]));
            let above_dn = (contrast - others) / (contrast + others) * modulation_dn;
            give(triple, &Pixel { place, above_dn, modulation_dn, unit: [cos, sin] });
        }
    }
}

/// Finds the pixel half a ripple further on a line.
#[derive(Clone, Copy)]
struct Half<'a> {
    map: &'a PhaseViewMut<'a>,
    turn_rad: f32,
    first: usize,
    ahead: usize,
    length: usize,
    /// How far it was last time, px.
    usual: usize,
}

impl Half<'_> {
    fn from(&mut self, begin: usize) -> Option<usize> {
        let own = self.phase(begin);
        let half = *self;
        let over = |end: usize| (half.phase(end) - own).abs() - half.turn_rad;
        let last = self.length.min(begin + MOST_HALF_PX + 1);
        let usual = begin + self.usual;
        let is_short = usual < last && over(usual) < 0.0;
        let mut end = if is_short { usual } else { begin + 1 };
        // Where there is no phase the search ends as well.
        while end < last && over(end) < 0.0 {
            end += 1;
        }
        if end >= last {
            return None;
        }
        // The pixel before may be nearer.
        if end > begin + 1 && over(end) + over(end - 1) > 0.0 {
            end -= 1;
        }
        self.usual = (end - begin).saturating_sub(2).max(1);
        (over(end).abs() < MET_RAD / PI * self.turn_rad).then_some(end)
    }

    fn phase(&self, i: usize) -> f32 {
        let place = self.first + i * self.ahead;
        if self.map.valid[place] == 1 { self.map.phase_rad[place] } else { f32::NAN }
    }
}

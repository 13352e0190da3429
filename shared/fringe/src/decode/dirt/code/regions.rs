//! Regions in which the wrapped phase runs on from pixel to pixel, so that one number gives all their orders.
//!
//! The phase is unwrapped from its most reliable neighbours on, so that turns are counted right within a surface. From one surface to another they are not:
//! there the orders that the pixels themselves show are off by the same number all over a surface. So they are where a frame of the code is wrong, but
//! then the phase runs on across the border between the two.

use super::CodeLook;
use crate::unwrap::{Method, UnwrapSettings, Wrapped, unwrap};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Neighbours belong to one surface that misfit its slope by less than so many times the usual, within these limits, turns.
const USUAL: f64 = 4.0;
const CONTINUOUS: [f64; 2] = [0.03, 0.2];
/// Pixels that tell the usual difference, about.
const SAMPLES: usize = 20_000;
/// Parts that are off by different numbers are one surface where so large a share of the neighbours across their border follow each other …
const SAME_SURFACE: f64 = 0.9;
/// … over a stretch that is no bridge: so long beside the root of the smaller part's pixels.
const BRIDGE: f64 = 0.25;
/// A smaller part is noise: it goes with one of its neighbours and joins none.
const SPECK: usize = 16;
/// Fewest pixels of a region, and most regions.
const LEAST: usize = 300;
const MOST_REGIONS: usize = 64;
/// Regions of so many pixels and fringes should tell where they begin.
const TELLING: usize = 2000;
const TELLING_TURNS: i16 = 3;
/// Stands for no region at all.
pub(super) const NONE: u8 = u8::MAX;

/// Regions of an image, the largest first.
#[derive(Debug)]
pub(super) struct Regions {
    /// Number of each pixel's region, or [`NONE`].
    pub home: Vec<u8>,
    /// Whole turns of each pixel, counted within its region from 0.
    pub turns: Vec<i16>,
    /// Pixels of each region, and the largest number of whole turns in it.
    pub sizes: Vec<(usize, i16)>,
    /// Largest misfit of neighbours on one surface, turns.
    limit: f64,
}

impl Regions {
    /// Of all pixels with a phase.
    pub fn new(look: &CodeLook) -> Self {
        let turns = unwrapped(look);
        let parts = Parts::new(look, &turns);
        let surfaces = parts.surfaces(look);
        let surface = |at: usize| surfaces.get(parts.of[at] as usize).copied();
        // Pixels, least and most turns of each surface.
        let mut found = vec![(0_usize, i32::MAX, i32::MIN); surfaces.len()];
        for (at, turns) in turns.iter().enumerate() {
            if let Some(surface) = surface(at) {
                let all = &mut found[surface as usize];
                *all = (all.0 + 1, all.1.min(*turns), all.2.max(*turns));
            }
        }
        let mut order: Vec<usize> = (0..found.len()).filter(|i| found[*i].0 >= LEAST).collect();
        order.sort_by_key(|i| (std::cmp::Reverse(found[*i].0), *i));
        order.truncate(MOST_REGIONS);
        let mut names = vec![NONE; found.len()];
        for (name, i) in order.iter().enumerate() {
            names[*i] = name as u8;
        }
        let home = (0..turns.len()).map(|at| surface(at).map_or(NONE, |i| names[i as usize])).collect();
        let counted = |at: usize| surface(at).map_or(0, |i| narrow(turns[at] - found[i as usize].1));
        let own = (0..turns.len()).map(counted).collect();
        let sizes = order.iter().map(|i| (found[*i].0, narrow(found[*i].2 - found[*i].1))).collect();
        Self { home, turns: own, sizes, limit: parts.limit }
    }

    /// Whether two neighbours are in one region, and the phase runs on from one to the other.
    pub fn runs_on(&self, look: &CodeLook, at: usize, next: usize) -> bool {
        self.home[at] != NONE && self.home[at] == self.home[next] && follow(look, at, next, self.limit)
    }

    /// Share of the pixels whose region begins at a known fringe, of all in regions that should tell it; 1 where none should.
    pub fn share(&self, begins: &[Option<i32>]) -> f64 {
        let (mut known, mut all) = (0.0, 0.0);
        for ((pixels, turns), begin) in self.sizes.iter().zip(begins) {
            let tells = *pixels >= TELLING && *turns >= TELLING_TURNS;
            known += if begin.is_some() { *pixels as f64 } else { 0.0 };
            all += if tells || begin.is_some() { *pixels as f64 } else { 0.0 };
        }
        if all > 0.0 { known / all } else { 1.0 }
    }
}

/// A number of turns; more than any projector shows end at the most that can be counted.
fn narrow(turns: i32) -> i16 {
    turns.clamp(0, i32::from(i16::MAX)) as i16
}

/// Whole turns of each pixel, from the most reliable neighbours on.
fn unwrapped(look: &CodeLook) -> Vec<i32> {
    let pixels = look.phase_rad.len();
    let valid: Vec<u8> = (0..pixels).map(|at| u8::from(look.turn(at).is_some())).collect();
    let wrapped = Wrapped {
        width_px: look.width as u32,
        height_px: (pixels / look.width) as u32,
        phase_rad: look.phase_rad,
        valid: &valid,
        modulation: None,
    };
    // The planes are as large as the picture: nothing else would be refused.
    let found = unwrap(&wrapped, None, &UnwrapSettings::new(Method::Reliability)).ok();
    let whole = |at: usize| {
        let phase_rad = f64::from(found.as_ref()?.phase_rad[at]);
        Some((phase_rad / TAU - look.turn(at)?).round() as i32)
    };
    (0..pixels).map(|at| whole(at).unwrap_or(0)).collect()
}

/// Connected parts of the picture, in each of which the orders that the pixels show are off from the turns by one number.
struct Parts {
    /// Part of each pixel; `u32::MAX` where there is no phase.
    of: Vec<u32>,
    /// Pixels of each part.
    areas: Vec<usize>,
    /// Largest misfit of neighbours on one surface, turns.
    limit: f64,
}

impl Parts {
    fn new(look: &CodeLook, turns: &[i32]) -> Self {
        let limit = continuous(look);
        let off = |at: usize| (f64::from(look.phase_rad[at]) / TAU).floor() as i32 - turns[at];
        let any = |at: usize| look.turn(at).is_some();
        let runs_on = |at: usize, next: usize| follow(look, at, next, limit);
        let (of, areas) = connected(look, any, |at, next| runs_on(at, next) && off(next) == off(at));
        // Where a bit shows nothing the orders are noise: there the specks are one part as far as the phase runs on.
        let is_speck = |at: usize| areas.get(of[at] as usize).is_some_and(|area| *area < SPECK);
        let (noise, noisy) = connected(look, is_speck, |at, next| is_speck(next) && runs_on(at, next));
        let firm = areas.len() as u32;
        let own = |at: usize| if noise[at] == u32::MAX { of[at] } else { firm + noise[at] };
        let of = (0..turns.len()).map(own).collect();
        Self { of, areas: [areas, noisy].concat(), limit }
    }

    /// Of neighbours in two parts: how many there are, and how many follow each other.
    fn borders(&self, look: &CodeLook) -> BTreeMap<[u32; 2], [usize; 2]> {
        let mut borders: BTreeMap<[u32; 2], [usize; 2]> = BTreeMap::new();
        for (at, own) in self.of.iter().enumerate().filter(|(_, own)| **own != u32::MAX) {
            let [right, _, lower, _] = around(at, look.width, self.of.len());
            for next in [right, lower].into_iter().flatten() {
                let other = self.of[next];
                if other != u32::MAX && other != *own {
                    let counts = borders.entry([*own.min(&other), *own.max(&other)]).or_default();
                    counts[0] += 1;
                    counts[1] += usize::from(follow(look, at, next, self.limit));
                }
            }
        }
        borders
    }

    /// The surface that each part belongs to, named by one of its parts.
    fn surfaces(&self, look: &CodeLook) -> Vec<u32> {
        let borders = self.borders(look);
        let mut surfaces: Vec<u32> = (0..self.areas.len() as u32).collect();
        let root = |surfaces: &[u32], mut part: u32| {
            while surfaces[part as usize] != part {
                part = surfaces[part as usize];
            }
            part
        };
        // What each speck has most in common with.
        let mut nearest: BTreeMap<u32, (usize, u32)> = BTreeMap::new();
        for ([one, other], [all, following]) in borders {
            let [small, large] = if self.areas[one as usize] < self.areas[other as usize] {
                [one, other]
            } else {
                [other, one]
            };
            let area = self.areas[small as usize];
            if area < SPECK {
                let best = nearest.entry(small).or_default();
                if following > best.0 && self.areas[large as usize] >= SPECK {
                    *best = (following, large);
                }
            } else if following as f64 >= SAME_SURFACE * all as f64
                && following as f64 > BRIDGE * (area as f64).sqrt()
            {
                let [one, other] = [one, other].map(|part| root(&surfaces, part));
                surfaces[one.max(other) as usize] = one.min(other);
            }
        }
        for (speck, (following, large)) in nearest {
            if following > 0 {
                surfaces[speck as usize] = large;
            }
        }
        (0..surfaces.len() as u32).map(|part| root(&surfaces, part)).collect()
    }
}

/// Number of the part that each pixel belongs to, `u32::MAX` where there is none, and the pixels of each: parts grow from pixel to neighbour.
fn connected(
    look: &CodeLook,
    any: impl Fn(usize) -> bool,
    joined: impl Fn(usize, usize) -> bool,
) -> (Vec<u32>, Vec<usize>) {
    let pixels = look.phase_rad.len();
    let (mut of, mut areas, mut stack) = (vec![u32::MAX; pixels], Vec::new(), Vec::new());
    for start in 0..pixels {
        if of[start] != u32::MAX || !any(start) {
            continue;
        }
        of[start] = areas.len() as u32;
        stack.push(start);
        let mut area = 0;
        while let Some(at) = stack.pop() {
            area += 1;
            for next in around(at, look.width, pixels).into_iter().flatten() {
                if of[next] == u32::MAX && joined(at, next) {
                    of[next] = areas.len() as u32;
                    stack.push(next);
                }
            }
        }
        areas.push(area);
    }
    (of, areas)
}

/// Right, left, lower and upper neighbour.
fn around(at: usize, width: usize, pixels: usize) -> [Option<usize>; 4] {
    let column = at % width;
    [
        (column + 1 < width).then_some(at + 1),
        at.checked_sub(1).filter(|_| column > 0),
        Some(at + width).filter(|next| *next < pixels),
        at.checked_sub(width),
    ]
}

/// Largest misfit of neighbours that belong to one surface, turns.
fn continuous(look: &CodeLook) -> f64 {
    let every = (look.phase_rad.len() / SAMPLES).max(1) | 1;
    let places = (0..look.phase_rad.len()).step_by(every);
    let steps =
        places.flat_map(|place| around(place, look.width, look.phase_rad.len()).map(|next| (place, next)));
    let mut misfits: Vec<f64> =
        steps.filter_map(|(one, other)| Some(misfit(look, one, other?)?.abs())).collect();
    // At rims and where little is known of the slope it is larger.
    let middle = misfits.len() / 4 * 3;
    if misfits.is_empty() {
        return CONTINUOUS[1];
    }
    let usual = *misfits.select_nth_unstable_by(middle, f64::total_cmp).1;
    (USUAL * usual).clamp(CONTINUOUS[0], CONTINUOUS[1])
}

/// By how much the step to a neighbour differs from the mean of the step before and the step behind, turns without the whole ones: steep fringes are
/// no rims.
fn misfit(look: &CodeLook, at: usize, next: usize) -> Option<f64> {
    let (low, high) = (at.min(next), at.max(next));
    let stride = high - low;
    let in_row = |one: usize, other: usize| stride > 1 || one / look.width == other / look.width;
    let step = |one: usize, other: usize| {
        let difference = look.turn(other)? - look.turn(one)?;
        Some(difference - difference.round())
    };
    let before = low.checked_sub(stride).filter(|at| in_row(*at, low)).and_then(|at| step(at, low));
    let behind = Some(high + stride)
        .filter(|at| *at < look.phase_rad.len() && in_row(high, *at))
        .and_then(|at| step(high, at));
    let (sum, count) = [before, behind].iter().flatten().fold((0.0, 0.0), |(sum, n), s| (sum + s, n + 1.0));
    let misfit: f64 = step(low, high)? - sum / f64::max(count, 1.0);
    Some(misfit - misfit.round())
}

/// Whether the phase of a neighbour follows that of a pixel.
fn follow(look: &CodeLook, at: usize, next: usize, most: f64) -> bool {
    misfit(look, at, next).is_some_and(|misfit| misfit.abs() < most)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 240;

    fn regions(phase_turns: impl Fn(f64, f64) -> f64) -> Regions {
        let place = |at: usize| (phase_turns((at % SIDE) as f64, (at / SIDE) as f64) * TAU) as f32;
        let phase_rad: Vec<f32> = (0..SIDE * SIDE).map(place).collect();
        let light = vec![50.0; SIDE * SIDE];
        let look = CodeLook {
            width: SIDE,
            phase_rad: &phase_rad,
            middle_dn: &light,
            contrast_dn: &light,
            period_px: 16.0,
            extent_px: 608.0,
            frames: &[],
        };
        Regions::new(&look)
    }

    /// Orders at which the pixels of a region show that it begins.
    fn begins(found: &Regions, name: u8, phase_turns: impl Fn(f64, f64) -> f64) -> Vec<i32> {
        let of = (0..SIDE * SIDE).filter(|at| found.home[*at] == name);
        let stored = |at: usize| (phase_turns((at % SIDE) as f64, (at / SIDE) as f64) * TAU) as f32;
        let shown = |at: usize| (f64::from(stored(at)) / TAU).floor() as i32;
        let mut begins: Vec<i32> = of.map(|at| shown(at) - i32::from(found.turns[at])).collect();
        begins.sort_unstable();
        begins.dedup();
        begins
    }

    /// A disc before a plane: along its rim both phases agree wherever they differ by whole turns, which is so in six places.
    #[test]
    fn surfaces_whose_phases_meet_in_places_are_regions_of_their_own() {
        let disc = |x: f64, y: f64| (x - 120.0).powi(2) + (y - 120.0).powi(2) < 4900.0;
        let phase = |x: f64, y: f64| 5.3 + 0.05 * x + if disc(x, y) { 4.0 + 0.02 * y } else { 0.01 * y };
        let found = regions(phase);
        assert_eq!(found.sizes.len(), 2, "{:?}", found.sizes);
        for name in 0..2 {
            assert_eq!(begins(&found, name, phase).len(), 1, "region {name}");
        }
        for (x, y) in [(5, 5), (120, 120), (120, 60), (230, 120)] {
            let inside = u8::from(disc(x as f64, y as f64));
            assert_eq!(found.home[y * SIDE + x], inside, "{x}, {y}");
        }
    }

    /// Two frames that show each other's bits beside their inverses: in half of the picture noise decides the bits.
    #[test]
    fn orders_that_are_noise_part_no_region() {
        let noise = |x: f64, y: f64| {
            let place = (y * SIDE as f64 + x) as u64;
            let mixed = place.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            [0.0, 2.0, 4.0, 8.0][mixed as usize % 4]
        };
        let phase = |x: f64, y: f64| 5.3 + 0.05 * x + 0.01 * y + if x > 100.0 { noise(x, y) } else { 0.0 };
        let found = regions(phase);
        assert_eq!(found.sizes, [(SIDE * SIDE, 14)]);
        assert_eq!(begins(&found, 0, phase).len(), 4);
    }

    /// A frame of the code that is wrong: the plane shows eight fringes too many from a fringe on, and stays one region.
    #[test]
    fn orders_that_jump_where_the_phase_runs_on_part_no_region() {
        let phase = |x: f64, y: f64| {
            let plane = 5.3 + 0.05 * x + 0.01 * y;
            plane + if plane >= 11.0 { 8.0 } else { 0.0 }
        };
        let found = regions(phase);
        assert_eq!(found.sizes, [(SIDE * SIDE, 14)]);
        assert_eq!(begins(&found, 0, phase).len(), 2);
    }
}

//! Regions in which the wrapped phase runs on from pixel to pixel, so that one number gives all their orders.

use super::CodeLook;

/// Neighbours whose phases differ by less than so many times the usual difference belong to one surface, within these limits, turns.
const USUAL: f64 = 4.0;
const CONTINUOUS: [f64; 2] = [0.03, 0.2];
/// Pixels that tell the usual difference, about.
const SAMPLES: usize = 20_000;
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
}

impl Regions {
    /// Walks over all pixels with a phase, from neighbour to neighbour.
    pub fn new(look: &CodeLook) -> Self {
        let pixels = look.phase_rad.len();
        let (mut label, mut turns) = (vec![0_u32; pixels], vec![0_i16; pixels]);
        let mut found: Vec<(usize, i16, i16)> = Vec::new();
        let mut stack = Vec::new();
        let limit = continuous(look);
        for start in 0..pixels {
            if label[start] != 0 || look.turn(start).is_none() {
                continue;
            }
            let number = found.len() as u32 + 1;
            label[start] = number;
            stack.push(start);
            let (mut count, mut least, mut most) = (0, 0, 0);
            while let Some(at) = stack.pop() {
                count += 1;
                (least, most) = (turns[at].min(least), turns[at].max(most));
                for next in around(at, look.width, pixels).into_iter().flatten() {
                    if label[next] == 0
                        && let Some(carried) = carry(look, at, next, limit)
                    {
                        label[next] = number;
                        turns[next] = turns[at].saturating_add(carried);
                        stack.push(next);
                    }
                }
            }
            found.push((count, least, most));
        }
        let mut order: Vec<usize> = (0..found.len()).filter(|i| found[*i].0 >= LEAST).collect();
        order.sort_by_key(|i| (std::cmp::Reverse(found[*i].0), *i));
        order.truncate(MOST_REGIONS);
        let mut names = vec![NONE; found.len() + 1];
        for (name, i) in order.iter().enumerate() {
            names[i + 1] = name as u8;
        }
        let home: Vec<u8> = label.iter().map(|label| names[*label as usize]).collect();
        for (turns, label) in turns.iter_mut().zip(&label) {
            if let Some(found) = (*label as usize).checked_sub(1).map(|i| found[i]) {
                *turns = turns.saturating_sub(found.1);
            }
        }
        let sizes = order.iter().map(|i| (found[*i].0, found[*i].2.saturating_sub(found[*i].1))).collect();
        Self { home, turns, sizes }
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

/// Largest difference of neighbours that belong to one surface, turns.
fn continuous(look: &CodeLook) -> f64 {
    let every = (look.phase_rad.len() / SAMPLES).max(1) | 1;
    let places = (0..look.phase_rad.len().saturating_sub(look.width)).step_by(every);
    let steps = places.flat_map(|place| [(place, place + 1), (place, place + look.width)]);
    let mut differences: Vec<f64> = steps
        .filter_map(|(one, other)| {
            let difference = look.turn(other)? - look.turn(one)?;
            Some((difference - difference.round()).abs())
        })
        .collect();
    // The steeper of rows and columns counts: half of the differences belong to the other.
    let middle = differences.len() / 4 * 3;
    if differences.is_empty() {
        return CONTINUOUS[1];
    }
    let usual = *differences.select_nth_unstable_by(middle, f64::total_cmp).1;
    (USUAL * usual).clamp(CONTINUOUS[0], CONTINUOUS[1])
}

/// Whole turns between two neighbours of one surface.
fn carry(look: &CodeLook, at: usize, next: usize, most: f64) -> Option<i16> {
    let difference = look.turn(next)? - look.turn(at)?;
    let whole = difference.round();
    ((difference - whole).abs() < most).then_some(-whole as i16)
}

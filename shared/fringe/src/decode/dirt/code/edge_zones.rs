//! Where a bit of a Gray code should change, as the finer bits tell it.
//!
//! Between two changes of a bit the finer ones count up and down again; where they stand highest, the bit changes. There a sharp frame has passed
//! most of the way from dark to light some pixels beside the edge, a blurred one has not, and a frame of one level does not change at all. Faces
//! of the part and dirt on it matter little: their edges stand anywhere.

use super::CodeLook;
use super::steps::Steps;
use crate::decode::bits::resolve;
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;
use crate::pattern::Code;

/// Fewer finer bits do not tell where an edge is.
const LEAST_FINER: usize = 3;
/// An edge is seen from so many pixels on …
const LEAST_PIXELS: usize = 200;
/// … and from this share of the pixels with contrast.
const LEAST_SHARE: f64 = 0.002;
/// A bit of which less than this share of the other level is seen beside its edges does not change there.
const FLAT: f64 = 0.02;
/// Edges with less of the usual contrast are blurred.
const SOFT: f64 = 0.6;
/// Fewer bits have no usual contrast.
const LEAST_BITS: usize = 3;

/// What a bit shows beside its edges.
#[derive(Debug, Clone, Copy)]
pub struct Edges {
    /// Median level without its sign: 1 where it is wholly light or dark.
    pub contrast: f64,
    /// Whether all of it is light, or all of it dark.
    pub is_flat: bool,
}

/// What each bit shows beside its edges; `None` where none are seen, the code is no Gray code, or there is no surface.
pub fn edges(look: &CodeLook, rasters: &Rasters, frames: &[usize], inverse: bool) -> Vec<Option<Edges>> {
    let from: Vec<(usize, bool)> = frames.iter().map(|frame| (*frame, inverse)).collect();
    let asked = frames.len().saturating_sub(LEAST_FINER);
    let steps = Steps::new(look, rasters, &from);
    if !steps.run_on() || frames.first().is_none_or(|frame| look.code_of(*frame) != Code::Gray) {
        return vec![None; asked];
    }
    let mut levels = vec![Vec::new(); asked];
    let mut pixels = 0_usize;
    for place in 0..look.middle_dn.len() {
        let Some(word) = look.word(rasters, &from, place) else { continue };
        pixels += 1;
        for (bit, levels) in levels.iter_mut().enumerate() {
            let top = (1_u16 << (frames.len() - 1 - bit)) - 1;
            if i32::from(top) - i32::from(resolve(word & top, Code::Gray)) <= steps.apart / 2 {
                levels.push(f64::from(look.level(rasters, frames[bit], place)));
            }
        }
    }
    let least = LEAST_PIXELS.max((LEAST_SHARE * pixels as f64) as usize);
    levels.iter_mut().map(|levels| (levels.len() >= least).then(|| Edges::of(levels))?).collect()
}

impl Edges {
    /// `None` where there are no levels, which are left without their signs.
    fn of(levels: &mut [f64]) -> Option<Self> {
        let light = levels.iter().filter(|level| **level > 0.0).count();
        let fewer = light.min(levels.len() - light);
        for level in levels.iter_mut() {
            *level = level.abs();
        }
        let contrast = median(levels)?;
        Some(Self { contrast, is_flat: (fewer as f64) < FLAT * levels.len() as f64 })
    }
}

/// The bits whose edges have clearly less contrast than usual, and the share that they have.
pub fn soft(edges: &[Option<Edges>]) -> Vec<(usize, f64)> {
    let mut known: Vec<f64> = edges.iter().flatten().map(|edges| edges.contrast).collect();
    let Some(usual) = median(&mut known).filter(|_| known.len() >= LEAST_BITS) else { return Vec::new() };
    let shares = edges.iter().enumerate().filter_map(|(bit, own)| Some((bit, (*own)?.contrast / usual)));
    shares.filter(|(_, share)| *share < SOFT).collect()
}

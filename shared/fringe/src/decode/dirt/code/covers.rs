//! Where something stands before a frame of a code: a hand, a tool, a cable.
//!
//! What stands there has a brightness of its own. Each pixel knows its levels of light and dark from the fringes, so that a frame is covered where it
//! shows neither, or the wrong one of them where the region's phase says which it should be. Light that bounces, a rim or a highlight
//! do the same to all frames: a cell of the picture is covered in a frame only if it is so by far more than in the others, and by far more
//! than that frame is elsewhere.

use super::frame_levels::every;
use super::{CodeFrame, CodeLook, Shown};
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;

/// Columns and rows of a cell, px.
const CELL_PX: usize = 16;
/// A cell with light on a smaller part tells nothing.
const LEAST_LIT: f64 = 1.0 / 16.0;
/// Clear of an edge by this part of a stripe a pixel shows its level.
const CLEAR_STRIPES: f64 = 0.3;
/// Half way from a level to the middle, and as far beyond it, is neither light nor dark, as a share of the step between them.
const NEITHER: f64 = 0.25;
/// Share of the pixels that must be light, or dark, to have a level.
const LEAST_LEVEL: f64 = 0.05;
/// Share of a cell's pixels that are wrong where it is covered …
const COVERED: f64 = 0.5;
/// … and so many times as many as in the other frames, and as in the other cells.
const TIMES: f64 = 3.0;
/// By level a frame is compared with this part of its cells: what most of them show is the frame as a whole …
const MOST_CELLS: f64 = 0.5;
/// … and by what is demanded, when that was judged, with its better cells.
const BETTER_CELLS: f64 = 0.25;
/// Share of the pixels from which a frame is named: highlights and rims of a clean recording are a twentieth at most.
const LEAST_SHARE: f64 = 0.05;

/// Which cells of the picture are covered in which frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Covers {
    /// Columns of the picture, px, and columns of cells.
    width: [usize; 2],
    /// Usual levels of dark and light; none where nothing was looked at.
    levels: Option<[f64; 2]>,
    /// Of each frame, its cells; empty where nothing stands before it.
    cells: Vec<Vec<bool>>,
}

/// Pixels of the cells that are clear of edges, and those that show neither light nor dark or the wrong one of them.
struct Counts {
    clear: Vec<u32>,
    wrong: Vec<u32>,
}

impl Counts {
    fn share(&self, cell: usize) -> Option<f64> {
        let least = LEAST_LIT * (CELL_PX * CELL_PX) as f64;
        let clear = f64::from(self.clear[cell]);
        (clear >= least).then(|| f64::from(self.wrong[cell]) / clear)
    }
}

impl Covers {
    /// Nothing stands before any frame.
    pub fn none(look: &CodeLook) -> Self {
        let width = [look.width, look.width.div_ceil(CELL_PX)];
        Self { width, levels: None, cells: vec![Vec::new(); look.frames.len()] }
    }

    /// What is neither light nor dark in any of the frames.
    pub fn new(look: &CodeLook, rasters: &Rasters) -> Self {
        let mut covers = Self { levels: usual_levels(look, rasters), ..Self::none(look) };
        covers.look(look, rasters, None);
        covers
    }

    /// Adds what is light where it should be dark, or dark, by the coordinates that are demanded, projector pixels; NaN: either may be
    /// right. Coordinates are in doubt where frames are.
    pub fn add_demanded(
        &mut self,
        look: &CodeLook,
        rasters: &Rasters,
        demanded_px: &[f32],
        doubted: &[bool],
    ) {
        self.look(look, rasters, Some((demanded_px, doubted)));
    }

    fn look(&mut self, look: &CodeLook, rasters: &Rasters, demanded: Option<(&[f32], &[bool])>) {
        let Some(levels) = self.levels else { return };
        let (demanded_px, doubted) = demanded.unzip();
        let counts = self.count(look, rasters, demanded_px.unwrap_or(&[]), levels);
        let found: Vec<Vec<bool>> =
            (0..counts.len()).map(|frame| self.covered(&counts, frame, doubted)).collect();
        for (frame, covered) in found.into_iter().enumerate() {
            let pixels = |cell: usize| f64::from(counts[frame].clear[cell]);
            let all: f64 = (0..covered.len()).map(pixels).sum();
            let hidden: f64 = (0..covered.len()).filter(|cell| covered[*cell]).map(pixels).sum();
            if hidden > LEAST_SHARE * all {
                let more = self.with_edges(&covered);
                self.cells[frame].resize(more.len(), false);
                self.cells[frame].iter_mut().zip(more).for_each(|(own, more)| *own |= more);
            }
        }
    }

    /// Whether something stands before a pixel of a frame.
    pub fn hides(&self, frame: usize, place: usize) -> bool {
        let cells = &self.cells[frame];
        !cells.is_empty() && cells[self.cell(place)]
    }

    /// Whether other levels of dark and light explain what is covered of a frame: it is brighter, darker or blurred as a whole.
    pub fn are_explained(
        &self,
        look: &CodeLook,
        rasters: &Rasters,
        demanded_px: &[f32],
        (frame, own): (usize, [f64; 2]),
    ) -> bool {
        let wrong = |levels: [f64; 2]| {
            let counts = &self.count(look, rasters, demanded_px, levels)[frame];
            let cells = self.cells[frame].iter().zip(&counts.wrong).filter(|(covered, _)| **covered);
            cells.map(|(_, wrong)| f64::from(*wrong)).sum::<f64>()
        };
        self.levels.is_some_and(|usual| TIMES * wrong(own) < wrong(usual))
    }

    /// Whether something stands before some pixels of a frame.
    pub fn any(&self, frame: usize) -> bool {
        !self.cells[frame].is_empty()
    }

    /// Forgets what stands before a frame.
    pub fn clear(&mut self, frame: usize) {
        self.cells[frame].clear();
    }

    fn cell(&self, place: usize) -> usize {
        let [width, columns] = self.width;
        place / width / CELL_PX * columns + place % width / CELL_PX
    }

    /// Counts the pixels of all frames that show neither light nor dark, or not the one that is demanded.
    fn count(
        &self,
        look: &CodeLook,
        rasters: &Rasters,
        demanded_px: &[f32],
        [dark, light]: [f64; 2],
    ) -> Vec<Counts> {
        let pixels = look.phase_rad.len();
        let cells = (pixels / look.width).div_ceil(CELL_PX) * self.width[1];
        let empty = |_| Counts { clear: vec![0; cells], wrong: vec![0; cells] };
        let mut counts: Vec<Counts> = look.frames.iter().map(empty).collect();
        let least_px: Vec<f64> = look.frames.iter().map(least_px).collect();
        let scale_px = look.period_px / std::f64::consts::TAU;
        let inverse = 1.0 / (light - dark);
        for place in (0..pixels).filter(|place| look.turn(*place).is_some()) {
            // The edges of the stripes lie at the same parts of each fringe: a wrong order does not matter to them.
            let demanded = demanded_px.get(place).filter(|x_px| x_px.is_finite());
            let x_px = demanded.map_or(scale_px * f64::from(look.phase_rad[place]), |x_px| f64::from(*x_px));
            let cell = self.cell(place);
            for (frame, counts) in counts.iter_mut().enumerate() {
                let (is_light, edge_px) = look.frames[frame].shown.at(x_px);
                if edge_px > least_px[frame] {
                    let level = (f64::from(look.level(rasters, frame, place)) - dark) * inverse;
                    let off = level.abs().min((level - 1.0).abs());
                    let other = demanded.is_some() && is_light != (level > 0.5);
                    counts.clear[cell] += 1;
                    counts.wrong[cell] += u32::from(off > NEITHER || other);
                }
            }
        }
        counts
    }

    /// Which cells of a frame are wrong, unlike those of the other frames and unlike its other cells.
    fn covered(&self, counts: &[Counts], frame: usize, doubted: Option<&[bool]>) -> Vec<bool> {
        let own = &counts[frame];
        let cells = own.clear.len();
        let mut scratch: Vec<f64> = (0..cells).filter_map(|cell| own.share(cell)).collect();
        let part = if doubted.is_some() { BETTER_CELLS } else { MOST_CELLS };
        scratch.sort_unstable_by(f64::total_cmp);
        let elsewhere = scratch.get((part * scratch.len() as f64) as usize).copied().unwrap_or(0.0);
        let is_covered = |cell: usize| {
            let Some(share) = own.share(cell).filter(|share| *share > COVERED.max(TIMES * elsewhere)) else {
                return false;
            };
            let others = || (0..counts.len()).filter(|i| *i != frame);
            // A coordinate that another frame contradicts, or does not confirm, is itself in doubt.
            let is_hidden = |other: usize| self.cells[other].get(cell).is_some_and(|hidden| *hidden);
            let differs = |i: usize| is_hidden(i) || counts[i].share(cell).is_some_and(|s| s > COVERED);
            if doubted.is_some_and(|doubted| others().any(|i| doubted[i] || differs(i))) {
                return false;
            }
            scratch.clear();
            scratch.extend(others().filter_map(|i| counts[i].share(cell)));
            median(&mut scratch).is_some_and(|others| share > TIMES * others)
        };
        (0..cells).map(is_covered).collect()
    }

    /// The same cells and those beside them, through which the edge of what stands there may pass.
    fn with_edges(&self, covered: &[bool]) -> Vec<bool> {
        let columns = self.width[1];
        let rows = covered.len() / columns;
        let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        let any = |cell: usize| {
            let mut around = near(cell / columns, rows)
                .flat_map(|row| near(cell % columns, columns).map(move |column| row * columns + column));
            around.any(|cell| covered[cell])
        };
        (0..covered.len()).map(any).collect()
    }

    /// Share of a frame's pixels with a phase that are hidden.
    pub fn hidden(&self, look: &CodeLook, frame: usize) -> f64 {
        let (mut hidden, mut all) = (0_usize, 0_usize);
        for place in (0..look.phase_rad.len()).filter(|place| look.turn(*place).is_some()) {
            all += 1;
            hidden += usize::from(self.hides(frame, place));
        }
        hidden as f64 / all.max(1) as f64
    }
}

/// Usual levels of dark and light of the bits, at pixels with a phase that are clear of edges.
fn usual_levels(look: &CodeLook, rasters: &Rasters) -> Option<[f64; 2]> {
    let bits = (0..look.frames.len()).filter(|f| matches!(look.frames[*f].shown, Shown::Bit { .. }));
    let mut seen: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
    for frame in bits {
        let of_frame = clear_levels(look, rasters, frame);
        for (class, seen) in seen.iter_mut().enumerate() {
            let is_of = |level: &&f64| usize::from(**level > 0.0) == class;
            let mut own: Vec<f64> = of_frame.iter().filter(is_of).copied().collect();
            // A level that hardly a pixel shows is that of rims.
            if own.len() as f64 > LEAST_LEVEL * of_frame.len() as f64 {
                seen.extend(median(&mut own));
            }
        }
    }
    let [mut dark, mut light] = seen;
    Some([median(&mut dark)?, median(&mut light)?])
}

/// What a frame shows at some pixels with a phase that are clear of its edges.
fn clear_levels(look: &CodeLook, rasters: &Rasters, frame: usize) -> Vec<f64> {
    let scale_px = look.period_px / std::f64::consts::TAU;
    let least_px = least_px(&look.frames[frame]);
    let is_clear = |place: &usize| {
        look.turn(*place).is_some()
            && look.frames[frame].shown.at(scale_px * f64::from(look.phase_rad[*place])).1 > least_px
    };
    let places = (0..look.phase_rad.len()).step_by(every(look)).filter(is_clear);
    places.map(|place| f64::from(look.level(rasters, frame, place))).collect()
}

/// Farther from an edge a pixel of a frame shows its level, projector pixels.
fn least_px(frame: &CodeFrame) -> f64 {
    if let Shown::Bit { code, .. } = frame.shown { CLEAR_STRIPES * code.stripe_px } else { 0.0 }
}

//! Frames of a code drawn along the fringes of each region, and what they must show there.

use super::begins::begins;
use super::covers::Covers;
use super::regions::{NONE, Regions};
use super::{CodeLook, Fault, Shown};
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;

/// Cells of a strip in one turn of the phase.
pub(super) const CELLS: usize = 8;
/// Cells nearer to an edge of a stripe than this part of a period, or of the stripe, tell nothing.
const EDGE_PERIODS: f64 = 0.1;
const EDGE_STRIPES: f64 = 0.3;
/// A frame has this share of the usual contrast, else it is blurred …
const BLURRED: f64 = 0.6;
/// … or this part of the usual contrast near its edges …
const BLURRED_EDGES: f64 = 0.8;
/// … or this where its stripes are as narrow as a fringe …
const BLURRED_NARROW: f64 = 0.3;
/// … or nothing is seen of its pattern.
const LOST: f64 = 0.2;
/// A frame shows another pattern when it has this contrast there.
const SHOWS: f64 = 0.7;
/// A level that is off by more of the contrast is a changing light.
const CHANGED: f64 = 0.2;
/// A frame is shifted that has so much more contrast when it is moved back.
const MOVED_GAIN: f64 = 0.1;
/// Cells within so many periods of an edge are near it; fewest pixels there on either side.
const NEAR_PERIODS: f64 = 0.75;
const LEAST_NEAR: f64 = 200.0;
/// Share of a strip's cells that contradict in places.
const STRANGE: f64 = 0.1;
/// The same of stripes as narrow as a fringe, which a coarse camera blurs.
const STRANGE_NARROW: f64 = 0.2;
/// Share of the cells that must be light, or dark, to have a level.
const LEAST_SHARE: f64 = 0.005;

/// Levels of all frames along each region: sums over the pixels of each cell.
pub(super) struct Strips {
    /// Of each region, its cells.
    regions: Vec<Strip>,
}

/// Levels of all frames along one region.
pub(super) struct Strip {
    /// Pixels of each cell.
    pub count: Vec<f64>,
    /// Of these, those of each frame before which nothing stands.
    pub seen: Vec<Vec<f64>>,
    /// Their mean level of each frame in each cell.
    pub level: Vec<Vec<f64>>,
}

/// What was found about one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Judged {
    /// What is wrong with it, if anything.
    pub fault: Option<Fault>,
    /// Its level where it should be dark and light, as a share of the contrast from −1 to 1.
    pub dark: f64,
    pub light: f64,
    /// Another frame that shows what this one should.
    pub shown_by: Option<usize>,
}

/// What all frames show, and what each of them does.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Verdict {
    /// One for each frame.
    pub frames: Vec<Judged>,
    /// Usual levels of dark and light.
    pub dark: f64,
    pub light: f64,
}

impl Verdict {
    /// Names the frames before which something stands; those that are wrong as a whole are not covered.
    pub fn cover(&mut self, look: &CodeLook, rasters: &Rasters, demanded_px: &[f32], covers: &mut Covers) {
        for (frame, judged) in self.frames.iter_mut().enumerate().filter(|(_, judged)| judged.fault.is_some())
        {
            let levels = [judged.dark, judged.light];
            let is_whole = match judged.fault {
                None | Some(Fault::Strange) => false,
                Some(Fault::Level(_) | Fault::Blurred(_)) => {
                    covers.are_explained(look, rasters, demanded_px, (frame, levels))
                }
                Some(_) => true,
            };
            if is_whole {
                covers.clear(frame);
            }
        }
        for (frame, judged) in self.frames.iter_mut().enumerate().filter(|(frame, _)| covers.any(*frame)) {
            judged.fault = Some(Fault::Covered(covers.hidden(look, frame)));
        }
    }
}

/// Sums over the cells where a frame should be dark and light.
#[derive(Debug, Clone, Copy, Default)]
struct Classes {
    count: [f64; 2],
    sum: [f64; 2],
}

impl Classes {
    fn mean(&self, class: usize) -> Option<f64> {
        let all = self.count[0] + self.count[1];
        (self.count[class] > LEAST_SHARE * all).then(|| self.sum[class] / self.count[class])
    }

    /// Half of light less dark; none where a frame should show one of them only.
    fn contrast(&self) -> Option<f64> {
        Some(0.5 * (self.mean(1)? - self.mean(0)?))
    }
}

impl Strips {
    /// Sums up the levels of all frames where nothing stands before them.
    pub fn new(look: &CodeLook, regions: &Regions, rasters: &Rasters, covers: &Covers) -> Self {
        let cells = |turns: i16| (turns as usize + 1) * CELLS;
        let empty = |size: &(usize, i16)| Strip {
            count: vec![0.0; cells(size.1)],
            seen: vec![vec![0.0; cells(size.1)]; look.frames.len()],
            level: vec![vec![0.0; cells(size.1)]; look.frames.len()],
        };
        let mut strips: Vec<Strip> = regions.sizes.iter().map(empty).collect();
        for (place, home) in regions.home.iter().enumerate().filter(|(_, home)| **home != NONE) {
            let Some(turn) = look.turn(place) else { continue };
            let cell =
                regions.turns[place] as usize * CELLS + ((turn * CELLS as f64) as usize).min(CELLS - 1);
            let strip = &mut strips[usize::from(*home)];
            strip.count[cell] += 1.0;
            for (frame, (level, seen)) in strip.level.iter_mut().zip(&mut strip.seen).enumerate() {
                if !covers.hides(frame, place) {
                    level[cell] += f64::from(look.level(rasters, frame, place));
                    seen[cell] += 1.0;
                }
            }
        }
        for strip in &mut strips {
            for (level, seen) in strip.level.iter_mut().zip(&strip.seen) {
                for (level, count) in level.iter_mut().zip(seen) {
                    *level /= count.max(1.0);
                }
            }
        }
        Self { regions: strips }
    }

    /// The fringe at which each region begins, where the frames tell.
    pub fn begins(&self, look: &CodeLook) -> Vec<Option<i32>> {
        begins(look, &self.regions)
    }

    /// What each frame shows.
    pub fn judge(&self, look: &CodeLook, begins: &[Option<i32>]) -> Verdict {
        let own: Vec<Classes> = (0..look.frames.len())
            .map(|frame| self.classes(look, begins, frame, &look.frames[frame].shown, (0, false)))
            .collect();
        let middle = |class: usize, other: f64| {
            let mut seen: Vec<f64> = own.iter().filter_map(|classes| classes.mean(class)).collect();
            median(&mut seen).unwrap_or(other)
        };
        let (dark, light) = (middle(0, -1.0), middle(1, 1.0));
        let usual = 0.5 * (light - dark);
        let near = |frame: usize| self.near(look, begins, frame, 0);
        let mut at_edges: Vec<f64> = (0..look.frames.len()).filter_map(near).collect();
        let at_edges = median(&mut at_edges).unwrap_or(usual);
        let mut frames: Vec<Judged> = own
            .iter()
            .enumerate()
            .map(|(frame, classes)| {
                let fault = self.fault(look, begins, (frame, classes), (dark, light, at_edges));
                let (seen_dark, seen_light) =
                    (classes.mean(0).unwrap_or(dark), classes.mean(1).unwrap_or(light));
                Judged { fault, dark: seen_dark, light: seen_light, shown_by: None }
            })
            .collect();
        // Who shows what a wrong frame should?
        for frame in 0..frames.len() {
            if frames[frame].fault.is_none_or(|fault| matches!(fault, Fault::Level(_) | Fault::Blurred(_))) {
                continue;
            }
            let shown = &look.frames[frame].shown;
            let other = (0..frames.len()).filter(|other| *other != frame && frames[*other].fault.is_some());
            let best = other.filter_map(|other| {
                Some((self.classes(look, begins, other, shown, (0, false)).contrast()? / usual, other))
            });
            let best = best.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 > SHOWS);
            if let Some((_, other)) = best {
                frames[frame].shown_by = Some(other);
                frames[other].fault = Some(Fault::Shows(look.frames[frame].set, look.frames[frame].step));
            }
        }
        Verdict { frames, dark, light }
    }

    /// What is wrong with a frame.
    fn fault(
        &self,
        look: &CodeLook,
        begins: &[Option<i32>],
        (frame, classes): (usize, &Classes),
        (dark, light, usual_near): (f64, f64, f64),
    ) -> Option<Fault> {
        let usual = 0.5 * (light - dark);
        let Some(contrast) = classes.contrast().map(|contrast| contrast / usual) else {
            // All light or all dark: only the level tells.
            let class = usize::from(classes.mean(1).is_some());
            let off = (classes.mean(class)? - [dark, light][class]) / (2.0 * usual);
            return match class {
                1 if off < -0.7 => Some(Fault::Black),
                _ if off.abs() > 0.7 => Some(Fault::Strange),
                _ if off.abs() > CHANGED => Some(Fault::Level(off)),
                _ => None,
            };
        };
        let (seen_dark, seen_light) = (classes.mean(0)?, classes.mean(1)?);
        let level = (0.5 * (seen_dark + seen_light) - 0.5 * (dark + light)) / (2.0 * usual);
        if contrast < -SHOWS {
            return Some(Fault::Inverse);
        }
        // Shifted or blurred stripes differ near their edges alone.
        let near = |cells: i32| Some(self.near(look, begins, frame, cells)? / usual_near);
        let at_edges = near(0);
        let moved = (2..=CELLS as i32).flat_map(|cells| [cells, -cells]);
        let moved = moved.filter_map(|cells| Some((near(cells)?, cells))).max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((best, cells)) = moved
            && best > SHOWS
            && at_edges.is_some_and(|here| best > here + MOVED_GAIN)
        {
            return Some(Fault::Shifted(f64::from(cells) / CELLS as f64 * look.period_px));
        }
        if contrast < BLURRED {
            for other in (0..look.frames.len()).filter(|other| *other != frame) {
                let shown = look.frames[other].shown;
                let other_contrast = self.classes(look, begins, frame, &shown, (0, false)).contrast();
                if other_contrast.is_some_and(|contrast| contrast > SHOWS * usual) {
                    return Some(Fault::Shows(look.frames[other].set, look.frames[other].step));
                }
            }
        }
        if contrast < LOST {
            let black = seen_light < dark + 0.3 * usual;
            return Some(if black { Fault::Black } else { Fault::Strange });
        }
        // Narrow stripes are near an edge everywhere, and defocus has its part in them.
        let wide = look.frames[frame].is_wide(look.period_px);
        if self.contradicting(look, begins, frame, 0.5 * (seen_dark + seen_light))
            > (if wide { STRANGE } else { STRANGE_NARROW })
        {
            return Some(Fault::Strange);
        }
        if level.abs() > CHANGED {
            return Some(Fault::Level(level));
        }
        if contrast < (if wide { BLURRED } else { BLURRED_NARROW }) {
            return Some(Fault::Blurred(contrast));
        }
        at_edges.filter(|contrast| wide && *contrast < BLURRED_EDGES).map(Fault::Blurred)
    }

    /// Contrast of a frame near the edges of its pattern.
    fn near(&self, look: &CodeLook, begins: &[Option<i32>], frame: usize, cells: i32) -> Option<f64> {
        if !matches!(look.frames[frame].shown, Shown::Bit { .. }) {
            return None;
        }
        let classes = self.classes(look, begins, frame, &look.frames[frame].shown, (cells, true));
        classes.contrast().filter(|_| classes.count[0].min(classes.count[1]) > LEAST_NEAR)
    }

    /// Levels of a frame where a pattern is dark and light, the strip moved by so many cells.
    fn classes(
        &self,
        look: &CodeLook,
        begins: &[Option<i32>],
        frame: usize,
        shown: &Shown,
        (moved, near): (i32, bool),
    ) -> Classes {
        let mut classes = Classes::default();
        for (strip, begin) in self.known(begins) {
            let seen = &strip.seen[frame];
            for (cell, level) in
                strip.level[frame].iter().enumerate().filter(|(cell, _)| strip.count[*cell] > 0.0)
            {
                let at = begin * CELLS as i32 + cell as i32 + moved;
                if let Some(light) = light_at(look, shown, at).filter(|_| !near || is_near(look, shown, at)) {
                    classes.count[usize::from(light)] += seen[cell];
                    classes.sum[usize::from(light)] += seen[cell] * level;
                }
            }
        }
        classes
    }

    /// Share of the pixels in cells of a frame on the wrong side of the middle.
    fn contradicting(&self, look: &CodeLook, begins: &[Option<i32>], frame: usize, middle: f64) -> f64 {
        let (mut wrong, mut all) = (0.0, 0.0);
        for (strip, begin) in self.known(begins) {
            for (cell, level) in strip.level[frame].iter().enumerate() {
                let at = begin * CELLS as i32 + cell as i32;
                if let Some(light) = light_at(look, &look.frames[frame].shown, at) {
                    all += strip.seen[frame][cell];
                    wrong += if light == (*level > middle) { 0.0 } else { strip.seen[frame][cell] };
                }
            }
        }
        wrong / f64::max(all, 1.0)
    }

    fn known<'a>(&'a self, begins: &'a [Option<i32>]) -> impl Iterator<Item = (&'a Strip, i32)> {
        self.regions.iter().zip(begins).filter_map(|(strip, begin)| Some((strip, (*begin)?)))
    }
}

/// Whether a cell is light; none near an edge and outside of the projector.
pub(super) fn light_at(look: &CodeLook, shown: &Shown, cell: i32) -> Option<bool> {
    let x_px = (f64::from(cell) + 0.5) / CELLS as f64 * look.period_px;
    if x_px < -0.5 || x_px > look.extent_px {
        return None;
    }
    let (light, edge_px) = shown.at(x_px);
    let stripe_px = if let Shown::Bit { code, .. } = shown { code.stripe_px } else { f64::INFINITY };
    (edge_px > (EDGE_PERIODS * look.period_px).min(EDGE_STRIPES * stripe_px)).then_some(light)
}

/// Whether an edge of the pattern is near.
fn is_near(look: &CodeLook, shown: &Shown, cell: i32) -> bool {
    let x_px = (f64::from(cell) + 0.5) / CELLS as f64 * look.period_px;
    shown.at(x_px).1 < NEAR_PERIODS * look.period_px
}

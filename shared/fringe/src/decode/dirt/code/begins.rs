//! The fringe with which each region begins.
//!
//! Two frames that were exchanged are exchanged in all regions. A region of few fringes may agree with another begin as well as with the
//! exchange, so that is looked for in all of them together.

use super::strips::{CELLS, Strip, light_at};
use super::{CodeLook, Shown};

/// Frames that may contradict while the others find where a region begins; of fewer than five frames one.
const MOST_WRONG: usize = 2;
/// The other frames agree by this with the fringe at which a region begins, 1 being without any doubt …
const AGREE: f64 = 0.8;
/// … each of them by so much at least …
const LEAST_AGREE: f64 = 0.5;
/// … and by so much less with any other, in whole frames.
const APART: f64 = 0.4;
/// Two frames are exchanged with which the frames agree by so much more, in whole frames, in the mean over the pixels.
const EXCHANGED: f64 = 0.1;

/// The fringe at which each region begins, where the frames tell.
pub(super) fn begins(look: &CodeLook, strips: &[Strip]) -> Vec<Option<i32>> {
    let orders = (look.extent_px / look.period_px).ceil() as i32 + 1;
    let bits: Vec<usize> = (0..look.frames.len())
        .filter(|frame| matches!(look.frames[*frame].shown, Shown::Bit { .. }))
        .collect();
    let signs: Vec<Vec<f64>> =
        bits.iter().map(|frame| signs(look, &look.frames[*frame].shown, orders)).collect();
    let common: Vec<Common> = strips.iter().map(|strip| Common::new(strip, &bits, &signs, orders)).collect();
    let exchanged = exchanged(&common, bits.len());
    common.iter().map(|common| common.begin(exchanged)).collect()
}

/// What the frames of a code have in common with the patterns along one region.
struct Common {
    pixels: f64,
    /// For each begin, of each frame with its own pattern and those of the others, −1 to 1.
    at: Vec<(i32, Vec<Vec<f64>>)>,
}

impl Common {
    fn new(strip: &Strip, bits: &[usize], signs: &[Vec<f64>], orders: i32) -> Self {
        let turns = (strip.count.len() / CELLS) as i32;
        let of_begin = |begin: i32| {
            let with =
                |frame: &usize| signs.iter().map(|signs| strip.agreement(*frame, signs, begin)).collect();
            (begin, bits.iter().map(with).collect())
        };
        let at = (-1..=(orders - turns + 1)).map(of_begin).collect();
        Self { pixels: strip.count.iter().sum(), at }
    }

    /// By how much each frame agrees for each begin, where two of them may be exchanged.
    fn agreed(&self, exchanged: Option<[usize; 2]>) -> impl Iterator<Item = (i32, Vec<f64>)> {
        self.at.iter().map(move |(begin, common)| {
            let mut agreed: Vec<f64> = (0..common.len()).map(|i| common[i][i]).collect();
            if let Some([i, j]) = exchanged {
                (agreed[i], agreed[j]) = (common[j][i], common[i][j]);
            }
            (*begin, agreed)
        })
    }

    /// Whole frames by which all of them agree with the best begin, times the pixels.
    fn best(&self, exchanged: Option<[usize; 2]>) -> f64 {
        let sums = self.agreed(exchanged).map(|(_, agreed)| agreed.iter().sum::<f64>());
        self.pixels * sums.max_by(f64::total_cmp).unwrap_or(0.0)
    }

    /// The begin with which all frames agree, or all but as few as possible.
    fn begin(&self, exchanged: Option<[usize; 2]>) -> Option<i32> {
        let agreed: Vec<(i32, Vec<f64>)> = self.agreed(exchanged).collect();
        let count = agreed.first()?.1.len();
        let most = if count < 5 { 1 } else { MOST_WRONG };
        (0..=most.min(count.saturating_sub(2))).find_map(|wrong| settled(&agreed, wrong))
    }
}

/// The two frames that show each other's patterns.
fn exchanged(common: &[Common], frames: usize) -> Option<[usize; 2]> {
    let total = |exchanged| common.iter().map(|common| common.best(exchanged)).sum::<f64>();
    let pairs = (0..frames).flat_map(|i| (0..i).map(move |j| [i, j]));
    let (best, pair) = pairs.map(|pair| (total(Some(pair)), pair)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let pixels: f64 = common.iter().map(|common| common.pixels).sum();
    (best > total(None) + EXCHANGED * pixels).then_some(pair)
}

impl Strip {
    /// Mean over the pixels of what a frame shows times what it should, −1 to 1; 0 where something stands before them.
    fn agreement(&self, frame: usize, signs: &[f64], begin: i32) -> f64 {
        let (mut sum, mut all) = (0.0, 0.0);
        let first = (begin + 1) * CELLS as i32;
        for (cell, level) in self.level[frame].iter().enumerate() {
            let Some(sign) = usize::try_from(first + cell as i32).ok().and_then(|at| signs.get(at)) else {
                continue;
            };
            sum += self.seen[frame][cell] * sign * level.clamp(-1.0, 1.0);
            all += self.count[cell] * sign.abs();
        }
        if all > 0.0 { sum / all } else { 0.0 }
    }
}

/// The begin with which all frames agree but so many, and with which they agree by far the most.
fn settled(agreed: &[(i32, Vec<f64>)], wrong: usize) -> Option<i32> {
    let (mut best, mut second) = ((f64::NEG_INFINITY, None), f64::NEG_INFINITY);
    for (begin, agreed) in agreed {
        let mut sorted = agreed.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let right = &sorted[wrong..];
        let score: f64 = right.iter().sum();
        let all_agree = right[0] > LEAST_AGREE && score > AGREE * right.len() as f64;
        if score > best.0 {
            (second, best) = (best.0, (score, all_agree.then_some(*begin)));
        } else {
            second = second.max(score);
        }
    }
    best.1.filter(|_| best.0 - second > APART)
}

/// ±1 of all cells from one period before the projector on; 0 near an edge and outside.
fn signs(look: &CodeLook, shown: &Shown, orders: i32) -> Vec<f64> {
    let cells = -(CELLS as i32)..(orders + 1) * CELLS as i32;
    cells
        .map(|cell| light_at(look, shown, cell).map_or(0.0, |light| if light { 1.0 } else { -1.0 }))
        .collect()
}

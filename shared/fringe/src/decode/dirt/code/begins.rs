//! The fringe with which each region begins.
//!
//! Two frames that were exchanged are exchanged in all regions. A region of few fringes may agree with another begin as well as with the
//! exchange, so that is looked for in all of them together, as far as the frames tell where they begin.

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
/// Nothing outside of the projector was lit by it: pixels there count so many times as disagreement, so that only specks may lie there.
const OUTSIDE: f64 = 10.0;

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
        // A speck whose turns were counted wrong may come long before all others, or long after.
        let at = (-turns..=orders).map(of_begin).collect();
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

    /// Whole frames by which all of them agree with the begin of the region, times the pixels; 0 where the frames do not tell it: a region that is
    /// two surfaces agrees a little with anything.
    fn told(&self, exchanged: Option<[usize; 2]>) -> f64 {
        let begin = self.begin(exchanged);
        let told = self.agreed(exchanged).find(|(at, _)| Some(*at) == begin);
        self.pixels * told.map_or(0.0, |(_, agreed)| agreed.iter().sum::<f64>())
    }

    /// The begin with which all frames agree, or all but as few as possible.
    fn begin(&self, exchanged: Option<[usize; 2]>) -> Option<i32> {
        let agreed: Vec<(i32, Vec<f64>)> = self.agreed(exchanged).collect();
        let count = agreed.first()?.1.len();
        let most = if count < 5 { 1 } else { MOST_WRONG };
        (0..=most.min(count.saturating_sub(2))).find_map(|wrong| settled(&agreed, wrong))
    }
}

/// The two frames that show each other's patterns: with which all regions together agree better, and those that tell where they begin as well.
fn exchanged(common: &[Common], frames: usize) -> Option<[usize; 2]> {
    let best = |exchanged| common.iter().map(|common| common.best(exchanged)).sum::<f64>();
    let told = |exchanged| common.iter().map(|common| common.told(exchanged)).sum::<f64>();
    let pairs = (0..frames).flat_map(|i| (0..i).map(move |j| [i, j]));
    let (most, pair) = pairs.map(|pair| (best(Some(pair)), pair)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let more = EXCHANGED * common.iter().map(|common| common.pixels).sum::<f64>();
    (most > best(None) + more && told(Some(pair)) > told(None) + more).then_some(pair)
}

impl Strip {
    /// Mean over the pixels of what a frame shows times what it should, −1 to 1; 0 where something stands before them, and outside of the projector.
    fn agreement(&self, frame: usize, signs: &[f64], begin: i32) -> f64 {
        let (mut sum, mut all) = (0.0, 0.0);
        let first = (begin + 1) * CELLS as i32;
        for (cell, level) in self.level[frame].iter().enumerate() {
            let sign = usize::try_from(first + cell as i32).ok().and_then(|at| signs.get(at));
            let weight = sign.map_or(OUTSIDE, |sign| sign.abs());
            sum += self.seen[frame][cell] * sign.unwrap_or(&0.0) * level.clamp(-1.0, 1.0);
            all += self.count[cell] * weight;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A region that begins at one fringe of three: what its frames agree by there, each with its own pattern and with those of the others.
    fn region(pixels: f64, own: f64, others: f64) -> Common {
        let row =
            |i: usize, own: f64, others: f64| (0..5).map(|j| if i == j { own } else { others }).collect();
        let at = |begin: i32| {
            let here = if begin == 1 { [own, others] } else { [0.0; 2] };
            (begin, (0..5).map(|i| row(i, here[0], here[1])).collect())
        };
        Common { pixels, at: (0..3).map(at).collect() }
    }

    #[test]
    fn a_region_that_tells_no_begin_proves_no_exchange() {
        // Where two surfaces are one region, its frames agree better with the patterns of others, and with neither enough.
        let (mixed, small) = (region(9000.0, 0.3, 0.6), region(900.0, 1.0, 0.0));
        assert_eq!((mixed.begin(None), small.begin(None)), (None, Some(1)));
        assert_eq!(exchanged(&[mixed, small], 5), None);
    }

    #[test]
    fn an_exchange_is_found_where_all_other_frames_agree() {
        let mut region = region(5000.0, 1.0, 0.0);
        for (begin, common) in &mut region.at {
            common.swap(1, 3);
            assert!(*begin != 1 || common[1][3] > 0.9);
        }
        assert_eq!(exchanged(&[region], 5), Some([3, 1]));
    }

    #[test]
    fn a_tenth_of_a_region_lies_nowhere_outside_of_the_projector() {
        let (turns, begin) = (10, -2);
        // One turn of ten lies farther before the projector than the patterns reach; all others agree.
        let (signs, cells) = (vec![1.0; 40 * CELLS], turns * CELLS);
        let (count, level) = (vec![100.0; cells], vec![vec![1.0; cells]]);
        let strip = Strip { level, seen: vec![count.clone()], count };
        assert_eq!(strip.agreement(0, &signs, -1), 1.0);
        assert!(strip.agreement(0, &signs, begin) < LEAST_AGREE, "{}", strip.agreement(0, &signs, begin));
    }

    /// A few pixels at a rim whose turns were counted far off, as they are at steep edges: the region seems to be as long as the projector.
    #[test]
    fn pixels_counted_off_hide_no_begin() {
        let (orders, begin) = (20, 7);
        // Bits that change at every fringe, every other one and so on, from a period before the projector on.
        let bit = |bit: u32| {
            move |cell: i32| if (cell.div_euclid(CELLS as i32) >> bit) & 1 == 1 { 1.0 } else { -1.0 }
        };
        let cells = -(CELLS as i32)..(orders + 1) * CELLS as i32;
        let signs: Vec<Vec<f64>> = (0..5).map(|k| cells.clone().map(bit(k)).collect()).collect();
        let long = (orders as usize + 4) * CELLS;
        let real = 10 * CELLS;
        let count: Vec<f64> = (0..long)
            .map(|cell| if cell < real { 100.0 } else { f64::from(u8::from(cell + 1 == long)) })
            .collect();
        let shows = |k: u32| (0..long).map(|cell| bit(k)(begin * CELLS as i32 + cell as i32)).collect();
        let strip = Strip { level: (0..5).map(shows).collect(), seen: vec![count.clone(); 5], count };
        let common = Common::new(&strip, &[0, 1, 2, 3, 4], &signs, orders);
        assert_eq!(common.begin(None), Some(begin));
    }
}

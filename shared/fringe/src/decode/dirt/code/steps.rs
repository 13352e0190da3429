//! How the stripes of a code run on from place to place: over a surface they run one way.

use super::CodeLook;
use super::bit_edges::REACH_PX;
use crate::decode::bits::resolve;
use crate::decode::rasters::Rasters;
use crate::math::statistics::median;
use crate::pattern::Code;

/// Places whose distance in stripes is looked at, about, along the rows and along the columns.
const SAMPLES: usize = 20_000;

/// Pixels between two places, as between both sides of an edge.
const APART_PX: usize = 2 * REACH_PX + 1;

/// Stripes between neighbouring places, along the rows or the columns: the way along which they run more clearly.
#[derive(Debug, Clone, Copy)]
pub struct Steps {
    /// Finest stripes between two places, in the median.
    pub apart: i32,
    /// Share of the steps over a surface that run the other way than most. A bit that is wrong in a part of the picture turns the order of
    /// all finer stripes there.
    pub turned_back: f64,
}

impl Steps {
    /// `from`: the frame of each bit, and whether it shows the inverse.
    pub fn new(look: &CodeLook, rasters: &Rasters, from: &[(usize, bool)]) -> Self {
        let code = from.first().map_or(Code::Gray, |from| look.code_of(from.0));
        let (width, pixels) = (look.width, look.middle_dn.len());
        let every = (pixels / SAMPLES).max(1) | 1;
        let number = |place| Some(i32::from(resolve(look.word(rasters, from, place)?, code)));
        let numbers = |[a, b]: [usize; 2]| Some([number(a)?, number(b)?]);
        let along_rows = |place: &usize| place % width + APART_PX < width;
        let rows = (0..pixels).step_by(every).filter(along_rows).map(|place| [place, place + APART_PX]);
        let columns = (0..pixels.saturating_sub(APART_PX * width)).step_by(every);
        let columns = columns.map(|place| [place, place + APART_PX * width]);
        let rows = Self::of(&rows.filter_map(&numbers).collect::<Vec<_>>());
        let columns = Self::of(&columns.filter_map(&numbers).collect::<Vec<_>>());
        let clearer = if rows.1 >= columns.1 { rows.0 } else { columns.0 };
        Self { apart: rows.0.apart.max(columns.0.apart), ..clearer }
    }

    /// Whether there are surfaces at all: stripes of less than a pixel are none.
    pub fn run_on(&self) -> bool {
        self.apart <= APART_PX as i32
    }

    /// Of one direction, and how many more steps run one way than the other.
    fn of(numbers: &[[i32; 2]]) -> (Self, usize) {
        let steps = || numbers.iter().map(|[a, b]| b - a);
        let mut sizes: Vec<f64> = steps().map(|step| f64::from(step.abs())).collect();
        let apart = median(&mut sizes).unwrap_or(0.0) as i32;
        // Larger steps lead from one surface to another.
        let most = 2 * apart.max(1) + 1;
        let forward = steps().filter(|step| (1..=most).contains(step)).count();
        let backward = steps().filter(|step| (-most..=-1).contains(step)).count();
        let turned_back = forward.min(backward) as f64 / (forward + backward).max(1) as f64;
        (Self { apart, turned_back }, forward.abs_diff(backward))
    }
}

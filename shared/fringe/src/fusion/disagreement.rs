//! Where two pairs disagree beyond what both state: light that bounces between faces, a view out of focus, a rig that is off.
//!
//! The distances d of the points of one cloud from the surface of the other have the variance u² that both clouds state, if all is
//! well. Cells of the search where Σ d² is beyond Σ u², by themselves and with the 26 cells around them, get the surplus: ½ (Σ d² − Σ u²) / n
//! is added to the variance of every point of both clouds in the cell, since the distance does not tell which of the two is wrong.
//! Neighbours share noise, for they were smoothed together, so that a block of 27 cells has few distances that are independent; light, a blurred
//! view and a rig reach further. Where a block is no clear case, the 98 cells around it, with noise of their own, have to disagree as well.
//! Pairs that share a picture take its noise in opposite directions, mostly, so that their distances scatter by more than both state. How much
//! more is asked of the distances about the mean of their block, which neither light nor a rig that is off changes much;
//! Σ u² counts as so many times as large. Pairs that share none are not asked, nor is anything allowed for them.
//! Cells in which nothing was compared, since only the other cloud has points there, its surface lies beyond their border, or they were not
//! looked at, are judged by those around them alone. What both pairs see alike is not seen here, nor what parts them by more than the radius.

use super::cells::Cells;
use super::grid::Grid;
use super::surroundings::Surroundings;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::ops::Range;

/// Mean square of the distances over the stated one from which on a cell, its block and those around it disagree. The variance of distances is
/// 1.2 times the stated one, since that takes the points of a surface as independent: of a block, with some eight independent distances, noise
/// exceeds this in a tenth of the cases, and of those around it, with fourteen of their own, in one of twenty.
const LIKELY: f64 = 2.0;
/// The same of a block whatever those around it say: noise exceeds it in one of 20 000 blocks.
const CERTAIN: f64 = 5.0;
/// Distances of a block, and of those around it, that are independent, where all cells are looked at.
const IN_BLOCK: f64 = 8.0;
const AROUND: f64 = 14.0;
/// Quantiles of a normal variable that are exceeded in one of ten, of twenty and of 20 000 cases.
const ONE_OF_TEN: f64 = 1.2816;
const ONE_OF_TWENTY: f64 = 1.6449;
const ONE_OF_20000: f64 = 3.8906;
/// Fewer points of a block say nothing.
const LEAST: f64 = 16.0;
/// Blocks that are asked how far distances scatter, at most and at least.
const ASKED: usize = 255;
const LEAST_ASKED: usize = 20;
/// What distances scatter by about the mean of their block, over the stated variance, where smoothed neighbours share noise and pairs do not:
/// 1.2 of seven eighths, and the median of that many is 0.91 of the mean.
const USUAL_SCATTER: f64 = 1.2 * 0.875 * 0.91;
/// Errors of two pairs that are the opposite of each other have distances of twice the stated variance, and nothing makes more of noise.
const MOST_NOISE: f64 = 2.0;
/// Cells that are judged as one part.
const CELLS: usize = 1024;

/// Quantile of the mean of so many squares of independent normal variables of variance 1, by that of a normal variable (Wilson and Hilferty 1931).
fn mean_square(count: f64, quantile: f64) -> f64 {
    let spread = 2.0 / (9.0 * count);
    (1.0 - spread + quantile * spread.sqrt()).powi(3)
}

/// What is asked of the mean squares where one of so many cells is looked at, so that noise exceeds it no more often than where all are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Of a block that those around it have to confirm, of those around it, and of a block by itself.
    block: f64,
    around: f64,
    certain: f64,
    /// What distances usually scatter by about the mean of their block.
    usual_scatter: f64,
}

impl Limits {
    /// Where one of `every` cells is looked at.
    pub fn of_every(every: usize) -> Self {
        let part = |all: f64, less: f64| (all / every as f64 - less).max(0.5);
        let more =
            |all: f64, quantile: f64| mean_square(part(all, 0.0), quantile) / mean_square(all, quantile);
        // Of n values, n − 1 are free of their mean.
        let [some, all] = [part(IN_BLOCK, 1.0), IN_BLOCK - 1.0];
        let free = (some / (some + 1.0)) / (all / IN_BLOCK);
        Self {
            block: LIKELY * more(IN_BLOCK, ONE_OF_TEN),
            around: LIKELY * more(AROUND, ONE_OF_TWENTY),
            certain: CERTAIN * more(IN_BLOCK, ONE_OF_20000),
            usual_scatter: USUAL_SCATTER * free * mean_square(some, 0.0) / mean_square(all, 0.0),
        }
    }
}

/// What the points of a cell show that have a surface of the other cloud beside them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Compared {
    count: f64,
    /// Sum of the distances, mm.
    sum: f64,
    /// Sum of the squared distances, Σ d², mm².
    squares: f64,
    /// Sum of the stated variances, Σ u², mm².
    stated: f64,
}

/// Points of a cell of a cloud, and the variance that they get.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Raised {
    /// Number of the cloud, and of the cell in it.
    pub cell: (usize, usize),
    /// Surplus of the variance, mm².
    pub excess_mm2: f64,
}

impl Compared {
    /// Adds the distance of a point from the other surface, mm, and the variance that is stated of it, mm². Where none is stated there
    /// is nothing to compare with, and one beyond the radius, mm, says nothing of distances within it.
    #[inline(always)]
    pub fn add(&mut self, distance: f64, u2: f64, radius_mm: f64) {
        if u2 > 0.0 && u2 < radius_mm * radius_mm {
            self.count += 1.0;
            self.sum += distance;
            self.squares += distance * distance;
            self.stated += u2;
        }
    }

    fn disagrees(&self, ratio: f64) -> bool {
        self.squares > ratio * self.stated
    }

    fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.stated += other.stated;
    }

    /// What the distances scatter by about their mean, over the stated variance.
    fn scatter(&self) -> f64 {
        (self.squares - self.sum * self.sum / self.count) / self.stated
    }
}

/// Two clouds, numbered, and what the cells of the first one show of the second.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comparison<'a> {
    pub own: (usize, &'a Cells),
    pub other: (usize, &'a Cells),
    /// For each cell of the first cloud.
    pub compared: &'a [Compared],
    pub grid: &'a Grid,
    /// The variance of distances by noise, over what it usually is of the stated one.
    pub noise: f64,
    pub limits: Limits,
}

impl Comparison<'_> {
    /// Adds the cells of both clouds in which they disagree; `parts` is memory.
    pub fn find(&self, parts: &mut Vec<Vec<Raised>>, raised: &mut Vec<Raised>) {
        let (own, other) = (self.own.1, self.other.1);
        let [of_own, of_other] = [own, other].map(|cells| cells.len().div_ceil(CELLS));
        parts.resize_with(parts.len().max(of_own + of_other), Vec::new);
        let parts = &mut parts[..of_own + of_other];
        // Those of the first cloud take longer: none goes to a thread together with another.
        parts.par_iter_mut().enumerate().with_max_len(1).for_each(|(part, raised)| {
            raised.clear();
            if part < of_own {
                self.judge((own, part * CELLS), |cell| Some(self.compared[cell]), raised);
            } else {
                // Where the first cloud has points as well, the cell is judged as its own.
                let only_there = |cell| own.find(other.key(cell)).is_none().then(Compared::default);
                self.judge((other, (part - of_own) * CELLS), only_there, raised);
            }
        });
        raised.extend(parts.iter().flatten());
    }

    /// The same with the noise that its distances show: more than 1 where pairs share pictures, or both state too little.
    pub fn with_own_noise(self) -> Self {
        Self { noise: self.shown_noise(), ..self }
    }

    fn shown_noise(&self) -> f64 {
        let own = self.own.1;
        let compared = || (0..own.len()).filter(|cell| self.compared[*cell].count >= 1.0);
        let asked = compared().count();
        if asked < LEAST_ASKED {
            return 1.0;
        }
        let mut near = Surroundings::<9>::from(self.grid, own, own.key(0));
        let (mut found, mut count) = ([0.0; ASKED], 0);
        for cell in compared().step_by(asked.div_ceil(ASKED)) {
            let block = self.within(&near.rows(own, own.key(cell)));
            if block.count >= LEAST && block.stated > 0.0 {
                found[count] = block.scatter();
                count += 1;
            }
        }
        let found = &mut found[..count];
        if count < LEAST_ASKED {
            return 1.0;
        }
        let (_, median, _) = found.select_nth_unstable_by(count / 2, f64::total_cmp);
        (*median / self.limits.usual_scatter).clamp(1.0, MOST_NOISE)
    }

    /// Adds those of some cells from `first` on in which the clouds disagree beyond noise. `shown`: what a cell shows; `None` where it is
    /// not judged.
    fn judge(
        &self,
        (cells, first): (&Cells, usize),
        shown: impl Fn(usize) -> Option<Compared>,
        raised: &mut Vec<Raised>,
    ) {
        let own = self.own.1;
        let mut near = Surroundings::<9>::from(self.grid, own, cells.key(first));
        let mut wide = Surroundings::<25>::from(self.grid, own, cells.key(first));
        for cell in first..(first + CELLS).min(cells.len()) {
            let Some(compared) = shown(cell) else { continue };
            let is_silent = compared.count < 1.0;
            if !is_silent && !compared.disagrees(LIKELY * self.noise) {
                continue;
            }
            let key = cells.key(cell);
            let rows = near.rows(own, key);
            let disagree = |row: &Range<usize>| {
                self.compared[row.clone()].iter().any(|c| c.disagrees(LIKELY * self.noise))
            };
            if is_silent && !rows.iter().any(disagree) {
                continue;
            }
            if let Some(block) = self.disagreeing(key, &rows, &mut wide) {
                self.raise(key, if is_silent { &block } else { &compared }, raised);
            }
        }
    }

    /// What a cell and the 26 around it show together, where that is a disagreement.
    fn disagreeing(&self, key: u64, rows: &[Range<usize>], wide: &mut Surroundings<25>) -> Option<Compared> {
        let block = self.within(rows);
        if block.count < LEAST || !block.disagrees(self.limits.block * self.noise) {
            return None;
        }
        let mut confirmed = || {
            let all = self.within(&wide.rows(self.own.1, key));
            let around = Compared {
                count: all.count - block.count,
                sum: all.sum - block.sum,
                squares: all.squares - block.squares,
                stated: all.stated - block.stated,
            };
            around.count >= LEAST && around.disagrees(self.limits.around * self.noise)
        };
        (block.disagrees(self.limits.certain * self.noise) || confirmed()).then_some(block)
    }

    /// What the cells of some rows show.
    fn within(&self, rows: &[Range<usize>]) -> Compared {
        let mut sum = Compared::default();
        rows.iter().flat_map(|row| &self.compared[row.clone()]).for_each(|compared| sum.join(compared));
        sum
    }

    /// Adds the cells of both clouds at a key with the surplus of what was compared.
    fn raise(&self, key: u64, compared: &Compared, raised: &mut Vec<Raised>) {
        let excess_mm2 = 0.5 * (compared.squares - self.noise * compared.stated) / compared.count;
        for (cloud, cells) in [self.own, self.other] {
            let cell = cells.find(key).map(|cell| (cloud, cell));
            raised.extend(cell.map(|cell| Raised { cell, excess_mm2 }));
        }
    }
}

/// Each cell once, with the largest surplus that any comparison gives.
pub(super) fn largest(raised: &mut Vec<Raised>) {
    raised.sort_unstable_by_key(|r| (r.cell, Reverse(r.excess_mm2.to_bits())));
    raised.dedup_by_key(|r| r.cell);
}

/// Share of the points at which pairs disagree from which on a person should know. Chance and rounded creases reach one or two hundredths of a part without
/// fault; light from other faces, after its own filter, leaves no more than two or three: a warning too many is better than one that is missing.
const MANY_DISAGREE: f64 = 0.01;

/// What a person should know, where pairs disagree beyond what they state at so many points of a fused cloud.
pub fn disagreement_warning(disagreeing: u32, points: u32) -> Option<String> {
    let share = f64::from(disagreeing) / f64::from(points.max(1));
    (share >= MANY_DISAGREE).then(|| {
        format!(
            "the pairs disagree beyond what they state at {:.0} % of the points, whose uncertainty is raised: light came from other \
             faces, or the rig changed; turn the part, or run `fringetool check-rig` on a recording",
            100.0 * share
        )
    })
}

#[cfg(test)]
mod tests;

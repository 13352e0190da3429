//! Number-theoretical order: the residues of the coordinate by several periods determine it up to their least common multiple.
//!
//! x = wᵢ + kᵢ pᵢ for every period pᵢ, so the differences wᵢ − w₀ = k₀ p₀ − kᵢ pᵢ take one value per tuple of orders (eq. 2.57, there
//! multiplied with fᵢ). A table over these differences, one cell a pixel, names the tuples that can be nearest in that cell (eq. 2.58), and the nearest
//! of them is taken: distances count each difference with the noise of its sine, so that the choice is the most likely one. Rounding to the cell alone, as
//! for two periods, would make up to twice as many errors with three.
//!
//! The chance of an error is that of a normal deviation beyond the border halfway to another tuple: over directions u the border lies at
//! R(u) = min |Δ|²/(2 u·Δ), and P = ⟨P(χ > R(u)/σ)⟩ with one degree of freedom less than there are sines.

use crate::math::random::normal_quantile;
use crate::math::{erfc, exp};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use thiserror::Error;

/// Most cells of the table.
const MOST_CELLS: usize = 1 << 18;
/// Periods are whole numbers of pixels after at most this scale.
const MOST_SCALE: u32 = 64;
/// Nearest tuples among which the borders are sought.
const NEAR: usize = 16;
/// Orders change together when their places are nearer than this fraction of the period: three standard deviations at the largest phase noise
/// that the decoder takes (0.2 rad).
const TURN: f64 = 0.1;
/// Directions in which borders are sought, for three and more sines.
const DIRECTIONS: usize = 512;
/// Borders are counted in so many bins from the nearest one to [`FAR`] times its distance; beyond, no error comes from.
const BINS: usize = 1024;
const FAR: f64 = 6.0;
/// Most tuples: more would be sought for seconds (a projector of 65535 px with six periods of 16 px has 24 576, and is refused).
const MOST_TUPLES: usize = 1 << 12;

/// Why the periods give no order.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ResidueError {
    /// There is only one period.
    #[error("a second sine set: one period repeats after {period_px} px")]
    One {
        /// The only period, projector pixels.
        period_px: f64,
    },
    /// Periods without a common measure.
    #[error("periods in whole pixels (or whole {MOST_SCALE}ths of them), but one is {period_px} px")]
    Broken {
        /// A period that is no whole number of pixels, projector pixels.
        period_px: f64,
    },
    /// Periods that repeat too early.
    #[error(
        "periods that cover {extent_px} px: those of {list} px repeat after {lcm_px} px; take coprime ones"
    )]
    Short {
        /// Projector pixels along the axis.
        extent_px: u32,
        /// All periods, projector pixels, as text.
        list: String,
        /// Least common multiple of the periods, projector pixels.
        lcm_px: f64,
    },
    /// A table that would be too large.
    #[error(
        "shorter or fewer periods: {cells} cells or {tuples} orders, limits {MOST_CELLS} and {MOST_TUPLES}"
    )]
    Large {
        /// Cells that the table would have.
        cells: usize,
        /// Tuples of fringe orders that the table would have.
        tuples: usize,
    },
}

/// A tuple of orders and where it holds.
#[derive(Debug, Clone, PartialEq)]
struct Tuple {
    /// Start kᵢ pᵢ of each sine's period, projector pixels.
    starts_px: Vec<f64>,
    /// Length of the stretch, px.
    length_px: f64,
}

/// The table of one set of periods. Sines are counted as in the axis' plan, the finest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Residues {
    periods_px: Vec<f64>,
    /// 1/variance of each coordinate, the finest's being 1.
    weights: Vec<f64>,
    tuples: Vec<Tuple>,
    /// First candidate of each cell in `candidates`, and the end.
    cells: Vec<u32>,
    candidates: Vec<u16>,
    /// Distance of borders, px of weighted distance, and their share of all directions and places.
    borders: Vec<(f64, f64)>,
    /// Half the least distance of two tuples, px of weighted distance.
    half_px: f64,
    /// Least common multiple of the periods, and where the stretch of that length begins whose middle is the projector's, px.
    repeats_px: f64,
    begins_px: f64,
}

impl Residues {
    /// Tabulates (period, steps) of each sine over a projector.
    ///
    /// # Errors
    /// Fewer than two periods, periods without a common measure, or that repeat before the projector ends.
    pub fn new(sines: &[(f64, u32)], extent_px: u32) -> Result<Self, ResidueError> {
        let periods_px: Vec<f64> = sines.iter().map(|s| s.0).collect();
        if periods_px.len() < 2 {
            return Err(ResidueError::One { period_px: periods_px.first().copied().unwrap_or(0.0) });
        }
        let lcm_px = lcm_px(&periods_px)?;
        if lcm_px < f64::from(extent_px) {
            let list: Vec<String> = periods_px.iter().map(ToString::to_string).collect();
            return Err(ResidueError::Short { extent_px, list: list.join(", "), lcm_px });
        }
        let finest = sines[0].0 * sines[0].0 / f64::from(sines[0].1);
        let weights = sines.iter().map(|(p, n)| finest * f64::from(*n) / (p * p)).collect();
        let mut out = Self {
            periods_px,
            weights,
            tuples: Vec::new(),
            cells: Vec::new(),
            candidates: Vec::new(),
            borders: Vec::new(),
            half_px: 0.0,
            repeats_px: lcm_px,
            begins_px: 0.5 * (f64::from(extent_px) - 1.0 - lcm_px),
        };
        let cells: usize = (1..out.periods_px.len()).map(|j| out.span(j)).product();
        let expected: f64 = out.periods_px.iter().map(|p| f64::from(extent_px) / p + 1.0).sum();
        if cells > MOST_CELLS || expected > MOST_TUPLES as f64 {
            return Err(ResidueError::Large { cells, tuples: expected as usize });
        }
        out.tuples = out.stretches(f64::from(extent_px));
        out.fill_cells(cells);
        out.find_borders();
        Ok(out)
    }

    /// Cells along the difference to sine j: it lies between −p₀ and pⱼ.
    fn span(&self, j: usize) -> usize {
        (self.periods_px[0] + self.periods_px[j]).ceil() as usize + 1
    }

    /// Differences at the centre of a cell.
    fn centre(&self, mut cell: usize) -> Vec<f64> {
        let mut differences = vec![0.0];
        for j in 1..self.periods_px.len() {
            differences.push((cell % self.span(j)) as f64 - self.periods_px[0].floor());
            cell /= self.span(j);
        }
        differences
    }

    /// The stretches between all the places where an order changes.
    fn stretches(&self, extent_px: f64) -> Vec<Tuple> {
        let (first, last) = (-0.5, extent_px - 0.5);
        let mut places = vec![first, last];
        for p in &self.periods_px {
            let count = (last / p).floor() as usize;
            places.extend((0..=count).map(|k| k as f64 * p).filter(|x| *x > first && *x < last));
        }
        places.sort_by(f64::total_cmp);
        places.dedup();
        let tuple = |w: &[f64]| {
            let middle = 0.5 * (w[0] + w[1]);
            let starts_px = self.periods_px.iter().map(|p| (middle / p).floor() * p).collect();
            Tuple { starts_px, length_px: w[1] - w[0] }
        };
        let mut all: Vec<Tuple> = places.windows(2).map(tuple).collect();
        all.extend(places.iter().flat_map(|at| self.mixed(*at)));
        // One tuple for each set of differences, the longest stretch: the periods may repeat just after the end, and the first half pixel then has the
        // differences of the last stretch.
        all.sort_by(|a, b| b.length_px.total_cmp(&a.length_px));
        let mut kept: Vec<Tuple> = Vec::new();
        for tuple in all {
            let alike = |other: &Tuple| {
                let from = |t: &Tuple, j: usize| t.starts_px[j] - t.starts_px[0];
                (1..tuple.starts_px.len()).all(|j| (from(other, j) - from(&tuple, j)).abs() < 1e-9)
            };
            if !kept.iter().any(alike) {
                kept.push(tuple);
            }
        }
        kept
    }

    /// The tuples that noise makes where several orders change at nearly the same place: one has turned already, the other not yet.
    fn mixed(&self, at_px: f64) -> Vec<Tuple> {
        let mut all: Vec<Vec<f64>> = vec![Vec::new()];
        for p in &self.periods_px {
            let near = (at_px / p).round() * p;
            let starts = if (at_px - near).abs() < TURN * p {
                vec![near - p, near]
            } else {
                vec![(at_px / p).floor() * p]
            };
            let longer = |tuple: &Vec<f64>| {
                starts.iter().map(|s| [tuple.as_slice(), &[*s]].concat()).collect::<Vec<_>>()
            };
            all = all.iter().flat_map(longer).collect();
        }
        all.into_iter().map(|starts_px| Tuple { starts_px, length_px: 0.0 }).collect()
    }

    /// Squared weighted distance of differences d from a tuple, and the mean coordinate less w₀: the scatter of wᵢ + kᵢ pᵢ.
    fn distance_px2(&self, differences: &[f64], tuple: &Tuple) -> (f64, f64) {
        let (mut w, mut wx, mut wxx) = (0.0, 0.0, 0.0);
        for ((d, start), weight) in differences.iter().zip(&tuple.starts_px).zip(&self.weights) {
            let x = d + start - tuple.starts_px[0];
            w += weight;
            wx += weight * x;
            wxx += weight * x * x;
        }
        let mean = wx / w;
        ((wxx - mean * wx).max(0.0), mean + tuple.starts_px[0])
    }

    /// The tuples that can be nearest to some point of a cell: none is farther from its centre than the nearest one by more than the cell's width.
    fn fill_cells(&mut self, cells: usize) {
        let corner: f64 = self.weights[1..].iter().map(|w| 0.25 * w).sum::<f64>();
        let slack = 2.0 * corner.sqrt() + 1e-9;
        self.cells.push(0);
        for cell in 0..cells {
            let centre = self.centre(cell);
            let far: Vec<f64> = self.tuples.iter().map(|t| self.distance_px2(&centre, t).0.sqrt()).collect();
            let least = far.iter().copied().fold(f64::INFINITY, f64::min);
            let near = far.iter().enumerate().filter(|(_, d)| **d <= least + slack);
            self.candidates.extend(near.map(|(index, _)| index as u16));
            self.cells.push(self.candidates.len() as u32);
        }
    }

    /// Where a tuple stands when distances are those of equal noise: √wⱼ times its differences, less their part along √w.
    fn place(&self, tuple: &Tuple) -> Vec<f64> {
        let total: f64 = self.weights.iter().sum();
        let mean: f64 = tuple.starts_px.iter().zip(&self.weights).map(|(s, w)| s * w).sum::<f64>() / total;
        tuple.starts_px.iter().zip(&self.weights).map(|(s, w)| (s - mean) * w.sqrt()).collect()
    }

    /// Unit vectors of the space of the differences, evenly spread (a Kronecker sequence through the normal quantile).
    fn directions(&self) -> Vec<Vec<f64>> {
        let n = self.len();
        let root: Vec<f64> = self.weights.iter().map(|w| w.sqrt()).collect();
        let length2: f64 = self.weights.iter().sum();
        let flat = |mut v: Vec<f64>| {
            let along: f64 = v.iter().zip(&root).map(|(v, r)| v * r).sum::<f64>() / length2;
            v.iter_mut().zip(&root).for_each(|(v, r)| *v -= along * r);
            let length = v.iter().map(|v| v * v).sum::<f64>().sqrt();
            v.iter().map(|v| v / length).collect::<Vec<f64>>()
        };
        if n == 2 {
            return vec![flat(vec![1.0, 0.0]), flat(vec![-1.0, 0.0])];
        }
        // Fractional parts of the square roots of primes.
        let primes = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0];
        let normal = |i: usize, j: usize| {
            let turns = (i as f64 + 0.5) * primes[j % primes.len()].sqrt();
            normal_quantile((turns - turns.floor()).clamp(1e-9, 1.0 - 1e-9))
        };
        (0..DIRECTIONS).map(|i| flat((0..n).map(|j| normal(i, j)).collect())).collect()
    }

    /// Collects how far the borders are in every direction from every tuple.
    fn find_borders(&mut self) {
        let places: Vec<Vec<f64>> = self.tuples.iter().map(|t| self.place(t)).collect();
        let between = |a: &[f64], b: &[f64]| -> Vec<f64> { b.iter().zip(a).map(|(b, a)| b - a).collect() };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let directions = self.directions();
        let mut all: Vec<(f64, f64)> = Vec::new();
        for (i, here) in places.iter().enumerate().filter(|(i, _)| self.tuples[*i].length_px > 0.0) {
            let mut near: Vec<(f64, Vec<f64>)> = (0..places.len())
                .filter(|j| *j != i)
                .map(|j| between(here, &places[j]))
                .map(|way| (dot(&way, &way), way))
                .collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            near.truncate(NEAR);
            let weight = self.tuples[i].length_px / directions.len() as f64;
            for u in &directions {
                let ways = near.iter().map(|(d2, way)| (d2, dot(u, way))).filter(|(_, along)| *along > 0.0);
                let border = ways.map(|(d2, along)| 0.5 * d2 / along).fold(f64::INFINITY, f64::min);
                all.push((border, weight));
            }
        }
        let total: f64 = all.iter().map(|b| b.1).sum();
        let least = all.iter().map(|b| b.0).fold(f64::INFINITY, f64::min);
        let mut bins = vec![(0.0, 0.0); BINS];
        for (border, weight) in all.into_iter().filter(|b| b.0 < FAR * least) {
            let bin = ((border / least - 1.0) / (FAR - 1.0) * BINS as f64) as usize;
            let bin = &mut bins[bin.min(BINS - 1)];
            (bin.0, bin.1) = (bin.0 + border * weight / total, bin.1 + weight / total);
        }
        self.borders = bins.into_iter().filter(|b| b.1 > 0.0).map(|b| (b.0 / b.1, b.1)).collect();
        self.half_px = least;
    }

    /// Number of sine sets.
    pub fn len(&self) -> usize {
        self.periods_px.len()
    }

    /// Whether there is none: never.
    pub fn is_empty(&self) -> bool {
        self.periods_px.is_empty()
    }

    /// Coordinate of wrapped phases (one per sine, finest first), and how far it is from the border to the next tuple: 0 in the middle, 1 at
    /// the border of the two nearest ones.
    pub fn resolve(&self, phase_rad: impl Fn(usize) -> f64) -> (f64, f64) {
        let wrapped = |j: usize| phase_rad(j) * self.periods_px[j] / TAU;
        let (first, floor) = (wrapped(0), self.periods_px[0].floor());
        let mut cell = 0;
        let mut factor = 1;
        for j in 1..self.len() {
            let place = ((wrapped(j) - first).round() + floor).clamp(0.0, (self.span(j) - 1) as f64);
            cell += factor * place as usize;
            factor *= self.span(j);
        }
        let bounds = self.cells.get(cell).zip(self.cells.get(cell + 1));
        let candidates = bounds.and_then(|(from, to)| self.candidates.get(*from as usize..*to as usize));
        let mut best = (f64::INFINITY, f64::NAN);
        for index in candidates.unwrap_or(&[]) {
            let tuple = &self.tuples[usize::from(*index)];
            let (mut w, mut wx, mut wxx) = (0.0, 0.0, 0.0);
            for (j, (start, weight)) in tuple.starts_px.iter().zip(&self.weights).enumerate() {
                let x = wrapped(j) - first + start - tuple.starts_px[0];
                w += weight;
                wx += weight * x;
                wxx += weight * x * x;
            }
            let mean = wx / w;
            let distance2 = (wxx - mean * wx).max(0.0);
            if distance2 < best.0 {
                best = (distance2, first + tuple.starts_px[0] + mean);
            }
        }
        let multiples = ((best.1 - self.begins_px) / self.repeats_px).floor();
        (best.1 - multiples * self.repeats_px, best.0.sqrt() / self.half_px)
    }

    /// Probability of a wrong tuple for a phase noise of the finest sine, the others having theirs by the number of steps: the mean over
    /// directions and places of the chance to pass the border.
    pub fn wrong_order(&self, sigma_rad: f64) -> f64 {
        let sigma_px = sigma_rad * self.periods_px[0] / TAU;
        let freedom = self.len() - 1;
        let chance = |(border, weight): &(f64, f64)| weight * beyond(border / sigma_px, freedom);
        self.borders.iter().map(chance).sum::<f64>().min(1.0)
    }
}

/// P(χ > r) with so many degrees of freedom, by the recurrence from one or two.
fn beyond(r: f64, freedom: usize) -> f64 {
    let bell = exp(-0.5 * r * r);
    let (mut sum, mut term, mut k) = if freedom % 2 == 1 {
        (erfc(r * FRAC_1_SQRT_2), (2.0 / PI).sqrt() * r * bell, 1)
    } else {
        (bell, 0.5 * r * r * bell, 2)
    };
    while k + 2 <= freedom {
        sum += term;
        term *= r * r / (k as f64 + 2.0);
        k += 2;
    }
    sum
}

/// Least common multiple of lengths that are whole in some fraction of a pixel.
fn lcm_px(periods_px: &[f64]) -> Result<f64, ResidueError> {
    let whole = |p: f64, scale: u32| ((p * f64::from(scale)).round() - p * f64::from(scale)).abs() < 1e-6;
    let scale = (1..=MOST_SCALE).find(|scale| periods_px.iter().all(|p| whole(*p, *scale)));
    let Some(scale) = scale else {
        let broken = periods_px.iter().find(|p| !whole(**p, 1)).copied().unwrap_or(0.0);
        return Err(ResidueError::Broken { period_px: broken });
    };
    let mut lcm = 1_u64;
    for p in periods_px {
        let n = ((p * f64::from(scale)).round() as u64).max(1);
        lcm = (lcm / gcd(lcm, n)).saturating_mul(n).min(1 << 40);
    }
    Ok(lcm as f64 / f64::from(scale))
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

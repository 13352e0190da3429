//! The three columns that the grey values of all pixels share, found by orthogonal iteration from the nominal ones.

// The sums of a set live on the stack: a warm decoder allocates nothing.
#![allow(clippy::large_stack_arrays)]

use super::columns::{Column, dot, nominal_columns, solver, times};
use super::rows::{Factors, FrameRow, Rows};
use super::samples::Samples;
use super::steadied::Steadied;
use crate::decode::limits::MAX_STEPS;
use crate::decode::spectrum::{SIDE, Side};
use crate::math::simd::vectorised;
use crate::math::{atan2, wrap_rad};
use nalgebra::{Matrix3, Vector3};

/// Levels of the frames that differ by more are a changing light.
const FLICKER: f64 = 0.05;
/// A fringe that stands still in the level is a changing light by itself from this size on.
const STANDING_FLICKER: f64 = 0.03;
/// Levels that differ by more are no changing light.
const MOST_FLICKER: f64 = 0.5;
/// Rounds of the iteration: what is not of the three columns loses its share of the power each time.
const ROUNDS: usize = 24;
/// Tiles along each side in which the mean over the fringes is taken.
const TILES: usize = 4;
/// Bins of the phase in a tile: all must be filled for a mean over whole fringes.
const PHASES: usize = 8;
/// Least share of a full bin.
const LEAST_BIN: f64 = 0.4;
/// Fewest pixels of a tile, and fewest tiles.
const LEAST_IN_TILE: f64 = 64.0;
const LEAST_TILES: f64 = 4.0;
/// Standard errors that a standing fringe must exceed, and its least size over the level.
const STANDING_SIGMAS: f64 = 6.0;
const STANDING: f64 = 0.01;
/// Bins of residuals, eight to the octave, from 2⁻¹² of the level on.
const BINS: usize = 128;

/// A light that changes from frame to frame.
pub(super) struct ChangingLight {
    /// The columns under it.
    pub columns: [Column; 3],
    /// Standard deviation of its levels over their mean.
    pub deviation: f64,
    /// What takes its changes out of the frames.
    pub steadied: Steadied,
    /// Whether it changes so much that it is told and normalised.
    pub is_fault: bool,
}

/// Pixels of one phase in a tile: how many, and sums of r = √(C² + S²)/A and of the phase's direction.
#[derive(Clone, Copy, Default)]
struct Bin {
    count: f64,
    /// Σ r, Σ cos φ, Σ sin φ, Σ r cos φ, Σ r sin φ.
    sums: [f64; 5],
}

impl Samples<'_> {
    /// Σ over the pixels of the products of two frames.
    #[inline(always)]
    fn power(&self) -> [Column; MAX_STEPS] {
        let mut power = [[0.0; MAX_STEPS]; MAX_STEPS];
        for i in 0..self.steps() {
            for j in i..self.steps() {
                let mut sums = [0.0; SIDE];
                for (_, _, rows) in self.groups() {
                    for (sum, (a, b)) in sums.iter_mut().zip(rows[i].iter().zip(&rows[j])) {
                        *sum += a * b;
                    }
                }
                power[i][j] = sums.iter().sum();
                power[j][i] = power[i][j];
            }
        }
        power
    }

    /// Columns near the nominal ones that all pixels share, and what each frame's row tells.
    pub(super) fn rows(&self) -> Option<Rows> {
        self.rows_of(&vectorised!(self.level, self.power()))
    }

    /// The same by the products of the frames over the pixels.
    pub(super) fn rows_of(&self, power: &[Column; MAX_STEPS]) -> Option<Rows> {
        let steps = self.steps();
        let nominal = nominal_columns(self.plan);
        let mut basis = nominal;
        orthonormal(&mut basis, steps)?;
        for _ in 0..ROUNDS {
            for column in &mut basis {
                let old = *column;
                for (value, row) in column[..steps].iter_mut().zip(power) {
                    *value = dot(row, &old, steps);
                }
            }
            orthonormal(&mut basis, steps)?;
        }
        let columns = nearest(&basis, &nominal, steps, None)?;
        let left = self.left(&columns)?;
        // A bad frame must not pull the columns towards what it should show: the one without which the others fit best is left aside.
        let mut others = (columns, f64::INFINITY);
        for frame in (0..steps).filter(|_| steps > 4) {
            let fit = nearest(&basis, &nominal, steps, Some(frame))?;
            let off = misfit(&fit, &nominal, steps, frame);
            if off < others.1 {
                others = (fit, off);
            }
        }
        let mut frames = [FrameRow::default(); MAX_STEPS];
        for (frame, row) in frames[..steps].iter_mut().enumerate() {
            *row = self.frame_row(&others.0, frame, &left);
        }
        Some(Rows { steps, nominal, basis, columns, frames, power: *power })
    }

    /// How the light changes from frame to frame; `None` where it changes by more than a light does.
    pub(super) fn changing_light(&self, rows: &Rows) -> Option<ChangingLight> {
        let Rows { nominal, columns, .. } = rows;
        let steps = self.steps();
        let added = [columns[0], nominal[1], nominal[2]];
        let standing = self.standing(&added);
        let mut levels = columns[0];
        if let Some([c, s]) = standing {
            for (i, level) in levels[..steps].iter_mut().enumerate() {
                *level += c * nominal[1][i] + s * nominal[2][i];
            }
        }
        let mean = levels[..steps].iter().sum::<f64>() / steps as f64;
        levels[..steps].iter_mut().for_each(|level| *level /= mean);
        let most = levels[..steps].iter().map(|level| (level - 1.0).abs()).fold(0.0, f64::max);
        let still = standing.map_or(0.0, |[c, s]| (c * c + s * s).sqrt());
        if most > MOST_FLICKER {
            return None;
        }
        // Room light adds to all fringes, an exposure scales them: what leaves less is taken.
        let mut best = ([levels, nominal[1], nominal[2]], levels);
        let mut of_levels: fn(&Column, f64) -> Steadied = Steadied::of_added;
        if let Some(Factors { scaled: factors, .. }) = (steps > 4).then(|| rows.factors()).flatten() {
            let scaled = rows.nominal.map(|column| times(&column, &factors));
            if rows.unexplained(&scaled) < rows.unexplained(&added) {
                best = (scaled, factors);
                of_levels = Steadied::of_scaled;
            }
        }
        let deviation = deviation(&best.1[..steps]);
        let is_fault = still > STANDING_FLICKER || most > FLICKER;
        Some(ChangingLight { columns: best.0, deviation, steadied: of_levels(&best.1, deviation), is_fault })
    }

    /// The fringe that stands still in the level, over the level, where it is certain. It makes the modulation vary once with the phase: r + E cos
    /// (φ − ψ), whatever phases a tile has.
    fn standing(&self, columns: &[Column; 3]) -> Option<[f64; 2]> {
        let weights = solver(columns, self.steps())?;
        let mut tiles = [[Bin::default(); PHASES]; TILES * TILES];
        vectorised!(self.level, self.fill(&weights, &mut tiles));
        // The mean of (r − r̄) cos φ over the phases is half the amplitude.
        let of_tile = |tile: &[Bin; PHASES]| {
            let count: f64 = tile.iter().map(|bin| bin.count).sum();
            let least = tile.iter().map(|bin| bin.count).fold(f64::INFINITY, f64::min);
            let whole = count >= LEAST_IN_TILE && least >= LEAST_BIN * count / PHASES as f64;
            let mean = |k: usize| tile.iter().map(|bin| bin.sums[k] / bin.count).sum::<f64>() / PHASES as f64;
            whole.then(|| [1, 2].map(|k| 2.0 * (mean(k + 2) - mean(0) * mean(k))))
        };
        let whole = || tiles.iter().filter_map(of_tile);
        let n = whole().count() as f64;
        if n < LEAST_TILES {
            return None;
        }
        let mean = [0, 1].map(|k| whole().map(|tile| tile[k]).sum::<f64>() / n);
        let square = |tile: [f64; 2]| {
            (tile[0] - mean[0]) * (tile[0] - mean[0]) + (tile[1] - mean[1]) * (tile[1] - mean[1])
        };
        let error = (whole().map(square).sum::<f64>() / (n * (n - 1.0))).sqrt();
        let size = (mean[0] * mean[0] + mean[1] * mean[1]).sqrt();
        (size > STANDING_SIGMAS * error && size > STANDING).then_some(mean)
    }

    /// Residual of each frame over the level that three quarters of the pixels stay below.
    fn left(&self, columns: &[Column; 3]) -> Option<Column> {
        let steps = self.steps();
        let weights = solver(columns, steps)?;
        let mut bins = [[0_u32; BINS]; MAX_STEPS];
        vectorised!(self.level, self.count_left(columns, &weights, &mut bins));
        let mut left = [0.0; MAX_STEPS];
        for (left, bins) in left[..steps].iter_mut().zip(&bins) {
            let most = bins.iter().sum::<u32>() / 4 * 3;
            let mut below = 0;
            let at = bins.iter().position(|count| {
                below += count;
                below > most
            });
            *left = level_of(at.unwrap_or(0));
        }
        Some(left)
    }

    /// Counts the pixels by what each frame leaves over the level.
    #[inline(always)]
    fn count_left(&self, columns: &[Column; 3], weights: &[Column; 3], bins: &mut [[u32; BINS]; MAX_STEPS]) {
        for (chosen, _, rows) in self.groups() {
            let x = fitted(weights, rows);
            for (i, (bins, values)) in bins.iter_mut().zip(rows).enumerate() {
                let mut places = [0_u32; SIDE];
                for l in 0..SIDE {
                    let told = x[0][l] * columns[0][i] + x[1][l] * columns[1][i] + x[2][l] * columns[2][i];
                    places[l] = bin((values[l] - told).abs());
                }
                for place in &places[..chosen.len()] {
                    bins[*place as usize] += 1;
                }
            }
        }
    }

    /// Deals the pixels to tiles and phases.
    #[inline(always)]
    fn fill(&self, weights: &[Column; 3], tiles: &mut [[Bin; PHASES]; TILES * TILES]) {
        let (width, height) = self.size_px();
        for (chosen, _, rows) in self.groups() {
            let [a, c, s] = fitted(weights, rows);
            let (mut r, mut cosine, mut sine) = ([0.0; SIDE], [0.0; SIDE], [0.0; SIDE]);
            for l in 0..SIDE {
                let length = (c[l] * c[l] + s[l] * s[l]).sqrt();
                (r[l], cosine[l], sine[l]) = (length / a[l], c[l] / length, s[l] / length);
            }
            for (l, position) in chosen.iter().enumerate() {
                if a[l] <= 0.0 || (c[l] == 0.0 && s[l] == 0.0) {
                    continue;
                }
                let place = self.look.positions[*position as usize];
                let (x, y) = (place % width * TILES / width, place / width * TILES / height);
                let bin = &mut tiles[(y * TILES + x).min(TILES * TILES - 1)][octant(c[l], s[l])];
                bin.count += 1.0;
                let own = [r[l], cosine[l], sine[l], r[l] * cosine[l], r[l] * sine[l]];
                for (sum, value) in bin.sums.iter_mut().zip(own) {
                    *sum += value;
                }
            }
        }
    }

    /// What the row of a frame tells beside those of most others.
    fn frame_row(&self, columns: &[Column; 3], frame: usize, left: &Column) -> FrameRow {
        let steps = self.steps();
        let contrast = |i: usize| (columns[1][i] * columns[1][i] + columns[2][i] * columns[2][i]).sqrt();
        let off = |i: usize| wrap_rad(atan2(columns[2][i], columns[1][i]) - self.plan.shifts_rad[i]);
        let usual = |of: &dyn Fn(usize) -> f64| {
            let mut sorted = [0.0; MAX_STEPS];
            sorted[..steps].iter_mut().enumerate().for_each(|(i, value)| *value = of(i));
            sorted[..steps].sort_unstable_by(f64::total_cmp);
            sorted[steps / 2]
        };
        FrameRow {
            level: columns[0][frame] / usual(&|i| columns[0][i]),
            contrast: contrast(frame) / usual(&contrast),
            off_rad: off(frame) - usual(&off),
            left: left[frame],
            usual: usual(&|i| left[i]),
        }
    }
}

/// Standard deviation of levels whose mean is 1.
pub(super) fn deviation(levels: &[f64]) -> f64 {
    let variance = levels.iter().map(|level| (level - 1.0) * (level - 1.0)).sum::<f64>();
    (variance / (levels.len() as f64 - 1.0)).sqrt()
}

/// A, C and S of the pixels of a group.
#[inline(always)]
fn fitted(weights: &[Column; 3], rows: &[Side]) -> [Side; 3] {
    let mut x = [[0.0; SIDE]; 3];
    for (i, values) in rows.iter().enumerate() {
        for (x, weights) in x.iter_mut().zip(weights) {
            for l in 0..SIDE {
                x[l] += weights[i] * values[l];
            }
        }
    }
    x
}

/// Number of the eighth of a turn in which a direction lies, counted from that towards −c on.
#[inline(always)]
fn octant(c: f64, s: f64) -> usize {
    let steep = s.abs() > c.abs();
    match (s < 0.0, c < 0.0) {
        (true, true) => usize::from(steep),
        (true, false) => 3 - usize::from(steep),
        (false, false) => 4 + usize::from(steep),
        (false, true) => 7 - usize::from(steep),
    }
}

/// The columns that a basis spans, as near to the nominal ones as possible over all frames but one.
pub(super) fn nearest(
    basis: &[Column; 3],
    nominal: &[Column; 3],
    steps: usize,
    but: Option<usize>,
) -> Option<[Column; 3]> {
    let sum = |a: &Column, b: &Column| dot(a, b, steps) - but.map_or(0.0, |frame| a[frame] * b[frame]);
    let normal = Matrix3::from_fn(|i, j| sum(&basis[i], &basis[j]));
    let inverse = normal.try_inverse()?;
    let mut columns = [[0.0; MAX_STEPS]; 3];
    for (column, wanted) in columns.iter_mut().zip(nominal) {
        let shares = inverse * Vector3::from_fn(|k, _| sum(&basis[k], wanted));
        for (i, value) in column[..steps].iter_mut().enumerate() {
            *value = (0..3).map(|k| shares[k] * basis[k][i]).sum();
        }
    }
    Some(columns)
}

/// Σ of the squares by which columns differ from the nominal ones, over all frames but one.
fn misfit(columns: &[Column; 3], nominal: &[Column; 3], steps: usize, but: usize) -> f64 {
    let mut sum = 0.0;
    for (column, wanted) in columns.iter().zip(nominal) {
        for i in (0..steps).filter(|i| *i != but) {
            sum += (column[i] - wanted[i]) * (column[i] - wanted[i]);
        }
    }
    sum
}

/// Gram and Schmidt; `None` where the columns do not span three dimensions.
fn orthonormal(columns: &mut [Column; 3], steps: usize) -> Option<()> {
    for k in 0..3 {
        // Twice, against rounding.
        for _ in 0..2 {
            for other in 0..k {
                let base = columns[other];
                let share = dot(&base, &columns[k], steps);
                columns[k].iter_mut().zip(&base).for_each(|(v, b)| *v -= share * b);
            }
        }
        let length = dot(&columns[k], &columns[k], steps).sqrt();
        if length.is_nan() || length <= 0.0 {
            return None;
        }
        columns[k].iter_mut().for_each(|v| *v /= length);
    }
    Some(())
}

/// Bin of a residual: the exponent and three bits of the number.
#[inline(always)]
fn bin(value: f64) -> u32 {
    let bits = (value as f32).to_bits() >> 20;
    bits.saturating_sub((127 - 12) << 3).min(BINS as u32 - 1)
}

/// Lower end of a bin.
fn level_of(bin: usize) -> f64 {
    f64::from(f32::from_bits((bin as u32 + ((127 - 12) << 3)) << 20))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sincos;

    #[test]
    fn eighths_of_a_turn_are_those_of_the_angle() {
        for i in 0..1000 {
            let (s, c) = sincos(f64::from(i) * 0.01 - 5.0);
            let turns = atan2(s, c) / std::f64::consts::TAU + 0.5;
            assert_eq!(octant(3.0 * c, 3.0 * s), (turns * 8.0) as usize, "{c} {s}");
        }
    }
}

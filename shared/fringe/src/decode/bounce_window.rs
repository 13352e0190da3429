//! Scatter of the modulation over a window, without what changes smoothly, with steepness or with the fringes themselves.
//!
//! The ratio q of modulation to white less black is explained by a straight line over the window (a lens or projector out of
//! focus, light from everywhere), by ½ |∇φ|² (a footprint that is not known exactly) and by cos Nφ, sin Nφ (harmonics
//! of the fringes, which N steps let pass: they move the phases of two cameras alike). Each coefficient is
//! known beforehand to be small, which keeps the equations regular where a window does not show it. What is left scatters.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::bounce_cells::{ASKED, CELL, Cell, KINDS, LINES, NOISE, PLAIN, RATIO, Row, SCATTER, place};
use nalgebra::{SMatrix, SVector};

/// Fewer smooth pixels in a window say nothing.
const LEAST: f64 = 32.0;
/// Scatter beyond noise counts from so many of its standard deviations on.
const CERTAIN: f64 = 3.0;
/// So many of the nine windows that hold a cell have to show bounced light.
const WITNESSES: u32 = 3;
/// The ratio itself is no better than this part: levels of 8 bits, footprints that are no Gaussians.
const MODEL: f64 = 0.004;
/// What is explained is explained to this part: smooth changes are no straight lines.
const BENT: f64 = 0.1;
/// Largest relative coefficients to be expected: slopes along x and y per cell, harmonics.
const SLOPE: f64 = 0.08;
const RIPPLE: f64 = 0.1;
/// Coefficients beside the mean: slopes along x and y, and what a cell sums besides.
const UNKNOWNS: usize = KINDS;
/// Where that of the footprint stands among them, and how many of its standard uncertainties it may have.
const STEEP: usize = 2;
const MOST: f64 = 2.0;
/// Windows that are looked at side by side.
const LANES: usize = 16;
/// Part of a sum, and of a limit, within which rounding to single precision could decide: some hundred roundings.
const CLOSE: f32 = 1e-5;
type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;
/// Variance of the place within a cell, over the square of the cell's edge.
const WITHIN: f64 = (1.0 - 1.0 / (CELL * CELL) as f64) / 12.0;

/// Number of pixels, variance that noise explains, mean of the ratio, and the moments about the means of x, y and the kinds.
#[derive(Debug, Clone, Copy)]
struct Window {
    count: f64,
    noise: f64,
    mean: f64,
    moments: SMatrix<f64, { UNKNOWNS + 1 }, { UNKNOWNS + 1 }>,
}

/// Marks, in the middle one of three rows of cells, those whose windows scatter by more than noise, or by so little less that rounding could decide; most do not, and
/// no equation is solved for them. The others become 0.
#[inline(always)]
pub(super) fn suspects(rows: &[Row; LINES], out: &mut [f32]) {
    for first in (0..out.len()).step_by(LANES) {
        let found = if is_empty(rows, first) { [0.0; LANES] } else { scattered(rows, first) };
        if first + LANES <= out.len() {
            out[first..first + LANES].copy_from_slice(&found);
        } else {
            let count = out.len() - first;
            out[first..].copy_from_slice(&found[..count]);
        }
    }
}

/// Whether no window about cells side by side holds a pixel.
#[inline(always)]
fn is_empty(rows: &[Row; LINES], first: usize) -> bool {
    let mut most = [0.0_f32; LANES];
    for row in rows {
        let (one, other) = (row.taken::<LANES>(0, first), row.taken::<LANES>(0, first + 2));
        for l in 0..LANES {
            most[l] += one[l] + other[l];
        }
    }
    most.iter().fold(0.0, |sum, count| sum + count) == 0.0
}

/// 1 where the window about a cell of some side by side may scatter by more than noise, else 0.
#[inline(always)]
fn scattered(rows: &[Row; LINES], first: usize) -> [f32; LANES] {
    let (mut sums, mut worst) = ([[0.0_f32; LANES]; ASKED.len()], rows[0].taken::<LANES>(SCATTER, first));
    // That of the nine cells which scatters most is left out.
    let mut out = ASKED.map(|asked| rows[0].taken::<LANES>(asked, first));
    for place in 1..9 {
        let (row, at) = (&rows[place / 3], first + place % 3);
        let scatter = row.taken::<LANES>(SCATTER, at);
        // All bits where it scatters more than the worst so far. A choice of two numbers becomes one of two places in memory, which is no vector.
        let mut more = [0_u32; LANES];
        for l in 0..LANES {
            more[l] = if scatter[l] > worst[l] { u32::MAX } else { 0 };
            worst[l] = if scatter[l] > worst[l] { scatter[l] } else { worst[l] };
        }
        for ((sum, out), asked) in sums.iter_mut().zip(&mut out).zip(ASKED) {
            leave_out(sum, out, &row.taken(asked, at), &more);
        }
    }
    let [count, ratio, squares, noise] = sums;
    let mut found = [0.0; LANES];
    for l in 0..LANES {
        let enough = count[l] >= LEAST as f32;
        let number = count[l].max(1.0);
        let mean = ratio[l] / number;
        let moment = squares[l] - ratio[l] * mean;
        let model = MODEL as f32 * (PLAIN + mean);
        let allowed = (noise[l] / number + model * model) * (1.0 + CERTAIN as f32 * (2.0 / number).sqrt());
        let most = (number - UNKNOWNS as f32) * allowed;
        let near = moment > most * (1.0 - CLOSE) - squares[l] * CLOSE;
        found[l] = if enough & near { 1.0 } else { 0.0 };
    }
    found
}

/// Adds the values of a cell, or those of the one that was left out so far where this one scatters more and takes its place.
#[inline(always)]
fn leave_out(sum: &mut [f32; LANES], out: &mut [f32; LANES], values: &[f32; LANES], more: &[u32; LANES]) {
    for l in 0..LANES {
        let (new, old) = (values[l].to_bits(), out[l].to_bits());
        let exchanged = (new ^ old) & more[l];
        sum[l] += f32::from_bits(new ^ exchanged);
        out[l] = f32::from_bits(old ^ exchanged);
    }
}

/// Relative variance of the ratio about a cell beyond that of noise; 0 where noise may explain all. `u_px2`: how uncertain the variance of
/// the footprint is.
pub(super) fn excess(rows: &[Row; LINES], column: usize, u_px2: f64) -> f32 {
    let Some(window) = Window::of(&parts(rows, column)) else { return 0.0 };
    let last = UNKNOWNS;
    if window.moments[(last, last)] <= (window.count - UNKNOWNS as f64) * window.allowed(0.0) {
        return 0.0;
    }
    window.excess(&[SLOPE, SLOPE, u_px2, RIPPLE, RIPPLE]) as f32
}

/// Mean excess of the nine windows that hold a cell, of those that show any, for each cell of a row; 0 where fewer than [`WITNESSES`] do.
pub(super) fn joined(excess: &[f32], columns: usize, row: usize) -> impl Iterator<Item = (usize, f32)> {
    let rows = excess.len() / columns;
    let near = &excess[row.saturating_sub(1) * columns..(row + 2).min(rows) * columns];
    // Most rows show none.
    let any = near.iter().fold(0, |any, found| any | u32::from(*found > 0.0)) != 0;
    (0..if any { columns } else { 0 }).map(move |column| {
        let (mut sum, mut count) = (0.0, 0);
        for line in near.chunks_exact(columns) {
            for found in &line[column.saturating_sub(1)..(column + 2).min(columns)] {
                sum += found;
                count += u32::from(*found > 0.0);
            }
        }
        (column, if count >= WITNESSES { sum / count as f32 } else { 0.0 })
    })
}

/// The cells about one but for that which scatters most, and their places beside the middle one.
fn parts(rows: &[Row; LINES], column: usize) -> [(Cell, [f64; 2]); 8] {
    let of = |place: usize| {
        let [x, y] = [place % 3, place / 3];
        (rows[y].cell(column + x), [x as f64 - 1.0, y as f64 - 1.0])
    };
    let scatter = |place: usize| rows[place / 3].taken::<1>(SCATTER, column + place % 3)[0];
    let worst = (1..9).fold(0, |worst, place| if scatter(place) > scatter(worst) { place } else { worst });
    std::array::from_fn(|k| of(if k == worst { 8 } else { k }))
}

impl Window {
    fn of(parts: &[(Cell, [f64; 2])]) -> Option<Self> {
        let count: f64 = parts.iter().map(|(cell, _)| f64::from(cell[0])).sum();
        if count < LEAST {
            return None;
        }
        // 1, x, y, then the kinds after the first one.
        let mut sums = SMatrix::<f64, { UNKNOWNS + 2 }, { UNKNOWNS + 2 }>::zeros();
        let mut noise = 0.0;
        for (cell, [x, y]) in parts {
            noise += f64::from(cell[NOISE]);
            let terms = [(1.0, 0), (*x, 0), (*y, 0), (1.0, 1), (1.0, 2), (1.0, 3), (1.0, RATIO)];
            for (i, (factor, kind)) in terms.iter().enumerate() {
                for (j, (other, of)) in terms.iter().enumerate().skip(i) {
                    sums[(i, j)] += factor * other * f64::from(cell[place(*kind, *of)]);
                }
            }
        }
        let about = |i: usize, j: usize| {
            let (i, j) = (i.min(j) + 1, i.max(j) + 1);
            sums[(i, j)] - sums[(0, i)] * sums[(0, j)] / count
        };
        let moments = SMatrix::from_fn(about);
        let mean = f64::from(PLAIN) + sums[(0, UNKNOWNS + 1)] / count;
        (mean > 0.0).then_some(Self { count, noise: noise / count, mean, moments })
    }

    /// Variance beyond which noise does not explain what is left, where so much is explained otherwise.
    fn allowed(&self, explained: f64) -> f64 {
        (self.known() + BENT * BENT * explained / self.count) * (1.0 + CERTAIN * (2.0 / self.count).sqrt())
    }

    /// Variance by noise and by what the ratio is good for.
    fn known(&self) -> f64 {
        self.noise + (MODEL * self.mean) * (MODEL * self.mean)
    }

    fn excess(&self, expected: &[f64; UNKNOWNS]) -> f64 {
        let plain = self.moments.fixed_view::<UNKNOWNS, UNKNOWNS>(0, 0).into_owned();
        let right: Vector = self.moments.fixed_view::<UNKNOWNS, 1>(0, UNKNOWNS).into_owned();
        let mut equations = plain;
        let mut free = self.count - 1.0;
        for (i, expected) in expected.iter().enumerate() {
            let shown = equations[(i, i)];
            let known = self.known() / (expected * self.mean * expected * self.mean);
            equations[(i, i)] += known;
            free -= shown / (shown + known);
        }
        let most = MOST * expected[STEEP] * self.mean;
        let Some(solved) = solve(equations, right, most) else { return 0.0 };
        // A cell has one place: what the slopes explain within cells is added.
        let slopes2 = solved[0] * solved[0] + solved[1] * solved[1];
        let within = slopes2 * WITHIN * self.count;
        let explained = 2.0 * solved.dot(&right) - solved.dot(&(plain * solved)) + within;
        let left = self.moments[(UNKNOWNS, UNKNOWNS)] - explained;
        if left / free <= self.allowed(explained) {
            return 0.0;
        }
        // Where light from other faces is proven, what it changes along a line is of it, too.
        let along = (solved[0] * right[0] + solved[1] * right[1]).max(0.0) + within;
        ((left + along) / free - self.noise).max(0.0) / (self.mean * self.mean)
    }
}

/// The coefficients; that of the slopes of the fringes stays within ± `most`, since bounced light moves these slopes, too, and must not be
/// explained by them.
fn solve(mut equations: Matrix, mut right: Vector, most: f64) -> Option<Vector> {
    let solved = equations.cholesky()?.solve(&right);
    if solved[STEEP].abs() <= most {
        return Some(solved);
    }
    let held = most * solved[STEEP].signum();
    for i in 0..UNKNOWNS {
        right[i] -= equations[(i, STEEP)] * held;
        (equations[(i, STEEP)], equations[(STEEP, i)]) = (0.0, 0.0);
    }
    (equations[(STEEP, STEEP)], right[STEEP]) = (1.0, held);
    Some(equations.cholesky()?.solve(&right))
}

#[cfg(test)]
mod tests {
    use super::super::bounce_cells::{Cells, SUMS, memory};
    use super::*;
    use crate::math::random::{Key, normal_quantile};
    use crate::math::simd::{levels, vectorised};

    /// Cells of 16, 9 or no pixels whose ratios scatter by noise, and in some places by more: whatever the fit finds was suspected, at every level of
    /// instructions, and few cells are suspected where noise is all there is.
    #[test]
    fn what_the_fit_finds_was_suspected() {
        let (columns, rows) = (45, 30);
        let random = Key::new(3);
        let cell = |row: usize, column: usize| {
            let first = 16 * (row * columns + column);
            let pixels = [16, 16, 9, 16, 0, 16, 16][(row / 3 + column / 5) % 7];
            let scatter = [0.004, 0.01, 0.016, 0.03][column * 4 / columns];
            let ratios: Vec<f32> = (0..pixels)
                .map(|i| (0.02 + scatter * normal_quantile(random.open((first + i) as u64))) as f32)
                .collect();
            let mut cell = [0.0; SUMS];
            cell[0] = pixels as f32;
            cell[place(0, RATIO)] = ratios.iter().sum();
            cell[place(RATIO, RATIO)] = ratios.iter().map(|r| r * r).sum();
            cell[NOISE] = pixels as f32 * 0.01 * 0.01;
            cell
        };
        let mut sums = vec![0.0; memory(columns)];
        for level in levels() {
            let (mut suspected, mut found) = ([0; 4], [0; 4]);
            for row in 1..=rows {
                let mut cells = Cells::new(columns, &mut sums);
                for (near, column) in (row - 1..=row + 1).flat_map(|row| (0..columns).map(move |c| (row, c)))
                {
                    cells.put(near, column, &cell(near, column));
                }
                let (rows, mut marks) = (cells.about(row), vec![9.0; columns]);
                vectorised!(level, suspects(&rows, &mut marks));
                for (column, mark) in marks.iter().enumerate() {
                    let excess = excess(&rows, column, 0.01);
                    assert!(
                        *mark == 1.0 || (*mark == 0.0 && excess == 0.0),
                        "{row}, {column}: {mark}, {excess}"
                    );
                    suspected[column * 4 / columns] += i32::from(*mark > 0.0);
                    found[column * 4 / columns] += i32::from(excess > 0.0);
                }
            }
            assert!(
                suspected[0] == 0 && found[3] > 100 && suspected[3] >= found[3],
                "{suspected:?} {found:?}"
            );
        }
    }
}

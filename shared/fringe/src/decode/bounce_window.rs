//! Scatter of the modulation over a window, without what changes smoothly, with steepness or with the fringes themselves.
//!
//! The ratio q of modulation to white less black is explained by a straight line over the window (a lens or projector out of
//! focus, light from everywhere), by ½ |∇φ|² (a footprint that is not known exactly) and by cos Nφ, sin Nφ (harmonics
//! of the fringes, which N steps let pass: they move the phases of two cameras alike). Each coefficient is
//! known beforehand to be small, which keeps the equations regular where a window does not show it. What is left scatters.

use nalgebra::{SMatrix, SVector};

/// Edge of a cell, px.
pub(super) const CELL: usize = 4;
/// What a cell sums: 1, ½ |∇φ|², cos Nφ, sin Nφ, and the ratio.
pub(super) const KINDS: usize = 5;
/// Sums of the products of two of them.
pub(super) const PRODUCTS: usize = KINDS * (KINDS + 1) / 2;
/// Fewer smooth pixels in a window say nothing.
const LEAST: f64 = 32.0;
/// Scatter beyond noise counts from so many of its standard deviations on.
const CERTAIN: f64 = 3.0;
/// So many of the nine windows that hold a cell have to show bounced light.
const WITNESSES: u32 = 3;
/// The modulation over white less black without blur: sums of what it differs by lose no digits.
pub(super) const PLAIN: f32 = 0.5;
/// The ratio itself is no better than this part: levels of 8 bits, footprints beyond the second order.
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
type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;
/// Variance of the place within a cell, over the square of the cell's edge.
const WITHIN: f64 = (1.0 - 1.0 / (CELL * CELL) as f64) / 12.0;

/// Sums over the smooth pixels of a cell.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    /// Products of two kinds of values, the first kind with itself and all later ones, and so on.
    pub products: [f32; PRODUCTS],
    /// Variance of the ratio that noise explains.
    pub noise: f32,
}

/// Place of the product of two kinds.
const fn place(one: usize, other: usize) -> usize {
    let (first, second) = if one < other { (one, other) } else { (other, one) };
    first * KINDS - first * (first + 1) / 2 + second
}

/// The ratio among the kinds.
const RATIO: usize = KINDS - 1;

impl Cell {
    fn count(&self) -> f32 {
        self.products[0]
    }

    /// Sum of squares of the ratio about its mean.
    fn scatter(&self) -> f32 {
        let [mean, squares] = [place(0, RATIO), place(RATIO, RATIO)].map(|at| self.products[at]);
        if self.count() > 0.0 { squares - mean * mean / self.count() } else { 0.0 }
    }
}

/// Number of pixels, variance that noise explains, mean of the ratio, and the moments about the means of x, y and the kinds.
#[derive(Debug, Clone, Copy)]
struct Window {
    count: f64,
    noise: f64,
    mean: f64,
    moments: SMatrix<f64, { UNKNOWNS + 1 }, { UNKNOWNS + 1 }>,
}

/// Relative variance of the ratio about a cell beyond that of noise; 0 where noise may explain all. `u_px2`: how uncertain the variance of
/// the footprint is.
pub(super) fn excess(cells: &[Cell], columns: usize, (row, column): (usize, usize), u_px2: f64) -> f32 {
    let (parts, count) = parts(cells, columns, row, column);
    let Some(window) = Window::of(&parts[..count]) else { return 0.0 };
    // Most windows scatter by noise alone: no equation is solved for them.
    let last = UNKNOWNS;
    if window.moments[(last, last)] <= (window.count - UNKNOWNS as f64) * window.allowed(0.0) {
        return 0.0;
    }
    window.excess(&[SLOPE, SLOPE, u_px2, RIPPLE, RIPPLE]) as f32
}

/// Mean excess of the nine windows that hold a cell, of those that show any; 0 where fewer than [`WITNESSES`] do.
pub(super) fn joined(excess: &[f32], columns: usize, row: usize, column: usize) -> f32 {
    let rows = excess.len() / columns;
    let (mut sum, mut count) = (0.0, 0);
    for y in row.saturating_sub(1)..(row + 2).min(rows) {
        for found in &excess[y * columns..][column.saturating_sub(1)..(column + 2).min(columns)] {
            sum += found;
            count += u32::from(*found > 0.0);
        }
    }
    if count >= WITNESSES { sum / count as f32 } else { 0.0 }
}

/// A cell, and its place beside the middle one.
type Part<'a> = (&'a Cell, [f64; 2]);

/// Up to nine cells about one, without the one that scatters most.
fn parts(cells: &[Cell], columns: usize, row: usize, column: usize) -> ([Part<'_>; 9], usize) {
    let rows = cells.len() / columns;
    let (mut parts, mut count, mut worst) = ([(&cells[0], [0.0; 2]); 9], 0, 0);
    for y in row.saturating_sub(1)..(row + 2).min(rows) {
        for x in column.saturating_sub(1)..(column + 2).min(columns) {
            parts[count] = (&cells[y * columns + x], [x as f64 - column as f64, y as f64 - row as f64]);
            if parts[count].0.scatter() > parts[worst].0.scatter() {
                worst = count;
            }
            count += 1;
        }
    }
    parts.swap(worst, count - 1);
    (parts, count - 1)
}

impl Window {
    fn of(parts: &[Part]) -> Option<Self> {
        let count: f64 = parts.iter().map(|(cell, _)| f64::from(cell.count())).sum();
        if count < LEAST {
            return None;
        }
        // 1, x, y, then the kinds after the first one.
        let mut sums = SMatrix::<f64, { UNKNOWNS + 2 }, { UNKNOWNS + 2 }>::zeros();
        let mut noise = 0.0;
        for (cell, [x, y]) in parts {
            noise += f64::from(cell.noise);
            let terms = [(1.0, 0), (*x, 0), (*y, 0), (1.0, 1), (1.0, 2), (1.0, 3), (1.0, RATIO)];
            for (i, (factor, kind)) in terms.iter().enumerate() {
                for (j, (other, of)) in terms.iter().enumerate().skip(i) {
                    sums[(i, j)] += factor * other * f64::from(cell.products[place(*kind, *of)]);
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

//! Sums of the modulation over white less black, and of what explains it, over cells of 4 × 4 pixels.

// Without branches a loop vectorises. The sums of a group are local arrays so that they stay in registers.
#![allow(clippy::needless_bitwise_bool, clippy::large_stack_arrays)]

use super::block::filled;
use super::contrast_bins::Reflectance;
use super::noise_model::NoiseModel;
use super::rasters::{Kept, Rasters};
use crate::math::simd::{loaded, put, taken, vectorised};
use fearless_simd::{Level, Select, Simd, SimdBase, SimdFloat, SimdFrom};

/// Edge of a cell, px.
pub(super) const CELL: usize = 4;
/// What a cell sums: 1, ½ |∇φ|², cos Nφ, sin Nφ, and the ratio.
pub(super) const KINDS: usize = 5;
/// The ratio among the kinds.
pub(super) const RATIO: usize = KINDS - 1;
/// Sums of the products of two of them.
const PRODUCTS: usize = KINDS * (KINDS + 1) / 2;
/// Where the variance of the ratio by noise stands behind the products, and the sum of squares of the ratio about its mean.
pub(super) const NOISE: usize = PRODUCTS;
pub(super) const SCATTER: usize = PRODUCTS + 1;
/// Sums of a cell.
pub(super) const SUMS: usize = PRODUCTS + 2;
/// Behind them, at the first cell of a group, whether all of its sums were made; else only those that show the scatter of the ratio.
const WHOLE: usize = SUMS;
/// Numbers that are kept of a cell.
const KEPT: usize = SUMS + 1;
/// The modulation over white less black without blur: sums of what it differs by lose no digits.
pub(super) const PLAIN: f32 = 0.5;
/// Number of pixels, sum and sum of squares of the ratio, variance by noise: they show how the ratio scatters, and its scatter follows from them.
pub(super) const ASKED: [usize; 4] = [0, place(0, RATIO), place(RATIO, RATIO), NOISE];
/// All sums over pixels.
const EVERY: [usize; NOISE + 1] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// Pixels that are worked on side by side.
const LANES: usize = 16;
/// Cells that they belong to.
const GROUP: usize = LANES / CELL;
/// Rows of cells that a window reaches.
pub(super) const LINES: usize = 3;
/// Cells beyond the last one of a row, which groups of cells read.
const MARGIN: usize = 32;

type Lanes = [f32; LANES];

/// Sums of one cell over its smooth pixels.
pub(super) type Cell = [f32; SUMS];

/// Place of the product of two kinds: the first kind with itself and all later ones, and so on.
pub(super) const fn place(one: usize, other: usize) -> usize {
    let (first, second) = if one < other { (one, other) } else { (other, one) };
    first * KINDS - first * (first + 1) / 2 + second
}

/// What is known of the pixels of an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    /// Phase of each pixel, rad.
    pub phase: &'a [f32],
    /// Modulation of each pixel, DN.
    pub modulation: &'a [f32],
    /// Finite where the neighbourhood of a pixel is one surface.
    pub smooth: &'a [f32],
    /// Width of the image, px.
    pub width: usize,
}

/// What the test needs besides the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light<'a> {
    /// The frames white and black.
    pub reflectance: Reflectance<'a>,
    /// Noise of the camera.
    pub noise: NoiseModel,
    /// Steps of the sine whose modulation the map has.
    pub steps: u32,
    /// Variance of the pixel's footprint, px².
    pub footprint_px2: f32,
    /// Its standard uncertainty, px².
    pub u_footprint_px2: f64,
}

/// The sums of three rows of cells, of which the window about a cell is made, sum by sum; behind each end of a row a cell is empty.
#[derive(Debug)]
pub(super) struct Cells<'a> {
    stride: usize,
    sums: &'a mut [f32],
}

/// The sums of a row of cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<'a> {
    stride: usize,
    sums: &'a [f32],
}

impl Row<'_> {
    /// A sum of some cells from one on; the first one is that of the ring.
    #[inline(always)]
    pub(super) fn taken<const N: usize>(&self, sum: usize, first: usize) -> [f32; N] {
        taken(self.sums, sum * self.stride + first)
    }

    /// All sums of a cell.
    pub(super) fn cell(&self, at: usize) -> Cell {
        std::array::from_fn(|sum| self.sums[sum * self.stride + at])
    }
}

/// Numbers in the memory of so many cells to a row.
pub(super) fn memory(columns: usize) -> usize {
    LINES * KEPT * (columns + MARGIN)
}

impl<'a> Cells<'a> {
    /// Of so many cells to a row, in memory that is there.
    pub(super) fn new(columns: usize, sums: &'a mut [f32]) -> Self {
        Self { stride: columns + MARGIN, sums }
    }

    /// Takes a row of cells of an image in, in place of the third one before it: the sums that show how the ratio scatters. Rows count from 1;
    /// there is none at 0 and behind the last one.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(&mut self, simd: S, row: usize, seen: &Seen, light: &Light) {
        let length = KEPT * self.stride;
        let sums = &mut self.sums[row % LINES * length..][..length];
        for sum in ASKED.into_iter().chain([SCATTER, WHOLE]) {
            sums[sum * self.stride..][..self.stride].fill(0.0);
        }
        let Some(line) = seen.first_line(row) else { return };
        for column in (0..seen.width).step_by(LANES) {
            light.sum::<S, false>(simd, seen, [column, line], (sums, self.stride));
        }
    }

    /// Makes all sums of the cells about one, in three rows that were filled last. Most cells are never asked for them.
    pub(super) fn complete(&mut self, [row, column]: [usize; 2], seen: &Seen, light: &Light, level: Level) {
        let length = KEPT * self.stride;
        for row in row - 1..=row + 1 {
            let sums = &mut self.sums[row % LINES * length..][..length];
            for group in column.saturating_sub(1) / GROUP..=(column + 1) / GROUP {
                let first = 1 + group * GROUP;
                if sums[WHOLE * self.stride + first] != 0.0 {
                    continue;
                }
                // What stood there belongs to another row, and there may be nothing to sum.
                for sum in 0..SUMS {
                    sums[sum * self.stride + first..][..GROUP].fill(0.0);
                }
                sums[WHOLE * self.stride + first] = 1.0;
                if let Some(line) = seen.first_line(row)
                    && group * LANES < seen.width
                {
                    let place = [group * LANES, line];
                    vectorised!(level, |simd| light.sum::<_, true>(
                        simd,
                        seen,
                        place,
                        (&mut *sums, self.stride)
                    ));
                }
            }
        }
    }

    /// The row before one, that row, and the one behind it, which were filled last.
    #[inline(always)]
    pub(super) fn about(&self, row: usize) -> [Row<'_>; LINES] {
        let length = KEPT * self.stride;
        let of = |row: usize| Row { stride: self.stride, sums: &self.sums[row % LINES * length..][..length] };
        [of(row - 1), of(row), of(row + 1)]
    }

    /// Writes the sums of a cell but for the scatter, which follows from them.
    #[cfg(test)]
    pub(super) fn put(&mut self, row: usize, column: usize, cell: &Cell) {
        let first = row % LINES * KEPT * self.stride + column + 1;
        for (sum, value) in cell.iter().enumerate() {
            self.sums[first + sum * self.stride] = *value;
        }
        let (count, mean, squares) = (cell[0], cell[place(0, RATIO)], cell[place(RATIO, RATIO)]);
        let scatter = if count > 0.0 { squares - mean * mean / count } else { 0.0 };
        self.sums[first + SCATTER * self.stride] = scatter;
    }
}

impl Seen<'_> {
    /// First line of a row of cells, where there is such a row.
    fn first_line(&self, row: usize) -> Option<usize> {
        let line = row.checked_sub(1)? * CELL;
        (line < self.phase.len() / self.width).then_some(line)
    }
}

impl Light<'_> {
    /// Sums the pixels from a column on, of up to four rows from one on, cell by cell: all sums, or those that show how the ratio scatters.
    #[inline(always)]
    fn sum<S: Simd, const ALL: bool>(
        &self,
        simd: S,
        seen: &Seen,
        place: [usize; 2],
        cells: (&mut [f32], usize),
    ) {
        match self.reflectance.rasters {
            Rasters::Bytes(kept) => self.sum_of::<S, ALL, u8>(simd, kept, seen, place, cells),
            Rasters::Words(kept) => self.sum_of::<S, ALL, u16>(simd, kept, seen, place, cells),
        }
    }

    #[inline(always)]
    fn sum_of<S: Simd, const ALL: bool, T: Copy + Default + Into<u16>>(
        &self,
        simd: S,
        kept: &Kept<T>,
        seen: &Seen,
        [column, row]: [usize; 2],
        (cells, stride): (&mut [f32], usize),
    ) {
        let Seen { phase, modulation, smooth, width } = *seen;
        let pixels = modulation.len();
        let levels = self.reflectance.levels;
        let white = &kept.raster(levels.white)[..pixels];
        let black = &kept.raster(levels.black)[..pixels];
        let lines = row..(row + CELL).min(pixels / width);
        let count = LANES.min(width - column);
        let least = |y: usize| {
            smooth[y * width + column..][..count]
                .iter()
                .fold(u32::MAX, |least, v| least.min(v.to_bits() << 1))
        };
        // Without its sign, the bits of a finite number are fewer than those of infinity.
        if lines.clone().fold(u32::MAX, |all, y| all.min(least(y))) >= f32::INFINITY.to_bits() << 1 {
            return;
        }
        let mut sums = [[0.0; LANES]; NOISE + 1];
        for first in lines.map(|y| y * width + column) {
            // No pixel of the outermost rows and columns is smooth: what they take for their neighbours does not matter.
            let at = [first.max(1) - 1, first + 1, first.max(width) - width, first + width]
                .map(|at| at.min(pixels - count));
            let lit = Levels {
                light: filled(white, first, count, T::default()).map(value),
                dark: filled(black, first, count, T::default()).map(value),
                clipped_dn: f32::from(self.reflectance.clipped_dn),
            };
            if count == LANES {
                let of = |at: usize| &phase[at..at + LANES];
                let here = first..first + LANES;
                let near = at.map(of);
                let line = Line {
                    smooth: &smooth[here.clone()],
                    phase: of(first),
                    modulation: &modulation[here],
                    near,
                };
                self.add::<S, ALL>(simd, &lit, &line, &mut sums);
            } else {
                let of = |values: &[f32], at: usize, rest: f32| filled::<_, LANES>(values, at, count, rest);
                let (known, own) = (of(smooth, first, f32::NAN), of(phase, first, 0.0));
                let (shown, near) = (of(modulation, first, 0.0), at.map(|at| of(phase, at, 0.0)));
                let near = [&near[0][..], &near[1], &near[2], &near[3]];
                let line = Line { smooth: &known, phase: &own, modulation: &shown, near };
                self.add::<S, ALL>(simd, &lit, &line, &mut sums);
            }
        }
        store::<ALL>(&sums, cells, stride, 1 + column / CELL);
    }

    /// Adds the pixels side by side to the sums of their columns: the products of what a cell sums, and the variance of the ratio by noise; nothing where a
    /// pixel does not count.
    #[inline(always)]
    fn add<S: Simd, const ALL: bool>(
        &self,
        simd: S,
        lit: &Levels,
        line: &Line,
        sums: &mut [Lanes; NOISE + 1],
    ) {
        let (read, gain) = (self.noise.read_variance_dn2 as f32, self.noise.gain_dn as f32);
        let of_steps = 2.0 / self.steps as f32;
        let fourth = self.footprint_px2 * self.footprint_px2;
        let turns = self.steps as f32 / std::f32::consts::TAU;
        let [zero, one] = [0.0, 1.0].map(|value| S::f32s::simd_from(simd, value));
        for part in 0..LANES / S::f32s::LEN {
            let first = part * S::f32s::LEN;
            let near = |side: usize| loaded(simd, line.near[side], first);
            let (light, dark) = (loaded(simd, &lit.light, first), loaded(simd, &lit.dark, first));
            let (x, y) = ((near(1) - near(0)) * 0.5, (near(3) - near(2)) * 0.5);
            let (range, modulation) = (light - dark, loaded(simd, line.modulation, first));
            let steep = (x * x + y * y) * 0.5;
            let ratio = modulation / range * grown::<S>(steep * self.footprint_px2);
            let of_modulation = ((light + dark) * (gain * 0.5) + read) * of_steps / (modulation * modulation);
            let of_range = ((light + dark) * gain + 2.0 * read) / (range * range);
            // The slope of the phase has noise, too, of which half the variance of a phase (that of the modulation over its square).
            let of_slope = of_modulation * (steep * fourth);
            let noise = ratio * ratio * (of_modulation + of_slope + of_range);
            let counts = loaded(simd, line.smooth, first).is_finite()
                & light.simd_lt(lit.clipped_dn)
                & range.simd_gt(0.0)
                & modulation.simd_gt(0.0);
            let mut kinds = [counts.select(one, zero), zero, zero, zero, counts.select(ratio - PLAIN, zero)];
            if ALL {
                let turn = loaded(simd, line.phase, first) * turns;
                kinds[1] = counts.select(steep, zero);
                kinds[2] = counts.select(wave::<S>(turn + 0.25), zero);
                kinds[3] = counts.select(wave::<S>(turn), zero);
            }
            add_to(simd, &mut sums[NOISE], first, counts.select(noise, zero));
            for one in 0..KINDS {
                for other in one..KINDS {
                    let at = place(one, other);
                    if ALL || ASKED.contains(&at) {
                        add_to(simd, &mut sums[at], first, kinds[one] * kinds[other]);
                    }
                }
            }
        }
    }
}

/// Adds a vector to the values from a place on.
#[inline(always)]
fn add_to<S: Simd>(simd: S, sums: &mut Lanes, first: usize, more: S::f32s) {
    put::<S>(loaded(simd, sums, first) + more, sums, first);
}

/// A grey value, DN.
#[inline(always)]
fn value<T: Into<u16>>(grey: T) -> f32 {
    f32::from(grey.into())
}

/// White and black of pixels side by side, DN.
struct Levels {
    light: Lanes,
    dark: Lanes,
    /// White from here on is clipped.
    clipped_dn: f32,
}

/// What else is known of them; the phase of their neighbours to the left, to the right, above and below.
struct Line<'a> {
    smooth: &'a [f32],
    phase: &'a [f32],
    modulation: &'a [f32],
    near: [&'a [f32]; 4],
}

/// Writes the sums of four columns each as those of cells from one on.
#[inline(always)]
fn store<const ALL: bool>(sums: &[Lanes; NOISE + 1], cells: &mut [f32], stride: usize, first: usize) {
    let mut found = [[0.0_f32; GROUP]; SUMS];
    let wanted: &[usize] = if ALL { &EVERY } else { &ASKED };
    for sum in wanted {
        for (cell, found) in found[*sum].iter_mut().enumerate() {
            let [a, b, c, d] = taken(&sums[*sum], cell * CELL);
            *found = ((a + b) + c) + d;
        }
    }
    let (mean, squares) = (found[place(0, RATIO)], found[place(RATIO, RATIO)]);
    for cell in 0..GROUP {
        let count = found[0][cell];
        found[SCATTER][cell] =
            if count > 0.0 { squares[cell] - mean[cell] * mean[cell] / count } else { 0.0 };
    }
    for sum in wanted.iter().chain([&SCATTER]) {
        cells[sum * stride + first..][..GROUP].copy_from_slice(&found[*sum]);
    }
}

/// e^x to the fourth order, which is 0.4 % too small at 1 and 1e-4 at 0.4.
#[inline(always)]
fn grown<S: Simd>(x: S::f32s) -> S::f32s {
    (((x * 0.25 + 1.0) * x * (1.0 / 3.0) + 1.0) * x * 0.5 + 1.0) * x + 1.0
}

/// A wave of period 1 that begins as a sine and differs from it by a thousandth at most.
#[inline(always)]
fn wave<S: Simd>(turn: S::f32s) -> S::f32s {
    let half = -(turn - turn.floor() - 0.5);
    let bow = half * 8.0 * (-(half.abs() * 2.0 - 1.0));
    bow * (bow.abs() * 0.225 + 0.775)
}

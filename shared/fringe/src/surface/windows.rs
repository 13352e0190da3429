//! Fits over the 5 × 5 windows of neighbouring pixels, which share the sums over their columns.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::curved::{BENT, Derivatives, missing, variance};
use super::point::View;
use super::smooth::{MAX_NOISE, MAX_ROUGHNESS};
use std::ops::Range;

/// Pixels that are worked on side by side.
pub(crate) const LANES: usize = 8;

/// Half the side of the window.
pub(super) const HALF: usize = 2;

pub(super) type Lanes = [f64; LANES];

/// A fixed number of values from `start` on; they must be there.
#[inline(always)]
pub(crate) fn taken<T: Copy + Default, const N: usize>(values: &[T], start: usize) -> [T; N] {
    let mut taken = [T::default(); N];
    taken.copy_from_slice(&values[start..start + N]);
    taken
}

/// The same in place: what was copied and is then read from other offsets waits for the copy.
#[inline(always)]
fn viewed<T, const N: usize>(values: &[T], start: usize) -> &[T; N] {
    let Some(viewed) = values[start..].first_chunk() else {
        unreachable!("the caller's windows lie in the image")
    };
    viewed
}

/// Whether the 5 × 5 window of a pixel is known to show no plane, and no quadratic, of all its samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Broken {
    pub plane: bool,
    pub quadratic: bool,
}

impl Broken {
    /// Nothing is known of the window.
    pub const UNKNOWN: Self = Self { plane: false, quadratic: false };
}

/// The least-squares fits over the windows of neighbouring pixels.
pub(super) struct Fits {
    /// The quadratic at the middle; NaN where the window is not one smooth surface.
    pub smooth: Lanes,
    /// By how much it bends more than noise does; see [`BENT`].
    pub bent: Lanes,
    /// The plane: value and derivatives by column and row; NaN where it is not one surface.
    pub value: Lanes,
    pub by_column: Lanes,
    pub by_row: Lanes,
}

/// Sums over columns of five samples, of their differences from the one in the middle. Windows that lie side by side share them.
#[derive(Debug, Clone)]
pub(super) struct Columns<const N: usize> {
    /// The sample in the middle, and the smallest and the largest one.
    middle: [f64; N],
    low: [f64; N],
    high: [f64; N],
    /// Σ d, Σ v d, Σ (v² − 2) d and Σ d² over the rows v from −2 to 2; not finite where a sample is absent.
    sum: [f64; N],
    slope: [f64; N],
    bend: [f64; N],
    squares: [f64; N],
}

impl<const N: usize> Columns<N> {
    pub const NONE: Self = {
        let none = [f64::NAN; N];
        Self { middle: none, low: none, high: none, sum: none, slope: none, bend: none, squares: none }
    };

    /// Takes five rows of so many samples as there is room for.
    #[inline(always)]
    pub fn fill(&mut self, [above, over, own, under, below]: [&[f64]; 5]) {
        let Self { middle, low, high, sum, slope, bend, squares } = self;
        let count = own.len().min(N);
        let rows = (&above[..count], &over[..count], &own[..count], &under[..count], &below[..count]);
        let ends = (&mut middle[..count], &mut low[..count], &mut high[..count]);
        let sums = (&mut sum[..count], &mut slope[..count], &mut bend[..count], &mut squares[..count]);
        for k in 0..count {
            let (a, b, m, c, d) = (rows.0[k], rows.1[k], rows.2[k], rows.3[k], rows.4[k]);
            let least = |a: f64, b: f64| if a < b { a } else { b };
            let most = |a: f64, b: f64| if a > b { a } else { b };
            ends.0[k] = m;
            ends.1[k] = least(least(a, b), least(least(c, d), m));
            ends.2[k] = most(most(a, b), most(most(c, d), m));
            let (a, b, c, d) = (a - m, b - m, c - m, d - m);
            let (outer, inner) = (a + d, b + c);
            sums.0[k] = outer + inner;
            sums.1[k] = 2.0 * (d - a) + (c - b);
            sums.2[k] = 2.0 * outer - inner;
            sums.3[k] = (a * a + d * d) + (b * b + c * c);
        }
    }

    /// Those of `M` columns from one on.
    #[inline(always)]
    pub fn part<const M: usize>(&self, first: usize) -> [&[f64; M]; 7] {
        let part = |values| viewed::<f64, M>(values, first);
        let ends = [part(&self.middle), part(&self.low), part(&self.high)];
        [ends[0], ends[1], ends[2], part(&self.sum), part(&self.slope), part(&self.bend), part(&self.squares)]
    }
}

/// As [`super::smooth`] and [`super::normals`] fit a window of 5 × 5 samples that are all there, but for rounding; `at(k, l)` is the place of column k of
/// window l among the columns.
#[inline(always)]
pub(super) fn fits<const M: usize>(
    [middle, low, high, sums, slopes, bends, squares]: [&[f64; M]; 7],
    at: impl Fn(usize, usize) -> usize,
    [sigma, own]: [&Lanes; 2],
    (max_step, pitch): (f64, f64),
) -> Fits {
    let zero = [0.0; LANES];
    let mut out = Fits { smooth: zero, bent: zero, value: zero, by_column: zero, by_row: zero };
    for l in 0..LANES {
        let centre = middle[at(HALF, l)];
        let (mut line, mut by_v, mut by_vv, mut square, mut worst) = ([0.0; 5], 0.0, 0.0, 0.0, 0.0);
        for (k, line) in line.iter_mut().enumerate() {
            let k = at(k, l);
            let off = middle[k] - centre;
            *line = sums[k] + 5.0 * off;
            square += squares[k] + off * (sums[k] + *line);
            by_v += slopes[k];
            by_vv += bends[k];
            let (above, below) = (high[k] - centre, centre - low[k]);
            worst = if above > worst { above } else { worst };
            worst = if below > worst { below } else { worst };
        }
        let slope = |k: usize| slopes[at(k, l)];
        let (outer, inner) = (line[0] + line[4], line[1] + line[3]);
        let (sum, by_uu) = (outer + inner + line[2], 2.0 * (outer - line[2]) - inner);
        let by_u = 2.0 * (line[4] - line[0]) + (line[3] - line[1]);
        let by_uv = 2.0 * (slope(4) - slope(0)) + (slope(3) - slope(1));
        // Norms of the polynomials 1, u, uv, u² − 2: 25, 50, 100, 70.
        let slope2 = (by_u * by_u + by_v * by_v) * (1.0 / (50.0 * 50.0));
        let bend = (by_uu * by_uu + by_vv * by_vv) * (1.0 / 70.0) + by_uv * by_uv * (1.0 / 100.0);
        let explained = sum * sum * (1.0 / 25.0) + (by_u * by_u + by_v * by_v) * (1.0 / 50.0) + bend;
        let residual = (square - explained) * (1.0 / 19.0);
        let noise = MAX_NOISE * sigma[l];
        let limit = noise * noise + MAX_ROUGHNESS * MAX_ROUGHNESS * slope2 + 1e-12 * square;
        let connected = worst <= max_step * HALF as f64 * centre.abs() + 2.0 * noise;
        let derivatives = Derivatives {
            u: by_u * (1.0 / 50.0),
            v: by_v * (1.0 / 50.0),
            uu: by_uu * (2.0 / 70.0),
            uv: by_uv * (1.0 / 100.0),
            vv: by_vv * (2.0 / 70.0),
        };
        let missing = missing(HALF, derivatives, [centre, sigma[l], own[l]], pitch);
        let smooth = centre + (sum * (1.0 / 25.0) - (by_uu + by_vv) * (2.0 / 70.0) + missing);
        // An absent sample makes the sums NaN, and the comparison false.
        out.smooth[l] = if (residual <= limit) & connected { smooth } else { f64::NAN };
        out.bent[l] = bend - BENT * variance(sigma[l], own[l]);
        let one = worst <= max_step * centre.abs() + 6.0 * sigma[l];
        out.value[l] = if one { centre + sum * (1.0 / 25.0) } else { f64::NAN };
        out.by_column[l] = by_u * (1.0 / 50.0);
        out.by_row[l] = by_v * (1.0 / 50.0);
    }
    out
}

/// Pixels of a row whose windows are prepared together.
const BLOCK: usize = 64;

/// The columns of the windows of some pixels of a row.
#[derive(Debug, Clone)]
pub(super) struct Block {
    columns: Columns<{ BLOCK + 2 * HALF }>,
    /// First pixel, and one behind the last.
    pixels: Range<usize>,
}

impl Block {
    pub const NONE: Self = Self { columns: Columns::NONE, pixels: 0..0 };

    /// The columns of the pixels from `at` on, whose windows lie in the image.
    #[inline(always)]
    pub fn columns(&mut self, view: &View, depths: &[f64], at: usize) -> [&[f64; LANES + 2 * HALF]; 7] {
        let width = view.width;
        if at < self.pixels.start || at + LANES > self.pixels.end {
            let end = (at + BLOCK + HALF).min((at / width + 1) * width);
            let row =
                |r: usize| &depths[at + r * width - HALF * width - HALF..end + r * width - HALF * width];
            self.columns.fill([row(0), row(1), row(2), row(3), row(4)]);
            self.pixels = at..end - HALF;
        }
        self.columns.part(at - self.pixels.start)
    }
}

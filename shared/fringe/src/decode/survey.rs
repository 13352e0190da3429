//! Derivatives of a phase map: the least-squares quadratic over 5 × 5 pixels about each pixel.
//!
//! Those of the modulation are differences of two pixels to each side instead. A surface is smooth, its reflectance need not be: 5 × 5 pixels smooth
//! a texture away whose grain is as fine as a pixel, and with it most of what it does to the phase. The differences add s² |∇φ| of its own noise to a
//! phase, in squares (0.08 where a fringe is 25 px wide); the smoothing of points takes most of that out.
//!
//! The sums of a window are sums of its rows, and a row's sums serve five windows: they are made once, for a tile that fits the second
//! cache, relative to the pixel in the middle of the row. A window then joins five of them.

// A tile is a local array so that it stays in the cache.
#![allow(clippy::large_stack_arrays)]

use super::contrast_bins::{ALIKE, BINS, Bins, FIRST_BITS, GROUPS, ROWS, Reflectance};
use super::rasters::{Kept, Rasters};
use crate::math::simd::{loaded, put, taken};
use crate::phase::PhaseViewMut;
use fearless_simd::{Select, Simd, SimdBase, SimdFrom};

/// Half the edge of the neighbourhood.
const HALF: usize = 2;
/// Σ x² over the 5 × 5 neighbourhood.
const SUM_X2: f32 = 50.0;
/// Σ (x² − 2)² over the neighbourhood.
const SUM_Q2: f32 = 70.0;
/// Σ x² y² over the neighbourhood.
const SUM_XY2: f32 = 100.0;
/// Times the derivative of the modulation, which is that of the polynomial through five pixels.
const SLOPE_DIVISOR: f32 = 12.0;
/// A neighbourhood is smooth when its residual stays within so many times the phase noise, plus this many rad.
const SMOOTH_SIGMAS: f32 = 3.0;
const SMOOTH_RAD: f32 = 0.02;
/// Its slope counts for the footprint where the residual's square stays within that of so many times the phase noise, and of
/// [`SMOOTH_RAD`]: noise is 19 such squares, ± 6. What three times the noise hides of a crease or a limb takes contrast away.
const COUNTED_SIGMAS: f32 = 1.5;
/// The cubic through a neighbourhood along x or along y stays within so many times its noise, plus [`SMOOTH_RAD`]. A pixel that its footprint shares
/// with the dark, or with a face behind, lies off in the outermost row of the window two pixels farther in: there it bends the quadratic, which
/// would shift a good phase by a seventh of s² times as much. Its cubic is 0.7 of what it is off, and that of a surface much less. Beyond this, no bias is
/// known, and none is taken off.
const CUBIC_SIGMAS: f32 = 4.0;
/// Σ of the squared weights of the cubic over the neighbourhood.
const SUM_C2: f32 = 50.0;
/// Pixels that are worked on side by side, as vectors; narrower images are left alone.
const LANES: usize = 16;
/// Groups of them in a tile: wide enough that rows of a large image, each of which lies on pages of its own, are read in long pieces (at 13.5 megapixels, 8
/// take a fifth more of the decoder's time), and few enough for the second cache.
const TILE: usize = 32;
/// Rows that a window reaches.
const LINES: usize = 2 * HALF + 1;
/// Bin of a pixel that is not counted.
const NO_BIN: u32 = u32::MAX;

/// What a survey of the phase looks at.
#[derive(Clone, Copy)]
pub struct Survey<'a> {
    /// Phase map whose derivatives are taken.
    pub map: &'a PhaseViewMut<'a>,
    /// The frames that give the reflectance, where there are any.
    pub reflectance: Option<&'a Reflectance<'a>>,
    /// Variances of the footprint along x and y over their mean; [1, 1] where it is round.
    pub shape: [f32; 2],
    /// Width of the image, px.
    pub width: usize,
}

/// What a footprint of the variance s² does to the phase of some pixels, in the order of their places: s² bias + s⁴ fourth.
pub struct Bias<'a> {
    /// The part of second order, rad/px²; NaN where the neighbourhood is not one smooth surface.
    pub second: &'a mut [f32],
    /// The part of fourth order, rad/px⁴; says nothing where the other is NaN.
    pub fourth: &'a mut [f32],
}

/// One value for each of the pixels side by side.
type Lanes = [f32; LANES];

/// Sums over the five pixels of a row about each pixel, u = −2 … 2, v = phase less that of the middle one.
#[derive(Clone, Copy)]
struct RowSums {
    /// Σ v, the sum of the differences.
    flat: Lanes,
    /// Σ u v, for the slope.
    slope: Lanes,
    /// Σ (u² − 2) v.
    curve: Lanes,
    /// Σ (−1, 2, 0, −2, 1) v, of which all that is quadratic has none.
    cubic: Lanes,
    /// Σ v², for the residual.
    squares: Lanes,
    /// Phase of the middle pixel.
    middle: Lanes,
}

impl RowSums {
    const ZERO: Self = Self {
        flat: [0.0; LANES],
        slope: [0.0; LANES],
        curve: [0.0; LANES],
        cubic: [0.0; LANES],
        squares: [0.0; LANES],
        middle: [0.0; LANES],
    };

    /// The sums of the pixels of a row from two behind `at` on. Each offset is read by itself: to shift what was read costs more.
    #[inline(always)]
    fn fill<S: Simd>(&mut self, simd: S, phase: &[f32], at: usize) {
        let phase = &phase[at..at + LANES + 2 * HALF];
        for part in 0..LANES / S::f32s::LEN {
            let first = part * S::f32s::LEN;
            let [p0, p1, m, p3, p4] = beside(simd, phase, first);
            let (v0, v1, v3, v4) = (p0 - m, p1 - m, p3 - m, p4 - m);
            put::<S>(m, &mut self.middle, first);
            put::<S>((v0 + v4) + (v1 + v3), &mut self.flat, first);
            let (outer, inner) = (v4 - v0, v3 - v1);
            put::<S>(outer * 2.0 + inner, &mut self.slope, first);
            put::<S>(outer - inner * 2.0, &mut self.cubic, first);
            put::<S>((v0 + v4) * 2.0 - (v1 + v3), &mut self.curve, first);
            put::<S>((v0 * v0 + v4 * v4) + (v1 * v1 + v3 * v3), &mut self.squares, first);
        }
    }
}

/// The modulation of a map, about the pixels from a place on.
#[derive(Clone, Copy)]
struct Light<'a> {
    modulation: &'a [f32],
    at: usize,
    width: usize,
}

impl Light<'_> {
    /// That of the pixels `away` from those from `first` on.
    #[inline(always)]
    fn beside<S: Simd>(self, simd: S, first: usize, away: isize) -> S::f32s {
        loaded(simd, self.modulation, (self.at + first).wrapping_add_signed(away))
    }

    /// [`SLOPE_DIVISOR`] times the derivative where neighbours are `next` pixels apart, from two to each side.
    #[inline(always)]
    fn slope<S: Simd>(self, simd: S, first: usize, next: usize) -> S::f32s {
        let next = next as isize;
        let at = |steps: isize| self.beside(simd, first, steps * next);
        (at(1) - at(-1)) * 8.0 - (at(2) - at(-2))
    }
}

/// Five vectors of a row, each from the next value on.
#[inline(always)]
fn beside<S: Simd>(simd: S, row: &[f32], first: usize) -> [S::f32s; 5] {
    let at = |offset: usize| loaded(simd, row, first + offset);
    [at(0), at(1), at(2), at(3), at(4)]
}

/// The same part of five rows.
#[inline(always)]
fn above<S: Simd>(simd: S, [a, b, c, d, e]: [&Lanes; 5], first: usize) -> [S::f32s; 5] {
    let of = |row: &Lanes| loaded(simd, row, first);
    [of(a), of(b), of(c), of(d), of(e)]
}

/// The parts of the bias (see [`Bias`] and `footprint`) and |∇φ|² of the pixels whose five rows are given; NaN where they are not one smooth
/// surface. What belongs to x and to y is weighted by the shape of the footprint.
#[inline(always)]
fn window<S: Simd>(
    simd: S,
    [a, b, c, d, e]: [&RowSums; 5],
    (sigma_rad, light): (&Lanes, Light),
    [along_x, along_y]: [f32; 2],
) -> [Lanes; 3] {
    let [mut second, mut fourth, mut slope2] = [[0.0; LANES]; 3];
    let nothing = S::f32s::simd_from(simd, f32::NAN);
    for part in 0..LANES / S::f32s::LEN {
        let first = part * S::f32s::LEN;
        let middle = above(simd, [&a.middle, &b.middle, &c.middle, &d.middle, &e.middle], first);
        let flat = above(simd, [&a.flat, &b.flat, &c.flat, &d.flat, &e.flat], first);
        let squares = above(simd, [&a.squares, &b.squares, &c.squares, &d.squares, &e.squares], first);
        let (mut g, mut d2) = (flat, S::f32s::simd_from(simd, 0.0));
        for r in 0..5 {
            // The middle of the row less that of the window.
            let v = middle[r] - middle[2];
            g[r] = flat[r] + v * 5.0;
            d2 += squares[r] + v * (flat[r] + g[r]);
        }
        let (total, dy) = (across::<S>(g), along::<S>(g));
        let dyy = (g[0] + g[4] - g[2]) * 2.0 - (g[1] + g[3]);
        let slope = above(simd, [&a.slope, &b.slope, &c.slope, &d.slope, &e.slope], first);
        let (dx, dxy) = (across::<S>(slope), along::<S>(slope));
        let dxx = across::<S>(above(simd, [&a.curve, &b.curve, &c.curve, &d.curve, &e.curve], first));
        let cubic = across::<S>(above(simd, [&a.cubic, &b.cubic, &c.cubic, &d.cubic, &e.cubic], first));
        let cubic_down = (g[4] - g[0]) - (g[3] - g[1]) * 2.0;
        let explained = total * total * (1.0 / 25.0)
            + (dx * dx + dy * dy) * (1.0 / SUM_X2)
            + (dxx * dxx + dyy * dyy) * (1.0 / SUM_Q2)
            + dxy * dxy * (1.0 / SUM_XY2);
        let noise = loaded(simd, sigma_rad, first);
        let (limit, least) = (noise * SMOOTH_SIGMAS + SMOOTH_RAD, noise * COUNTED_SIGMAS);
        let lit = light.beside(simd, first, 0);
        // 25 values, six parameters. A masked neighbour makes the sum NaN, and NaN is not within the limit.
        let rest = d2 - explained;
        let bent = noise * CUBIC_SIGMAS + SMOOTH_RAD;
        let even = (cubic * cubic).max(cubic_down * cubic_down).simd_le(bent * bent * SUM_C2);
        let smooth = rest.simd_le(limit * 19.0 * limit) & lit.simd_gt(0.0);
        let counted = smooth & rest.simd_le((least * least + SMOOTH_RAD * SMOOTH_RAD) * 19.0);
        let (x, y) = (dx * (1.0 / SUM_X2), dy * (1.0 / SUM_X2));
        let shading = S::f32s::simd_from(simd, 1.0) / (lit * SLOPE_DIVISOR);
        let (u, v) = (light.slope(simd, first, 1) * shading, light.slope(simd, first, light.width) * shading);
        let (gx, gy) = (x * along_x, y * along_y);
        let curve = (dxx * along_x + dyy * along_y) * (1.0 / SUM_Q2);
        let value = curve + (u * x * along_x + v * y * along_y);
        // ½ gᵀ H g, H the second derivatives.
        let (half_xx, half_yy, xy) = (dxx * (1.0 / SUM_Q2), dyy * (1.0 / SUM_Q2), dxy * (1.0 / SUM_XY2));
        let zero = S::f32s::simd_from(simd, 0.0);
        put::<S>(even.select(gx * gx * half_xx + gy * gy * half_yy + gx * gy * xy, zero), &mut fourth, first);
        put::<S>(smooth.select(even.select(value, zero), nothing), &mut second, first);
        put::<S>(counted.select(x * x * along_x + y * y * along_y, nothing), &mut slope2, first);
    }
    [second, fourth, slope2]
}

/// Sum of five values.
#[inline(always)]
fn across<S: Simd>(v: [S::f32s; 5]) -> S::f32s {
    (v[0] + v[4]) + (v[1] + v[3]) + v[2]
}

/// Sum of five values, each times its place from −2 on.
#[inline(always)]
fn along<S: Simd>(v: [S::f32s; 5]) -> S::f32s {
    (v[4] - v[0]) * 2.0 + (v[3] - v[1])
}

impl Survey<'_> {
    /// Fills the bias of up to [`ROWS`] rows from `row` on, where it is known, and adds them to the bins.
    #[inline(always)]
    pub fn rows<S: Simd>(&self, simd: S, row: usize, bias: &mut Bias, bins: &mut Bins) {
        let (width, height) = (self.width, self.map.phase_rad.len() / self.width);
        let (first, last) = (row.max(HALF), (row + ROWS).min(height.saturating_sub(HALF)));
        if first >= last || width < LANES + 2 * HALF {
            return;
        }
        let end = width - HALF;
        let mut sums = [[RowSums::ZERO; TILE]; LINES];
        for column in (HALF..end).step_by(TILE * LANES) {
            let tile = TILE.min((end - column).div_ceil(LANES));
            // The last group of a row reaches back, so that it ends with the row.
            let start = |group: usize| (column + group * LANES).min(end - LANES);
            let lit = |y: usize| {
                self.map.valid[y * width + start(0)..y * width + start(tile - 1) + LANES].contains(&1)
            };
            if !(first..last).any(lit) {
                continue;
            }
            for below in first - HALF..last + HALF {
                // The sums of a row take the place of those that no window reaches any more.
                for (group, sums) in sums[below % LINES][..tile].iter_mut().enumerate() {
                    let at = below * width + start(group) - HALF;
                    sums.fill(simd, self.map.phase_rad, at);
                }
                let Some(y) = below.checked_sub(HALF).filter(|y| *y >= first && lit(*y)) else { continue };
                // Not over the rows of sums: five of them serve each group.
                for (group, at) in (0..tile).map(|group| (group, y * width + start(group))) {
                    let mut rows = [&sums[0][group]; LINES];
                    for (r, row) in rows.iter_mut().enumerate() {
                        *row = &sums[(y + r - HALF) % LINES][group];
                    }
                    // A tile may reach far beyond the part.
                    if taken::<u8, LANES>(self.map.valid, at).iter().fold(0, |any, valid| any | valid) == 0 {
                        continue;
                    }
                    let modulation = taken(self.map.modulation, at);
                    let light = Light { modulation: self.map.modulation, at, width };
                    let [second, fourth, slope2] =
                        window(simd, rows, (&taken(self.map.sigma_rad, at), light), self.shape);
                    bias.second[at - row * width..][..LANES].copy_from_slice(&second);
                    bias.fourth[at - row * width..][..LANES].copy_from_slice(&fourth);
                    let counted = column + group * LANES - start(group);
                    self.add_to_bins(simd, at, counted, (&slope2, &modulation), y % GROUPS, bins);
                }
            }
        }
    }

    /// Adds the pixels from `at` on, but for the first ones that were counted before.
    #[inline(always)]
    fn add_to_bins<S: Simd>(
        &self,
        simd: S,
        at: usize,
        counted: usize,
        (slope2, modulation): (&Lanes, &Lanes),
        group: usize,
        bins: &mut Bins,
    ) {
        let Some(light) = self.reflectance else { return };
        let reflectance = match light.rasters {
            Rasters::Bytes(kept) => light.read(kept, at),
            Rasters::Words(kept) => light.read(kept, at),
        };
        let mut places = [NO_BIN; LANES];
        for i in 0..LANES {
            // Four bins to the octave, read from the bits of the number.
            let bits = (slope2[i].to_bits() >> 21).max(FIRST_BITS as u32);
            let place = (bits - FIRST_BITS as u32).min(BINS as u32 - 1);
            #[allow(clippy::needless_bitwise_bool, reason = "without branches the loop vectorises")]
            let known = (slope2[i] >= 0.0) & (reflectance[i] > 0.0) & (i >= counted);
            places[i] = if known { place } else { NO_BIN };
        }
        for first in (0..LANES).step_by(ALIKE) {
            let part = first..first + ALIKE;
            let place = places[first];
            let alike = places[part.clone()].iter().fold(0, |other, bin| other | (*bin ^ place)) == 0;
            if alike && place == NO_BIN {
                continue;
            }
            if alike {
                let sums = &mut bins[place as usize][group];
                sums.add_together(simd, [modulation, &reflectance, slope2], first);
                continue;
            }
            for i in part.filter(|i| places[*i] != NO_BIN) {
                let sums = &mut bins[places[i] as usize][group];
                sums.add(&modulation[i..=i], &reflectance[i..=i], &slope2[i..=i]);
            }
        }
    }
}

impl Reflectance<'_> {
    /// White less black from pixel `at` on, DN; 0 where white is clipped or not brighter.
    #[inline(always)]
    fn read<T: Copy + Into<u16>>(&self, kept: &Kept<T>, at: usize) -> Lanes {
        let white = &kept.raster(self.levels.white)[at..][..LANES];
        let black = &kept.raster(self.levels.black)[at..][..LANES];
        let mut out = [0.0; LANES];
        for ((out, white), black) in out.iter_mut().zip(white).zip(black) {
            let (white, black): (u16, u16) = ((*white).into(), (*black).into());
            #[allow(clippy::needless_bitwise_bool, reason = "without branches the loop vectorises")]
            let usable = (white < self.clipped_dn) & (white > black);
            *out = if usable { f32::from(white.wrapping_sub(black)) } else { 0.0 };
        }
        out
    }
}

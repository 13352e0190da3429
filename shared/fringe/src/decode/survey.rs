//! Derivatives of a phase map: the least-squares quadratic over 5 × 5 pixels about each pixel.
//!
//! The sums of a window are sums of its rows, and a row's sums serve five windows: they are made once, for a tile that fits the first
//! cache, relative to the pixel in the middle of the row. A window then joins five of them.

// A tile is a local array so that it stays in the first cache.
#![allow(clippy::large_stack_arrays)]

use super::contrast_bins::{ALIKE, BINS, Bins, FIRST_BITS, GROUPS, ROWS, Reflectance};
use super::rasters::Rasters;
use crate::math::simd::taken;
use crate::phase::PhaseViewMut;

/// Half the edge of the neighbourhood.
const HALF: usize = 2;
/// Σ x² over the 5 × 5 neighbourhood.
const SUM_X2: f32 = 50.0;
/// Σ (x² − 2)² over the neighbourhood.
const SUM_Q2: f32 = 70.0;
/// Σ x² y² over the neighbourhood.
const SUM_XY2: f32 = 100.0;
/// A neighbourhood is smooth when its residual stays within so many times the phase noise, plus this many rad.
const SMOOTH_SIGMAS: f32 = 3.0;
const SMOOTH_RAD: f32 = 0.02;
/// Pixels that are worked on side by side, as vectors; narrower images are left alone.
const LANES: usize = 16;
/// Groups of them in a tile.
const TILE: usize = 8;
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
    /// What is known of the footprint beforehand.
    pub expected: Expected,
    /// Width of the image, px.
    pub width: usize,
}

/// A footprint as it is known before the frames are asked.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// Variances along x and y over their mean; [1, 1] where it is round.
    pub shape: [f32; 2],
    /// Their mean, for the terms of fourth order, px².
    pub variance_px2: f32,
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
    /// Σ v², for the residual.
    squares: Lanes,
    /// Σ B, the sum of the modulation.
    light: Lanes,
    /// Σ u B, for the slope of the modulation.
    light_slope: Lanes,
    /// Phase of the middle pixel.
    middle: Lanes,
}

impl RowSums {
    const ZERO: Self = Self {
        flat: [0.0; LANES],
        slope: [0.0; LANES],
        curve: [0.0; LANES],
        squares: [0.0; LANES],
        light: [0.0; LANES],
        light_slope: [0.0; LANES],
        middle: [0.0; LANES],
    };

    /// The sums of the pixels of a row from two behind `at` on, from the phase and the modulation of the map. Each offset is read by itself:
    /// what was copied and is then read from other offsets waits for the copy.
    #[inline(always)]
    fn new(phase: &[f32], light: &[f32], at: usize) -> Self {
        let mut sums = Self::ZERO;
        let (p0, p1): (Lanes, Lanes) = (taken(phase, at), taken(phase, at + 1));
        let (middle, p3): (Lanes, Lanes) = (taken(phase, at + 2), taken(phase, at + 3));
        let p4: Lanes = taken(phase, at + 4);
        for i in 0..LANES {
            let m = middle[i];
            let (v0, v1, v3, v4) = (p0[i] - m, p1[i] - m, p3[i] - m, p4[i] - m);
            sums.middle[i] = m;
            sums.flat[i] = (v0 + v4) + (v1 + v3);
            sums.slope[i] = 2.0 * (v4 - v0) + (v3 - v1);
            sums.curve[i] = 2.0 * (v0 + v4) - (v1 + v3);
            sums.squares[i] = (v0 * v0 + v4 * v4) + (v1 * v1 + v3 * v3);
        }
        let (l0, l1): (Lanes, Lanes) = (taken(light, at), taken(light, at + 1));
        let (l2, l3): (Lanes, Lanes) = (taken(light, at + 2), taken(light, at + 3));
        let l4: Lanes = taken(light, at + 4);
        for i in 0..LANES {
            let (b0, b1, b2, b3, b4) = (l0[i], l1[i], l2[i], l3[i], l4[i]);
            sums.light[i] = (b0 + b4) + (b1 + b3) + b2;
            sums.light_slope[i] = 2.0 * (b4 - b0) + (b3 - b1);
        }
        sums
    }
}

/// The bias of the phase over the variance of the footprint (see `footprint`) and |∇φ|² of the pixels whose five rows are given; NaN where they
/// are not one smooth surface. What belongs to x and to y is weighted by the shape of the footprint.
#[inline(always)]
fn window(rows: [&RowSums; 5], sigma_rad: &Lanes, modulation: &Lanes, expected: &Expected) -> (Lanes, Lanes) {
    let [along_x, along_y] = expected.shape;
    let (mut bias, mut slope2) = ([0.0; LANES], [0.0; LANES]);
    let (mut gx, mut gy) = ([0.0; LANES], [0.0; LANES]);
    let (mut half_xx, mut half_yy, mut xy) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let m = rows[2].middle[i];
        let (mut g, mut slope, mut curve) = ([0.0_f32; 5], [0.0_f32; 5], [0.0_f32; 5]);
        let (mut light, mut light_slope) = ([0.0_f32; 5], [0.0_f32; 5]);
        let mut d2 = 0.0;
        for r in 0..5 {
            // The middle of the row less that of the window.
            let v = rows[r].middle[i] - m;
            g[r] = rows[r].flat[i] + 5.0 * v;
            d2 += rows[r].squares[i] + v * (rows[r].flat[i] + g[r]);
            (slope[r], curve[r]) = (rows[r].slope[i], rows[r].curve[i]);
            (light[r], light_slope[r]) = (rows[r].light[i], rows[r].light_slope[i]);
        }
        let d = across(g);
        let (dx, dxx) = (across(slope), across(curve));
        let (dy, dyy) = (along(g), 2.0 * (g[0] + g[4] - g[2]) - (g[1] + g[3]));
        let dxy = along(slope);
        let explained = d * d * (1.0 / 25.0)
            + (dx * dx + dy * dy) * (1.0 / SUM_X2)
            + (dxx * dxx + dyy * dyy) * (1.0 / SUM_Q2)
            + dxy * dxy * (1.0 / SUM_XY2);
        let limit = SMOOTH_SIGMAS * sigma_rad[i] + SMOOTH_RAD;
        // 25 values, six parameters. A masked neighbour makes the sum NaN, and NaN is not within the limit.
        #[allow(clippy::needless_bitwise_bool, reason = "without branches the loop vectorises")]
        let smooth = (d2 - explained <= 19.0 * limit * limit) & (modulation[i] > 0.0);
        let (x, y) = (dx * (1.0 / SUM_X2), dy * (1.0 / SUM_X2));
        let shading = 1.0 / (SUM_X2 * modulation[i]);
        let (u, v) = (across(light_slope) * shading, along(light) * shading);
        let curve = (along_x * dxx + along_y * dyy) * (1.0 / SUM_Q2);
        let value = curve + (along_x * (u * x) + along_y * (v * y));
        bias[i] = if smooth { value } else { f32::NAN };
        slope2[i] = if smooth { along_x * (x * x) + along_y * (y * y) } else { f32::NAN };
        (gx[i], gy[i]) = (along_x * x, along_y * y);
        (half_xx[i], half_yy[i], xy[i]) = (dxx * (1.0 / SUM_Q2), dyy * (1.0 / SUM_Q2), dxy * (1.0 / SUM_XY2));
    }
    // ½ gᵀ H g, H the second derivatives. In a loop of its own: with it the one above needs more registers than there are.
    for i in 0..LANES {
        let (g, h) = (gx[i], gy[i]);
        bias[i] += expected.variance_px2 * (g * g * half_xx[i] + h * h * half_yy[i] + g * h * xy[i]);
    }
    (bias, slope2)
}

/// Sum of five values. No closure: where a closure is not inlined, it is compiled for the plainest processor.
#[inline(always)]
fn across(v: [f32; 5]) -> f32 {
    (v[0] + v[4]) + (v[1] + v[3]) + v[2]
}

/// Sum of five values, each times its place from −2 on.
#[inline(always)]
fn along(v: [f32; 5]) -> f32 {
    2.0 * (v[4] - v[0]) + (v[3] - v[1])
}

impl Survey<'_> {
    /// Fills the bias over the variance of up to [`ROWS`] rows from `row` on, where it is known, and adds them to the bins.
    #[inline(always)]
    pub fn rows(&self, row: usize, bias: &mut [f32], bins: &mut Bins) {
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
                    *sums = RowSums::new(self.map.phase_rad, self.map.modulation, at);
                }
                let Some(y) = below.checked_sub(HALF).filter(|y| *y >= first && lit(*y)) else { continue };
                // Not over the rows of sums: five of them serve each group.
                for (group, at) in (0..tile).map(|group| (group, y * width + start(group))) {
                    let mut rows = [&sums[0][group]; LINES];
                    for (r, row) in rows.iter_mut().enumerate() {
                        *row = &sums[(y + r - HALF) % LINES][group];
                    }
                    let modulation = taken(self.map.modulation, at);
                    let (found, slope2) =
                        window(rows, &taken(self.map.sigma_rad, at), &modulation, &self.expected);
                    bias[at - row * width..][..LANES].copy_from_slice(&found);
                    let counted = column + group * LANES - start(group);
                    self.add_to_bins(at, counted, (&slope2, &modulation), y % GROUPS, bins);
                }
            }
        }
    }

    /// Adds the pixels from `at` on, but for the first ones that were counted before.
    #[inline(always)]
    fn add_to_bins(
        &self,
        at: usize,
        counted: usize,
        (slope2, modulation): (&Lanes, &Lanes),
        group: usize,
        bins: &mut Bins,
    ) {
        let Some(light) = self.reflectance else { return };
        let pixels = self.map.valid.len();
        let reflectance = match light.rasters {
            Rasters::Bytes(data) => light.read(data, pixels, at),
            Rasters::Words(data) => light.read(data, pixels, at),
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
                sums.add_together(taken(modulation, first), taken(&reflectance, first), taken(slope2, first));
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
    fn read<T: Copy + Into<u16>>(&self, data: &[T], pixels: usize, at: usize) -> Lanes {
        let white = &data[self.levels.white * pixels + at..][..LANES];
        let black = &data[self.levels.black * pixels + at..][..LANES];
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

//! The pixel's footprint: what it does to the phase, how large it is, and how its bias is removed.
//!
//! A pixel does not see a point. Its light, and so its phasor R e^{iφ}, is an average over the pixel's area and the lens
//! blur, a weight w of variance s² per axis: Z = w ∗ R e^{iφ}. To second order in s
//!
//! ```text
//! arg Z = φ + s² (½ ∇²φ + ∇ln R · ∇φ),      |Z| = R (1 − ½ s² |∇φ|²) + ½ s² ∇²R
//! ```
//!
//! The first says that curvature and shading shift the phase; a sphere measured by two cameras comes out too large by
//! some s² times the square of the pixel's size over its radius, 5 to 12 µm at 0.2 mm per pixel. The second says how to
//! find s² without knowing the lens: steep fringes lose modulation. The difference of white and black is R with the
//! same ½ s² ∇²R, so over the image
//!
//! ```text
//! ln (B / (white − black)) = constant − ½ s² |∇φ|²
//! ```
//!
//! is a straight line against |∇φ|². The constant holds the projector's contrast and blur, which do not depend on the
//! camera. The estimate is joined with what is known of lenses, by inverse variance. Where the surface is all of one slope
//! there is no line, but nothing to correct either.
//!
//! Derivatives are those of a least-squares quadratic over 5 × 5 pixels, all of them valid and smooth.

use super::accumulate::Rasters;
use super::roles::Levels;
use crate::math::ln;
use crate::phase::PhaseViewMut;
use rayon::prelude::*;

/// Half the edge of the neighbourhood.
const HALF: usize = 2;
/// Σ x² over the 5 × 5 neighbourhood.
const SUM_X2: f32 = 50.0;
/// Σ (x² − 2)² over the neighbourhood.
const SUM_Q2: f32 = 70.0;
/// Σ x² y² over the neighbourhood.
const SUM_XY2: f32 = 100.0;
/// Weight of the middle pixel in the Laplacian, and the sum of all squared weights.
const LAPLACIAN_MIDDLE: f64 = -8.0 / 70.0;
const LAPLACIAN_POWER: f64 = 8.0 / 70.0;
/// A neighbourhood is smooth when its residual stays within so many times the phase noise, plus this many rad.
const SMOOTH_SIGMAS: f32 = 3.0;
const SMOOTH_RAD: f32 = 0.02;
/// Bins along |∇φ|², four to the octave from 2⁻¹⁰ rad²/px² on; the last one has no end.
const BINS: usize = 40;
const FIRST_BITS: usize = (127 - 10) << 2;
/// Rows are dealt to so many groups; the scatter of the groups gives the uncertainty of a bin.
const GROUPS: usize = 8;
/// Fewer pixels in a group of a bin say nothing.
const LEAST_IN_GROUP: u32 = 20;
/// What is known before the frames are asked: the area of a pixel (1/12 px²) and a lens in focus (0.2 to 0.5 px), and
/// its standard uncertainty. The frames outweigh it where they show slopes and little noise; it holds the estimate
/// where light between surfaces, which steep places get more of, bends the line.
const LENS_PX2: f64 = 0.2;
const LENS_U_PX2: f64 = 0.12;
/// A variance below this, px², moves no phase that could be measured.
const LEAST_PX2: f64 = 0.005;
/// Beyond this the expansion to second order does not hold and the image is out of focus.
const MOST_PX2: f64 = 0.6;
/// Pixels that are worked on side by side; narrower images are left alone.
const LANES: usize = 8;
/// Rows of one parallel job; a multiple of `GROUPS`.
const ROWS: usize = 16;

/// The frames that give R, and the grey value from which they do not.
#[derive(Debug, Clone, Copy)]
pub struct Reflectance<'a> {
    /// The stored frames of the sequence.
    pub rasters: &'a Rasters,
    /// Where white and black lie among the stored frames.
    pub levels: Levels,
    /// A white frame from here on is clipped.
    pub clipped_dn: u16,
}

/// Memory of the estimate and the correction, reserved once.
#[derive(Debug)]
pub struct Footprint {
    width: usize,
    /// ½ ∇²φ + ∇ln R · ∇φ, rad/px²; NaN where the neighbourhood is not smooth.
    bias: Vec<f32>,
    jobs: Vec<Bins>,
}

/// Sums over the pixels of a group in a bin. Ratios of sums have no bias from noise, as means of logarithms would.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    modulation: f64,
    reflectance: f64,
    slope2: f64,
    count: u32,
}

type Bins = [[Sums; GROUPS]; BINS];

/// A point of the line.
#[derive(Debug, Clone, Copy)]
struct Place {
    slope2: f64,
    log_contrast: f64,
    weight: f64,
}

/// Derivatives of the phase and the modulation at one pixel.
#[derive(Debug, Clone, Copy)]
struct Local {
    gradient: [f32; 2],
    laplacian: f32,
    /// ∇B/B, 1/px, by column and row.
    shading: [f32; 2],
}

impl Footprint {
    /// Allocates the buffers for images of one size.
    pub fn new(width: usize, pixels: usize) -> Self {
        let jobs = (pixels / width.max(1)).div_ceil(ROWS);
        let empty = [[Sums::default(); GROUPS]; BINS];
        Self { width, bias: vec![f32::NAN; pixels], jobs: vec![empty; jobs] }
    }

    /// Derivatives of the whole map, and from them the variance s² of the footprint, px²; `None` where the frames do
    /// not determine it.
    pub fn survey(&mut self, map: &PhaseViewMut, reflectance: Option<Reflectance>) -> Option<f64> {
        let width = self.width;
        let rows = self.bias.len() / width;
        let parts = self.bias.par_chunks_mut(ROWS * width).zip(&mut self.jobs).enumerate();
        parts.for_each(|(chunk, (bias, bins))| {
            *bins = [[Sums::default(); GROUPS]; BINS];
            bias.fill(f32::NAN);
            for (offset, line) in bias.chunks_mut(width).enumerate() {
                let row = chunk * ROWS + offset;
                if (HALF..rows.saturating_sub(HALF)).contains(&row) {
                    survey_row(map, reflectance.as_ref(), row * width, line, bins);
                }
            }
        });
        reflectance.and_then(|_| self.variance_px2())
    }

    fn variance_px2(&self) -> Option<f64> {
        let mut total = [[Sums::default(); GROUPS]; BINS];
        for job in &self.jobs {
            for (sum, part) in total.as_flattened_mut().iter_mut().zip(job.as_flattened()) {
                sum.join(part);
            }
        }
        let mut places = [Place { slope2: 0.0, log_contrast: 0.0, weight: 0.0 }; BINS];
        let mut count = 0;
        for place in total.iter().filter_map(place) {
            places[count] = place;
            count += 1;
        }
        let (slope, u_slope) = line(&places[..count])?;
        let (measured, known) = (1.0 / (4.0 * u_slope * u_slope), 1.0 / (LENS_U_PX2 * LENS_U_PX2));
        let variance_px2 = (measured * -2.0 * slope + known * LENS_PX2) / (measured + known);
        (variance_px2 > LEAST_PX2).then_some(variance_px2.min(MOST_PX2))
    }

    /// Removes the bias of a footprint from the phase; its noise grows by some per cent, which the uncertainty contains.
    /// Pixels without a smooth neighbourhood stay as they are. The map must be the one surveyed last.
    pub fn correct(&self, variance_px2: f64, map: &mut PhaseViewMut) {
        let half = 0.5 * variance_px2;
        let growth = (1.0 - 2.0 * half * LAPLACIAN_MIDDLE + half * half * LAPLACIAN_POWER).sqrt() as f32;
        let s2 = variance_px2 as f32;
        for ((phase, sigma), bias) in map.phase_rad.iter_mut().zip(map.sigma_rad.iter_mut()).zip(&self.bias) {
            if bias.is_finite() {
                *phase -= s2 * bias;
                *sigma *= growth;
            }
        }
    }
}

/// A fixed number of values from `start` on; they must be there.
fn lanes<const N: usize>(values: &[f32], start: usize) -> [f32; N] {
    let mut taken = [0.0; N];
    taken.copy_from_slice(&values[start..start + N]);
    taken
}

/// Bin of a slope: four to the octave, read from the bits of the number.
fn bin(slope2: f32) -> usize {
    ((slope2.to_bits() >> 21) as usize).saturating_sub(FIRST_BITS).min(BINS - 1)
}

/// Derivatives along one row, and its part of the bins.
fn survey_row(
    map: &PhaseViewMut,
    reflectance: Option<&Reflectance>,
    first: usize,
    line: &mut [f32],
    bins: &mut Bins,
) {
    let width = line.len();
    let group = first / width % GROUPS;
    let last = width.saturating_sub(HALF);
    let mut column = HALF;
    while column < last {
        // The last block of a row reaches back, so that it ends with the row.
        let start = column.min(last.saturating_sub(LANES)).max(HALF);
        if start + LANES > last {
            return;
        }
        let index = first + start;
        if map.valid[index..index + LANES].contains(&1) {
            let block = Block::new(map, width, index);
            for lane in column - start..LANES {
                let at = index + lane;
                let Some(local) = block.local(lane, map.sigma_rad[at], map.modulation[at]) else { continue };
                let ([x, y], [u, v]) = (local.gradient, local.shading);
                line[start + lane] = 0.5 * local.laplacian + u * x + v * y;
                if let Some(light) = reflectance.and_then(|r| r.at(at, map.valid.len())) {
                    let slope2 = x * x + y * y;
                    bins[bin(slope2)][group].add(map.modulation[at], light, slope2);
                }
            }
        }
        column = start + LANES;
    }
}

impl Reflectance<'_> {
    /// White less black, DN; `None` where white is clipped or not brighter.
    fn at(&self, index: usize, pixels: usize) -> Option<f32> {
        let (white, black) = self.rasters.pair(self.levels.white, self.levels.black, pixels, index);
        (white < self.clipped_dn && white > black).then(|| f32::from(white - black))
    }
}

impl Sums {
    fn add(&mut self, modulation: f32, reflectance: f32, slope2: f32) {
        self.modulation += f64::from(modulation);
        self.reflectance += f64::from(reflectance);
        self.slope2 += f64::from(reflectance * slope2);
        self.count += 1;
    }

    fn join(&mut self, other: &Self) {
        self.modulation += other.modulation;
        self.reflectance += other.reflectance;
        self.slope2 += other.slope2;
        self.count += other.count;
    }
}

/// Mean and scatter of the groups of a bin; `None` where one of them has too few pixels.
fn place(groups: &[Sums; GROUPS]) -> Option<Place> {
    if groups.iter().any(|g| g.count < LEAST_IN_GROUP) {
        return None;
    }
    let mut all = Sums::default();
    for group in groups {
        all.join(group);
    }
    let logs = groups.map(|g| ln(g.modulation / g.reflectance));
    let n = GROUPS as f64;
    let mean = logs.iter().sum::<f64>() / n;
    let variance = logs.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0) / n;
    // Never below what single precision and rounded grey values resolve.
    let weight = 1.0 / variance.max(1e-9);
    Some(Place {
        slope2: all.slope2 / all.reflectance,
        log_contrast: ln(all.modulation / all.reflectance),
        weight,
    })
}

/// Weighted straight line: slope and its standard uncertainty.
fn line(places: &[Place]) -> Option<(f64, f64)> {
    if places.len() < 3 {
        return None;
    }
    let sum = |f: &dyn Fn(&Place) -> f64| places.iter().map(f).sum::<f64>();
    let weight = sum(&|p| p.weight);
    let (x0, y0) = (sum(&|p| p.weight * p.slope2) / weight, sum(&|p| p.weight * p.log_contrast) / weight);
    let xx = sum(&|p| p.weight * (p.slope2 - x0) * (p.slope2 - x0));
    if !(xx.is_finite() && xx > 0.0) {
        return None;
    }
    let slope = sum(&|p| p.weight * (p.slope2 - x0) * (p.log_contrast - y0)) / xx;
    let misfit = |p: &Place| p.log_contrast - y0 - slope * (p.slope2 - x0);
    // What the line does not explain (light between surfaces, focus) counts as uncertainty.
    let chi2 = sum(&|p| p.weight * misfit(p) * misfit(p)) / (places.len() as f64 - 2.0);
    Some((slope, (chi2.max(1.0) / xx).sqrt()))
}

/// The quadratics about [`LANES`] neighbouring pixels; side by side, so that the loops become vector instructions.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    dx: [f32; LANES],
    dy: [f32; LANES],
    dxx: [f32; LANES],
    dyy: [f32; LANES],
    bx: [f32; LANES],
    by: [f32; LANES],
    /// Sum of squares that the quadratic does not explain, rad².
    rest: [f32; LANES],
}

impl Block {
    /// All pixels and their neighbourhoods must lie in the image; what is masked gives NaN.
    fn new(map: &PhaseViewMut, width: usize, index: usize) -> Self {
        let mut sums = Self::default();
        let (mut d, mut dxy, mut d2) = ([0.0_f32; LANES], [0.0_f32; LANES], [0.0_f32; LANES]);
        let middle = lanes::<LANES>(map.phase_rad, index);
        for row in 0..5_usize {
            let y = row as f32 - 2.0;
            let start = index + row * width - HALF * width - HALF;
            let phase = lanes::<{ LANES + 4 }>(map.phase_rad, start);
            let light = lanes::<{ LANES + 4 }>(map.modulation, start);
            for l in 0..LANES {
                let m = middle[l];
                let (v0, v1, v2) = (phase[l] - m, phase[l + 1] - m, phase[l + 2] - m);
                let (v3, v4) = (phase[l + 3] - m, phase[l + 4] - m);
                // Σ v, Σ x v, Σ (x² − 2) v of the row, x = −2 … 2.
                let flat = v0 + v1 + v2 + v3 + v4;
                let slope = 2.0 * (v4 - v0) + (v3 - v1);
                let curve = 2.0 * (v0 + v4 - v2) - (v1 + v3);
                d[l] += flat;
                sums.dx[l] += slope;
                sums.dy[l] += y * flat;
                sums.dxx[l] += curve;
                sums.dyy[l] += (y * y - 2.0) * flat;
                dxy[l] += y * slope;
                d2[l] += v0 * v0 + v1 * v1 + v2 * v2 + v3 * v3 + v4 * v4;
            }
            for l in 0..LANES {
                let (b0, b1, b3, b4) = (light[l], light[l + 1], light[l + 3], light[l + 4]);
                sums.bx[l] += 2.0 * (b4 - b0) + (b3 - b1);
                sums.by[l] += y * (b0 + b1 + light[l + 2] + b3 + b4);
            }
        }
        for l in 0..LANES {
            let [dx, dy, dxx, dyy] = [sums.dx[l], sums.dy[l], sums.dxx[l], sums.dyy[l]];
            let explained = d[l] * d[l] * (1.0 / 25.0)
                + (dx * dx + dy * dy) * (1.0 / SUM_X2)
                + (dxx * dxx + dyy * dyy) * (1.0 / SUM_Q2)
                + dxy[l] * dxy[l] * (1.0 / SUM_XY2);
            sums.rest[l] = d2[l] - explained;
        }
        sums
    }

    /// The quadratic of one lane; `None` across masks and steps.
    fn local(&self, lane: usize, sigma_rad: f32, light: f32) -> Option<Local> {
        let limit = SMOOTH_SIGMAS * sigma_rad + SMOOTH_RAD;
        // 25 values, six parameters. A masked neighbour makes the rest NaN, and NaN is not within the limit.
        (self.rest[lane] <= 19.0 * limit * limit && light > 0.0).then(|| Local {
            gradient: [self.dx[lane] * (1.0 / SUM_X2), self.dy[lane] * (1.0 / SUM_X2)],
            laplacian: (self.dxx[lane] + self.dyy[lane]) * (2.0 / SUM_Q2),
            shading: [self.bx[lane] / (SUM_X2 * light), self.by[lane] / (SUM_X2 * light)],
        })
    }
}

//! Light that bounces between faces: what it does to the phase is read from the modulation.
//!
//! A pixel in a corner also sees light that another face throws there. It carries fringes of its own, of unrelated phase, so that the
//! phasor becomes Z = R e^{iφ} (1 + b e^{iψ}): the phase errs by b sin ψ, and the modulation by b cos ψ. ψ turns from place to place, so over
//! a neighbourhood both scatter alike. The phase follows the unknown surface, but the modulation over white less black is a constant
//! of camera and projector: its scatter beyond that of noise is what bounced light adds to the phase.
//!
//! ```text
//! q = B / (white − black),   u²(φ) = Var(q) / q² − (2/N) σ_I²(A) / B² − (σ_I²(white) + σ_I²(black)) / (white − black)²
//! ```
//!
//! Steep fringes lose modulation by the pixel's footprint (see [`super::footprint`]); that is put right first, q e^{½ s² |∇φ|²}; what
//! else makes q change without any bounced light is explained by a fit ([`super::bounce_window`]). Only pixels with
//! a smooth neighbourhood count, since edges mix faces. Sums are those of cells of 4 × 4 pixels; a window is nine cells
//! without the one that scatters most, so that one faulty pixel is not taken for bounced light, and three of the nine windows that hold a cell
//! have to agree.
//! What bounces as a constant over the whole window is not seen.

use super::Decoder;
use super::bounce_window::{self, CELL, Cell, KINDS, PLAIN, PRODUCTS};
use super::contrast_bins::Reflectance;
use super::footprint::{LENS_PX2, LENS_U_PX2};
use super::noise_model::NoiseModel;
use super::rasters::Rasters;
use super::roles::SineKind;
use super::sensor_test::SCENE_U_PX2;
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use fearless_simd::Level;
use rayon::prelude::*;

/// Columns that are worked on side by side.
const LANES: usize = 64;

/// Pixels whose phase bounced light moves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bounced {
    /// Pixels whose uncertainty contains it.
    pub raised: usize,
    /// Masked: it moves the phase by more than the limit.
    pub masked: usize,
}

/// What the test needs besides the frames.
#[derive(Debug, Clone, Copy)]
pub struct Light<'a> {
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

/// Memory of the test, reserved once.
#[derive(Debug)]
pub struct Bounce {
    width: usize,
    columns: usize,
    cells: Vec<Cell>,
    /// Relative variance that bounced light adds, of each cell.
    excess: Vec<f32>,
}

impl Bounce {
    /// Memory for images of one size.
    pub fn new(width: usize, pixels: usize) -> Self {
        let columns = width.div_ceil(CELL);
        let count = columns * (pixels / width.max(1)).div_ceil(CELL);
        Self { width, columns, cells: vec![Cell::default(); count], excess: vec![0.0; count] }
    }

    /// Adds what bounced light does to the uncertainty of the phase, and masks pixels where that is more than `most_rad`. `smooth`: finite
    /// where the neighbourhood of a pixel is one surface.
    pub fn find(
        &mut self,
        map: &mut PhaseViewMut,
        smooth: &[f32],
        light: &Light,
        most_rad: f32,
        level: Level,
    ) -> Bounced {
        let (width, columns) = (self.width, self.columns);
        let (phase, modulation) = (&*map.phase_rad, &*map.modulation);
        self.cells.par_chunks_mut(columns).enumerate().for_each(|(row, cells)| {
            cells.fill(Cell::default());
            vectorised!(level, light.sum((phase, modulation, smooth), row * CELL, width, cells));
        });
        let cells = &self.cells;
        self.excess.par_chunks_mut(columns).enumerate().for_each(|(row, excess)| {
            for (column, excess) in excess.iter_mut().enumerate() {
                *excess = bounce_window::excess(cells, columns, (row, column), light.u_footprint_px2);
            }
        });
        let part = CELL * width;
        let planes = map.phase_rad.par_chunks_mut(part).zip(map.sigma_rad.par_chunks_mut(part));
        let planes = planes.zip(map.valid.par_chunks_mut(part)).enumerate();
        let excess = &self.excess;
        let counts = planes.map(|(row, ((phase, sigma), valid))| {
            let mut count = Bounced::default();
            let found =
                (0..columns).map(|column| (column, bounce_window::joined(excess, columns, row, column)));
            for (column, excess) in found.filter(|(_, excess)| *excess > 0.0) {
                for line in 0..valid.len() / width {
                    let first = line * width + column * CELL;
                    for i in first..first + CELL.min(width - column * CELL) {
                        let pixel = (&mut phase[i], &mut sigma[i], &mut valid[i]);
                        raise(excess, most_rad, pixel, &mut count);
                    }
                }
            }
            count
        });
        counts.reduce(Bounced::default, |a, b| Bounced {
            raised: a.raised + b.raised,
            masked: a.masked + b.masked,
        })
    }
}

fn raise(
    excess: f32,
    most_rad: f32,
    (phase, sigma, valid): (&mut f32, &mut f32, &mut u8),
    count: &mut Bounced,
) {
    if *valid == 0 {
        return;
    }
    if excess > most_rad * most_rad {
        (*phase, *sigma, *valid) = (f32::NAN, f32::NAN, 0);
        count.masked += 1;
    } else {
        *sigma = (*sigma * *sigma + excess).sqrt();
        count.raised += 1;
    }
}

impl Decoder {
    /// Bounced light in the map that was surveyed last; none is looked for without white and black, or where the settings ask for none.
    /// `footprint_px`: what is known of the pixel's footprint.
    pub(super) fn find_bounce(
        &mut self,
        home: usize,
        footprint_px: Option<f64>,
        out: &mut PhaseViewMut,
    ) -> Bounced {
        let plan = &self.plan.axes[home];
        let Some(levels) = plan.levels.filter(|_| self.looks_for_bounce(home)) else {
            return Bounced::default();
        };
        let reflectance = Reflectance { rasters: &self.rasters, levels, clipped_dn: self.clipped_dn };
        let noise = self.noise(&self.axes[home]);
        let steps = self.steps[plan.sines[0]];
        let footprint_px2 = footprint_px.map_or(LENS_PX2, |px| px * px) as f32;
        // What light between surfaces and the second order leave of a footprint that is known.
        let u_footprint_px2 = if footprint_px.is_some() { SCENE_U_PX2 } else { LENS_U_PX2 };
        let light = Light { reflectance, noise, steps, footprint_px2, u_footprint_px2 };
        let most_rad = self.settings.max_bounce_rad as f32;
        self.bounce.find(out, self.footprint.smooth(), &light, most_rad, self.level)
    }

    /// Whether an axis has what shows bounced light, and it is asked for. Lines do not: where they are bright, their modulation has more noise.
    pub(super) fn looks_for_bounce(&self, home: usize) -> bool {
        let plan = &self.plan.axes[home];
        let finest = plan.sines.first().map(|slot| self.plan.sines[*slot].kind);
        let shows = finest.is_some_and(|kind| kind != SineKind::Lines);
        self.settings.max_bounce_rad > 0.0 && plan.levels.is_some() && shows
    }
}

impl Light<'_> {
    /// Adds the pixels of up to four rows from `row` on to their cells.
    #[inline(always)]
    fn sum(&self, map: (&[f32], &[f32], &[f32]), row: usize, width: usize, cells: &mut [Cell]) {
        match self.reflectance.rasters {
            Rasters::Bytes(data) => self.sum_of(data, map, row, width, cells),
            Rasters::Words(data) => self.sum_of(data, map, row, width, cells),
        }
    }

    #[inline(always)]
    fn sum_of<T: Copy + Into<u16>>(
        &self,
        data: &[T],
        (phase, modulation, smooth): (&[f32], &[f32], &[f32]),
        row: usize,
        width: usize,
        cells: &mut [Cell],
    ) {
        let pixels = modulation.len();
        let levels = self.reflectance.levels;
        let white = &data[levels.white * pixels..][..pixels];
        let black = &data[levels.black * pixels..][..pixels];
        for column in (0..width).step_by(LANES) {
            let count = LANES.min(width - column);
            let lines = row..(row + CELL).min(pixels / width);
            let shown = |y: usize| smooth[y * width + column..][..count].iter().any(|v| v.is_finite());
            if !lines.clone().any(shown) {
                continue;
            }
            let mut sums = [[0.0_f32; LANES]; PRODUCTS + 1];
            for y in lines {
                let first = y * width + column;
                let part = first..first + count;
                // No pixel of the outermost rows and columns is smooth: what they take for their neighbours does not matter.
                let beside = |at: usize| &phase[at.min(pixels - count)..][..count];
                let across = beside(first.max(1) - 1).iter().zip(beside(first + 1));
                let along = beside(first.max(width) - width).iter().zip(beside(first + width));
                let slopes = across.zip(along).zip(&phase[part.clone()]);
                let light = white[part.clone()].iter().zip(&black[part.clone()]);
                let map = modulation[part.clone()].iter().zip(&smooth[part]);
                for (i, (((white, black), (b, smooth)), slopes)) in light.zip(map).zip(slopes).enumerate() {
                    let (((left, right), (above, below)), phase) = slopes;
                    let slope = [0.5 * (right - left), 0.5 * (below - above)];
                    let levels = [(*white).into(), (*black).into()];
                    let (kinds, noise) = self.values(levels, *b, slope, *phase, smooth.is_finite());
                    let mut at = 0;
                    for (one, value) in kinds.iter().enumerate() {
                        for other in &kinds[one..] {
                            sums[at][i] += value * other;
                            at += 1;
                        }
                    }
                    sums[PRODUCTS][i] += noise;
                }
            }
            for (i, cell) in cells[column / CELL..].iter_mut().take(LANES / CELL).enumerate() {
                let lanes = i * CELL..(i + 1) * CELL;
                cell.products = std::array::from_fn(|kind| sums[kind][lanes.clone()].iter().sum());
                cell.noise = sums[PRODUCTS][lanes].iter().sum();
            }
        }
    }

    /// What a cell sums of a pixel, and the variance of the ratio by noise; zeros where it does not count.
    #[inline(always)]
    fn values(
        &self,
        [white, black]: [u16; 2],
        modulation: f32,
        [x, y]: [f32; 2],
        phase: f32,
        smooth: bool,
    ) -> ([f32; KINDS], f32) {
        let (read, gain) = (self.noise.read_variance_dn2 as f32, self.noise.gain_dn as f32);
        let clipped = white >= self.reflectance.clipped_dn;
        let (white, black) = (f32::from(white), f32::from(black));
        let range = white - black;
        let steep = 0.5 * (x * x + y * y);
        let ratio = modulation / range * (1.0 + self.footprint_px2 * steep);
        let of_steps = 2.0 / self.steps as f32;
        let of_modulation = of_steps * (read + gain * 0.5 * (white + black)) / (modulation * modulation);
        let of_range = (2.0 * read + gain * (white + black)) / (range * range);
        let noise = ratio * ratio * (of_modulation + of_range);
        let turn = phase * (self.steps as f32 / std::f32::consts::TAU);
        #[allow(clippy::needless_bitwise_bool, reason = "without branches the loop vectorises")]
        let counts = smooth & !clipped & (range > 0.0) & (modulation > 0.0);
        let kinds = [1.0, steep, wave(turn + 0.25), wave(turn), ratio - PLAIN];
        (kinds.map(|value| if counts { value } else { 0.0 }), if counts { noise } else { 0.0 })
    }
}

/// A wave of period 1 that begins as a sine and differs from it by a thousandth at most.
#[inline(always)]
fn wave(turn: f32) -> f32 {
    let half = 0.5 - (turn - turn.floor());
    let bow = 8.0 * half * (1.0 - 2.0 * half.abs());
    bow * (0.775 + 0.225 * bow.abs())
}

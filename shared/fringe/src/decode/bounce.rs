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
//! Steep fringes lose modulation by the pixel's footprint (see [`super::footprint`]); that is put right first, q e^{½ s² |∇φ|²}. Only pixels with
//! a smooth neighbourhood count, since edges mix faces. Sums are those of cells of 4 × 4 pixels; a window is nine cells
//! without the one that scatters most, so that one faulty pixel is not taken for bounced light.
//! What bounces as a constant over the whole window is not seen.

use super::Decoder;
use super::footprint::{LENS_PX2, Reflectance};
use super::rasters::Rasters;
use super::report::NoiseModel;
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use fearless_simd::Level;
use rayon::prelude::*;

/// Edge of a cell, px.
const CELL: usize = 4;
/// Columns that are worked on side by side.
const LANES: usize = 64;
/// Fewer smooth pixels in a window say nothing.
const LEAST: f32 = 32.0;
/// Scatter beyond noise counts from so many of its standard deviations on.
const CERTAIN: f32 = 3.0;
/// The modulation over white less black without blur: sums of what it differs by lose no digits.
const PLAIN: f32 = 0.5;

/// Sums over the smooth pixels of a cell.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    count: f32,
    /// Sums of the ratio less [`PLAIN`] and of its squares.
    ratio: f32,
    squares: f32,
    /// Variance of the ratio that noise explains.
    noise: f32,
}

impl Cell {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.ratio += other.ratio;
        self.squares += other.squares;
        self.noise += other.noise;
    }

    fn less(&self, other: &Self) -> Self {
        Self {
            count: self.count - other.count,
            ratio: self.ratio - other.ratio,
            squares: self.squares - other.squares,
            noise: self.noise - other.noise,
        }
    }

    /// Sum of squares about the mean.
    fn scatter(&self) -> f32 {
        if self.count > 0.0 { self.squares - self.ratio * self.ratio / self.count } else { 0.0 }
    }

    /// Relative variance beyond that of noise; 0 where noise may explain all.
    fn excess(&self) -> f32 {
        if self.count < LEAST {
            return 0.0;
        }
        let mean = PLAIN + self.ratio / self.count;
        let variance = self.scatter() / (self.count - 1.0);
        let noise = self.noise / self.count;
        let certain = variance > noise * (1.0 + CERTAIN * (2.0 / self.count).sqrt());
        if certain && mean > 0.0 { (variance - noise) / (mean * mean) } else { 0.0 }
    }
}

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
                *excess = window(cells, columns, row, column).excess();
            }
        });
        let part = CELL * width;
        let planes = map.phase_rad.par_chunks_mut(part).zip(map.sigma_rad.par_chunks_mut(part));
        let planes = planes.zip(map.valid.par_chunks_mut(part)).zip(self.excess.par_chunks(columns));
        let counts = planes.map(|(((phase, sigma), valid), excess)| {
            let mut count = Bounced::default();
            for (column, excess) in excess.iter().enumerate().filter(|(_, excess)| **excess > 0.0) {
                for line in 0..valid.len() / width {
                    let first = line * width + column * CELL;
                    for i in first..first + CELL.min(width - column * CELL) {
                        let pixel = (&mut phase[i], &mut sigma[i], &mut valid[i]);
                        raise(*excess, most_rad, pixel, &mut count);
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

/// Nine cells about one, without the one that scatters most.
fn window(cells: &[Cell], columns: usize, row: usize, column: usize) -> Cell {
    let rows = cells.len() / columns;
    let (mut all, mut worst) = (Cell::default(), &Cell::default());
    for y in row.saturating_sub(1)..(row + 2).min(rows) {
        for cell in &cells[y * columns..][column.saturating_sub(1)..(column + 2).min(columns)] {
            all.add(cell);
            if cell.scatter() > worst.scatter() {
                worst = cell;
            }
        }
    }
    all.less(worst)
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
        let light = Light { reflectance, noise, steps, footprint_px2 };
        let most_rad = self.settings.max_bounce_rad as f32;
        self.bounce.find(out, self.footprint.smooth(), &light, most_rad, self.level)
    }

    /// Whether an axis has what shows bounced light, and it is asked for.
    pub(super) fn looks_for_bounce(&self, home: usize) -> bool {
        let plan = &self.plan.axes[home];
        self.settings.max_bounce_rad > 0.0 && plan.levels.is_some() && !plan.sines.is_empty()
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
        let (read, gain) = (self.noise.read_variance_dn2 as f32, self.noise.gain_dn as f32);
        let of_steps = 2.0 / self.steps as f32;
        for column in (0..width).step_by(LANES) {
            let count = LANES.min(width - column);
            let mut sums = [[0.0_f32; LANES]; 4];
            for y in row..(row + CELL).min(pixels / width) {
                let first = y * width + column;
                let part = first..first + count;
                // No pixel of the outermost rows and columns is smooth: what they take for their neighbours does not matter.
                let beside = |at: usize| &phase[at.min(pixels - count)..][..count];
                let across = beside(first.max(1) - 1).iter().zip(beside(first + 1));
                let along = beside(first.max(width) - width).iter().zip(beside(first + width));
                let slopes = across.zip(along);
                let light = white[part.clone()].iter().zip(&black[part.clone()]);
                let map = modulation[part.clone()].iter().zip(&smooth[part]);
                for (i, (((white, black), (b, smooth)), slopes)) in light.zip(map).zip(slopes).enumerate() {
                    let ((left, right), (above, below)) = slopes;
                    let (x, y) = (0.5 * (right - left), 0.5 * (below - above));
                    let lost = 1.0 + 0.5 * self.footprint_px2 * (x * x + y * y);
                    let (white, black): (u16, u16) = ((*white).into(), (*black).into());
                    let clipped = white >= self.reflectance.clipped_dn;
                    let (white, black) = (f32::from(white), f32::from(black));
                    let range = white - black;
                    let ratio = b / range * lost;
                    let beside = ratio - PLAIN;
                    let of_modulation = of_steps * (read + gain * 0.5 * (white + black)) / (b * b);
                    let of_range = (2.0 * read + gain * (white + black)) / (range * range);
                    let noise = ratio * ratio * (of_modulation + of_range);
                    #[allow(clippy::needless_bitwise_bool, reason = "without branches the loop vectorises")]
                    let counts = smooth.is_finite() & !clipped & (range > 0.0) & (*b > 0.0);
                    for (sum, value) in sums.iter_mut().zip([1.0, beside, beside * beside, noise]) {
                        sum[i] += if counts { value } else { 0.0 };
                    }
                }
            }
            let [n, s1, s2, v] = sums;
            for (i, cell) in cells[column / CELL..].iter_mut().take(LANES / CELL).enumerate() {
                for lane in i * CELL..(i + 1) * CELL {
                    cell.add(&Cell { count: n[lane], ratio: s1[lane], squares: s2[lane], noise: v[lane] });
                }
            }
        }
    }
}

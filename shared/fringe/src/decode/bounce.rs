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
use super::bounce_cells::{CELL, Cells, Light, Seen, memory};
use super::bounce_window;
use super::contrast_bins::Reflectance;
use super::roles::SineKind;
use super::sensor_test::SCENE_U_PX2;
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use crate::sensor::{USUAL_LENS_PX2, USUAL_LENS_U_PX2};
use fearless_simd::Level;
use rayon::prelude::*;

/// Rows of cells of one parallel job.
const BAND: usize = 32;

/// Pixels whose phase bounced light moves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bounced {
    /// Pixels whose uncertainty contains it.
    pub raised: usize,
    /// Masked: it moves the phase by more than the limit.
    pub masked: usize,
}

/// Memory of the test, reserved once.
#[derive(Debug)]
pub struct Bounce {
    width: usize,
    /// Sums of three rows of cells for each band.
    sums: Vec<f32>,
    /// Relative variance that bounced light adds, of each cell.
    excess: Vec<f32>,
}

impl Bounce {
    /// Memory for images of one size.
    pub fn new(width: usize, pixels: usize) -> Self {
        let [columns, rows] = [width, pixels / width.max(1)].map(|side| side.div_ceil(CELL));
        let sums = vec![0.0; memory(columns) * rows.div_ceil(BAND)];
        Self { width, sums, excess: vec![0.0; columns * rows] }
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
        let (width, columns) = (self.width, self.width.div_ceil(CELL).max(1));
        let seen = Seen { phase: map.phase_rad, modulation: map.modulation, smooth, width };
        let bands = self.excess.par_chunks_mut(BAND * columns).zip(self.sums.par_chunks_mut(memory(columns)));
        bands.enumerate().for_each(|(band, (excess, sums))| {
            let (mut cells, first) = (Cells::new(columns, sums), 1 + band * BAND);
            // One function, for each place that fills would be compiled by itself.
            let fill =
                |cells: &mut Cells, row| vectorised!(level, |simd| cells.fill(simd, row, &seen, light));
            fill(&mut cells, first - 1);
            fill(&mut cells, first);
            for (row, excess) in (first..).zip(excess.chunks_mut(columns)) {
                fill(&mut cells, row + 1);
                vectorised!(level, bounce_window::suspects(&cells.about(row), excess));
                for (column, excess) in excess.iter_mut().enumerate().filter(|(_, suspect)| **suspect > 0.0) {
                    cells.complete([row, column], &seen, light, level);
                    *excess = bounce_window::excess(&cells.about(row), column, light.u_footprint_px2);
                }
            }
        });
        let part = CELL * width;
        let planes = map.phase_rad.par_chunks_mut(part).zip(map.sigma_rad.par_chunks_mut(part));
        let planes = planes.zip(map.valid.par_chunks_mut(part)).enumerate();
        let excess = &self.excess;
        let counts = planes.map(|(row, ((phase, sigma), valid))| {
            let mut count = Bounced::default();
            let found = bounce_window::joined(excess, columns, row);
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
    /// `known_px2`: what is known of the footprint's variance.
    pub(super) fn find_bounce(
        &mut self,
        home: usize,
        known_px2: Option<f64>,
        out: &mut PhaseViewMut,
    ) -> Bounced {
        let plan = &self.plan.axes[home];
        let Some(levels) = plan.levels.filter(|_| self.looks_for_bounce(home)) else {
            return Bounced::default();
        };
        let reflectance = Reflectance { rasters: &self.rasters, levels, clipped_dn: self.clipped_dn };
        let noise = self.noise(&self.axes[home]);
        let steps = self.steps[plan.sines[0]];
        let footprint_px2 = known_px2.unwrap_or(USUAL_LENS_PX2) as f32;
        // What light between surfaces and focus leave of a footprint that is known.
        let u_footprint_px2 = if known_px2.is_some() { SCENE_U_PX2 } else { USUAL_LENS_U_PX2 };
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

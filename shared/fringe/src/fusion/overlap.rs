//! How two clouds agree where both see the part.

use super::Overlap;
use super::cells::Cells;
use super::disagreement::Compared;
use super::grid::Grid;
use super::near::{Beside, Near};
use super::sites::Place;
use crate::math::simd::vectorised;
use fearless_simd::Level;
use std::ops::Range;

/// Which points of another cloud count beside a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearness {
    /// Radius of a neighbourhood, mm.
    pub radius_mm: f64,
    /// Smallest cosine of the normals.
    pub cosine: f64,
    /// Fewest points that make a surface.
    pub fewest: u32,
    /// One of so many cells is looked at.
    pub every: usize,
}

/// Sums of the distances, in the order of the cells. The square of their mean takes digits of the mean of their squares: of a rig that is off by a
/// third of a millimetre, the standard deviation is known to some nanometres all the same.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Distances {
    count: u32,
    sum: f64,
    squares: f64,
    max: f64,
    weights: f64,
    weighted: f64,
    weighted_squares: f64,
}

impl Distances {
    /// From the points in some cells of one cloud to the surface of another; `compared` gets what each of these cells shows. `near`: memory.
    pub fn of(
        (own, other): (&Cells, &Cells),
        (first, compared): (usize, &mut [Compared]),
        near: &mut Near,
        grid: &Grid,
        nearness: &Nearness,
        level: Level,
    ) -> Self {
        let mut distances = Self::default();
        let cells = first..first + compared.len();
        let mut numbered = (first..).zip(compared);
        own.sweep(cells, grid, other, |sites, runs| {
            let Some((number, compared)) = numbered.next() else { return };
            *compared = Compared::default();
            if number.is_multiple_of(nearness.every) && runs.iter().any(|run| !run.is_empty()) {
                vectorised!(level, distances.add_cell((own, other), (sites, runs), near, nearness, compared));
            }
        });
        distances
    }

    /// Adds the distances of all points in a cell.
    #[inline(always)]
    fn add_cell(
        &mut self,
        (own, other): (&Cells, &Cells),
        (sites, runs): (Range<usize>, &[Range<usize>; 9]),
        near: &mut Near,
        nearness: &Nearness,
        compared: &mut Compared,
    ) {
        let limit_mm2 = nearness.radius_mm * nearness.radius_mm;
        near.take(&other.sites, runs);
        for site in sites {
            let Some(place) = own.sites.place(site, limit_mm2, nearness.cosine) else { continue };
            self.add_point(&place, &near.beside(&place), nearness, compared);
        }
    }

    #[inline(always)]
    fn add_point(&mut self, place: &Place, beside: &Beside, nearness: &Nearness, compared: &mut Compared) {
        let [count, distance, variance] = beside.sums();
        if count >= f64::from(nearness.fewest.max(1)) {
            let share = 1.0 / count;
            let distance = 0.5 * distance * share;
            let u2 = place.sigma_mm * place.sigma_mm + variance * (share * share);
            self.add(distance, u2);
            compared.add(distance, u2, nearness.radius_mm);
        }
    }

    /// Adds a distance, mm, with its variance, mm².
    #[inline(always)]
    fn add(&mut self, distance: f64, u2: f64) {
        self.count += 1;
        self.sum += distance;
        self.squares += distance * distance;
        self.max = self.max.max(distance.abs());
        let weight = 1.0 / u2;
        self.weights += weight;
        self.weighted += weight * distance;
        self.weighted_squares += weight * distance * distance;
    }

    /// Joins the sums over other cells.
    pub fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.max = self.max.max(other.max);
        self.weights += other.weights;
        self.weighted += other.weighted;
        self.weighted_squares += other.weighted_squares;
    }

    /// What is reported of them.
    pub fn overlap(&self, a: usize, b: usize) -> Overlap {
        let n = f64::from(self.count);
        let m = if self.count == 0 { 0.0 } else { self.sum / n };
        let about_mean = self.squares - n * m * m;
        // Rounding may leave less than nothing of distances that are alike.
        let sd_mm = if self.count < 2 || about_mean < 0.0 { 0.0 } else { (about_mean / (n - 1.0)).sqrt() };
        // Σ w (d − m)² = Σ w d² − 2 m Σ w d + m² Σ w.
        let sum = self.weighted_squares - 2.0 * m * self.weighted + m * m * self.weights;
        let ratio = (sum / n).sqrt();
        let sd_over_sigma = (self.count > 1 && ratio.is_finite()).then_some(ratio);
        Overlap { a, b, count: self.count, mean_mm: m, sd_mm, max_mm: self.max, sd_over_sigma }
    }
}

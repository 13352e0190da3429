//! Quality maps: reliability of each pixel, larger is better (Ghiglia & Pritt 1998, chapter 3; eq. 2.31–2.33).

use super::Wrapped;
use super::angle::{Angles, turns};
use super::edges::Grid;
use crate::math;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Quantity that measures the reliability.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QualityMap {
    /// The modulation as measured, as a fraction of its largest value.
    Modulation,
    /// 1 − spread of the phase derivatives over 3 × 3 pixels (standard deviations along x and y, turns).
    PhaseDerivativeVariance,
    /// |mean of exp(iφ)| over 3 × 3 pixels; steep phases look bad, too.
    PseudoCorrelation,
    /// 1 − largest wrapped difference to a neighbour, half turns: 1 − Q_g of eq. 2.31.
    MaximumGradient,
}

/// The map, 0 … 1; 0 where not valid. Neighbours that are not valid are left out.
pub fn map(which: QualityMap, wrapped: &Wrapped<'_>, angles: &Angles<'_>, grid: &Grid<'_>) -> Vec<f32> {
    let of_pixel = match which {
        QualityMap::Modulation => return modulation(wrapped.modulation, angles),
        QualityMap::PhaseDerivativeVariance => derivative_variance,
        QualityMap::PseudoCorrelation => pseudo_correlation,
        QualityMap::MaximumGradient => maximum_gradient,
    };
    let mut quality = vec![0.0_f32; angles.turn.len()];
    quality.par_chunks_mut(grid.width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            if angles.valid[y * grid.width + x] {
                *value = of_pixel(angles, grid, x, y);
            }
        }
    });
    quality
}

/// Without a modulation, which the input's check refuses, all pixels are alike.
fn modulation(values: Option<&[f32]>, angles: &Angles<'_>) -> Vec<f32> {
    let Some(values) = values else { return vec![0.0; angles.turn.len()] };
    let used = |i: usize| if angles.valid[i] && values[i].is_finite() { values[i].max(0.0) } else { 0.0 };
    let most = (0..values.len()).map(used).fold(0.0, f32::max);
    (0..values.len()).map(|i| if most > 0.0 { used(i) / most } else { 0.0 }).collect()
}

/// Columns and rows of the 3 × 3 pixels about a pixel that lie in the image.
fn window(grid: &Grid<'_>, x: usize, y: usize) -> impl Iterator<Item = usize> + use<> {
    let (columns, rows) =
        (x.saturating_sub(1)..grid.width.min(x + 2), y.saturating_sub(1)..grid.height.min(y + 2));
    let width = grid.width;
    rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
}

fn derivative_variance(angles: &Angles<'_>, grid: &Grid<'_>, x: usize, y: usize) -> f32 {
    let spread = |edge: &dyn Fn(usize) -> Option<(usize, usize)>| {
        let (mut count, mut sum, mut squares) = (0.0_f64, 0.0, 0.0);
        for (a, b) in window(grid, x, y).filter_map(edge) {
            let step = f64::from(turns(angles.difference(a, b)));
            count += 1.0;
            sum += step;
            squares += step * step;
        }
        // A single derivative has no spread: the worst that is possible.
        if count < 2.0 { 0.5 } else { (squares / count - (sum / count) * (sum / count)).max(0.0).sqrt() }
    };
    (1.0 - spread(&|i| grid.right(i)) - spread(&|i| grid.down(i))) as f32
}

fn pseudo_correlation(angles: &Angles<'_>, grid: &Grid<'_>, x: usize, y: usize) -> f32 {
    let (mut count, mut real, mut imaginary) = (0.0_f64, 0.0, 0.0);
    for pixel in window(grid, x, y).filter(|i| angles.valid[*i]) {
        let (sine, cosine) = math::sincos(angles.on_grid(pixel) * TAU);
        count += 1.0;
        real += cosine;
        imaginary += sine;
    }
    // One pixel alone agrees with itself, which is no information.
    if count < 2.0 { 0.0 } else { ((real * real + imaginary * imaginary).sqrt() / count) as f32 }
}

fn maximum_gradient(angles: &Angles<'_>, grid: &Grid<'_>, x: usize, y: usize) -> f32 {
    let pixel = y * grid.width + x;
    let left = (x > 0).then(|| grid.right(pixel - 1)).flatten();
    let above = (y > 0).then(|| grid.down(pixel - grid.width)).flatten();
    let steps = [left, grid.right(pixel), above, grid.down(pixel)];
    let most = steps.iter().flatten().map(|(a, b)| turns(angles.difference(*a, *b)).abs()).reduce(f32::max);
    most.map_or(0.0, |most| 1.0 - 2.0 * most)
}

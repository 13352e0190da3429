//! Gaussian and median over pairs of opposite neighbours.

use super::{FilterReport, value};
use crate::math;
use crate::math::statistics;
use crate::phase::PhaseMap;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Half of the square about a pixel: each offset stands for itself and its opposite.
fn half_square(radius: i64) -> impl Iterator<Item = (i64, i64)> {
    (0..=radius)
        .flat_map(move |dy| (-radius..=radius).map(move |dx| (dx, dy)))
        .filter(|(dx, dy)| *dy > 0 || *dx > 0)
}

/// A pixel's new phase and the factor on its standard uncertainty.
type Smoothed = Option<(f32, f32)>;

/// φ + Σ w (φ₊ + φ₋ − 2φ) / (w₀ + 2 Σ w) over the pairs that do not lie across an edge.
pub fn gaussian(map: &mut PhaseMap, sigma_px: f64, edge_rad: f32) -> FilterReport {
    let radius = (3.0 * sigma_px).ceil() as i64;
    let weight =
        |(dx, dy): (i64, i64)| math::exp(-((dx * dx + dy * dy) as f64) / (2.0 * sigma_px * sigma_px));
    let pairs: Vec<(i64, i64, f32)> =
        half_square(radius).map(|offset| (offset.0, offset.1, weight(offset) as f32)).collect();
    replace(map, |map, x, y, centre| {
        let (mut sum, mut weights, mut squares) = (0.0_f32, 1.0_f32, 1.0_f32);
        for (dx, dy, weight) in &pairs {
            let Some((a, b)) = value(map, x + dx, y + dy).zip(value(map, x - dx, y - dy)) else { continue };
            let off = (a - centre) + (b - centre);
            if off.abs() <= 2.0 * edge_rad {
                sum += weight * off;
                weights += 2.0 * weight;
                squares += 2.0 * weight * weight;
            }
        }
        (weights > 1.0).then(|| (centre + sum / weights, squares.sqrt() / weights))
    })
}

/// The median of the pixel and all pairs about it.
pub fn median(map: &mut PhaseMap, radius: usize) -> FilterReport {
    let pairs: Vec<(i64, i64)> = half_square(radius as i64).collect();
    replace(map, |map, x, y, centre| {
        let mut values = Vec::with_capacity(2 * pairs.len() + 1);
        values.push(centre);
        for (dx, dy) in &pairs {
            if let Some((a, b)) = value(map, x + dx, y + dy).zip(value(map, x - dx, y - dy)) {
                values.extend([a, b]);
            }
        }
        // The median of many normal values scatters √(π/2) times as much as their mean.
        let factor = (PI / 2.0 / values.len() as f64).sqrt().min(1.0) as f32;
        statistics::median(&mut values).filter(|_| values.len() > 1).map(|median| (median, factor))
    })
}

/// Puts what `of_pixel` makes of the old phases in their place.
fn replace(
    map: &mut PhaseMap,
    of_pixel: impl Fn(&PhaseMap, i64, i64, f32) -> Smoothed + Sync,
) -> FilterReport {
    let width = map.info.width_px as usize;
    let mut smoothed: Vec<Smoothed> = vec![None; map.info.len()];
    smoothed.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, new) in row.iter_mut().enumerate() {
            let (x, y) = (x as i64, y as i64);
            *new = value(map, x, y).and_then(|centre| of_pixel(map, x, y, centre));
        }
    });
    let mut report = FilterReport::default();
    for (i, (phase_rad, factor)) in smoothed.into_iter().enumerate().filter_map(|(i, new)| Some((i, new?))) {
        map.phase_rad[i] = phase_rad;
        map.sigma_rad[i] *= factor;
        report.smoothed += 1;
    }
    report
}

//! What the fit leaves, summed over parts of the image: where residuals hang together, something is not noise.

use super::robust::{Fit, normal};
use super::rows::Row;
use std::collections::BTreeMap;

/// Means over fewer residuals are mostly noise.
const LEAST_IN_TILE: f64 = 8.0;
/// Of fewer tiles for each unknown a fit takes a smooth pattern for a drift, and leaves nothing of it: two spheres, for example.
const TILES_PER_UNKNOWN: usize = 10;

/// Sums over one tile.
struct Tile<const N: usize> {
    /// Σ a r, over the standard deviations.
    score: [f64; N],
    /// Sum of residuals Σ r, px.
    sum_px: f64,
    /// Sum of squares Σ r², px².
    squares_px2: f64,
    count: f64,
}

impl<const N: usize> Default for Tile<N> {
    fn default() -> Self {
        Self { score: [0.0; N], sum_px: 0.0, squares_px2: 0.0, count: 0.0 }
    }
}

/// Statistics of the residuals over tiles.
pub(super) struct Tiles {
    /// Mean over the drifts of the variance of their scores over that of independent residuals with the predicted noise.
    ///
    /// Cluster-robust ("sandwich") variance with tiles as clusters (Liang & Zeger 1986).
    pub correlation: f64,
    /// Mean squares of the tiles' means, their noise taken out, px²; may be negative.
    pattern_px2: f64,
    /// Tiles whose means tell something.
    count: usize,
    /// Unknowns of the fit.
    unknowns: usize,
}

impl Tiles {
    /// From the rows kept.
    pub fn new<const N: usize, const P: usize>(kept: &[&Row<N, P>], fit: &Fit<N>) -> Self {
        let mut tiles = BTreeMap::<u64, Tile<N>>::new();
        for row in kept {
            let residual = row.error - fit.modelled(row);
            let tile = tiles.entry(row.tile).or_default();
            tile.score.iter_mut().zip(row.by).for_each(|(sum, by)| *sum += by * residual);
            let residual_px = residual * row.sigma_px;
            tile.sum_px += residual_px;
            tile.squares_px2 += residual_px * residual_px;
            tile.count += 1.0;
        }
        let matrix = normal(kept.iter().map(|row| (*row, 1.0)));
        let ratio = |direction: &[f64; N]| {
            let along = |v: &[f64]| v.iter().zip(direction).map(|(a, b)| a * b).sum::<f64>();
            let observed: f64 = tiles.values().map(|tile| along(&tile.score).powi(2)).sum();
            observed / along(&matrix.apply(direction))
        };
        let freedom = tiles.len() as f64 / (tiles.len() as f64 - N as f64).max(1.0);
        let correlation =
            freedom * fit.directions.iter().map(ratio).sum::<f64>() / fit.directions.len() as f64;
        let count = tiles.values().filter(|tile| tile.count >= LEAST_IN_TILE).count();
        Self { correlation, pattern_px2: pattern_px2(tiles.values()), count, unknowns: N }
    }

    /// Whether the fit leaves a pattern, if there is one.
    pub fn shows_pattern(&self) -> bool {
        self.count >= TILES_PER_UNKNOWN * self.unknowns
    }

    /// Root mean square of the smooth pattern, px; 0 where noise explains the means.
    pub fn pattern_px(&self) -> f64 {
        self.pattern_px2.max(0.0).sqrt()
    }
}

/// Mean over the tiles, weighted by their residuals, of mean² less its expectation from the scatter within.
fn pattern_px2<'a, const N: usize>(tiles: impl Iterator<Item = &'a Tile<N>>) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for tile in tiles.filter(|tile| tile.count >= LEAST_IN_TILE) {
        let mean = tile.sum_px / tile.count;
        let variance = (tile.squares_px2 / tile.count - mean * mean) / (tile.count - 1.0);
        sum += tile.count * (mean * mean - variance);
        weight += tile.count;
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

//! Reliability sorting (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41, 2002; eq. 2.34–2.39).

use super::angle::{Angles, turns};
use super::edges::Grid;
use rayon::prelude::*;

/// What a line through a pixel counts that lacks an end, turns²: the most a second difference can be.
const MISSING: f32 = 1.0;

/// Edges by rising sum of the second differences of their ends, which is falling reliability; for
/// [`Forest::span`](super::forest::Forest::span).
pub fn edges(angles: &Angles, grid: &Grid<'_>) -> Vec<u64> {
    let second = second_differences(angles, grid);
    grid.keyed(|(a, b)| (second[a] + second[b]).to_bits())
}

/// D_s² of eq. 2.34 per pixel, turns²: H² + V² + D₁² + D₂².
fn second_differences(angles: &Angles, grid: &Grid<'_>) -> Vec<f32> {
    let mut second = vec![0.0_f32; angles.turn.len()];
    second.par_chunks_mut(grid.width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let pixel = y * grid.width + x;
            if angles.valid[pixel] {
                *value = of_pixel(angles, grid, x, y);
            }
        }
    });
    second
}

fn of_pixel(angles: &Angles, grid: &Grid<'_>, x: usize, y: usize) -> f32 {
    let (inside_x, inside_y) = (x > 0 && x + 1 < grid.width, y > 0 && y + 1 < grid.height);
    let w = grid.width;
    let pixel = y * w + x;
    let line = |inside: bool, offset: usize| {
        if !inside || !angles.valid[pixel - offset] || !angles.valid[pixel + offset] {
            return MISSING;
        }
        let before = turns(angles.difference(pixel - offset, pixel));
        let after = turns(angles.difference(pixel, pixel + offset));
        (after - before) * (after - before)
    };
    let both = inside_x && inside_y;
    line(inside_x, 1) + line(inside_y, w) + line(both, w + 1) + line(both, w.saturating_sub(1))
}

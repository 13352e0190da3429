//! Reliability sorting (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41, 2002; eq. 2.34–2.39).

use super::angle::{Angles, turns};
use super::edges::{Edge, Grid};

/// What a line through a pixel counts that lacks an end, turns²: the most a second difference can be.
const MISSING: f32 = 1.0;

/// Key of an edge for [`jumps`](super::jumps::jumps): rising sum of the second differences of its ends, which is falling
/// reliability. Few edges are asked for, so that no map of it is made.
pub fn key(angles: &Angles<'_>, grid: &Grid<'_>) -> impl Fn(Edge) -> u32 + Sync {
    move |(a, b)| (second_difference(angles, grid, a) + second_difference(angles, grid, b)).to_bits()
}

/// D_s² of eq. 2.34 of a valid pixel, turns²: H² + V² + D₁² + D₂².
fn second_difference(angles: &Angles<'_>, grid: &Grid<'_>, pixel: usize) -> f32 {
    let (w, x) = (grid.width, pixel % grid.width);
    let (across, down) = (x > 0 && x + 1 < w, pixel >= w && pixel + w < angles.turn.len());
    let at = angles.turn[pixel];
    let bend = |inside: bool, reach: usize| {
        if !inside || !angles.valid[pixel - reach] || !angles.valid[pixel + reach] {
            return MISSING;
        }
        let [before, after] = [angles.turn[pixel - reach], angles.turn[pixel + reach]];
        let bend = turns(after.wrapping_sub(at) as i32) - turns(at.wrapping_sub(before) as i32);
        bend * bend
    };
    let both = across && down;
    bend(across, 1) + bend(down, w) + bend(both, w + 1) + bend(both, w - 1)
}

//! Reliability sorting (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41, 2002; eq. 2.34–2.39).

use super::angle::{Angles, turns};
use super::edges::{Edge, Grid};
use rayon::prelude::*;

/// What a line through a pixel counts that lacks an end, turns²: the most a second difference can be.
const MISSING: f32 = 1.0;

/// Key of an edge for [`span`](super::tiles::span): rising sum of the second differences of its ends, which is falling reliability.
pub fn key(second: Vec<f32>) -> impl Fn(Edge) -> u32 + Sync {
    move |(a, b)| (second[a] + second[b]).to_bits()
}

/// D_s² of eq. 2.34 per pixel, turns²: H² + V² + D₁² + D₂². Of pixels that are not valid the value means nothing.
pub fn second_differences(angles: &Angles<'_>, grid: &Grid<'_>) -> Vec<f32> {
    let mut second = vec![0.0_f32; angles.turn.len()];
    let w = grid.width;
    let all = |y: usize| Line { turn: &angles.turn[y * w..][..w], valid: &angles.valid[y * w..][..w] };
    second.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
        let here = all(y);
        let beside = (y > 0 && y + 1 < grid.height).then(|| (all(y - 1), all(y + 1)));
        add(row, 1, here, Some((here, here)), [0, 2]);
        add(row, 0, here, beside, [0, 0]);
        add(row, 1, here, beside, [0, 2]);
        add(row, 1, here, beside, [2, 0]);
    });
    second
}

/// Angles of a row and where they may be used.
#[derive(Clone, Copy)]
struct Line<'a> {
    turn: &'a [u32],
    valid: &'a [bool],
}

/// Adds the squared second differences along lines that begin at `offsets[0]` in the row before and end at `offsets[1]` in the
/// row after, for all pixels but `margin` at both ends, which lack an end of their line.
fn add(
    row: &mut [f32],
    margin: usize,
    here: Line<'_>,
    beside: Option<(Line<'_>, Line<'_>)>,
    offsets: [usize; 2],
) {
    let Some(((before, after), count)) = beside.zip(row.len().checked_sub(2 * margin)) else {
        for sum in row {
            *sum += MISSING;
        }
        return;
    };
    let last = margin + count;
    for sum in &mut row[..margin] {
        *sum += MISSING;
    }
    for sum in &mut row[last..] {
        *sum += MISSING;
    }
    let [from, to] = offsets;
    let ends = before.turn[from..][..count].iter().zip(&after.turn[to..][..count]);
    let usable = before.valid[from..][..count].iter().zip(&after.valid[to..][..count]);
    let middle = row[margin..last].iter_mut().zip(&here.turn[margin..]);
    for (((sum, at), (before, after)), (one, other)) in middle.zip(ends).zip(usable) {
        let bend = turns(after.wrapping_sub(*at) as i32) - turns(at.wrapping_sub(*before) as i32);
        *sum += if one & other { bend * bend } else { MISSING };
    }
}

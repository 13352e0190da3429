//! The naive way (Itoh 1982): along the rows, and from row to row where two runs of valid pixels first meet.
//!
//! It is also the last step of the methods that choose their way: once the jumps of the tree that they find are known, every loop
//! closes, so every way gives the same turns.

use super::NO_COMPONENT;
use super::angle::Angles;
use super::edges::{Edge, Grid, runs};
use super::faces::{Charges, Faces};
use super::forest::{Forest, Labels};
use super::jumps::{Jump, jumps};
use rayon::prelude::*;
use std::ops::Range;

/// Whole turns along the naive way, with jumps by rising edge added to the steps of their edges.
pub fn along_rows(angles: &Angles<'_>, grid: &Grid<'_>, jumps: &[Jump]) -> Labels {
    let width = grid.width;
    let mut turns = vec![0; grid.valid.len()];
    let rows = turns.par_chunks_mut(width).enumerate();
    let runs: Vec<Vec<Range<usize>>> =
        rows.map(|(y, turns)| along(y * width, turns, angles, jumps)).collect();
    let found = between_rows(&runs, angles, jumps, &turns, width);
    let first = runs.iter().scan(0, |next, row| {
        let first = *next;
        *next += row.len();
        Some(first)
    });
    let first: Vec<usize> = first.collect();
    let mut component = vec![NO_COMPONENT; turns.len()];
    let rows = component.par_chunks_mut(width).zip(turns.par_chunks_mut(width)).enumerate();
    rows.zip(runs.par_iter().zip(first)).for_each(|((y, (component, turns)), (row, first))| {
        for (run, number) in row.iter().zip(first..) {
            let columns = run.start - y * width..run.end - y * width;
            component[columns.clone()].fill(found.component[number]);
            let above = found.turns[number];
            turns[columns].iter_mut().for_each(|turns| *turns += above);
        }
    });
    Labels { component, turns }
}

/// Turns of the pixels of a row above the first one of their run; gives the runs, as pixels of the image.
fn along(start: usize, turns: &mut [i32], angles: &Angles<'_>, jumps: &[Jump]) -> Vec<Range<usize>> {
    let row = start..start + turns.len();
    let (turn, valid) = (&angles.turn[row.clone()], &angles.valid[row.clone()]);
    let mut jumps = rightwards(jumps, &row).peekable();
    let mut found = Vec::new();
    for (_, columns) in runs(valid).filter(|(valid, _)| *valid) {
        let mut total = 0;
        for column in columns.start + 1..columns.end {
            total += super::angle::step(turn[column - 1], turn[column]);
            if let Some((_, more)) = jumps.next_if(|(pixel, _)| *pixel + 1 == start + column) {
                total += more;
            }
            turns[column] = total;
        }
        found.push(start + columns.start..start + columns.end);
    }
    found
}

/// Pixels of a row that jumps to the right start from, with their turns.
fn rightwards<'a>(jumps: &'a [Jump], row: &Range<usize>) -> impl Iterator<Item = (usize, i32)> + use<'a> {
    let before = |pixel: usize| jumps.partition_point(|jump| (jump.edge as usize) < 2 * pixel);
    let of_row = &jumps[before(row.start)..before(row.end)];
    of_row.iter().filter(|j| j.edge.is_multiple_of(2)).map(|j| (j.edge as usize / 2, j.turns))
}

/// Turns that the edge down from a pixel jumps by.
fn downwards(jumps: &[Jump], pixel: usize) -> i32 {
    let found = jumps.binary_search_by_key(&(2 * pixel as u32 + 1), |jump| jump.edge);
    found.map_or(0, |place| jumps[place].turns)
}

/// Number of the component of each run, in the order of their first pixels, and its turns above the first run of its component.
fn between_rows(
    runs: &[Vec<Range<usize>>],
    angles: &Angles<'_>,
    jumps: &[Jump],
    turns: &[i32],
    width: usize,
) -> Labels {
    let count = runs.iter().map(Vec::len).sum();
    let mut forest = Forest::new(count);
    let mut first = 0;
    for pair in runs.windows(2) {
        let [above, here] = [&pair[0], &pair[1]];
        let (mut a, mut b) = (0, 0);
        while let Some((upper, lower)) = above.get(a).zip(here.get(b)) {
            let shared = (upper.start + width).max(lower.start);
            if shared < (upper.end + width).min(lower.end) {
                let from = shared - width;
                let step = angles.step(from, shared) + downwards(jumps, from) + turns[from] - turns[shared];
                forest.join(first + a, first + above.len() + b, step);
            }
            if upper.end + width <= lower.end {
                a += 1;
            } else {
                b += 1;
            }
        }
        first += above.len();
    }
    forest.labels(&vec![true; count])
}

/// Whole turns along the least spanning tree by a key of the edges, which is looked for where a loop does not close, and the
/// number of edges whose ends then differ by more than half a turn.
pub fn along_tree<K: Fn(Edge) -> u32>(
    angles: &Angles<'_>,
    grid: &Grid<'_>,
    key: impl FnOnce() -> K,
) -> (Labels, usize) {
    let charges = Charges::new(angles, grid);
    let close = charges.are_zero();
    let jumps = if close { Vec::new() } else { jumps(&Faces::new(charges, grid), grid, key()) };
    (along_rows(angles, grid, &jumps), jumps.len())
}

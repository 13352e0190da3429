//! The naive way (Itoh 1982): along the rows, and from row to row where two runs of valid pixels first meet.
//!
//! It is also the first step of the methods that choose their way. Where no pair of neighbours contradicts its result, every loop
//! closes, so every way gives the same turns: the tree that a method would have found need not be looked for.

use super::NO_COMPONENT;
use super::angle::Angles;
use super::edges::{Edge, Grid, contradictions};
use super::forest::{Forest, Labels};
use super::tiles::span;
use rayon::prelude::*;
use std::ops::Range;

/// Whole turns along the naive way.
pub fn along_rows(angles: &Angles<'_>, grid: &Grid<'_>) -> Labels {
    let width = grid.width;
    let mut turns = vec![0; grid.valid.len()];
    let rows = turns.par_chunks_mut(width).enumerate();
    let runs: Vec<Vec<Range<usize>>> = rows.map(|(y, turns)| along(y * width, turns, angles)).collect();
    let found = between_rows(&runs, angles, &turns, width);
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
fn along(start: usize, turns: &mut [i32], angles: &Angles<'_>) -> Vec<Range<usize>> {
    let row = start..start + turns.len();
    let (turn, valid) = (&angles.turn[row.clone()], &angles.valid[row]);
    let mut runs = Vec::new();
    let mut first = 0;
    for run in valid.chunk_by(|a, b| a == b) {
        let columns = first..first + run.len();
        first = columns.end;
        if !run[0] {
            continue;
        }
        let mut total = 0;
        let steps = turn[columns.clone()].windows(2).map(|pair| super::angle::step(pair[0], pair[1]));
        for (turns, step) in turns[columns.clone()][1..].iter_mut().zip(steps) {
            total += step;
            *turns = total;
        }
        runs.push(start + columns.start..start + columns.end);
    }
    runs
}

/// Number of the component of each run, in the order of their first pixels, and its turns above the first run of its component.
fn between_rows(runs: &[Vec<Range<usize>>], angles: &Angles<'_>, turns: &[i32], width: usize) -> Labels {
    let count = runs.iter().map(Vec::len).sum();
    let mut forest = Forest::new(count);
    let mut first = 0;
    for pair in runs.windows(2) {
        let [above, here] = [&pair[0], &pair[1]];
        let (mut a, mut b) = (0, 0);
        while let Some((upper, lower)) = above.get(a).zip(here.get(b)) {
            let shared = (upper.start + width).max(lower.start);
            if shared < (upper.end + width).min(lower.end) {
                let step = angles.step(shared - width, shared) + turns[shared - width] - turns[shared];
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

/// Whole turns along the least spanning tree by a key of the edges, which is looked for in components where the way matters.
pub fn along_tree<K: Fn(Edge) -> u32 + Sync>(
    angles: &Angles<'_>,
    grid: &Grid<'_>,
    key: impl FnOnce() -> K,
) -> Labels {
    let mut labels = along_rows(angles, grid);
    let Some(open) = contradictions(grid, angles, &labels) else { return labels };
    let in_open = |number: &u32| open.get(*number as usize).is_some_and(|open| *open);
    let valid: Vec<bool> = labels.component.iter().map(in_open).collect();
    let found = span(angles, &Grid::new(grid.width, grid.height, &valid), key()).labels(&valid);
    // Both count from the first pixel of each component.
    for ((turns, found), _) in labels.turns.iter_mut().zip(found.turns).zip(valid).filter(|(_, open)| *open) {
        *turns = found;
    }
    labels
}

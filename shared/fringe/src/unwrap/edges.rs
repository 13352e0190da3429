//! Edges: pairs of valid neighbours, right and down of each pixel, and the orders in which methods take them.

use super::angle::{Angles, step};
use rayon::prelude::*;
use std::ops::Range;

/// Two neighbours; the second lies right of or below the first.
pub type Edge = (usize, usize);

/// Which neighbours are joined at all.
#[derive(Debug, Clone, Copy)]
pub struct Grid<'a> {
    /// Number of columns, px.
    pub width: usize,
    /// Number of rows, px.
    pub height: usize,
    /// Which pixels are valid.
    pub valid: &'a [bool],
}

impl<'a> Grid<'a> {
    /// The grid of an image.
    pub fn new(width: usize, height: usize, valid: &'a [bool]) -> Self {
        Self { width, height, valid }
    }

    /// The edge to the right, if both ends are valid.
    #[inline]
    pub fn right(&self, pixel: usize) -> Option<Edge> {
        let joined = pixel % self.width + 1 < self.width && self.valid[pixel] && self.valid[pixel + 1];
        joined.then_some((pixel, pixel + 1))
    }

    /// The edge downwards, if both ends are valid.
    #[inline]
    pub fn down(&self, pixel: usize) -> Option<Edge> {
        let below = pixel + self.width;
        (below < self.valid.len() && self.valid[pixel] && self.valid[below]).then_some((pixel, below))
    }

    /// All edges with their numbers: 2 · pixel to the right, 2 · pixel + 1 downwards.
    pub fn edges(&self) -> impl Iterator<Item = (u32, Edge)> + '_ {
        (0..self.height).flat_map(move |y| (0..self.width).flat_map(move |x| self.of_pixel(x, y)))
    }

    fn of_pixel(&self, x: usize, y: usize) -> impl Iterator<Item = (u32, Edge)> + use<> {
        let pixel = y * self.width + x;
        let usable = self.valid[pixel];
        let right = (usable && x + 1 < self.width && self.valid[pixel + 1]).then_some(pixel + 1);
        let below = pixel + self.width;
        let down = (usable && y + 1 < self.height && self.valid[below]).then_some(below);
        let number = 2 * pixel as u32;
        right
            .map(|other| (number, (pixel, other)))
            .into_iter()
            .chain(down.map(|other| (number + 1, (pixel, other))))
    }

    /// The edge of a number from [`Self::edges`].
    #[inline]
    pub fn edge(&self, number: u32) -> Edge {
        let pixel = number as usize / 2;
        (pixel, if number.is_multiple_of(2) { pixel + 1 } else { pixel + self.width })
    }
}

/// Columns of a row that are alike, one run after the other, and whether they are valid.
pub fn runs(valid: &[bool]) -> impl Iterator<Item = (bool, Range<usize>)> {
    valid.chunk_by(|a, b| a == b).scan(0, |next, run| {
        let first = *next;
        *next += run.len();
        Some((run[0], first..*next))
    })
}

/// Key of an edge for [`span`](super::jumps::jumps): edges by falling quality of their worse end.
///
/// A flood that always takes the best pixel at its border reaches each pixel along the path whose worst pixel is as good as
/// possible. The tree of edges in this order has the same paths, but no start that would have to be chosen in each component.
pub fn best_pixels_first(quality: Vec<f32>) -> impl Fn(Edge) -> u32 + Sync {
    // The bits of a float that is not negative rise with it.
    move |(a, b)| !quality[a].min(quality[b]).max(0.0).to_bits()
}

/// Edges whose ends differ by more than half a turn in the result.
pub fn discontinuities(grid: &Grid<'_>, angles: &Angles<'_>, turns: &[i32]) -> usize {
    (0..grid.height).into_par_iter().map(|y| of_row(grid, angles, turns, y)).sum()
}

/// Edges to the right and downwards from the pixels of a row whose ends differ by more than half a turn.
fn of_row(grid: &Grid<'_>, angles: &Angles<'_>, turns: &[i32], y: usize) -> usize {
    let jumps = |first: usize, count: usize, stride: usize| -> usize {
        let (one, other) = (first..first + count, first + stride..first + stride + count);
        let steps = angles.turn[one.clone()].iter().zip(&angles.turn[other.clone()]);
        let found = turns[one.clone()].iter().zip(&turns[other.clone()]);
        let both = grid.valid[one].iter().zip(&grid.valid[other]);
        let jump = steps.zip(found).zip(both).map(|(((a, b), (turns_a, turns_b)), (valid_a, valid_b))| {
            valid_a & valid_b & (turns_b - turns_a != step(*a, *b))
        });
        jump.map(usize::from).sum()
    };
    let first = y * grid.width;
    let below = if first + grid.width < grid.valid.len() { jumps(first, grid.width, grid.width) } else { 0 };
    jumps(first, grid.width - 1, 1) + below
}

//! Edges: pairs of valid neighbours, right and down of each pixel, and the orders in which methods take them.

use super::angle::Angles;
use rayon::prelude::*;

/// Two neighbours; the second lies right of or below the first.
pub type Edge = (usize, usize);

/// Which neighbours are joined at all.
#[derive(Debug, Clone, Copy)]
pub struct Grid<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Valid pixels.
    pub valid: &'a [bool],
}

impl<'a> Grid<'a> {
    /// Of an image.
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

    /// All edges as numbers below their keys: what comes first has the least value, ties go by number.
    pub fn keyed(&self, key: impl Fn(Edge) -> u32 + Sync) -> Vec<u64> {
        let key = &key;
        let row = |y: usize| {
            (0..self.width).flat_map(move |x| {
                self.of_pixel(x, y).map(move |(number, edge)| u64::from(key(edge)) << 32 | u64::from(number))
            })
        };
        (0..self.height).into_par_iter().flat_map_iter(row).collect()
    }
}

/// Rows first, then from row to row where a run of pixels begins or is met (Itoh).
pub fn raster_edges<'a>(grid: &'a Grid<'_>) -> impl Iterator<Item = Edge> + 'a {
    let pixels = grid.valid.len();
    (0..pixels).filter_map(|i| grid.right(i)).chain((0..pixels).filter_map(|i| grid.down(i)))
}

/// Edges by falling quality of their worse end, for [`Forest::span`](super::forest::Forest::span).
///
/// A flood that always takes the best pixel at its border reaches each pixel along the path whose worst pixel is as good as
/// possible. The tree of edges in this order has the same paths, but no start that would have to be chosen in each component.
pub fn best_pixels_first(grid: &Grid<'_>, quality: &[f32]) -> Vec<u64> {
    // The bits of a float that is not negative rise with it.
    grid.keyed(|(a, b)| !quality[a].min(quality[b]).max(0.0).to_bits())
}

/// Edges whose ends differ by more than half a turn in the result.
pub fn discontinuities(grid: &Grid<'_>, angles: &Angles, turns: &[i32]) -> usize {
    let jump = |(_, (a, b)): &(u32, Edge)| turns[*b] - turns[*a] != angles.step(*a, *b);
    let row = |y: usize| (0..grid.width).flat_map(|x| grid.of_pixel(x, y)).filter(jump).count();
    (0..grid.height).into_par_iter().map(row).sum()
}

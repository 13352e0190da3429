//! Edges: pairs of valid neighbours, right and down of each pixel, and the orders in which methods take them.

use super::angle::Angles;

/// Two neighbours; the second lies right of or below the first.
pub type Edge = (usize, usize);

/// Digits of the sort: 3 × 11 bits hold a 32-bit key.
const DIGIT_BITS: u32 = 11;

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
    pub fn edge(&self, number: u32) -> Edge {
        let pixel = number as usize / 2;
        (pixel, if number.is_multiple_of(2) { pixel + 1 } else { pixel + self.width })
    }

    /// Edges by rising key, ties by number.
    pub fn sorted(&self, key: impl Fn(Edge) -> u32) -> Vec<u32> {
        let mut keyed: Vec<u64> =
            self.edges().map(|(number, edge)| u64::from(key(edge)) << 32 | u64::from(number)).collect();
        radix_sort(&mut keyed);
        keyed.into_iter().map(|value| value as u32).collect()
    }
}

/// Sorts by the upper 32 bits, stably: the lower ones, which rise in the input, break ties.
fn radix_sort(values: &mut Vec<u64>) {
    let mut other = vec![0; values.len()];
    for pass in 0..3 {
        let digit = |value: u64| (value >> (32 + pass * DIGIT_BITS)) as usize & ((1 << DIGIT_BITS) - 1);
        let mut starts = vec![0_usize; (1 << DIGIT_BITS) + 1];
        for value in values.iter() {
            starts[digit(*value) + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        for value in values.iter() {
            let place = &mut starts[digit(*value)];
            other[*place] = *value;
            *place += 1;
        }
        std::mem::swap(values, &mut other);
    }
}

/// Rows first, then from row to row where a run of pixels begins or is met (Itoh).
pub fn raster_edges<'a>(grid: &'a Grid<'_>) -> impl Iterator<Item = Edge> + 'a {
    let pixels = grid.valid.len();
    (0..pixels).filter_map(|i| grid.right(i)).chain((0..pixels).filter_map(|i| grid.down(i)))
}

/// Edges by falling quality of their worse end.
///
/// A flood that always takes the best pixel at its border reaches each pixel along the path whose worst pixel is as good as
/// possible. The tree of edges sorted so has the same paths, but no start that would have to be chosen in each component.
pub fn best_pixels_first<'a>(grid: &'a Grid<'_>, quality: &[f32]) -> impl Iterator<Item = Edge> + 'a {
    // The bits of a float that is not negative rise with it.
    let order = grid.sorted(|(a, b)| !quality[a].min(quality[b]).max(0.0).to_bits());
    order.into_iter().map(|number| grid.edge(number))
}

/// Edges whose ends differ by more than half a turn in the result.
pub fn discontinuities(grid: &Grid<'_>, angles: &Angles, turns: &[i32]) -> usize {
    grid.edges().filter(|(_, (a, b))| turns[*b] - turns[*a] != angles.step(*a, *b)).count()
}

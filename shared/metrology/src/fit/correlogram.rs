//! Pairs of cells of points by their distance.

use fearless_simd::{Level, dispatch};
use nalgebra::{ArrayStorage, SMatrix, SVector};
use rayon::prelude::*;
use std::ops::Range;

use super::cells::Cubes;
use super::correlation::{Cell, MOST_ROWS};
use fringe::math::statistics::median;

/// Noise correlated over more than this part of the extent cannot be separated from form.
const REACH_SHARE: f64 = 1.0 / 3.0;

/// Width of a bin over the spacing of neighbours. In bins of just that spacing, those neighbours on an exact grid would come first whose
/// residuals agree, since others add to the distance: noise without any correlation would seem correlated. It suffices for noise
/// up to a twentieth of the spacing.
const BIN_SPACINGS: f64 = 1.04;

/// Cells whose pairs one thread sums; fixed, so that no result depends on the number of threads.
const CELLS_AT_ONCE: usize = 128;

/// Places whose distances are looked at side by side.
const SIDE_BY_SIDE: usize = 8;

/// Bins that are summed at first.
const FIRST_BINS: usize = 4;

/// Pairs of cells of about one distance.
#[derive(Clone)]
pub(super) struct Bin<const P: usize> {
    /// Sum of products of scores, Σ S S′.
    pub product: f64,
    /// Sum of squared products of scores, Σ (S S′)².
    pub square: f64,
    /// Number of pairs of residuals, Σ n n′ for each row.
    pub pairs: f64,
    /// Sum of products of derivatives, Σ J J′ᵀ.
    pub derivatives: SMatrix<f64, P, P>,
}

impl<const P: usize> Bin<P> {
    const EMPTY: Self = Self {
        product: 0.0,
        square: 0.0,
        pairs: 0.0,
        derivatives: SMatrix::from_array_storage(ArrayStorage([[0.0; P]; P])),
    };

    /// Adds the pairs of another bin of the same distance.
    fn add(&mut self, other: &Self) {
        self.product += other.product;
        self.square += other.square;
        self.pairs += other.pairs;
        self.derivatives += other.derivatives;
    }

    /// Adds the pairs of a cell with those in one of its bins.
    fn add_pairs(&mut self, cell: &Cell<P>, beside: &Beside<P>, rows: usize) {
        for row in 0..rows {
            self.product += cell.residual[row] * beside.residual[row];
            self.derivatives += cell.derivatives[row] * beside.derivatives[row].transpose();
        }
        let ([first, second], [of_first, of_both, of_second]) = (cell.residual, beside.products);
        let squares = first * first * of_first + 2.0 * first * second * of_both + second * second * of_second;
        self.square += squares.max(0.0);
        self.pairs += rows as f64 * cell.count * beside.count;
    }
}

/// What the cells say that lie in one bin of another cell: sums of products with that cell are products with their sums.
#[derive(Clone)]
struct Beside<const P: usize> {
    /// Σ n′ of points.
    count: f64,
    /// Σ S′ of each row.
    residual: [f64; MOST_ROWS],
    /// Σ S′ S′ᵀ of the rows: of the first, of both, of the second.
    products: [f64; 3],
    /// Σ J′ of each row.
    derivatives: [SVector<f64, P>; MOST_ROWS],
}

impl<const P: usize> Beside<P> {
    const NONE: Self = Self {
        count: 0.0,
        residual: [0.0; MOST_ROWS],
        products: [0.0; 3],
        derivatives: [SVector::<f64, P>::from_array_storage(ArrayStorage([[0.0; P]])); MOST_ROWS],
    };

    #[inline(always)]
    fn add(&mut self, cell: &Cell<P>, rows: usize) {
        self.count += cell.count;
        for row in 0..rows {
            self.residual[row] += cell.residual[row];
            self.derivatives[row] += cell.derivatives[row];
        }
        let [first, second] = cell.residual;
        self.products[0] += first * first;
        if rows > 1 {
            self.products[1] += first * second;
            self.products[2] += second * second;
        }
    }
}

/// Pairs of cells by their distance, in bins about as wide as neighbours are apart (median). Bins are summed as far out as they are
/// asked for: pairs grow with the square of their distance, and noise seldom reaches over more than some cells.
pub(super) struct Correlogram<'a, const P: usize> {
    /// In the order of their places along the longest axis, and each coordinate of these places in one piece: most pairs are only
    /// asked how far apart they are.
    cells: Vec<&'a Cell<P>>,
    places: [Vec<f64>; 3],
    axis: usize,
    /// Residuals of a point: curves have two, surfaces one.
    rows: usize,
    /// Width of a bin.
    pub width_mm: f64,
    /// Bins up to where noise can be told from form.
    most: usize,
    bins: Vec<Bin<P>>,
}

impl<'a, const P: usize> Correlogram<'a, P> {
    /// Of these cells; nothing is summed yet.
    pub fn new(cells: &'a [Cell<P>]) -> Self {
        let extent = Cubes::new(&cells.iter().map(|c| c.position).collect::<Vec<_>>()).extent();
        let axis = extent.imax();
        let mut cells: Vec<&Cell<P>> = cells.iter().collect();
        cells.sort_by(|a, b| a.position[axis].total_cmp(&b.position[axis]));
        let places = [0, 1, 2].map(|axis| cells.iter().map(|c| c.position[axis]).collect::<Vec<f64>>());
        let reach_mm = REACH_SHARE * extent[axis];
        // No more bins than cells: neighbours that coincide would need infinitely many.
        let width_mm = BIN_SPACINGS * spacing_mm(places.each_ref().map(Vec::as_slice), axis);
        let width_mm = width_mm.max(reach_mm / cells.len().max(1) as f64);
        let most = if width_mm > 0.0 { (reach_mm / width_mm) as usize + 1 } else { 0 };
        let curves = cells.iter().any(|c| c.derivatives[1] != SVector::<f64, P>::zeros());
        Self {
            places,
            cells,
            axis,
            rows: 1 + usize::from(curves),
            width_mm: width_mm.max(0.0),
            most,
            bins: Vec::with_capacity(most),
        }
    }

    /// The bin of a number; `None` beyond the last one.
    pub fn bin(&mut self, index: usize) -> Option<&Bin<P>> {
        if index == self.bins.len() && index < self.most {
            self.sum_up_to(self.most.min(FIRST_BINS.max(2 * index)));
        }
        self.bins.get(index)
    }

    /// Sums the pairs of the bins from those that are there up to a number of them.
    fn sum_up_to(&mut self, count: usize) {
        let before = self.bins.len();
        let starts: Vec<usize> = (0..self.cells.len()).step_by(CELLS_AT_ONCE).collect();
        let parts: Vec<Vec<Bin<P>>> =
            starts.into_par_iter().map(|start| self.pairs_of(start, before..count)).collect();
        self.bins.resize(count, Bin::EMPTY);
        for part in parts {
            self.bins[before..].iter_mut().zip(&part).for_each(|(bin, more)| bin.add(more));
        }
    }

    /// Sums the pairs of some cells with those behind each, in some bins.
    fn pairs_of(&self, start: usize, numbers: Range<usize>) -> Vec<Bin<P>> {
        let Self { cells, places, axis, rows, width_mm, .. } = self;
        let cells = &cells[start..];
        let [xs, ys, zs] = places.each_ref().map(|places| &places[start..]);
        let mut bins = vec![Bin::EMPTY; numbers.len()];
        let mut all_beside = vec![Beside::NONE; numbers.len()];
        let (mut squares, mut near) = (vec![0.0; cells.len()], vec![0_u32; cells.len()]);
        // A little wider, for rounding may put a pair at a border into the bin before it, or behind it.
        let nearest = (width_mm * numbers.start as f64).powi(2) * (1.0 - 1e-9);
        let far = (width_mm * numbers.end as f64).powi(2) * (1.0 + 1e-9);
        let level = Level::new();
        for (index, cell) in cells.iter().take(CELLS_AT_ONCE).enumerate() {
            let here = [xs[index], ys[index], zs[index]];
            let behind = [xs, ys, zs].map(|places| &places[index + 1..]);
            let reached = behind[*axis].partition_point(|along| (along - here[*axis]).powi(2) < far);
            let behind = behind.map(|places| &places[..reached]);
            dispatch!(level, _simd => squares_from(here, behind, &mut squares[..reached]));
            // Which pair is near enough no processor foresees: all are written, and those that are not are written over.
            let mut found = 0;
            for (other, square) in squares[..reached].iter().enumerate() {
                near[found] = other as u32;
                found += usize::from(*square < far) & usize::from(*square >= nearest);
            }
            all_beside.fill(Beside::NONE);
            for other in near[..found].iter().map(|other| *other as usize) {
                let number = (squares[other].sqrt() / width_mm) as usize;
                if let Some(beside) = all_beside.get_mut(number.wrapping_sub(numbers.start)) {
                    beside.add(cells[index + 1 + other], *rows);
                }
            }
            for (bin, beside) in bins.iter_mut().zip(&all_beside).filter(|(_, beside)| beside.count > 0.0) {
                bin.add_pairs(cell, beside, *rows);
            }
        }
        bins
    }
}

/// Squared distances of places from one, mm².
#[inline(always)]
fn squares_from(here: [f64; 3], [x, y, z]: [&[f64]; 3], squares: &mut [f64]) {
    for (((x, y), z), square) in x.iter().zip(y).zip(z).zip(squares) {
        let [x, y, z] = [x - here[0], y - here[1], z - here[2]];
        *square = x * x + y * y + z * z;
    }
}

/// Median distance of a position to its nearest neighbour, mm; the positions are in the order of one of their coordinates.
fn spacing_mm(places: [&[f64]; 3], axis: usize) -> f64 {
    let level = Level::new();
    let mut nearest = dispatch!(level, _simd => nearest_squares(places, axis));
    if nearest.len() < 2 {
        return 0.0;
    }
    median(&mut nearest).map_or(0.0, f64::sqrt)
}

/// Squared distance of each position to its nearest neighbour, mm²: some others are asked side by side, from the position on to either side.
#[inline(always)]
fn nearest_squares(places: [&[f64]; 3], axis: usize) -> Vec<f64> {
    let count = places[axis].len();
    let mut all = Vec::with_capacity(count);
    for index in 0..count {
        let here = places.map(|places| places[index]);
        let mut nearest = f64::INFINITY;
        // What lies farther along the axis than the nearest so far lies farther.
        let beyond = |other: usize, nearest: f64| {
            let along = places[axis][other] - here[axis];
            along * along >= nearest
        };
        let (mut start, mut end) = (index + 1, index);
        while start < count && !beyond(start, nearest) {
            let next = (start + SIDE_BY_SIDE).min(count);
            nearest = nearest_of(here, places.map(|places| &places[start..next]), nearest);
            start = next;
        }
        while end > 0 && !beyond(end - 1, nearest) {
            let next = end.saturating_sub(SIDE_BY_SIDE);
            nearest = nearest_of(here, places.map(|places| &places[next..end]), nearest);
            end = next;
        }
        all.push(nearest);
    }
    all
}

/// The least squared distance from a place to some others, mm², or `nearest` where none is less.
#[inline(always)]
fn nearest_of(here: [f64; 3], others: [&[f64]; 3], mut nearest: f64) -> f64 {
    let mut squares = [f64::INFINITY; SIDE_BY_SIDE];
    squares_from(here, others, &mut squares);
    for square in squares {
        nearest = if square < nearest { square } else { nearest };
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_is_the_nearest_of_all(
            mut places in proptest::collection::vec((0_i32..30, 0_i32..30, 0_i32..3), 1..60),
        ) {
            places.sort_unstable();
            let of = |axis: usize| -> Vec<f64> {
                places.iter().map(|p| f64::from([p.0, p.1, p.2][axis])).collect()
            };
            let [x, y, z] = [of(0), of(1), of(2)];
            let square = |i: usize, j: usize| (x[i] - x[j]).powi(2) + (y[i] - y[j]).powi(2) + (z[i] - z[j]).powi(2);
            let others = |i: usize| (0..x.len()).filter(move |j| *j != i);
            let expected: Vec<f64> =
                (0..x.len()).map(|i| others(i).map(|j| square(i, j)).fold(f64::INFINITY, f64::min)).collect();
            prop_assert_eq!(nearest_squares([&x, &y, &z], 0), expected);
        }

        #[test]
        fn bins_asked_for_one_by_one_are_those_summed_at_once(
            places in proptest::collection::vec((0_i32..40, 0_i32..40, -9_i32..9), 2..300)
        ) {
            // Whole numbers put pairs on the borders of bins.
            let cells: Vec<Cell<1>> = places.iter().map(|(x, y, residual)| Cell {
                position: Vector3::new(f64::from(*x), f64::from(*y), 0.0),
                count: 1.0,
                residual: [f64::from(*residual) * 0.1, 0.0],
                derivatives: [SVector::repeat(1.0), SVector::zeros()],
                score: SVector::repeat(f64::from(*residual) * 0.1),
                information: SMatrix::repeat(1.0),
            }).collect();
            let (mut one_by_one, mut at_once) = (Correlogram::new(&cells), Correlogram::new(&cells));
            at_once.sum_up_to(at_once.most);
            for (index, expected) in at_once.bins.iter().enumerate() {
                let bin = one_by_one.bin(index).expect("as many bins");
                prop_assert_eq!(bin.product.to_bits(), expected.product.to_bits());
                prop_assert_eq!(bin.square.to_bits(), expected.square.to_bits());
                prop_assert_eq!((bin.pairs, bin.derivatives), (expected.pairs, expected.derivatives));
            }
            prop_assert!(one_by_one.bin(at_once.bins.len()).is_none());
        }

        #[test]
        fn bins_hold_what_their_pairs_give_one_by_one(
            places in proptest::collection::vec((0.0..40.0, 0.0..40.0, -0.9..0.9, -0.9..0.9, 1.0..9.0), 2..200),
            curves: bool
        ) {
            let cells: Vec<Cell<2>> = places.iter().map(|(x, y, r, s, count)| {
                let second = if curves { [*s, 1.0 + s * s] } else { [0.0; 2] };
                Cell {
                    position: Vector3::new(*y, *x, 0.0),
                    count: *count,
                    residual: [*r, second[0]],
                    derivatives: [SVector::from([1.0 + r, *s]), SVector::from(second)],
                    score: SVector::zeros(),
                    information: SMatrix::zeros(),
                }
            }).collect();
            let mut correlogram = Correlogram::new(&cells);
            correlogram.sum_up_to(correlogram.most);
            let mut expected: Vec<[f64; 4]> = vec![[0.0; 4]; correlogram.bins.len()];
            for (first, second) in cells.iter().enumerate().flat_map(|(i, a)| cells[..i].iter().map(move |b| (a, b))) {
                let number = (first.position - second.position).norm() / correlogram.width_mm;
                let Some(sums) = expected.get_mut(number as usize) else { continue };
                let both = first.residual[0] * second.residual[0] + first.residual[1] * second.residual[1];
                let derivatives = [0, 1].map(|row| first.derivatives[row] * second.derivatives[row].transpose());
                let trace = (derivatives[0] + derivatives[1]).trace();
                let pairs = correlogram.rows as f64 * first.count * second.count;
                for (sum, more) in sums.iter_mut().zip([both, both * both, pairs, trace]) {
                    *sum += more;
                }
            }
            for (bin, expected) in correlogram.bins.iter().zip(&expected) {
                let found = [bin.product, bin.square, bin.pairs, bin.derivatives.trace()];
                for (found, expected) in found.iter().zip(expected) {
                    prop_assert!((found - expected).abs() < 1e-10 * (1.0 + bin.pairs), "{found} {expected}");
                }
            }
        }
    }
}

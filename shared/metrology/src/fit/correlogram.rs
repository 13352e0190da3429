//! Pairs of cells of points by their distance.

use nalgebra::{SMatrix, SVector, Vector3};

use super::cells::Cubes;
use super::correlation::Cell;
use fringe::math::statistics::median;

/// Noise correlated over more than this part of the extent cannot be separated from form.
const REACH_SHARE: f64 = 1.0 / 3.0;

/// Bins that are summed at first.
const FIRST_BINS: usize = 4;

/// Pairs of cells of about one distance.
pub(super) struct Bin<const P: usize> {
    /// Sum of products of scores, Σ S S′.
    pub product: f64,
    /// Sum of squared products of scores, Σ (S S′)².
    pub square: f64,
    /// Number of pairs of points, Σ n n′.
    pub pairs: f64,
    /// Sum of products of derivatives, Σ J J′ᵀ.
    pub derivatives: SMatrix<f64, P, P>,
}

/// Pairs of cells by their distance, in bins as wide as neighbours are apart (median). Bins are summed as far out as they are
/// asked for: pairs grow with the square of their distance, and noise seldom reaches over more than some cells.
pub(super) struct Correlogram<'a, const P: usize> {
    cells: &'a [Cell<P>],
    /// Where they lie, in one piece: most pairs are only asked how far apart they are.
    positions: Vec<Vector3<f64>>,
    /// Residuals of a point: curves have two, surfaces one.
    rows: usize,
    /// The lowest first coordinate of a cell and of those behind it, mm.
    lowest_later: Vec<f64>,
    /// Width of a bin.
    pub width_mm: f64,
    /// Bins up to where noise can be told from form.
    most: usize,
    bins: Vec<Bin<P>>,
}

impl<'a, const P: usize> Correlogram<'a, P> {
    /// Of these cells; nothing is summed yet.
    pub fn new(cells: &'a [Cell<P>]) -> Self {
        let positions: Vec<Vector3<f64>> = cells.iter().map(|c| c.position).collect();
        let reach_mm = REACH_SHARE * extent_mm(&positions);
        // No more bins than cells: neighbours that coincide would need infinitely many.
        let width_mm = spacing_mm(&positions).max(reach_mm / cells.len().max(1) as f64);
        let most = if width_mm > 0.0 { (reach_mm / width_mm) as usize + 1 } else { 0 };
        let curves = cells.iter().any(|c| c.derivatives[1] != SVector::<f64, P>::zeros());
        // Cells come in the order of their first coordinate, but for the places within them.
        let mut lowest_later: Vec<f64> = positions.iter().map(|p| p.x).collect();
        for index in (1..lowest_later.len()).rev() {
            lowest_later[index - 1] = lowest_later[index - 1].min(lowest_later[index]);
        }
        Self {
            cells,
            positions,
            rows: 1 + usize::from(curves),
            lowest_later,
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
        let empty = || Bin { product: 0.0, square: 0.0, pairs: 0.0, derivatives: SMatrix::zeros() };
        self.bins.resize_with(count, empty);
        // A little farther, for rounding may put a pair at the border into the bin before it.
        let far = (self.width_mm * count as f64).powi(2) * (1.0 + 1e-9);
        for (index, first) in self.positions.iter().enumerate() {
            let reached = self.lowest_later[index + 1..].partition_point(|x| {
                let along = x - first.x;
                along <= 0.0 || along * along < far
            });
            let later = index + 1..index + 1 + reached;
            for (other, second) in later.clone().zip(&self.positions[later]) {
                let square = (first - second).norm_squared();
                if square >= far {
                    continue;
                }
                let number = (square.sqrt() / self.width_mm) as usize;
                if let Some(bin) = self.bins[before..].get_mut(number.wrapping_sub(before)) {
                    add_pair(bin, &self.cells[index], &self.cells[other], self.rows);
                }
            }
        }
    }
}

/// Adds a pair of cells to a bin.
fn add_pair<const P: usize>(bin: &mut Bin<P>, first: &Cell<P>, second: &Cell<P>, rows: usize) {
    let mut both = 0.0;
    for row in 0..rows {
        both += first.residual[row] * second.residual[row];
        for column in 0..P {
            let other = second.derivatives[row][column];
            for line in 0..P {
                bin.derivatives[(line, column)] += first.derivatives[row][line] * other;
            }
        }
    }
    bin.product += both;
    bin.square += both * both;
    bin.pairs += first.count * second.count;
}

/// Median distance of a position to its nearest neighbour, mm.
fn spacing_mm(positions: &[Vector3<f64>]) -> f64 {
    // Along the longest axis: what lies farther along it than the nearest so far lies farther.
    let axis = (Cubes::new(positions).extent()).imax();
    let mut sorted = positions.to_vec();
    sorted.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
    let nearest_of = |index: usize| {
        let here = &sorted[index];
        let mut nearest = f64::INFINITY;
        let mut walk = |other: &Vector3<f64>| {
            let along = other[axis] - here[axis];
            if along * along >= nearest {
                return false;
            }
            nearest = nearest.min((here - other).norm_squared());
            true
        };
        let _ended = sorted[index + 1..].iter().all(&mut walk);
        let _ended = sorted[..index].iter().rev().all(&mut walk);
        nearest
    };
    let mut nearest: Vec<f64> = (0..sorted.len()).map(nearest_of).collect();
    if nearest.len() < 2 {
        return 0.0;
    }
    median(&mut nearest).map_or(0.0, f64::sqrt)
}

/// Largest edge of the bounding box, mm.
fn extent_mm(points: &[Vector3<f64>]) -> f64 {
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
    (high - low).max()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
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
    }
}

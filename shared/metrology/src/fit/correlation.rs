//! Covariance when the range of the noise's correlation is not known: estimated from the residuals themselves.
//!
//! With A = JᵀJ the covariance of the parameters is A⁻¹ M A⁻¹, M = Σᵢⱼ Jᵢ C(dᵢⱼ) Jⱼᵀ, C the covariance of the noise of
//! two points at the distance d. Cells of one size (1.41 to 2.6) hold the noise within them as it is (M₀ = Σ s sᵀ of
//! their scores). Between cells C is taken as a function of the distance alone and estimated from all pairs of cells of
//! a distance together (Conley 1999, with the weights of a correlogram instead of a kernel of given width), from the
//! nearest outwards up to the first distance where it no longer stands out of its own scatter (Geyer 1992, initial
//! positive sequence). Compared with cells of a given edge this neither cuts what reaches over their borders nor needs
//! the edge; compared with ever larger cells it does not run out of cells.
//!
//! Residuals hide a part of the noise, the one that the fit followed: cov(r) ≈ C − J V Jᵀ, V the covariance sought. It
//! is added back, by fixed-point iteration, which also replaces the factors for few points.

use nalgebra::{Cholesky, SMatrix, SVector, Vector3};

use super::adjust::Model;
use super::cells::Cubes;
use fringe::math::statistics::median;

/// Most cells: half a million pairs, some four milliseconds. Finer cells stated the same uncertainties on a hundred
/// scans.
const MOST_CELLS: usize = 1000;

/// Residuals a point may have (two for curves in space).
const MOST_ROWS: usize = 2;

/// Noise correlated over more than this part of the extent cannot be separated from form.
const REACH_SHARE: f64 = 1.0 / 3.0;

/// Rounds of adding back what the fit followed: each leaves the followed share (a tenth, say) of the error before.
const ROUNDS: usize = 8;

/// Bins that are summed at first.
const FIRST_BINS: usize = 4;

/// A bin counts while its covariance exceeds this many of its standard deviations. Measured on caps with noise of known
/// range: 0 states 3 % too much without correlation, 2 cuts 4 % of the uncertainty off with it.
const SIGNIFICANT: f64 = 1.0;

/// Variance after adding back over variance before: beyond it the fixed point runs away, because the noise reaches over
/// so much of the element that the residuals do not show how much of it the fit followed.
const RUNAWAY: f64 = 4.0;

/// Sums over the points of a cell.
struct Cell<const P: usize> {
    position: Vector3<f64>,
    count: f64,
    /// Σ r of each row.
    residual: [f64; MOST_ROWS],
    /// Σ J of each row.
    derivatives: [SVector<f64, P>; MOST_ROWS],
    /// Σ J r over all rows.
    score: SVector<f64, P>,
    /// Σ J Jᵀ over all rows.
    information: SMatrix<f64, P, P>,
}

/// Pairs of cells of about one distance.
struct Bin<const P: usize> {
    /// Sum of products of scores, Σ S S′.
    product: f64,
    /// Sum of squared products of scores, Σ (S S′)².
    square: f64,
    /// Number of pairs of points, Σ n n′.
    pairs: f64,
    /// Sum of products of derivatives, Σ J J′ᵀ.
    derivatives: SMatrix<f64, P, P>,
}

/// The middle matrix of the sandwich applied: covariance, number of cells, reach of the correlation.
pub(crate) struct Estimate<const P: usize> {
    pub covariance: SMatrix<f64, P, P>,
    pub cells: usize,
    pub reach_mm: f64,
}

/// Estimates the covariance of the parameters of a model; `inverse` is A⁻¹.
pub(super) fn estimate<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    inverse: &SMatrix<f64, P, P>,
) -> Estimate<P> {
    estimate_rows(points, &|index, mut add| model.rows(&points[index], &mut add), inverse)
}

/// Gives the residuals of a point, by its index, with their derivatives.
type Rows<'a, const P: usize> = &'a dyn Fn(usize, &mut dyn FnMut(f64, &SVector<f64, P>));

/// Estimates the covariance of parameters from the residuals of points; `inverse` is A⁻¹. Parameters that are held fixed
/// have zero derivatives, and zeros in `inverse`.
pub(crate) fn estimate_rows<const P: usize>(
    points: &[Vector3<f64>],
    rows: Rows<'_, P>,
    inverse: &SMatrix<f64, P, P>,
) -> Estimate<P> {
    let cells = gather(rows, points);
    let mut correlogram = Correlogram::new(&cells);
    let mut with = |covariance: &SMatrix<f64, P, P>| {
        let within = within(&cells, covariance);
        let (between, reach) = between(&mut correlogram, covariance);
        (admissible(&sandwich(inverse, &within), &sandwich(inverse, &(within + between))), reach)
    };
    let (first, mut reach) = with(&SMatrix::zeros());
    let mut covariance = first;
    for _ in 0..ROUNDS {
        let (next, last) = with(&covariance);
        if next.diagonal().iter().zip(&first.diagonal()).any(|(n, f)| n.is_nan() || *n > RUNAWAY * f) {
            break;
        }
        (covariance, reach) = (next, last);
    }
    Estimate { covariance, cells: cells.len(), reach_mm: reach as f64 * correlogram.width_mm }
}

/// A⁻¹ M A⁻¹, symmetric to the last bit.
fn sandwich<const P: usize>(inverse: &SMatrix<f64, P, P>, middle: &SMatrix<f64, P, P>) -> SMatrix<f64, P, P> {
    let full = inverse * middle * inverse;
    (full + full.transpose()) * 0.5
}

/// The middle matrix within cells, given the covariance so far.
fn within<const P: usize>(cells: &[Cell<P>], covariance: &SMatrix<f64, P, P>) -> SMatrix<f64, P, P> {
    let mut within = SMatrix::<f64, P, P>::zeros();
    for cell in cells {
        let followed = cell.information * covariance * cell.information;
        within += cell.score * cell.score.transpose() + followed;
    }
    within
}

/// The middle matrix between cells, and the number of bins that count, given the covariance so far.
fn between<const P: usize>(
    correlogram: &mut Correlogram<'_, P>,
    covariance: &SMatrix<f64, P, P>,
) -> (SMatrix<f64, P, P>, usize) {
    let mut between = SMatrix::<f64, P, P>::zeros();
    let (mut last, mut index) = (0, 0);
    while let Some(bin) = correlogram.bin(index) {
        index += 1;
        if bin.pairs == 0.0 {
            continue;
        }
        let noise = (bin.product + bin.derivatives.component_mul(covariance).sum()) / bin.pairs;
        let limit = SIGNIFICANT * bin.square.sqrt() / bin.pairs;
        if noise.is_nan() || noise <= limit {
            break;
        }
        between += (bin.derivatives + bin.derivatives.transpose()) * noise;
        last = index;
    }
    (between, last)
}

/// A sequence that is cut off need not be a covariance. Where it takes away most of the variance of some combination of
/// parameters, the mean inflation over all parameters stands in.
fn admissible<const P: usize>(within: &SMatrix<f64, P, P>, all: &SMatrix<f64, P, P>) -> SMatrix<f64, P, P> {
    let scale = within.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaled =
        |m: &SMatrix<f64, P, P>| SMatrix::<f64, P, P>::from_fn(|r, c| m[(r, c)] * scale[r] * scale[c]);
    // Parameters that are held fixed have no variance; a one in their place leaves the others as they are.
    let fixed = SMatrix::<f64, P, P>::from_diagonal(&scale.map(|s| f64::from(u8::from(s == 0.0))));
    if Cholesky::new(scaled(&(all - within * 0.25)) + fixed).is_some() {
        return *all;
    }
    let inflation = scaled(all).trace() / (P as f64 - fixed.trace());
    if inflation > 1.0 { within * inflation } else { *within }
}

/// Sums the points into cells; few points are a cell each.
fn gather<const P: usize>(rows: Rows<'_, P>, points: &[Vector3<f64>]) -> Vec<Cell<P>> {
    if points.len() <= MOST_CELLS {
        return (0..points.len() as u32).map(|index| cell(rows, points, &[(0, index)])).collect();
    }
    let cubes = Cubes::new(points);
    let extent_mm = cubes.extent_mm();
    let mut edge_mm = extent_mm / 40.0;
    let mut count = cubes.count(edge_mm);
    for _ in 0..20 {
        if count <= MOST_CELLS && (2 * count > MOST_CELLS || edge_mm < 1e-6 * extent_mm) {
            break;
        }
        // Points on a surface fill cells as the square of the edge; a little coarser than that, to arrive below.
        edge_mm *= 1.05 * (count as f64 / MOST_CELLS as f64).sqrt();
        count = cubes.count(edge_mm);
    }
    while count > MOST_CELLS {
        edge_mm *= 1.5;
        count = cubes.count(edge_mm);
    }
    let keyed = cubes.members(edge_mm);
    let mut cells = Vec::with_capacity(MOST_CELLS);
    cells.extend(keyed.chunk_by(|a, b| a.0 == b.0).map(|members| cell(rows, points, members)));
    cells
}

/// Sums over one cell.
fn cell<const P: usize>(rows: Rows<'_, P>, points: &[Vector3<f64>], members: &[(u64, u32)]) -> Cell<P> {
    let mut sums = Cell {
        position: Vector3::zeros(),
        count: members.len() as f64,
        residual: [0.0; MOST_ROWS],
        derivatives: [SVector::zeros(); MOST_ROWS],
        score: SVector::zeros(),
        information: SMatrix::zeros(),
    };
    for (_, index) in members {
        sums.position += points[*index as usize];
        let mut row = 0;
        rows(*index as usize, &mut |residual, derivatives| {
            sums.residual[row] += residual;
            sums.derivatives[row] += derivatives;
            sums.score += derivatives * residual;
            for column in 0..P {
                for line in 0..P {
                    sums.information[(line, column)] += derivatives[line] * derivatives[column];
                }
            }
            row += 1;
        });
    }
    sums.position /= sums.count;
    sums
}

/// Largest edge of the bounding box, mm.
fn extent_mm(points: &[Vector3<f64>]) -> f64 {
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
    (high - low).max()
}

/// Pairs of cells by their distance, in bins as wide as neighbours are apart (median). Bins are summed as far out as they are
/// asked for: pairs grow with the square of their distance, and noise seldom reaches over more than some cells.
struct Correlogram<'a, const P: usize> {
    cells: &'a [Cell<P>],
    /// Residuals of a point: curves have two, surfaces one.
    rows: usize,
    /// The lowest first coordinate of a cell and of those behind it, mm.
    lowest_later: Vec<f64>,
    width_mm: f64,
    /// Bins up to where noise can be told from form.
    most: usize,
    bins: Vec<Bin<P>>,
}

impl<'a, const P: usize> Correlogram<'a, P> {
    fn new(cells: &'a [Cell<P>]) -> Self {
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
            rows: 1 + usize::from(curves),
            lowest_later,
            width_mm: width_mm.max(0.0),
            most,
            bins: Vec::with_capacity(most),
        }
    }

    /// The bin of a number; `None` beyond the last one.
    fn bin(&mut self, index: usize) -> Option<&Bin<P>> {
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
        for (index, first) in self.cells.iter().enumerate() {
            let reached = self.lowest_later[index + 1..].partition_point(|x| {
                let along = x - first.position.x;
                along <= 0.0 || along * along < far
            });
            for second in &self.cells[index + 1..index + 1 + reached] {
                let square = (first.position - second.position).norm_squared();
                if square >= far {
                    continue;
                }
                let number = (square.sqrt() / self.width_mm) as usize;
                if let Some(bin) = self.bins[before..].get_mut(number.wrapping_sub(before)) {
                    add_pair(bin, first, second, self.rows);
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

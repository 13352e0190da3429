//! Covariance when the range of the noise's correlation is not known: estimated from the residuals themselves.
//!
//! With A = JᵀJ the covariance of the parameters is A⁻¹ M A⁻¹, M = Σᵢⱼ Jᵢ C(dᵢⱼ) Jⱼᵀ, C the covariance of the noise of
//! two points at the distance d. Cells of one size (1.41 to 2.6) hold the noise within them as it is (M₀ = Σ s sᵀ of
//! their scores). Between cells C is taken as a function of the distance alone and estimated from all pairs of cells of
//! a distance together (Conley 1999, with the weights of a correlogram instead of a kernel of given width), from the
//! nearest outwards up to the first distance where it no longer stands out of its own scatter (Geyer 1992, initial
//! positive sequence), and a third farther: smoothing by fitted surfaces makes noise negatively correlated there, and
//! without that part a mean would seem up to a tenth less certain than it is. Compared with cells of a given edge this
//! neither cuts what reaches over their borders nor needs the edge; compared with ever larger cells it does not run out
//! of cells.
//!
//! Residuals hide a part of the noise, the one that the fit followed: cov(r) ≈ C − J V Jᵀ, V the covariance sought. It
//! is added back, by fixed-point iteration, which also replaces the factors for few points.

use fearless_simd::{Level, dispatch};
use nalgebra::{Cholesky, SMatrix, SVector, Vector3};

use super::adjust::Model;
use super::cells::Cubes;
use super::correlogram::Correlogram;

/// Most cells: half a million pairs, some four milliseconds. Finer cells stated the same uncertainties on a hundred
/// scans.
const MOST_CELLS: usize = 1000;

/// Residuals a point may have (two for curves in space).
pub(super) const MOST_ROWS: usize = 2;

/// Rounds of adding back what the fit followed: each leaves the followed share (a tenth, say) of the error before.
const ROUNDS: usize = 8;

/// A bin counts while its covariance exceeds this many of its standard deviations. Measured on caps with noise of known
/// range: 0 states 3 % too much without correlation, 2 cuts 4 % of the uncertainty off with it.
const SIGNIFICANT: f64 = 1.0;

/// One bin is added beyond each so many that count. On a plane of 21 mm by 13 mm with 0.4 mm, 0.3 mm and 0.2 mm between its
/// points, noise smoothed by fits to 5 × 5 of them, the error over what is stated for its height is 0.95 to 0.99 with it and
/// 0.92 to 0.99 without; noise smoothed by means of 5 × 5, never negative, 0.97 to 1.04 and 0.95 to 1.02. One bin for two
/// scatters so much that this becomes 0.98 to 1.08; larger cells once the reach is known state too little, 1.06 to 1.3 (the
/// same estimate written with NumPy, 40 to 100 planes a figure).
const BINS_BEFORE_ONE_BEYOND: usize = 3;

/// Variance after adding back over variance before: beyond it the fixed point runs away, because the noise reaches over
/// so much of the element that the residuals do not show how much of it the fit followed.
const RUNAWAY: f64 = 4.0;

/// Sums over the points of a cell.
pub(super) struct Cell<const P: usize> {
    pub position: Vector3<f64>,
    pub count: f64,
    /// Σ r of each row.
    pub residual: [f64; MOST_ROWS],
    /// Σ J of each row.
    pub derivatives: [SVector<f64, P>; MOST_ROWS],
    /// Σ J r over all rows.
    pub score: SVector<f64, P>,
    /// Σ J Jᵀ over all rows.
    pub information: SMatrix<f64, P, P>,
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
    estimate_rows(points, &OfModel { model, points }, inverse)
}

/// Residuals of points, by their index, with their derivatives. To be inlined: what is not, is compiled for the plainest processor.
pub(crate) trait Rows<const P: usize> {
    /// Calls `add` with each residual of a point.
    fn rows(&self, index: usize, add: &mut impl FnMut(f64, &SVector<f64, P>));
}

/// Those of the points of a model.
struct OfModel<'a, M> {
    model: &'a M,
    points: &'a [Vector3<f64>],
}

impl<M: Model<P>, const P: usize> Rows<P> for OfModel<'_, M> {
    #[inline(always)]
    fn rows(&self, index: usize, add: &mut impl FnMut(f64, &SVector<f64, P>)) {
        self.model.rows(&self.points[index], add);
    }
}

/// Estimates the covariance of parameters from the residuals of points; `inverse` is A⁻¹. Parameters that are held fixed
/// have zero derivatives, and zeros in `inverse`.
pub(crate) fn estimate_rows<const P: usize>(
    points: &[Vector3<f64>],
    rows: &impl Rows<P>,
    inverse: &SMatrix<f64, P, P>,
) -> Estimate<P> {
    let cells = gather(rows, points);
    let (mut correlogram, scores) = (Correlogram::new(&cells), Within::new(&cells));
    let mut with = |covariance: &SMatrix<f64, P, P>| {
        let within = scores.given(covariance);
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

/// The middle matrix within cells: Σ s sᵀ, and what the fit followed, Σ I C I of their information I, which is linear in the covariance C.
struct Within<const P: usize> {
    scores: SMatrix<f64, P, P>,
    /// Σ I · column a · row b · I, by a and b.
    followed: [[SMatrix<f64, P, P>; P]; P],
}

impl<const P: usize> Within<P> {
    fn new(cells: &[Cell<P>]) -> Self {
        let nothing = SMatrix::<f64, P, P>::zeros();
        let mut sums = Self { scores: nothing, followed: [[nothing; P]; P] };
        for Cell { score, information, .. } in cells {
            sums.scores += score * score.transpose();
            for (a, of_column) in sums.followed.iter_mut().enumerate() {
                for (b, followed) in of_column.iter_mut().enumerate() {
                    *followed += information.column(a) * information.row(b);
                }
            }
        }
        sums
    }

    /// Given the covariance so far.
    fn given(&self, covariance: &SMatrix<f64, P, P>) -> SMatrix<f64, P, P> {
        let mut within = self.scores;
        for (a, of_column) in self.followed.iter().enumerate() {
            for (b, followed) in of_column.iter().enumerate() {
                within += followed * covariance[(a, b)];
            }
        }
        within
    }
}

/// The middle matrix between cells, and the number of bins that count, given the covariance so far.
fn between<const P: usize>(
    correlogram: &mut Correlogram<'_, P>,
    covariance: &SMatrix<f64, P, P>,
) -> (SMatrix<f64, P, P>, usize) {
    let mut between = SMatrix::<f64, P, P>::zeros();
    // The bins that count, and those that are added; the latter are known once one of them does not count.
    let (mut last, mut end, mut index) = (0, usize::MAX, 0);
    while index < end
        && let Some(bin) = correlogram.bin(index)
    {
        index += 1;
        if bin.pairs == 0.0 {
            continue;
        }
        let noise = (bin.product + bin.derivatives.component_mul(covariance).sum()) / bin.pairs;
        let limit = SIGNIFICANT * bin.square.sqrt() / bin.pairs;
        if end == usize::MAX && noise > limit {
            last = index;
        } else if end == usize::MAX {
            end = last + last / BINS_BEFORE_ONE_BEYOND;
        }
        if index > end || noise.is_nan() {
            break;
        }
        between += (bin.derivatives + bin.derivatives.transpose()) * noise;
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
fn gather<const P: usize>(rows: &impl Rows<P>, points: &[Vector3<f64>]) -> Vec<Cell<P>> {
    let level = Level::new();
    if points.len() <= MOST_CELLS {
        return (0..points.len() as u32).map(|index| cell_with(level, rows, points, &[(0, index)])).collect();
    }
    let mut cubes = Cubes::new(points);
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
    cells.extend(keyed.chunk_by(|a, b| a.0 == b.0).map(|members| cell_with(level, rows, points, members)));
    cells
}

/// As [`cell`] with given instructions, which change no bit.
fn cell_with<const P: usize>(
    level: Level,
    rows: &impl Rows<P>,
    points: &[Vector3<f64>],
    members: &[(u64, u32)],
) -> Cell<P> {
    dispatch!(level, _simd => cell(rows, points, members))
}

/// Sums over one cell.
#[inline(always)]
fn cell<const P: usize>(rows: &impl Rows<P>, points: &[Vector3<f64>], members: &[(u64, u32)]) -> Cell<P> {
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
        let mut found = [(0.0, SVector::<f64, P>::zeros()); MOST_ROWS];
        let mut count = 0;
        rows.rows(*index as usize, &mut |residual, derivatives| {
            found[count] = (residual, *derivatives);
            count += 1;
        });
        for (row, (residual, derivatives)) in found[..count].iter().enumerate() {
            sums.residual[row] += residual;
            sums.derivatives[row] += derivatives;
            sums.score += derivatives * *residual;
            for column in 0..P {
                for line in 0..P {
                    sums.information[(line, column)] += derivatives[line] * derivatives[column];
                }
            }
        }
    }
    sums.position /= sums.count;
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::random::Key;

    /// Residuals and derivatives of some points, made up.
    struct Given(Vec<(f64, SVector<f64, 3>)>);

    impl Rows<3> for Given {
        fn rows(&self, index: usize, add: &mut impl FnMut(f64, &SVector<f64, 3>)) {
            add(self.0[index].0, &self.0[index].1);
        }
    }

    fn given(count: usize) -> (Given, Vec<Vector3<f64>>) {
        let key = Key::new(3);
        let vector =
            |i: usize, k: u64| Vector3::from_fn(|axis, _| key.with(k).symmetric((3 * i + axis) as u64));
        let rows = (0..count).map(|i| (vector(i, 0).x, vector(i, 1))).collect();
        (Given(rows), (0..count).map(|i| vector(i, 2)).collect())
    }

    /// Proves: the sums that are made once give what each cell by itself gives, for every covariance.
    #[test]
    fn what_the_fit_followed_is_that_of_each_cell() {
        let (rows, points) = given(60);
        let cells: Vec<Cell<3>> =
            (0..20_u32).map(|i| cell(&rows, &points, &[(0, i), (0, i + 20), (0, i + 40)])).collect();
        let sums = Within::new(&cells);
        for number in 0..5 {
            let root = SMatrix::<f64, 3, 3>::from_fn(|r, c| Key::new(number).symmetric((3 * r + c) as u64));
            let covariance = root * root.transpose();
            let of_cell =
                |c: &Cell<3>| c.score * c.score.transpose() + c.information * covariance * c.information;
            let expected: SMatrix<f64, 3, 3> = cells.iter().map(of_cell).sum();
            assert!((sums.given(&covariance) - expected).amax() < 1e-12, "{covariance}");
        }
    }
}

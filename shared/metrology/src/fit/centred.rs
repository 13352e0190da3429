//! Points about their centroid, checked, with their principal axes.

use nalgebra::{Matrix3, Point3, Vector3};

use super::{COORDINATE_LIMIT_MM, FitError};
use fringe::math::linear::eigen_fixed;

/// Points summed one after another before the binary tree takes over.
const LEAF: usize = 256;

/// Branches of more points than this are summed side by side.
const BRANCH: usize = 8192;

/// Below this ratio of extents points count as coplanar or collinear: coordinates of 1 m that carry 1e-13 mm of
/// rounding, over an extent of 1 mm, reach 1e-13; the flattest real cap (sagitta 1 µm over 100 mm) has 1e-5.
const FLAT: f64 = 1e-9;

/// Points in mm about their centroid.
#[derive(Debug, Clone)]
pub(super) struct Centred {
    /// Centroid of the points, mm.
    pub centroid: Vector3<f64>,
    /// Points less the centroid, mm.
    pub points: Vec<Vector3<f64>>,
}

impl Centred {
    /// Checks and centres.
    ///
    /// # Errors
    /// A coordinate that is no length in mm.
    pub fn new(element: &'static str, points: &[Point3<f64>]) -> Result<Self, FitError> {
        for (index, point) in points.iter().enumerate() {
            if let Some(&value) =
                point.iter().find(|v| !(-COORDINATE_LIMIT_MM..=COORDINATE_LIMIT_MM).contains(*v))
            {
                return Err(FitError::Coordinate { element, index, value });
            }
        }
        let centroid = mean(points, |p| p.coords);
        Ok(Self { centroid, points: points.iter().map(|p| p.coords - centroid).collect() })
    }
}

/// Mean of the places of items, mm; zero of none.
pub(super) fn mean<T: Sync>(items: &[T], place: impl Fn(&T) -> Vector3<f64> + Sync) -> Vector3<f64> {
    let sum: Vector3<f64> = tree(items, &|leaf| leaf.iter().map(&place).sum(), &|a, b| a + b);
    sum / items.len().max(1) as f64
}

/// Reduces a slice over a fixed binary tree: the order of sums depends on the length alone, and the rounding error
/// grows with its logarithm. Threads take branches of it.
pub(super) fn tree<T: Sync, S: Send>(
    items: &[T],
    leaf: &(impl Fn(&[T]) -> S + Sync),
    join: &(impl Fn(S, S) -> S + Sync),
) -> S {
    if items.len() <= LEAF {
        return leaf(items);
    }
    let (left, right) = items.split_at(items.len() / 2);
    if items.len() > BRANCH {
        let (left, right) = rayon::join(|| tree(left, leaf, join), || tree(right, leaf, join));
        return join(left, right);
    }
    join(tree(left, leaf, join), tree(right, leaf, join))
}

/// Principal axes of points about the origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Principal {
    /// Root mean square extents, ascending, mm.
    pub extents_mm: Vector3<f64>,
    /// Unit axes in the columns, in the same order.
    pub axes: Matrix3<f64>,
}

impl Principal {
    /// Of points about their centroid.
    pub fn new(points: &[Vector3<f64>]) -> Self {
        let scatter: Matrix3<f64> = tree(
            points,
            &|leaf| leaf.iter().map(|p| p * p.transpose()).sum(),
            &|a: Matrix3<f64>, b: Matrix3<f64>| a + b,
        );
        let (_, axes) = eigen_fixed(&scatter);
        // Measured along the axes, not as roots of the eigenvalues: those of a plane carry 1e-16 of the largest one,
        // whose root would be a thickness of 1e-8.
        let squares: Vector3<f64> = tree(
            points,
            &|leaf| leaf.iter().map(|p| axes.tr_mul(p)).map(|q| q.component_mul(&q)).sum(),
            &|a: Vector3<f64>, b: Vector3<f64>| a + b,
        );
        Self { extents_mm: squares.map(|s| (s / points.len().max(1) as f64).sqrt()), axes }
    }

    /// Whether all points coincide or lie on one line.
    pub fn collinear(&self) -> bool {
        self.extents_mm[1] <= FLAT * self.extents_mm[2]
    }

    /// Whether all points lie in one plane (or on one line).
    pub fn coplanar(&self) -> bool {
        self.extents_mm[0] <= FLAT * self.extents_mm[2]
    }

    /// Refuses points that lie in one plane, which determine no curved surface.
    pub fn check_spatial(&self, element: &'static str) -> Result<(), FitError> {
        match (self.coplanar(), self.collinear()) {
            (false, _) => Ok(()),
            (true, true) => Err(FitError::Degenerate { element, why: "they lie on one line" }),
            (true, false) => Err(FitError::Degenerate { element, why: "they lie in one plane" }),
        }
    }

    /// Whether all points coincide.
    pub fn coincident(&self) -> bool {
        self.extents_mm[2] == 0.0
    }
}

//! Points about their centroid, checked, with their principal axes.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::{COORDINATE_LIMIT_MM, FitError};
use fringe::math::linear::eigen_fixed;

/// Points summed one after another before the binary tree takes over.
const LEAF: usize = 256;

/// Values that are summed side by side, of which the processor then takes several at a time. It fixes the order of the sums.
const SIDE_BY_SIDE: usize = 8;

/// Branches of more points than this are summed by several threads.
pub(super) const BRANCH: usize = 8192;

/// A thickness beyond this part of the extent is told from a plane's by the scatter alone, whose rounding is 1e-8 of the extent.
const THICK: f64 = 1e-6;

/// Points of which the extent of many is taken.
const EXTENT_POINTS: usize = 1024;

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
        let within = |v: f64| (-COORDINATE_LIMIT_MM..=COORDINATE_LIMIT_MM).contains(&v);
        let leaf = |leaf: &[Point3<f64>]| {
            let (mut sum, mut all) = (Vector3::zeros(), true);
            for p in leaf {
                sum += p.coords;
                all &= within(p.x) & within(p.y) & within(p.z);
            }
            (sum, all)
        };
        let (sum, all) = tree(points, &leaf, &|a: (Vector3<f64>, bool), b| (a.0 + b.0, a.1 & b.1));
        if !all {
            let values = points.iter().enumerate().flat_map(|(index, p)| p.iter().map(move |v| (index, *v)));
            if let Some((index, value)) = values.into_iter().find(|(_, v)| !within(*v)) {
                return Err(FitError::Coordinate { element, index, value });
            }
        }
        let centroid = sum / points.len().max(1) as f64;
        let centred = points.par_iter().with_min_len(BRANCH).map(|p| p.coords - centroid).collect();
        Ok(Self { centroid, points: centred })
    }
}

/// Root mean square distance of points from a place, mm, by some of them when they are many: a scale for what is small beside it.
pub(super) fn extent_mm<'a>(
    points: impl ExactSizeIterator<Item = &'a Vector3<f64>>,
    place: &Vector3<f64>,
) -> f64 {
    let step = points.len().div_ceil(EXTENT_POINTS).max(1);
    let (mut squares, mut count) = (0.0, 0.0);
    for point in points.step_by(step) {
        squares += (point - place).norm_squared();
        count += 1.0;
    }
    if count > 0.0 { (squares / count).sqrt() } else { 0.0 }
}

/// Refuses points about their centroid that lie in one plane, which determine no curved surface. `scatter`: theirs, see [`scatter`].
///
/// # Errors
/// They lie in one plane or on one line.
pub(super) fn check_spatial(
    element: &'static str,
    points: &[Vector3<f64>],
    scatter: &Matrix3<f64>,
) -> Result<(), FitError> {
    let (squares, _) = eigen_fixed(scatter);
    if squares[0] > THICK * THICK * squares[2] {
        return Ok(());
    }
    Principal::new(points).check_spatial(element)
}

/// Σ p pᵀ, mm².
pub(super) fn scatter(points: &[Vector3<f64>]) -> Matrix3<f64> {
    tree(points, &|leaf| leaf.iter().map(|p| p * p.transpose()).sum(), &|a: Matrix3<f64>, b| a + b)
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

/// The sum of a function of values.
pub(super) fn sum(values: &[f64], of: impl Fn(f64) -> f64 + Sync) -> f64 {
    let leaf = |leaf: &[f64]| {
        let (groups, rest) = leaf.as_chunks::<SIDE_BY_SIDE>();
        let mut sums = [0.0; SIDE_BY_SIDE];
        for group in groups {
            for (sum, value) in sums.iter_mut().zip(group) {
                *sum += of(*value);
            }
        }
        sums.iter().sum::<f64>() + rest.iter().map(|r| of(*r)).sum::<f64>()
    };
    tree(values, &leaf, &|a: f64, b: f64| a + b)
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
        let (_, axes) = eigen_fixed(&scatter(points));
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

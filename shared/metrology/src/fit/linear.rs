//! Small dense algebra with fixed operation order: normal equations, their solution, eigenvectors.
//!
//! nalgebra's product dispatches on the processor from 6 × 6 on and its eigenvalue iteration calls the system's
//! `hypot`; both would let the machine into the bits. Hence these few loops.

use nalgebra::{Cholesky, SMatrix, SVector, Vector3};

/// Smallest pivot of the normal matrix scaled to unit diagonal: a Jacobian of condition 1e6.
const SMALLEST_PIVOT: f64 = 1e-12;

/// Sums JᵀJ, Jᵀr and rᵀr over the rows of an adjustment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal<const P: usize> {
    /// JᵀJ; only the upper triangle is filled before [`Normal::symmetric`].
    matrix: SMatrix<f64, P, P>,
    /// Jᵀr.
    pub gradient: SVector<f64, P>,
    /// rᵀr.
    pub sum: f64,
    /// Number of rows.
    pub rows: usize,
}

impl<const P: usize> Normal<P> {
    /// Empty sums.
    pub fn zero() -> Self {
        Self { matrix: SMatrix::zeros(), gradient: SVector::zeros(), sum: 0.0, rows: 0 }
    }

    /// Adds a residual with its derivatives.
    #[inline]
    pub fn add(&mut self, residual: f64, derivatives: &SVector<f64, P>) {
        for column in 0..P {
            for row in 0..=column {
                self.matrix[(row, column)] += derivatives[row] * derivatives[column];
            }
            self.gradient[column] += derivatives[column] * residual;
        }
        self.sum += residual * residual;
        self.rows += 1;
    }

    /// Joins two sums.
    pub fn join(&self, other: &Self) -> Self {
        Self {
            matrix: self.matrix + other.matrix,
            gradient: self.gradient + other.gradient,
            sum: self.sum + other.sum,
            rows: self.rows + other.rows,
        }
    }

    /// JᵀJ in full.
    pub fn symmetric(&self) -> SMatrix<f64, P, P> {
        let mut full = self.matrix;
        full.fill_lower_triangle_with_upper_triangle();
        full
    }

    /// The step −(JᵀJ + λ diag)⁻¹ Jᵀr; `None` when singular.
    pub fn step(&self, damping: f64) -> Option<SVector<f64, P>> {
        let (factor, scale) = factorise(&self.symmetric(), damping)?;
        let right = self.gradient.component_mul(&scale);
        Some(-factor.solve(&right).component_mul(&scale))
    }

    /// (JᵀJ)⁻¹; `None` when singular.
    pub fn inverse(&self) -> Option<SMatrix<f64, P, P>> {
        let (factor, scale) = factorise(&self.symmetric(), 0.0)?;
        let scaled = factor.inverse();
        Some(SMatrix::from_fn(|row, column| scaled[(row, column)] * scale[row] * scale[column]))
    }
}

type Factor<const P: usize> = Cholesky<f64, nalgebra::Const<P>>;

/// Cholesky factor of a symmetric matrix scaled to unit diagonal, and the scale.
fn factorise<const P: usize>(
    matrix: &SMatrix<f64, P, P>,
    damping: f64,
) -> Option<(Factor<P>, SVector<f64, P>)> {
    let scale = matrix.diagonal().map(|d| 1.0 / d.sqrt());
    if scale.iter().any(|s| !s.is_finite()) {
        return None;
    }
    let mut scaled = SMatrix::from_fn(|row, column| matrix[(row, column)] * scale[row] * scale[column]);
    for i in 0..P {
        scaled[(i, i)] += damping;
    }
    let factor: Factor<P> = Cholesky::new(scaled)?;
    let pivot = (0..P).map(|i| factor.l_dirty()[(i, i)]).fold(f64::INFINITY, f64::min);
    (pivot * pivot > SMALLEST_PIVOT).then_some((factor, scale))
}

/// a · b, each entry summed from left to right.
pub(super) fn product<const P: usize>(a: &SMatrix<f64, P, P>, b: &SMatrix<f64, P, P>) -> SMatrix<f64, P, P> {
    SMatrix::from_fn(|row, column| (0..P).map(|k| a[(row, k)] * b[(k, column)]).sum())
}

/// Eigenvalues of a small symmetric matrix in ascending order, and unit eigenvectors in the columns.
///
/// Cyclic Jacobi rotations (Golub & Van Loan, 8.5): only roots and quotients; eight sweeps pass the last bit.
pub(crate) fn eigen<const P: usize>(matrix: &SMatrix<f64, P, P>) -> (SVector<f64, P>, SMatrix<f64, P, P>) {
    let mut a = *matrix;
    let mut vectors = SMatrix::identity();
    for _ in 0..8 {
        for p in 0..P {
            for q in p + 1..P {
                rotate(&mut a, &mut vectors, p, q);
            }
        }
    }
    let mut order: [usize; P] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| a[(i, i)].total_cmp(&a[(j, j)]));
    let values = SVector::from(order.map(|i| a[(i, i)]));
    (values, SMatrix::from_columns(&order.map(|i| vectors.column(i).into_owned())))
}

/// One Jacobi rotation that makes the entry (p, q) zero.
fn rotate<const P: usize>(a: &mut SMatrix<f64, P, P>, vectors: &mut SMatrix<f64, P, P>, p: usize, q: usize) {
    let off = a[(p, q)];
    if off == 0.0 {
        return;
    }
    let tau = (a[(q, q)] - a[(p, p)]) / (2.0 * off);
    let root = tau.abs() + (1.0 + tau * tau).sqrt();
    // τ overflows when the entry is already negligible: t is then 0, and the rotation the identity.
    let t = if tau < 0.0 { -1.0 / root } else { 1.0 / root };
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    for k in 0..P {
        let (x, y) = (a[(k, p)], a[(k, q)]);
        a[(k, p)] = c * x - s * y;
        a[(k, q)] = s * x + c * y;
    }
    for k in 0..P {
        let (x, y) = (a[(p, k)], a[(q, k)]);
        a[(p, k)] = c * x - s * y;
        a[(q, k)] = s * x + c * y;
        let (x, y) = (vectors[(k, p)], vectors[(k, q)]);
        vectors[(k, p)] = c * x - s * y;
        vectors[(k, q)] = s * x + c * y;
    }
}

/// Two unit vectors that complete a unit vector to a right-handed frame (e1, e2, axis).
pub fn tangents(axis: &Vector3<f64>) -> [Vector3<f64>; 2] {
    // Crossing with the coordinate axis farthest from `axis` keeps the length away from zero.
    let smallest = axis.iamin();
    let mut other = Vector3::zeros();
    other[smallest] = 1.0;
    let across = other - axis * axis[smallest];
    let e1 = across / across.norm();
    [e1, axis.cross(&e1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn eigenvectors_rebuild_the_matrix() {
        let matrix = Matrix3::new(4.0, -2.0, 0.5, -2.0, 3.0, 1.25, 0.5, 1.25, 7.0);
        let (values, vectors) = eigen(&matrix);
        let again = vectors * Matrix3::from_diagonal(&values) * vectors.transpose();
        assert!((again - matrix).amax() < 1e-14 * matrix.amax());
        assert!((vectors.transpose() * vectors - Matrix3::identity()).amax() < 1e-14);
        assert!(values[0] <= values[1] && values[1] <= values[2]);
    }

    #[test]
    fn eigenvectors_of_extreme_matrices_stay_finite() {
        for matrix in [
            Matrix3::zeros(),
            Matrix3::identity() * 1e-300,
            Matrix3::new(1e300, 1.0, 0.0, 1.0, 1e-300, 0.0, 0.0, 0.0, 1.0),
        ] {
            let (values, vectors) = eigen(&matrix);
            assert!(values.iter().chain(vectors.iter()).all(|v| v.is_finite()), "{matrix}");
        }
    }

    #[test]
    fn a_singular_system_gives_no_step() {
        let mut normal = Normal::<2>::zero();
        normal.add(1.0, &SVector::from([1.0, 2.0]));
        normal.add(2.0, &SVector::from([2.0, 4.0]));
        assert!(normal.step(0.0).is_none());
        assert!(normal.step(0.1).is_some());
    }

    #[test]
    fn tangents_make_a_right_handed_frame() {
        for axis in [
            Vector3::x(),
            -Vector3::z(),
            Vector3::new(0.6, 0.0, -0.8),
            Vector3::new(1.0, 1.0, 1.0) / 3f64.sqrt(),
        ] {
            let [e1, e2] = tangents(&axis);
            let frame = Matrix3::from_columns(&[e1, e2, axis]);
            assert!((frame.transpose() * frame - Matrix3::identity()).amax() < 1e-15);
            assert!((frame.determinant() - 1.0).abs() < 1e-15);
        }
    }
}

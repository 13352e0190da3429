//! Normal equations of an adjustment: their sums, their solution, their inverse.
//!
//! All sizes are known at compile time, for which nalgebra's products and Cholesky factors are plain loops: their bits do not
//! depend on the processor.

use nalgebra::{Cholesky, SMatrix, SVector, Vector3};

/// Smallest pivot of the normal matrix scaled to unit diagonal: a Jacobian of condition 1e6.
const SMALLEST_PIVOT: f64 = 1e-12;

/// Sums JᵀJ, Jᵀr and rᵀr over the rows of an adjustment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal<const P: usize> {
    /// JᵀJ; only the upper triangle is filled before [`Normal::symmetric`].
    matrix: SMatrix<f64, P, P>,
    /// Gradient of half the sum of squares, Jᵀr.
    pub gradient: SVector<f64, P>,
    /// Sum of squared residuals, rᵀr.
    pub sum: f64,
    /// Number of residuals summed.
    pub rows: usize,
}

impl<const P: usize> Normal<P> {
    /// Sums over no rows.
    pub fn zero() -> Self {
        Self { matrix: SMatrix::zeros(), gradient: SVector::zeros(), sum: 0.0, rows: 0 }
    }

    /// From JᵀJ, of which the upper triangle is enough, and Jᵀr, for [`Self::step`] alone.
    pub fn of_sums(matrix: SMatrix<f64, P, P>, gradient: SVector<f64, P>) -> Self {
        Self { matrix, gradient, sum: 0.0, rows: 0 }
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

    /// Sums over the rows of both.
    pub fn join(&self, other: &Self) -> Self {
        Self {
            matrix: self.matrix + other.matrix,
            gradient: self.gradient + other.gradient,
            sum: self.sum + other.sum,
            rows: self.rows + other.rows,
        }
    }

    /// Sums over the rows that are not in the other, all of whose rows are in this one.
    pub fn less(&self, other: &Self) -> Self {
        Self {
            matrix: self.matrix - other.matrix,
            gradient: self.gradient - other.gradient,
            sum: self.sum - other.sum,
            rows: self.rows.saturating_sub(other.rows),
        }
    }

    /// The normal matrix JᵀJ with both triangles.
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

/// Rows that are summed side by side: the processor then takes several at a time. The order of the sums is fixed by this number.
pub(crate) const LANES: usize = 4;

/// The sums of [`Normal`] for rows in lanes.
pub(crate) struct Lanes<const P: usize> {
    matrix: [[[f64; LANES]; P]; P],
    gradient: [[f64; LANES]; P],
    sum: [f64; LANES],
    rows: usize,
}

impl<const P: usize> Lanes<P> {
    /// Sums over no rows.
    pub fn zero() -> Self {
        let none = [0.0; LANES];
        Self { matrix: [[none; P]; P], gradient: [none; P], sum: none, rows: 0 }
    }

    /// Adds a residual with its derivatives in each lane.
    #[inline(always)]
    pub fn add(&mut self, residual: &[f64; LANES], derivatives: &[[f64; LANES]; P]) {
        for column in 0..P {
            for row in 0..=column {
                products(&mut self.matrix[column][row], &derivatives[row], &derivatives[column]);
            }
            products(&mut self.gradient[column], &derivatives[column], residual);
        }
        products(&mut self.sum, residual, residual);
        self.rows += LANES;
    }

    /// The sums of all lanes.
    pub fn joined(&self) -> Normal<P> {
        let all = |lanes: &[f64; LANES]| (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
        Normal {
            matrix: SMatrix::from_fn(|r, c| if r <= c { all(&self.matrix[c][r]) } else { 0.0 }),
            gradient: SVector::from_fn(|r, _| all(&self.gradient[r])),
            sum: all(&self.sum),
            rows: self.rows,
        }
    }
}

/// Adds the products of two rows of lanes.
#[inline(always)]
fn products(sums: &mut [f64; LANES], a: &[f64; LANES], b: &[f64; LANES]) {
    for lane in 0..LANES {
        sums[lane] += a[lane] * b[lane];
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
    fn a_singular_system_gives_no_step() {
        let mut normal = Normal::<2>::zero();
        normal.add(1.0, &SVector::from([1.0, 2.0]));
        normal.add(2.0, &SVector::from([2.0, 4.0]));
        assert!(normal.step(0.0).is_none());
        assert!(normal.step(0.1).is_some());
    }

    #[test]
    fn sums_less_those_of_some_rows_are_those_of_the_others() {
        let of = |rows: std::ops::Range<usize>| {
            let mut normal = Normal::<2>::zero();
            rows.for_each(|i| normal.add(0.1 * i as f64 - 1.0, &SVector::from([1.0, (i % 7) as f64])));
            normal
        };
        let (left, expected) = (of(0..40).less(&of(0..13)), of(13..40));
        assert_eq!(left.rows, expected.rows);
        assert!((left.sum - expected.sum).abs() < 1e-12);
        assert!((left.gradient - expected.gradient).amax() < 1e-12);
        assert!((left.symmetric() - expected.symmetric()).amax() < 1e-12);
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

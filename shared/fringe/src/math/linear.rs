//! Small dense linear algebra whose order of operations is fixed.
//!
//! [`Dense`] has a size known at run time. nalgebra hands products of such matrices, from 6 × 6 on, to a kernel that is
//! chosen by the processor (fused or not), which would make the bits depend on the machine; its products of matrices of a size
//! known at compile time are plain loops and may be used. [`Factor`] names the parameter that the others determine, which
//! nalgebra's Cholesky factor does not. Eigenvectors come from Jacobi rotations for both kinds of matrix: they keep small
//! eigenvalues of scaled matrices to full relative accuracy and always end.

use nalgebra::{SMatrix, SVector};

/// A pivot of the matrix scaled to unit diagonal below this is rounding: the parameter follows from the others.
const SMALLEST_PIVOT: f64 = 1e-13;

/// Most sweeps of Jacobi's method; it converges quadratically, nine unknowns need six to eight.
const SWEEPS: usize = 40;

/// A matrix of a size known at run time, stored row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Number of rows of the matrix.
    pub rows: usize,
    /// Number of columns of the matrix.
    pub cols: usize,
    data: Vec<f64>,
}

impl Dense {
    /// A matrix of zeros.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self { rows, cols, data: vec![0.0; rows * cols] }
    }

    /// The n × n identity matrix.
    pub fn identity(n: usize) -> Self {
        Self::from_fn(n, n, |i, j| f64::from(u8::from(i == j)))
    }

    /// A matrix whose entries are `entry(row, column)`.
    pub fn from_fn(rows: usize, cols: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let data = (0..rows * cols).map(|k| entry(k / cols, k % cols)).collect();
        Self { rows, cols, data }
    }

    /// The entry in a row and a column.
    #[inline]
    pub fn at(&self, row: usize, col: usize) -> f64 {
        self.data[row * self.cols + col]
    }

    /// Adds `value` to an entry.
    #[inline]
    pub fn add(&mut self, row: usize, col: usize, value: f64) {
        self.data[row * self.cols + col] += value;
    }

    /// Sets an entry to `value`.
    #[inline]
    pub fn set(&mut self, row: usize, col: usize, value: f64) {
        self.data[row * self.cols + col] = value;
    }

    /// The entries of one row.
    #[inline]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.data[row * self.cols..(row + 1) * self.cols]
    }

    /// Returns the transposed matrix.
    #[must_use]
    pub fn transposed(&self) -> Self {
        Self::from_fn(self.cols, self.rows, |i, j| self.at(j, i))
    }

    /// The product with another matrix.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        let mut product = Self::zeros(self.rows, other.cols);
        for i in 0..self.rows {
            let line = &mut product.data[i * other.cols..(i + 1) * other.cols];
            for (k, a) in self.row(i).iter().enumerate() {
                if *a != 0.0 {
                    for (sum, b) in line.iter_mut().zip(other.row(k)) {
                        *sum += a * b;
                    }
                }
            }
        }
        product
    }

    /// The product with a vector.
    pub fn apply(&self, vector: &[f64]) -> Vec<f64> {
        (0..self.rows).map(|i| dot(self.row(i), vector)).collect()
    }

    /// The sum with another matrix of the same size.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self::from_fn(self.rows, self.cols, |i, j| self.at(i, j) + other.at(i, j))
    }

    /// A Σ Aᵀ for a symmetric Σ.
    #[must_use]
    pub fn sandwich(&self, inner: &Self) -> Self {
        self.times(inner).times(&self.transposed())
    }
}

/// Scalar product, summed from the first element to the last.
#[inline]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Cholesky factor of a symmetric matrix that was scaled to unit diagonal.
#[derive(Debug, Clone)]
pub struct Factor {
    lower: Dense,
    scale: Vec<f64>,
}

impl Factor {
    /// Factorises the lower triangle.
    ///
    /// # Errors
    /// The index of the first parameter that those before it determine.
    pub fn new(matrix: &Dense) -> Result<Self, usize> {
        let n = matrix.rows;
        let scale: Vec<f64> = (0..n).map(|i| 1.0 / matrix.at(i, i).sqrt()).collect();
        if let Some(bad) = scale.iter().position(|s| !s.is_finite()) {
            return Err(bad);
        }
        let mut lower = Dense::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let known = dot(&lower.row(i)[..j], &lower.row(j)[..j]);
                let rest = matrix.at(i, j) * scale[i] * scale[j] - known;
                if i == j {
                    // Written so that a NaN is refused too.
                    if rest.is_nan() || rest < SMALLEST_PIVOT {
                        return Err(i);
                    }
                    lower.set(i, i, rest.sqrt());
                } else {
                    lower.set(i, j, rest / lower.at(j, j));
                }
            }
        }
        Ok(Self { lower, scale })
    }

    /// The solution x of M x = `right`.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let n = self.scale.len();
        let mut x: Vec<f64> = right.iter().zip(&self.scale).map(|(b, s)| b * s).collect();
        for i in 0..n {
            let known = dot(&self.lower.row(i)[..i], &x[..i]);
            x[i] = (x[i] - known) / self.lower.at(i, i);
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| self.lower.at(k, i) * x[k]).sum();
            x[i] = (x[i] - known) / self.lower.at(i, i);
        }
        x.iter().zip(&self.scale).map(|(x, s)| x * s).collect()
    }

    /// The inverse of M, exactly symmetric.
    pub fn inverse(&self) -> Dense {
        let n = self.scale.len();
        let mut inverse = Dense::zeros(n, n);
        let mut unit = vec![0.0; n];
        for j in 0..n {
            unit[j] = 1.0;
            for (i, value) in self.solve(&unit).into_iter().enumerate().skip(j) {
                inverse.set(i, j, value);
                inverse.set(j, i, value);
            }
            unit[j] = 0.0;
        }
        inverse
    }
}

/// Columns of L with L Lᵀ = C for a symmetric C of any rank, and which part of each variance they leave: Cholesky with pivots, the variance
/// of which most is left first, until less than `least` of every one is. A part below 0 says that C is no covariance.
pub fn pivoted_root(matrix: &Dense, least: f64) -> (Vec<Vec<f64>>, Vec<f64>) {
    let (mut c, size) = (matrix.clone(), matrix.rows);
    let part = |c: &Dense, i: usize| {
        let whole = matrix.at(i, i);
        if whole > 0.0 { c.at(i, i) / whole } else { 0.0 }
    };
    let mut columns = Vec::new();
    for _ in 0..size {
        let Some(pivot) = (0..size).max_by(|a, b| part(&c, *a).total_cmp(&part(&c, *b))) else { break };
        if part(&c, pivot) < least {
            break;
        }
        let root = c.at(pivot, pivot).sqrt();
        let column: Vec<f64> = (0..size).map(|i| c.at(i, pivot) / root).collect();
        for (row, a) in c.data.chunks_exact_mut(size).zip(&column) {
            row.iter_mut().zip(&column).for_each(|(c, b)| *c -= a * b);
        }
        columns.push(column);
    }
    (columns, (0..size).map(|i| part(&c, i)).collect())
}

/// Eigenvalues of a symmetric matrix in rising order, and unit eigenvectors in the rows.
pub fn eigen(matrix: &Dense) -> (Vec<f64>, Dense) {
    let n = matrix.rows;
    let (mut a, mut vectors) = (matrix.clone(), Dense::identity(n));
    diagonalise(&mut a.data, &mut vectors.data, n);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|i, j| a.at(*i, *i).total_cmp(&a.at(*j, *j)));
    let values = order.iter().map(|i| a.at(*i, *i)).collect();
    (values, Dense::from_fn(n, n, |i, j| vectors.at(order[i], j)))
}

/// Eigenvalues of a symmetric matrix in rising order, and unit eigenvectors in the columns.
pub fn eigen_fixed<const P: usize>(matrix: &SMatrix<f64, P, P>) -> (SVector<f64, P>, SMatrix<f64, P, P>) {
    let mut a = *matrix;
    let mut vectors = SMatrix::<f64, P, P>::identity();
    // Stored column by column: what the kernel takes for rows of the vectors are columns here.
    diagonalise(a.as_mut_slice(), vectors.as_mut_slice(), P);
    let mut order: [usize; P] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| a[(i, i)].total_cmp(&a[(j, j)]));
    let values = SVector::from(order.map(|i| a[(i, i)]));
    (values, SMatrix::from_columns(&order.map(|i| vectors.column(i).into_owned())))
}

/// Cyclic Jacobi rotations (Golub & Van Loan, 8.5) of an n × n matrix; `vectors` starts as the identity and gets the
/// eigenvectors as rows.
#[inline]
fn diagonalise(a: &mut [f64], vectors: &mut [f64], n: usize) {
    for _ in 0..SWEEPS {
        let off_diagonal = || (0..n).flat_map(|i| (0..i).map(move |j| i * n + j));
        if off_diagonal().all(|i| a[i] == 0.0) || !off_diagonal().all(|i| a[i].is_finite()) {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                rotate(a, vectors, n, [p, q]);
            }
        }
    }
}

/// One Jacobi rotation that makes the entry (p, q) zero.
#[inline]
fn rotate(a: &mut [f64], vectors: &mut [f64], n: usize, [p, q]: [usize; 2]) {
    let off = a[p * n + q];
    if off == 0.0 {
        return;
    }
    let tau = (a[q * n + q] - a[p * n + p]) / (2.0 * off);
    let root = tau.abs() + (1.0 + tau * tau).sqrt();
    // τ overflows when the entry is already negligible: t is then 0, and the rotation the identity.
    let t = if tau < 0.0 { -1.0 / root } else { 1.0 / root };
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    for k in 0..n {
        let (x, y) = (a[k * n + p], a[k * n + q]);
        a[k * n + p] = c * x - s * y;
        a[k * n + q] = s * x + c * y;
    }
    for k in 0..n {
        for matrix in [&mut *a, &mut *vectors] {
            let (x, y) = (matrix[p * n + k], matrix[q * n + k]);
            matrix[p * n + k] = c * x - s * y;
            matrix[q * n + k] = s * x + c * y;
        }
    }
    a[p * n + q] = 0.0;
    a[q * n + p] = 0.0;
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    fn spd(n: usize) -> Dense {
        let root = Dense::from_fn(n, n, |i, j| 1.0 / (1.0 + (i * 7 + j * 3) as f64 % 11.0));
        root.times(&root.transposed()).plus(&Dense::identity(n))
    }

    fn largest(m: &Dense) -> f64 {
        (0..m.rows).flat_map(|i| m.row(i)).fold(0.0, |worst: f64, v| worst.max(v.abs()))
    }

    #[test]
    fn the_inverse_inverts() {
        let matrix = spd(13);
        let product = matrix.times(&Factor::new(&matrix).unwrap().inverse());
        let off = Dense::from_fn(13, 13, |i, j| product.at(i, j) - f64::from(u8::from(i == j)));
        assert!(largest(&off) < 1e-13, "{}", largest(&off));
    }

    #[test]
    fn eigenvectors_rebuild_the_matrix() {
        let matrix = spd(9);
        let (values, vectors) = eigen(&matrix);
        let diagonal = Dense::from_fn(9, 9, |i, j| if i == j { values[i] } else { 0.0 });
        let again = vectors.transposed().sandwich(&diagonal);
        let off = Dense::from_fn(9, 9, |i, j| again.at(i, j) - matrix.at(i, j));
        assert!(largest(&off) < 1e-13 * largest(&matrix));
        assert!(values.windows(2).all(|pair| pair[0] <= pair[1]));
    }

    #[test]
    fn a_singular_matrix_names_the_dependent_parameter() {
        let singular = Dense::from_fn(3, 3, |i, j| [1.0, 2.0, 3.0][i] * [1.0, 2.0, 3.0][j]);
        assert_eq!(Factor::new(&singular).unwrap_err(), 1);
    }

    #[test]
    fn eigenvectors_of_extreme_matrices_stay_finite() {
        for matrix in [
            Matrix3::zeros(),
            Matrix3::identity() * 1e-300,
            Matrix3::new(1e300, 1.0, 0.0, 1.0, 1e-300, 0.0, 0.0, 0.0, 1.0),
            Matrix3::new(1.0, 1e-200, 0.0, 1e-200, 1.0, 0.0, 0.0, 0.0, 1.0) * 1e-100,
        ] {
            let (values, vectors) = eigen_fixed(&matrix);
            assert!(values.iter().chain(vectors.iter()).all(|v| v.is_finite()), "{matrix}");
        }
    }

    /// Both kinds of matrix give the same bits.
    #[test]
    fn the_size_at_compile_time_gives_the_same_eigenvectors() {
        let matrix = Matrix3::new(4.0, -2.0, 0.5, -2.0, 3.0, 1.25, 0.5, 1.25, 7.0);
        let (values, vectors) = eigen_fixed(&matrix);
        let again = vectors * Matrix3::from_diagonal(&values) * vectors.transpose();
        assert!((again - matrix).amax() < 1e-14 * matrix.amax());
        assert!((vectors.transpose() * vectors - Matrix3::identity()).amax() < 1e-14);
        assert!(values[0] <= values[1] && values[1] <= values[2]);
        let (same, rows) = eigen(&Dense::from_fn(3, 3, |i, j| matrix[(i, j)]));
        assert_eq!(same, values.as_slice());
        assert_eq!(rows, Dense::from_fn(3, 3, |i, j| vectors[(j, i)]));
    }
}

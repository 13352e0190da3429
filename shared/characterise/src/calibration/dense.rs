//! Dense algebra of run-time size with a fixed order of operations.
//!
//! The matrix product of nalgebra dispatches on the processor from 6 × 6 on, and its eigenvalue iteration calls the
//! system's `hypot`; both would let the machine into the bits. Hence these loops.

/// A pivot of the matrix scaled to unit diagonal below this is rounding: the parameter follows from the others.
const SMALLEST_PIVOT: f64 = 1e-13;

/// Sweeps of Jacobi's method: it converges quadratically, nine unknowns need six to eight.
const SWEEPS: usize = 40;

/// A matrix, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dense {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    data: Vec<f64>,
}

impl Dense {
    /// All zero.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self { rows, cols, data: vec![0.0; rows * cols] }
    }

    /// The identity.
    pub fn identity(n: usize) -> Self {
        Self::from_fn(n, n, |i, j| f64::from(u8::from(i == j)))
    }

    /// Entry by entry.
    pub fn from_fn(rows: usize, cols: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let data = (0..rows * cols).map(|k| entry(k / cols, k % cols)).collect();
        Self { rows, cols, data }
    }

    /// An entry.
    #[inline]
    pub fn at(&self, row: usize, col: usize) -> f64 {
        self.data[row * self.cols + col]
    }

    /// Adds to an entry.
    #[inline]
    pub fn add(&mut self, row: usize, col: usize, value: f64) {
        self.data[row * self.cols + col] += value;
    }

    /// Sets an entry.
    #[inline]
    pub fn set(&mut self, row: usize, col: usize, value: f64) {
        self.data[row * self.cols + col] = value;
    }

    /// A row.
    #[inline]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.data[row * self.cols..(row + 1) * self.cols]
    }

    /// The transpose.
    pub fn transposed(&self) -> Self {
        Self::from_fn(self.cols, self.rows, |i, j| self.at(j, i))
    }

    /// The product with another matrix.
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
    pub fn plus(&self, other: &Self) -> Self {
        Self::from_fn(self.rows, self.cols, |i, j| self.at(i, j) + other.at(i, j))
    }

    /// A Σ Aᵀ for a symmetric Σ.
    pub fn sandwich(&self, inner: &Self) -> Self {
        self.times(inner).times(&self.transposed())
    }
}

/// Scalar product.
#[inline]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Cholesky factor of a symmetric matrix that was scaled to unit diagonal.
#[derive(Debug, Clone)]
pub(crate) struct Factor {
    lower: Dense,
    scale: Vec<f64>,
}

impl Factor {
    /// Factorises the lower triangle; `Err` holds the index of the first parameter that the others determine.
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

    /// Solves M x = b.
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

    /// M⁻¹, exactly symmetric.
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

/// Eigenvalues in rising order and eigenvectors (as rows) of a symmetric matrix, by Jacobi's method.
pub(crate) fn eigen(matrix: &Dense) -> (Vec<f64>, Dense) {
    let n = matrix.rows;
    let (mut a, mut vectors) = (matrix.clone(), Dense::identity(n));
    for _ in 0..SWEEPS {
        let off: f64 =
            (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| a.at(i, j).powi(2)).sum();
        if off == 0.0 || !off.is_finite() {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                rotate(&mut a, &mut vectors, p, q);
            }
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|i, j| a.at(*i, *i).total_cmp(&a.at(*j, *j)));
    let values = order.iter().map(|i| a.at(*i, *i)).collect();
    (values, Dense::from_fn(n, n, |i, j| vectors.at(order[i], j)))
}

/// One Jacobi rotation that zeroes the entry (p, q); `vectors` keeps eigenvectors as rows.
fn rotate(a: &mut Dense, vectors: &mut Dense, p: usize, q: usize) {
    let off = a.at(p, q);
    if off == 0.0 {
        return;
    }
    let tau = (a.at(q, q) - a.at(p, p)) / (2.0 * off);
    let root = tau.abs() + (1.0 + tau * tau).sqrt();
    // τ overflows when the entry is already negligible: t is then 0, and the rotation the identity.
    let t = if tau < 0.0 { -1.0 / root } else { 1.0 / root };
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    for k in 0..a.rows {
        let (x, y) = (a.at(k, p), a.at(k, q));
        a.set(k, p, c * x - s * y);
        a.set(k, q, s * x + c * y);
    }
    for k in 0..a.rows {
        for m in [&mut *a, &mut *vectors] {
            let (x, y) = (m.at(p, k), m.at(q, k));
            m.set(p, k, c * x - s * y);
            m.set(q, k, s * x + c * y);
        }
    }
    a.set(p, q, 0.0);
    a.set(q, p, 0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

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
}

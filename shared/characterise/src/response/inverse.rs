//! The inverse response as a polynomial of order 7 (eq. 3.2).

use super::{GreyLevel, ResponseError};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use serde::Serialize;

/// Number of coefficients a₀ … a₇.
pub const COEFFICIENTS: usize = 8;

/// Smallest ratio of the diagonal of R beyond which the levels do not determine all coefficients.
const LEAST_RATIO: f64 = 1e-9;

type Square = SMatrix<f64, COEFFICIENTS, COEFFICIENTS>;

/// `I_in = a₀ + a₁ I_out + … + a₇ I_out⁷` (eq. 3.2), where `I_in` is the drawn level 0 … 1 and `I_out` the light as a
/// fraction of the range from the darkest to the brightest level measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InversePolynomial {
    /// Coefficients a₀ … a₇.
    pub coefficients: [f64; COEFFICIENTS],
    /// Covariance of the coefficients, from the residuals with n − 8 degrees of freedom.
    pub covariance: [[f64; COEFFICIENTS]; COEFFICIENTS],
    /// Drawn less fitted level of each level measured.
    pub residuals: Vec<f64>,
    /// Root mean square of the residuals, level 0 … 1.
    pub residual_rms: f64,
    /// Largest magnitude of a residual, level 0 … 1.
    pub residual_max: f64,
    /// Whether the polynomial never falls between 0 and 1.
    pub monotonic: bool,
}

impl InversePolynomial {
    /// Fits by least squares in the drawn level, in shifted Legendre polynomials by QR: monomials up to the seventh power
    /// would lose five digits more.
    ///
    /// # Errors
    /// Fewer than nine levels, or light that does not determine the coefficients.
    pub fn fit(levels: &[GreyLevel], range_dn: [f64; 2]) -> Result<Self, ResponseError> {
        if levels.len() < super::curve::LEAST_LEVELS {
            let needed = super::curve::LEAST_LEVELS;
            return Err(ResponseError::TooFewLevels { found: levels.len(), needed });
        }
        let light: Vec<f64> =
            levels.iter().map(|g| (g.mean_dn - range_dn[0]) / (range_dn[1] - range_dn[0])).collect();
        let n = levels.len();
        let design = DMatrix::from_fn(n, COEFFICIENTS, |row, column| legendre(light[row])[column]);
        let drawn = DVector::from_iterator(n, levels.iter().map(|g| g.level));
        let qr = design.qr();
        let (q, r) = (qr.q(), qr.r());
        let r = Square::from_fn(|i, j| r[(i, j)]);
        let diagonal = r.diagonal().abs();
        let undetermined = ResponseError::Undetermined { what: "a polynomial of order 7" };
        if diagonal.min().is_nan() || diagonal.min() < LEAST_RATIO * diagonal.max() {
            return Err(undetermined);
        }
        let projected = q.tr_mul(&drawn);
        let right = SVector::<f64, COEFFICIENTS>::from_fn(|i, _| projected[i]);
        let (Some(c), Some(inverse)) =
            (r.solve_upper_triangular(&right), r.solve_upper_triangular(&Square::identity()))
        else {
            return Err(undetermined);
        };
        let to_monomials = monomials_from_legendre();
        let a = to_monomials * c;
        let residuals: Vec<f64> =
            light.iter().zip(levels).map(|(l, g)| g.level - legendre(*l).dot(&c)).collect();
        let squares: f64 = residuals.iter().map(|r| r * r).sum();
        let half: Square = to_monomials * inverse * (squares / (n - COEFFICIENTS) as f64).sqrt();
        let covariance = half * half.transpose();
        let mut fit = Self {
            coefficients: a.into(),
            covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
            residual_rms: (squares / n as f64).sqrt(),
            residual_max: residuals.iter().fold(0.0, |m: f64, r| m.max(r.abs())),
            residuals,
            monotonic: true,
        };
        let at = |i: u32| fit.level(f64::from(i) / 1000.0);
        fit.monotonic = (0..1000).all(|i| at(i + 1) >= at(i));
        Ok(fit)
    }

    /// The drawn level that gives a light 0 … 1, not limited to 0 … 1.
    pub fn level(&self, light: f64) -> f64 {
        self.coefficients.iter().rev().fold(0.0, |sum, a| sum * light + a)
    }

    /// Standard uncertainties of the coefficients.
    pub fn u_coefficients(&self) -> [f64; COEFFICIENTS] {
        std::array::from_fn(|i| self.covariance[i][i].max(0.0).sqrt())
    }
}

/// Legendre polynomials of 2y − 1, orders 0 … 7.
fn legendre(y: f64) -> SVector<f64, COEFFICIENTS> {
    let t = 2.0 * y - 1.0;
    let mut p = SVector::<f64, COEFFICIENTS>::zeros();
    (p[0], p[1]) = (1.0, t);
    for n in 2..COEFFICIENTS {
        let k = n as f64;
        p[n] = ((2.0 * k - 1.0) * t * p[n - 1] - (k - 1.0) * p[n - 2]) / k;
    }
    p
}

/// Column n holds the monomial coefficients of the n-th Legendre polynomial of 2y − 1: whole numbers, so exact.
fn monomials_from_legendre() -> Square {
    let choose = |n: usize, k: usize| (0..k).fold(1_u64, |c, i| c * (n - i) as u64 / (i as u64 + 1)) as f64;
    SMatrix::from_fn(|k, n| {
        if k > n {
            return 0.0;
        }
        let sign = if (n + k).is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * choose(n, k) * choose(n + k, k)
    })
}

//! The robust fit of the joint drift.

use super::rows::Row;
use fringe::math::linear::{Dense, eigen};
use fringe::math::statistics::sigma_by_median;

/// Directions whose information, scaled to unit diagonal, is below this are not determined by the matches (a flat object
/// leaves one open).
const LEAST_INFORMATION: f64 = 1e-6;

/// Rounds with Cauchy weights: they bring the fit near enough for rejection.
const WEIGHTED_ROUNDS: usize = 15;

/// Rounds of rejection; the set settles in three or four.
const REJECTION_ROUNDS: usize = 20;

/// Residuals beyond so many robust standard deviations are edges and wrong matches; of 10⁵ good ones six.
const OUTLIER: f64 = 4.0;

/// Tuning constant of Cauchy's weight, 95 % efficient.
const CAUCHY: f64 = 2.385;

/// Result of the robust fit.
pub(super) struct Fit<const N: usize> {
    /// Estimated drift of each unknown.
    pub drift: [f64; N],
    /// Which rows were kept.
    pub kept: Vec<bool>,
    /// Robust standard deviation of the residuals over the predicted one.
    pub scale: f64,
    /// The drifts that the matches determine: conjugate directions, each of unit information.
    pub directions: Vec<[f64; N]>,
}

impl<const N: usize> Fit<N> {
    /// The residual of a row by the drift.
    pub fn modelled<const P: usize>(&self, row: &Row<N, P>) -> f64 {
        modelled(&self.drift, row)
    }
}

fn modelled<const N: usize, const P: usize>(drift: &[f64; N], row: &Row<N, P>) -> f64 {
    drift.iter().zip(row.by).map(|(d, by)| d * by).sum()
}

/// Σ w a aᵀ over rows with their weights.
pub(super) fn normal<'a, const N: usize, const P: usize>(
    rows: impl Iterator<Item = (&'a Row<N, P>, f64)>,
) -> Dense {
    let mut normal = Dense::zeros(N, N);
    for (row, weight) in rows.filter(|(_, weight)| *weight > 0.0) {
        for (i, a) in row.by.iter().enumerate() {
            for (j, b) in row.by.iter().enumerate() {
                normal.add(i, j, weight * a * b);
            }
        }
    }
    normal
}

/// Conjugate directions of unit information; undetermined ones are left out.
pub(super) fn directions<const N: usize>(normal: &Dense) -> Vec<[f64; N]> {
    let scale: [f64; N] = std::array::from_fn(|i| {
        let information = normal.at(i, i);
        if information > 0.0 { 1.0 / information.sqrt() } else { 0.0 }
    });
    let scaled = Dense::from_fn(N, N, |i, j| normal.at(i, j) * scale[i] * scale[j]);
    let (values, vectors) = eigen(&scaled);
    values
        .iter()
        .enumerate()
        .filter(|(_, value)| **value > LEAST_INFORMATION)
        .map(|(k, value)| std::array::from_fn(|i| vectors.at(k, i) * scale[i] / value.sqrt()))
        .collect()
}

/// Weighted least squares within the determined directions; also returns these.
fn solve<const N: usize, const P: usize>(
    rows: &[Row<N, P>],
    weight: impl Fn(usize) -> f64,
) -> Option<([f64; N], Vec<[f64; N]>)> {
    let weighted = || rows.iter().enumerate().map(|(i, row)| (row, weight(i)));
    let matrix = normal(weighted());
    let mut right = [0.0; N];
    for (row, w) in weighted() {
        right.iter_mut().zip(row.by).for_each(|(sum, by)| *sum += w * by * row.error);
    }
    let directions = directions(&matrix);
    let mut drift = [0.0; N];
    for direction in &directions {
        let along: f64 = direction.iter().zip(right).map(|(a, b)| a * b).sum();
        drift.iter_mut().zip(direction).for_each(|(d, v)| *d += along * v);
    }
    let sane = !directions.is_empty() && drift.iter().all(|d| d.is_finite());
    sane.then_some((drift, directions))
}

/// Standard deviation by the median of the magnitudes; 0 without residuals.
fn spread(residuals: &[f64]) -> f64 {
    sigma_by_median(&mut residuals.to_vec()).unwrap_or(0.0)
}

/// Fits the drift; `None` for rows that determine nothing.
pub(super) fn fit<const N: usize, const P: usize>(rows: &[Row<N, P>]) -> Option<Fit<N>> {
    let residuals =
        |drift: &[f64; N]| -> Vec<f64> { rows.iter().map(|row| row.error - modelled(drift, row)).collect() };
    let mut drift = [0.0; N];
    for _ in 0..WEIGHTED_ROUNDS {
        let now = residuals(&drift);
        let scale = (CAUCHY * spread(&now)).max(f64::MIN_POSITIVE);
        (drift, _) = solve(rows, |i| 1.0 / (1.0 + (now[i] / scale).powi(2)))?;
    }
    let mut kept = vec![true; rows.len()];
    let mut directions = Vec::new();
    let mut scale = 0.0;
    for _ in 0..REJECTION_ROUNDS {
        let now = residuals(&drift);
        scale = spread(&now);
        // Ideal data: rounding is no outlier.
        let limit = (OUTLIER * scale).max(1e-9);
        let next: Vec<bool> = now.iter().map(|r| r.abs() <= limit).collect();
        let settled = next == kept && !directions.is_empty();
        kept = next;
        (drift, directions) = solve(rows, |i| f64::from(u8::from(kept[i])))?;
        if settled {
            break;
        }
    }
    Some(Fit { drift, kept, scale, directions })
}

//! What the choice of points by the fit itself does to its uncertainty.
//!
//! A fit that leaves points out by their own residuals, beyond c, sees a weaker normal matrix, by the points that a small motion pushes across c:
//! A = JᵀJ · (1 − c · h(c)/(d n)), h the density of |r| and d the number of residuals of a point: a motion along one of d directions changes |r| by the
//! cosine to it, whose mean square is 1/d. With Gaussian noise that is a sixth where 3 % are left out, 0.69 for 30 % and 0.86 for a half, so that the
//! uncertainty would be 1.2, 3.3 and 7 times too small without it.

use super::FitError;
use super::adjust::Model;
use super::solve::deviations;
use fringe::math::random::normal_quantile;
use fringe::math::{exp, ln};
use nalgebra::Vector3;

/// The density at the cut is counted over the last part of this width below it …
const WIDTHS: [f64; 3] = [0.1, 0.2, 0.3];
/// … the first that holds so many points.
const COUNTED: usize = 40;

/// Mean square of the residuals over the square of the margin: two standard deviations of Gaussian noise. A narrower margin cuts off so much
/// of the noise that the rest does not tell how much.
const WIDEST_NOISE: f64 = 0.193;
/// Fewer points do not tell it.
const LEAST_POINTS: usize = 30;
/// Share of Gaussian noise beyond two standard deviations.
const WIDEST_CUT: f64 = 0.0455;

/// Part of the normal matrix that is left where a share of the points was rejected, and where those left lie within a margin, mm.
///
/// # Errors
/// The margin cuts into the noise.
pub(super) fn left_of_normal_matrix<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    rows_a_point: f64,
    (rejected, within_mm): (f64, Option<f64>),
) -> Result<f64, FitError> {
    if rejected <= 0.0 && within_mm.is_none() {
        return Ok(1.0);
    }
    let mut sizes = deviations(model, points);
    for size in &mut sizes {
        *size = size.abs();
    }
    let mut left: f64 = 1.0;
    if rejected > 0.0 {
        let limit = sizes.iter().copied().fold(0.0, f64::max);
        // Never less than of Gaussian noise: few points count badly, and outliers among the rejected only make the cut milder.
        left = left_below(&sizes, limit, rows_a_point).max(left_of_gaussian(rejected, rows_a_point));
    }
    if let Some(margin) = within_mm {
        let mean_square = sizes.iter().map(|size| size * size).sum::<f64>() / sizes.len().max(1) as f64;
        if sizes.len() >= LEAST_POINTS && mean_square > WIDEST_NOISE * margin * margin {
            return Err(FitError::Margin { margin_mm: margin, scatter_mm: mean_square.sqrt() });
        }
        let gaussian = left_of_gaussian(cut_off(mean_square / (margin * margin)), 1.0);
        left = left.min(left_below(&sizes, margin, rows_a_point).max(gaussian));
    }
    Ok(left)
}

/// 1 − c · h(c)/(d n) of sizes below a limit c, counted.
fn left_below(sizes: &[f64], limit: f64, rows_a_point: f64) -> f64 {
    let near = |width: f64| sizes.iter().filter(|size| **size > (1.0 - width) * limit).count();
    let width = WIDTHS.into_iter().find(|width| near(*width) >= COUNTED).unwrap_or(WIDTHS[WIDTHS.len() - 1]);
    1.0 - near(width) as f64 / width / (rows_a_point * sizes.len().max(1) as f64)
}

/// The same of Gaussian noise of which a share is cut off.
fn left_of_gaussian(rejected: f64, rows_a_point: f64) -> f64 {
    let kept = 1.0 - rejected;
    if rows_a_point > 1.5 {
        // Two residuals: |r| is Rayleigh distributed, c² = −2 ln of the share beyond.
        return 1.0 + rejected * ln(rejected) / kept;
    }
    let limit = normal_quantile(1.0 - 0.5 * rejected);
    let density = exp(-0.5 * limit * limit) / std::f64::consts::TAU.sqrt();
    1.0 - 2.0 * limit * density / kept
}

/// Share of Gaussian noise beyond a margin, from the mean square of the residuals within over that of the margin; two standard deviations at least.
fn cut_off(mean_square: f64) -> f64 {
    let within =
        |rejected: f64| left_of_gaussian(rejected, 1.0) / normal_quantile(1.0 - 0.5 * rejected).powi(2);
    let (mut low, mut high) = (1e-15, WIDEST_CUT);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if within(middle) < mean_square { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_beyond_a_margin_follows_from_the_scatter_within() {
        for deviations in [2.0_f64, 2.5, 3.0, 4.0] {
            let draws = (0..400_000).map(|i| normal_quantile((f64::from(i) + 0.5) / 4e5));
            let kept: Vec<f64> = draws.filter(|draw| draw.abs() < deviations).collect();
            let mean_square = kept.iter().map(|draw| draw * draw).sum::<f64>() / kept.len() as f64;
            let (found, expected) =
                (cut_off(mean_square / (deviations * deviations)), 1.0 - kept.len() as f64 / 4e5);
            assert!((found - expected).abs() < 0.02 * expected + 1e-5, "{deviations}: {found}, {expected}");
        }
    }

    #[test]
    fn the_formula_is_that_of_counted_gaussian_noise() {
        let draws: Vec<f64> = (0..400_000).map(|i| normal_quantile((f64::from(i) + 0.5) / 4e5)).collect();
        for rejected in [0.03, 0.1, 0.3, 0.5] {
            let limit = normal_quantile(1.0 - 0.5 * rejected);
            let kept: Vec<f64> = draws.iter().map(|d| d.abs()).filter(|size| *size < limit).collect();
            let (counted, formula) = (left_below(&kept, limit, 1.0), left_of_gaussian(rejected, 1.0));
            // The density a little below the cut is a little larger.
            assert!((0.0..0.06).contains(&(formula - counted)), "{rejected}: {counted}, {formula}");
            // In the plane: of the same quantiles as two coordinates, by the closed form of the Rayleigh distribution.
            let plane: Vec<f64> = (0..400_000)
                .map(|i| (-2.0 * ln(1.0 - (f64::from(i) + 0.5) / 4e5 * (1.0 - rejected))).sqrt())
                .collect();
            let limit = (-2.0 * ln(rejected)).sqrt();
            let (counted, formula) = (left_below(&plane, limit, 2.0), left_of_gaussian(rejected, 2.0));
            assert!((formula - counted).abs() < 0.06, "{rejected}: {counted}, {formula}");
        }
    }
}

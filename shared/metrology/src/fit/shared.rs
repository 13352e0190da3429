//! What errors add that points have in common, whatever their correlation.
//!
//! A parameter moves by Σ aᵢ eᵢ, aᵢ = gᵀ A⁻¹ Jᵢ, where points err by eᵢ of standard deviation cᵢ. Light from another face or a pair that
//! stands off moves a whole face, a part of it, or one part up and another down; the residuals show little of it, and nobody knows which.
//! Of all correlations none gives more than (Σ |aᵢ| cᵢ)², and by Cauchy and Schwarz
//!
//! ```text
//! (Σ |aᵢ| cᵢ)² ≤ (Σ cᵢ) (Σ aᵢ² cᵢ) = gᵀ A⁻¹ (Σ cᵢ) (Σ cᵢ Jᵢ Jᵢᵀ) A⁻¹ g
//! ```
//!
//! for every combination g of the parameters: a covariance, which is that of n independent points times n where all cᵢ are alike.
//! For the place of a plane it is exact, for its tilt it exceeds the worst correlation by the root of 4/3.
//!
//! Noise alone makes pairs disagree at a few points in a hundred. Such errors are no wider than what residuals show, which the covariance
//! of noise holds already: a share of the points that is not larger adds nothing, and of a larger one what is beyond it counts.

use nalgebra::{SMatrix, Vector3};

use super::adjust::Model;

/// Share of the points that noise raises at most, with room: 1.6 to 2.1 % of whole clouds (docs/phase.md), and more of what both pairs see.
const BY_NOISE: f64 = 0.05;

/// The part of errors in common, 0 … 1, that counts.
pub(crate) fn beyond_noise(shared_mm: &[f32]) -> f64 {
    let raised = shared_mm.iter().filter(|shared| **shared > 0.0).count();
    let share = raised as f64 / shared_mm.len().max(1) as f64;
    ((share - BY_NOISE) / (share * (1.0 - BY_NOISE))).max(0.0)
}

/// The covariance that bounds what errors in common do to the parameters of a model; `inverse` is A⁻¹, `shared_mm` the standard
/// deviation of each point's error, or empty where there are none.
pub(super) fn covariance<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    shared_mm: &[f32],
    inverse: &SMatrix<f64, P, P>,
) -> SMatrix<f64, P, P> {
    let mut middle = SMatrix::<f64, P, P>::zeros();
    let mut total = 0.0;
    let part = beyond_noise(shared_mm);
    if part == 0.0 {
        return middle;
    }
    for (point, shared_mm) in points.iter().zip(shared_mm).filter(|(_, shared)| **shared > 0.0) {
        let shared_mm = part * f64::from(*shared_mm);
        total += shared_mm;
        model.rows(point, &mut |_, derivatives| middle += derivatives * derivatives.transpose() * shared_mm);
    }
    let full = inverse * middle * inverse * total;
    (full + full.transpose()) * 0.5
}

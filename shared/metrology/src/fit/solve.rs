//! From points to a fitted model: check, centre, start, adjust, reject, covariance.

use nalgebra::{Point3, SMatrix, Vector3};

use super::adjust::{Adjusted, Model, adjust};
use super::centred::Centred;
use super::cluster::covariance;
use super::form::{Form, Residuals, marked};
use super::{Correlation, FitError, FitSettings, Support};

/// Most rounds of rejection; each lowers the sum of squares of the kept points, so they end, usually after five.
const MAX_REJECT_ROUNDS: usize = 50;

/// A fitted model and everything that was learnt on the way.
pub(super) struct Solution<M, const P: usize> {
    /// In coordinates about `centroid`.
    pub model: M,
    /// Centroid of all points given, mm.
    pub centroid: Vector3<f64>,
    /// Centroid of the points used, about `centroid`, mm.
    pub used_centroid: Vector3<f64>,
    /// Covariance of the chart's parameters.
    pub covariance: SMatrix<f64, P, P>,
    /// What the covariance rests on.
    pub support: Support,
    /// Residuals of all points given.
    pub residuals: Residuals,
    /// Form statistics of the points used.
    pub form: Form,
}

/// Fits a model.
///
/// # Errors
/// See [`FitError`].
pub(super) fn solve<M: Model<P>, const P: usize>(
    element: &'static str,
    needs: usize,
    points: &[Point3<f64>],
    settings: &FitSettings,
    start: impl Fn(&[Vector3<f64>]) -> Result<M, FitError>,
) -> Result<Solution<M, P>, FitError> {
    check(settings)?;
    let rejected = (settings.max_reject_fraction * points.len() as f64) as usize;
    let kept = points.len() - rejected;
    // The index of a point must fit into the 32 bits of a cell entry.
    if kept < needs || u32::try_from(points.len()).is_err() {
        return Err(FitError::TooFewPoints { element, points: kept, needs });
    }
    let centred = Centred::new(element, points)?;
    let mut adjusted = adjust(element, start(&centred.points)?, &centred.points)?;
    let mut used = vec![true; points.len()];
    let mut chosen = centred.points.clone();
    if rejected > 0 {
        for _ in 0..MAX_REJECT_ROUNDS {
            let next = without_largest(&adjusted.model, &centred.points, rejected);
            if next == used {
                break;
            }
            used = next;
            chosen = marked(&centred.points, &used);
            adjusted = adjust(element, adjusted.model, &chosen)?;
        }
    }
    finish(element, &centred, adjusted, &chosen, used, settings)
}

/// Statistics and covariance of an adjusted model.
fn finish<M: Model<P>, const P: usize>(
    element: &'static str,
    centred: &Centred,
    adjusted: Adjusted<M, P>,
    chosen: &[Vector3<f64>],
    used: Vec<bool>,
    settings: &FitSettings,
) -> Result<Solution<M, P>, FitError> {
    let trimmed = chosen.len() < centred.points.len();
    let (covariance, support) = covariance(element, &adjusted, chosen, settings, trimmed)?;
    let deviation_mm = centred.points.iter().map(|p| adjusted.model.deviation(p)).collect();
    let residuals = Residuals { deviation_mm, used };
    Ok(Solution {
        form: residuals.form(),
        used_centroid: super::centred::mean(chosen),
        centroid: centred.centroid,
        model: adjusted.model,
        covariance,
        support,
        residuals,
    })
}

/// Checks that the settings are within their limits.
fn check(settings: &FitSettings) -> Result<(), FitError> {
    let fraction = settings.max_reject_fraction;
    if !(0.0..=0.5).contains(&fraction) {
        return Err(FitError::Setting { key: "max_reject_fraction", value: fraction, limits: "0 … 0.5" });
    }
    match settings.correlation {
        Correlation::Cells(edge) if !(edge > 0.0 && edge.is_finite()) => {
            Err(FitError::Setting { key: "cluster_mm", value: edge, limits: "0 … ∞, zero excluded" })
        }
        _ => Ok(()),
    }
}

/// Marks all points but the `rejected` ones of largest |deviation|; of equal ones the later point goes.
fn without_largest<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    rejected: usize,
) -> Vec<bool> {
    let mut order: Vec<(f64, u32)> =
        points.iter().enumerate().map(|(i, p)| (model.deviation(p).abs(), i as u32)).collect();
    let kept = points.len() - rejected;
    order.select_nth_unstable_by(kept, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut used = vec![true; points.len()];
    for (_, index) in &order[kept..] {
        used[*index as usize] = false;
    }
    used
}

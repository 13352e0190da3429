//! From points to a fitted model: check, centre, start, adjust, reject, covariance.

use fearless_simd::{Level, dispatch};
use nalgebra::{Point3, SMatrix, Vector3};
use rayon::prelude::*;
use std::borrow::Cow;

use super::adjust::{Adjusted, Model, Until, adjust, normal, surface_step};
use super::centred::{BRANCH, Centred, mean, sum};
use super::cluster::covariance;
use super::form::{Form, Residuals, marked};
use super::{Correlation, FitError, FitSettings, Support};

/// Most rounds of rejection; each lowers the sum of squares of the kept points, so they end, usually after five.
const MAX_REJECT_ROUNDS: usize = 50;

/// A step of at most this part of the residuals counts as small: surfaces bend by far less over it. Leaving out the largest of normal
/// residuals moves a model by less.
const SMALL_STEP: f64 = 0.1;

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
    check(settings, points.len())?;
    let rejected = (settings.max_reject_fraction * points.len() as f64) as usize;
    let kept = points.len() - rejected;
    // The index of a point must fit into the 32 bits of a cell entry.
    if kept < needs || u32::try_from(points.len()).is_err() {
        return Err(FitError::TooFewPoints { element, points: kept, needs });
    }
    let centred = Centred::new(element, points)?;
    let mut until = if rejected > 0 { Until::Near } else { Until::Settled };
    let mut adjusted = adjust(element, start(&centred.points)?, &centred.points, until)?;
    let mut used = vec![true; points.len()];
    let mut chosen = Cow::Borrowed(&centred.points[..]);
    // Which points go hardly changes with the last digits of the model: they are sought when the same ones go again.
    let rounds = if rejected > 0 { MAX_REJECT_ROUNDS } else { 0 };
    let mut sizes = Vec::new();
    for _ in 0..rounds {
        let next = without_largest(&adjusted.model, &centred.points, rejected, &mut sizes);
        if next == used {
            if until == Until::Settled {
                break;
            }
            until = Until::Settled;
        } else {
            used = next;
            let nearer = (until == Until::Near).then(|| nearer(&adjusted.model, &centred.points, &used));
            if let Some(model) = nearer.flatten() {
                adjusted.model = model;
                continue;
            }
        }
        chosen = Cow::Owned(marked(&centred.points, &used));
        adjusted = adjust(element, adjusted.model, &chosen, until)?;
    }
    if until == Until::Near {
        chosen = Cow::Owned(marked(&centred.points, &used));
        adjusted = adjust(element, adjusted.model, &chosen, Until::Settled)?;
    }
    finish(element, &centred, adjusted, &chosen, used, settings)
}

/// A model one step nearer to the points that are used: the sums of all points less those of the few others, so that nothing is copied.
/// `None` where the step is not small beside the residuals, or not known.
fn nearer<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>], used: &[bool]) -> Option<M> {
    let mut others = Vec::with_capacity(used.iter().filter(|used| !**used).count());
    others.extend(points.iter().zip(used).filter(|(_, used)| !**used).map(|(point, _)| *point));
    let left = normal(model, points).less(&normal(model, &others));
    let step = left.step(0.0)?;
    let residual_mm = (left.sum / left.rows.max(1) as f64).sqrt();
    (surface_step(&left, &step) <= SMALL_STEP * residual_mm).then(|| model.moved(&step))
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
    let shared_mm = if trimmed && !settings.shared_mm.is_empty() {
        Cow::Owned(marked(settings.shared_mm, &used))
    } else {
        Cow::Borrowed(settings.shared_mm)
    };
    let settings = FitSettings { shared_mm: &shared_mm, ..*settings };
    let rejected = 1.0 - chosen.len() as f64 / centred.points.len() as f64;
    let (covariance, support) = covariance(element, &adjusted, chosen, &settings, rejected)?;
    let residuals = Residuals { deviation_mm: deviations(&adjusted.model, &centred.points), used };
    Ok(Solution {
        form: residuals.form(),
        used_centroid: if trimmed { mean(chosen, |p| *p) } else { Vector3::zeros() },
        centroid: centred.centroid,
        model: adjusted.model,
        covariance,
        support,
        residuals,
    })
}

/// Signed distance of each point, mm.
pub(super) fn deviations<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>]) -> Vec<f64> {
    let mut deviations = Vec::new();
    deviations_into(model, points, &mut deviations);
    deviations
}

/// Signed distance of each point, mm, into a list that is used again and again.
fn deviations_into<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    deviations: &mut Vec<f64>,
) {
    deviations.resize(points.len(), 0.0);
    let level = Level::new();
    let chunks = deviations.par_chunks_mut(BRANCH).zip(points.par_chunks(BRANCH));
    chunks.for_each(|(deviations, points)| dispatch!(level, _simd => fill(model, points, deviations)));
}

/// Writes the signed distance of each point, mm.
#[inline(always)]
fn fill<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>], deviations: &mut [f64]) {
    for (deviation, point) in deviations.iter_mut().zip(points) {
        *deviation = model.deviation(point);
    }
}

/// Checks that the settings are within their limits.
fn check(settings: &FitSettings, points: usize) -> Result<(), FitError> {
    let shared = settings.shared_mm;
    if !shared.is_empty() && shared.len() != points {
        let value = shared.len() as f64;
        return Err(FitError::Setting { key: "shared_mm", value, limits: "one of each point, or none" });
    }
    if let Some(wrong) = shared.iter().find(|shared| !(0.0..f32::INFINITY).contains(*shared)) {
        let value = f64::from(*wrong);
        return Err(FitError::Setting { key: "shared_mm", value, limits: "0 … ∞" });
    }
    let fraction = settings.max_reject_fraction;
    if !(0.0..=0.5).contains(&fraction) {
        return Err(FitError::Setting { key: "max_reject_fraction", value: fraction, limits: "0 … 0.5" });
    }
    match settings.correlation {
        Correlation::Cells(edge) if !(edge > 0.0 && edge.is_finite()) => {
            Err(FitError::Setting { key: "cluster_mm", value: edge, limits: "0 … ∞, zero excluded" })
        }
        Correlation::Known(sigma) if !(sigma >= 0.0 && sigma.is_finite()) => {
            Err(FitError::Setting { key: "sigma_mm", value: sigma, limits: "0 … ∞" })
        }
        _ => Ok(()),
    }
}

/// Marks all points but the `rejected` ones of largest |deviation|; of equal ones the later point goes. `sizes`: memory.
fn without_largest<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    rejected: usize,
    sizes: &mut Vec<f64>,
) -> Vec<bool> {
    deviations_into(model, points, sizes);
    for size in sizes.iter_mut() {
        *size = size.abs();
    }
    let mut used = vec![true; points.len()];
    if rejected == 0 {
        return used;
    }
    // The largest are beyond twice the root mean square, as a rule: then only these are put in order.
    let squares = sum(sizes, |s| s * s);
    let far = 2.0 * (squares / sizes.len().max(1) as f64).sqrt();
    let numbered = || sizes.iter().copied().zip(0_u32..);
    let mut order: Vec<(f64, u32)> = numbered().filter(|(size, _)| *size > far).collect();
    if order.len() < rejected || squares.is_nan() {
        order = numbered().collect();
    }
    let kept = order.len() - rejected;
    if kept > 0 {
        order.select_nth_unstable_by(kept, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
    for (_, index) in &order[kept..] {
        used[*index as usize] = false;
    }
    used
}

#[cfg(test)]
mod tests {
    use super::super::plane::Plane;
    use super::super::tests::Noise;
    use super::*;

    /// Proves: the points left out are the last ones of all points in the order of their deviations, whether few lie far out or
    /// most of them, and among equals.
    #[test]
    fn the_largest_go_whatever_their_distribution() {
        let normal = Vector3::z();
        let model = Plane { normal, tangents: [Vector3::x(), Vector3::y()], offset: 0.0 };
        let mut noise = Noise(1);
        let gauss: Vec<f64> = (0..1000).map(|_| noise.normal()).collect();
        let stepped: Vec<f64> = gauss.iter().map(|v| v.round()).collect();
        let flat: Vec<f64> = (0..1000).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let wrong: Vec<f64> = gauss.iter().map(|v| if *v > 2.0 { f64::NAN } else { *v }).collect();
        for heights in [gauss, stepped, flat, wrong] {
            let points: Vec<Vector3<f64>> = heights.iter().map(|z| Vector3::new(0.0, 0.0, *z)).collect();
            for rejected in [0, 1, 3, 50, 400, 1000] {
                let mut order: Vec<usize> = (0..1000).collect();
                order.sort_by(|a, b| heights[*a].abs().total_cmp(&heights[*b].abs()).then(a.cmp(b)));
                let used = without_largest(&model, &points, rejected, &mut Vec::new());
                let left_out = order.iter().skip(1000 - rejected);
                assert!(left_out.clone().all(|i| !used[*i]), "{rejected} rejected");
                assert_eq!(used.iter().filter(|used| !**used).count(), rejected);
            }
        }
    }

    /// Proves: sums of all points less those of a few give the plane of the others; a large step is not taken.
    #[test]
    fn a_step_without_copies_is_that_of_the_points_left() {
        let mut noise = Noise(2);
        let points: Vec<Vector3<f64>> = (0..3000)
            .map(|i| Vector3::new(f64::from(i % 60) - 29.5, f64::from(i / 60) - 24.5, 0.02 * noise.normal()))
            .collect();
        let start = |offset| Plane { normal: Vector3::z(), tangents: [Vector3::x(), Vector3::y()], offset };
        let used = without_largest(&start(0.0), &points, 90, &mut Vec::new());
        let found = nearer(&start(0.0), &points, &used).expect("a small step");
        let expected = adjust("plane", start(0.0), &marked(&points, &used), Until::Settled).unwrap().model;
        assert!((found.normal - expected.normal).amax() < 1e-9, "{found:?} {expected:?}");
        assert!((found.offset - expected.offset).abs() < 1e-9, "{found:?} {expected:?}");
        assert!(nearer(&start(0.1), &points, &used).is_none());
    }
}

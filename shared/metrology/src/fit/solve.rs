//! From points to a fitted model: check, centre, start, adjust, reject, covariance.

use fearless_simd::{Level, dispatch};
use nalgebra::{Point3, SMatrix, Vector3};
use rayon::prelude::*;
use std::borrow::Cow;

use super::adjust::{Adjusted, Model, Until, adjust, normal, surface_step};
use super::centred::{BRANCH, Centred, mean, sum};
use super::cluster::covariance;
use super::form::{Form, Residuals, marked};
use super::point_noise::freed;
use super::{Correlation, FitError, FitSettings, Support};

/// Most rounds of rejection, usually four. Rounds that adjust lower the sum of squares of the kept points, so they end; steps are taken while
/// they lower it, see [`Steps`].
const MAX_REJECT_ROUNDS: usize = 50;

/// A step of at most this part of the residuals counts as small. Leaving out the largest of normal residuals moves a model by less.
const SMALL_STEP: f64 = 0.1;

/// A difference of two sums of squares that grows by less than this part of itself has not grown: it is less exact than each of them.
const DIFFERENCE_ROUNDING: f64 = 1e-12;

/// Steps are taken where at most one point in so many goes: differences of sums tell little of few points that stay.
const MOST_STAY: usize = 10;

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
    let (mut sizes, mut steps) = (Vec::new(), Steps::new(rejected, points.len()));
    for _ in 0..rounds {
        let next = without_largest(&adjusted.model, &centred.points, rejected, &mut sizes);
        if next == used {
            if until == Until::Settled {
                break;
            }
            until = Until::Settled;
        } else {
            used = next;
            if until == Until::Near && steps.take(&mut adjusted.model, &centred.points, &used) {
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

/// Rounds of rejection of one step each, by the sums of all points less those of the few that go: the many that stay are not copied.
struct Steps<M> {
    /// Whether steps are still taken.
    taken: bool,
    /// The model before the last step, and the sum of squares of the points that it kept.
    last: Option<(M, f64)>,
}

impl<M> Steps<M> {
    fn new(rejected: usize, points: usize) -> Self {
        Self { taken: rejected <= points / MOST_STAY, last: None }
    }

    /// Takes a model one step nearer to the points that are used. Takes none, and returns false, where the step is not small beside the
    /// residuals, or not known; and from then on where the last one has not lowered the sum of squares, which it is then taken back for: a size
    /// that the points hardly determine may go far in it.
    fn take<const P: usize>(&mut self, model: &mut M, points: &[Vector3<f64>], used: &[bool]) -> bool
    where
        M: Model<P>,
    {
        if !self.taken {
            return false;
        }
        let mut others = Vec::with_capacity(used.iter().filter(|used| !**used).count());
        others.extend(points.iter().zip(used).filter(|(_, used)| !**used).map(|(point, _)| *point));
        let left = normal(model, points).less(&normal(model, &others));
        if let Some((before, sum)) = self.last.take()
            && (left.sum.is_nan() || left.sum > sum * (1.0 + DIFFERENCE_ROUNDING))
        {
            (*model, self.taken) = (before, false);
            return false;
        }
        let residual_mm = (left.sum / left.rows.max(1) as f64).sqrt();
        match left.step(0.0) {
            Some(step) if surface_step(&left, &step) <= SMALL_STEP * residual_mm => {
                let next = model.moved(&step);
                self.last = Some((std::mem::replace(model, next), left.sum));
                true
            }
            _ => false,
        }
    }
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
    let model = freed(adjusted, settings.noise, &centred.centroid);
    let residuals = Residuals { deviation_mm: deviations(&model, &centred.points), used };
    Ok(Solution {
        form: residuals.form(),
        used_centroid: if trimmed { mean(chosen, |p| *p) } else { Vector3::zeros() },
        centroid: centred.centroid,
        model,
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
        let step = |offset, rejected| {
            let mut model = start(offset);
            Steps::new(rejected, 3000).take(&mut model, &points, &used).then_some(model)
        };
        let found = step(0.0, 90).expect("a small step");
        let expected = adjust("plane", start(0.0), &marked(&points, &used), Until::Settled).unwrap().model;
        assert!((found.normal - expected.normal).amax() < 1e-9, "{found:?} {expected:?}");
        assert!((found.offset - expected.offset).abs() < 1e-9, "{found:?} {expected:?}");
        assert!(step(0.1, 90).is_none());
        assert!(step(0.0, 301).is_none(), "too many go");
    }

    /// Proves: a step after which the points that stay lie farther off is taken back, and none follows.
    #[test]
    fn a_step_that_makes_it_worse_is_taken_back() {
        let mut noise = Noise(4);
        let points: Vec<Vector3<f64>> =
            (0..900).map(|i| Vector3::new(f64::from(i % 30), f64::from(i / 30), noise.normal())).collect();
        let plane = |offset| Plane { normal: Vector3::z(), tangents: [Vector3::x(), Vector3::y()], offset };
        let used = vec![true; points.len()];
        let mut steps = Steps::new(9, points.len());
        assert!(steps.take(&mut plane(0.02), &points, &used));
        let mut worse = plane(0.4);
        assert!(!steps.take(&mut worse, &points, &used));
        assert_eq!(worse.offset, 0.02);
        assert!(!steps.take(&mut plane(0.02), &points, &used));
    }

    /// Proves: rejection ends where no other choice of points would be made, whether it goes in steps or not: on a sphere, with a part of dirt on one side.
    #[test]
    fn rejection_ends_at_a_choice_that_its_own_sphere_makes() {
        let mut noise = Noise(6);
        let points: Vec<Point3<f64>> = (0..4000)
            .map(|i| {
                let [x, y, z] = [0; 3].map(|_| noise.normal());
                let away = Vector3::new(x, y, z.abs() + 0.2).normalize();
                let dirt = if i % 50 == 0 { 0.3 } else { 0.0 };
                Point3::from(away * (10.0 + 0.01 * noise.normal() + dirt))
            })
            .collect();
        for fraction in [0.01, 0.03, 0.1, 0.101, 0.5] {
            let settings = FitSettings { max_reject_fraction: fraction, ..FitSettings::default() };
            let fit = super::super::sphere(&points, &settings).unwrap();
            let model = super::super::sphere::FreeSphere {
                center: fit.center().coords,
                radius: 0.5 * fit.diameter_mm,
            };
            let places: Vec<Vector3<f64>> = points.iter().map(|p| p.coords).collect();
            let rejected = (fraction * 4000.0) as usize;
            let again = without_largest(&model, &places, rejected, &mut Vec::new());
            assert_eq!(again, fit.residuals.used, "{fraction}");
        }
    }
}

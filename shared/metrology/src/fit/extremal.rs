//! Maximum inscribed and minimum circumscribed elements: circle, sphere, cylinder.
//!
//! The circumscribed element makes the largest distance of a point from centre or axis least, the inscribed one the
//! smallest distance largest. Sequential linear programming within a trust region: the linearised problem "least t with
//! rᵢ + aᵢ · δ ≤ t, |δⱼ| ≤ Δ" is solved exactly by the simplex method on its dual, whose basis holds the points that
//! touch; the step is taken when the true distance gains. A linear optimum that promises nothing proves a local optimum;
//! it starts at the least-squares element, so it is the one that measured parts have.

use nalgebra::{Point3, SMatrix, SVector, Vector3};

use super::FitError;
use super::adjust::{Model, singular};
use super::centred::Centred;
use super::chart::{ChartCovariance, Effect, charted, tilts};
use super::circle::{Ring, ring};
use super::cylinder::{Cylinder, fitted as fitted_cylinder};
use super::elimination::solve_square;
use super::sphere::{FreeSphere, fitted as fitted_sphere};
use super::zone::{Zone, minimum_zone};

/// Most linearisations of a search; a vertex needs five to ten, a flat optimum as many halvings.
const MAX_ROUNDS: usize = 200;

/// Most pivots of the simplex method in one linearisation.
const MAX_PIVOTS: usize = 1000;

/// A gain below this part of the extent is none.
const GAP: f64 = 1e-13;

/// Which side of the element the points lie on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// All points lie outside: the element is the largest one inside them (GX of ISO 14405-1).
    Inscribed,
    /// All points lie inside: the element is the smallest one around them (GN of ISO 14405-1).
    Circumscribed,
    /// Largest distance of a point least (GC of ISO 14405-1): minimax or minimum zone.
    MinimumZone,
}

/// An element that touches a few points.
#[derive(Debug, Clone, PartialEq)]
pub struct Touching {
    /// Centre, or the point of the axis nearest to the centroid of the points, mm.
    pub point_mm: [f64; 3],
    /// Unit direction of the axis or of the circle's normal; zero for a sphere.
    pub direction: [f64; 3],
    /// Diameter of the element, mm.
    pub diameter_mm: f64,
    /// Covariance in the chart for touching points that scatter by 1 mm along the normal, each on its own.
    pub unit_covariance: ChartCovariance,
}

/// A row of the one-sided problem: value r and derivatives a by the D free parameters.
struct Bound<const D: usize> {
    value: f64,
    slope: SVector<f64, D>,
}

/// Where the one-sided problem ended.
struct Optimum<const D: usize> {
    step: SVector<f64, D>,
    level: f64,
    /// Rows that hold the optimum; `None` where the trust region does.
    touching: Vec<usize>,
}

/// A column of the dual's basis: a row of the problem, or a border of the trust region.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    Row(usize),
    Border(usize, f64),
}

/// Least t with rᵢ + aᵢ · δ ≤ t and |δⱼ| ≤ border, by the simplex method on the dual; `None` when it does not end.
#[allow(clippy::too_many_lines, reason = "one pivot is one thought")]
fn least_level<const D: usize>(rows: &[Bound<D>], border: f64) -> Option<Optimum<D>> {
    let first = rows.iter().enumerate().reduce(|a, b| if b.1.value > a.1.value { b } else { a })?;
    let mut basis = vec![Column::Row(first.0)];
    basis.extend((0..D).map(|j| Column::Border(j, if first.1.slope[j] > 0.0 { -1.0 } else { 1.0 })));
    let cost = |column: &Column| match column {
        Column::Row(index) => rows[*index].value,
        Column::Border(..) => -border,
    };
    // Entry k of a column: D equations of the slopes, then that of the weights.
    let entry = |column: &Column, k: usize| match column {
        Column::Row(index) => {
            if k < D {
                rows[*index].slope[k]
            } else {
                1.0
            }
        }
        Column::Border(axis, sign) => {
            if k == *axis {
                *sign
            } else {
                0.0
            }
        }
    };
    for _ in 0..MAX_PIVOTS {
        let costs: Vec<f64> = basis.iter().map(cost).collect();
        let transposed: Vec<Vec<f64>> =
            basis.iter().map(|c| (0..=D).map(|k| entry(c, k)).collect()).collect();
        let prices = solve_square(transposed.clone(), costs)?;
        let step = SVector::<f64, D>::from_fn(|j, _| -prices[j]);
        let level = prices[D];
        let mut worst: (f64, Option<Column>) = (1e-15 * (level.abs() + border), None);
        for (index, row) in rows.iter().enumerate() {
            let excess = row.value + row.slope.dot(&step) - level;
            if excess > worst.0 {
                worst = (excess, Some(Column::Row(index)));
            }
        }
        for axis in 0..D {
            for sign in [1.0, -1.0] {
                let excess = sign * step[axis] - border;
                if excess > worst.0 {
                    worst = (excess, Some(Column::Border(axis, sign)));
                }
            }
        }
        let entering = match worst.1 {
            Some(column) if !basis.contains(&column) => column,
            _ => {
                let row = |c: &Column| if let Column::Row(index) = c { Some(*index) } else { None };
                return Some(Optimum { step, level, touching: basis.iter().filter_map(row).collect() });
            }
        };
        let columns = |k: usize| -> Vec<f64> { transposed.iter().map(|c| c[k]).collect() };
        let matrix: Vec<Vec<f64>> = (0..=D).map(columns).collect();
        let weights = solve_square(matrix.clone(), (0..=D).map(|k| f64::from(u8::from(k == D))).collect())?;
        let change = solve_square(matrix, (0..=D).map(|k| entry(&entering, k)).collect())?;
        let mut leaving: Option<(f64, usize)> = None;
        for (place, (weight, by)) in weights.iter().zip(&change).enumerate() {
            if *by > 1e-12 {
                let ratio = weight.max(0.0) / by;
                if leaving.is_none_or(|(least, _)| ratio < least) {
                    leaving = Some((ratio, place));
                }
            }
        }
        basis[leaving?.1] = entering;
    }
    None
}

/// The inverse of a small matrix, column by column; `None` when it is singular.
fn inverse<const P: usize>(rows: &[SVector<f64, P>]) -> Option<SMatrix<f64, P, P>> {
    let matrix: Vec<Vec<f64>> = rows.iter().map(|row| row.iter().copied().collect()).collect();
    let mut found = SMatrix::<f64, P, P>::zeros();
    for k in 0..P {
        let right = (0..P).map(|i| f64::from(u8::from(i == k))).collect();
        let column = solve_square(matrix.clone(), right)?;
        found.set_column(k, &SVector::<f64, P>::from_iterator(column));
    }
    Some(found)
}

/// Moves a model, whose last parameter is the radius, until no small motion gains. Gives the model, its radius' change
/// and the covariance of its parameters for touching points that scatter by 1 mm.
fn extremal<M: Model<P>, const P: usize, const D: usize>(
    element: &'static str,
    side: Side,
    start: M,
    points: &[Vector3<f64>],
) -> Result<(M, SMatrix<f64, P, P>), FitError> {
    debug_assert!(P == D + 1, "the radius is the last parameter");
    let sign = if side == Side::Inscribed { -1.0 } else { 1.0 };
    let failed = if side == Side::Inscribed {
        let why = "no largest one lies inside them, because they do not surround it; take least-squares";
        FitError::Degenerate { element, why }
    } else {
        FitError::NoConvergence { element, iterations: MAX_ROUNDS }
    };
    let extent_mm = points.iter().fold(0.0, |most: f64, p| most.max(p.amax()));
    let level =
        |model: &M| points.iter().map(|p| sign * model.deviation(p)).fold(f64::NEG_INFINITY, f64::max);
    let radius = |model: &M, by: f64| {
        let mut step = SVector::<f64, P>::zeros();
        step[D] = by;
        model.moved(&step)
    };
    let mut model = start;
    let mut now = level(&model);
    let range_mm = points.iter().map(|p| model.deviation(p).abs()).fold(0.0, f64::max);
    let mut border = range_mm.max(1e-9 * extent_mm);
    for _ in 0..MAX_ROUNDS {
        let (rows, scale) = linearise::<M, P, D>(&model, points, sign).ok_or_else(|| singular(element))?;
        let found = least_level(&rows, border).ok_or(failed.clone())?;
        if now - found.level <= GAP * extent_mm || border <= 1e-15 * extent_mm {
            let model = radius(&model, sign * now);
            let covariance = touching_covariance::<P, D>(&rows, &scale, &found.touching, sign);
            return Ok((model, covariance));
        }
        if border > 100.0 * extent_mm {
            return Err(failed);
        }
        let mut step = SVector::<f64, P>::zeros();
        step.fixed_rows_mut::<D>(0).copy_from(&found.step.component_div(&scale));
        let next = model.moved(&step);
        let there = level(&next);
        if there < now {
            border *= if now - there > 0.5 * (now - found.level) { 2.0 } else { 0.5 };
            (model, now) = (next, there);
        } else {
            border *= 0.25;
        }
    }
    Err(failed)
}

/// Rows of the one-sided problem, their slopes scaled to a largest size of one, with the scale.
fn linearise<M: Model<P>, const P: usize, const D: usize>(
    model: &M,
    points: &[Vector3<f64>],
    sign: f64,
) -> Option<(Vec<Bound<D>>, SVector<f64, D>)> {
    let mut rows: Vec<Bound<D>> = Vec::with_capacity(points.len());
    for point in points {
        model.rows(point, &mut |residual, derivatives| {
            let slope = SVector::<f64, D>::from_fn(|j, _| sign * derivatives[j]);
            rows.push(Bound { value: sign * residual, slope });
        });
    }
    let mut scale = SVector::<f64, D>::zeros();
    for row in &rows {
        scale = scale.zip_map(&row.slope, |s, a| s.max(a.abs()));
    }
    if !scale.iter().all(|s| *s > 0.0 && s.is_finite()) {
        return None;
    }
    for row in &mut rows {
        row.slope.component_div_assign(&scale);
    }
    Some((rows, scale))
}

/// Covariance of the free parameters and the radius when each touching point scatters by 1 mm: the rows a · δ − t = −r of
/// the points, with δ held along directions that no point fixes.
fn touching_covariance<const P: usize, const D: usize>(
    rows: &[Bound<D>],
    scale: &SVector<f64, D>,
    touching: &[usize],
    sign: f64,
) -> SMatrix<f64, P, P> {
    let row =
        |index: &usize| SVector::<f64, P>::from_fn(|j, _| if j < D { rows[*index].slope[j] } else { -1.0 });
    let mut system: Vec<SVector<f64, P>> = touching.iter().take(P).map(row).collect();
    let known = system.len();
    let mut axis = 0;
    while system.len() < P && axis < D {
        system.push(SVector::<f64, P>::from_fn(|j, _| f64::from(u8::from(j == axis))));
        axis += 1;
    }
    let Some(found) = inverse(&system) else { return SMatrix::identity() };
    let mut by = found;
    for column in known..P {
        by.column_mut(column).fill(0.0);
    }
    for j in 0..D {
        by.row_mut(j).iter_mut().for_each(|v| *v /= scale[j]);
    }
    by.row_mut(D).iter_mut().for_each(|v| *v *= sign);
    by * by.transpose()
}

/// Refuses what is too few, and centres the points.
fn centred(element: &'static str, needs: usize, points: &[Point3<f64>]) -> Result<Centred, FitError> {
    if points.len() < needs {
        return Err(FitError::TooFewPoints { element, points: points.len(), needs });
    }
    Centred::new(element, points)
}

/// The model with the covariance of its parameters per square millimetre of scatter, by the side.
fn fitted<M: Model<P>, const P: usize, const D: usize>(
    element: &'static str,
    side: Side,
    points: &[Point3<f64>],
    start: impl Fn(&[Vector3<f64>]) -> Result<M, FitError>,
) -> Result<(M, Vector3<f64>, SMatrix<f64, P, P>), FitError> {
    if side == Side::MinimumZone {
        let Zone { model, centroid, unit_covariance, .. } = minimum_zone(element, points, start)?;
        return Ok((model, centroid, unit_covariance));
    }
    let Centred { centroid, points } = centred(element, P + 1, points)?;
    let (model, covariance) = extremal::<M, P, D>(element, side, start(&points)?, &points)?;
    Ok((model, centroid, covariance))
}

/// A circle that touches the points, seen along the normal of their least-squares circle.
///
/// # Errors
/// Fewer than 4 points, collinear points, no convergence; see [`FitError`].
pub fn touching_circle(points: &[Point3<f64>], side: Side) -> Result<Touching, FitError> {
    let (Ring(circle), centroid, covariance) = fitted::<Ring, 3, 2>("circle", side, points, ring)?;
    let [e1, e2] = circle.tangents;
    let effects = [Effect::shift(e1), Effect::shift(e2), Effect::sizes([2.0, 0.0])];
    Ok(Touching {
        point_mm: (centroid + circle.center).into(),
        direction: circle.normal.into(),
        diameter_mm: 2.0 * circle.radius,
        unit_covariance: charted(&effects, &covariance),
    })
}

/// A sphere that touches the points.
///
/// # Errors
/// Fewer than 5 points, coplanar points, no convergence; see [`FitError`].
pub fn touching_sphere(points: &[Point3<f64>], side: Side) -> Result<Touching, FitError> {
    let (FreeSphere { center, radius }, centroid, covariance) =
        fitted::<FreeSphere, 4, 3>("sphere", side, points, fitted_sphere)?;
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(Effect::shift);
    Ok(Touching {
        point_mm: (centroid + center).into(),
        direction: [0.0; 3],
        diameter_mm: 2.0 * radius,
        unit_covariance: charted(&[x, y, z, Effect::sizes([2.0, 0.0])], &covariance),
    })
}

/// A cylinder that touches the points.
///
/// # Errors
/// Fewer than 6 points, points on one line or in one plane, no convergence; see [`FitError`].
pub fn touching_cylinder(points: &[Point3<f64>], side: Side) -> Result<Touching, FitError> {
    let (Cylinder { axis, radius }, centroid, covariance) =
        fitted::<Cylinder, 5, 4>("cylinder", side, points, fitted_cylinder)?;
    let ([first, second], [e1, e2]) = (tilts(&axis.tangents), axis.tangents);
    let effects = [first, second, Effect::shift(e1), Effect::shift(e2), Effect::sizes([2.0, 0.0])];
    Ok(Touching {
        point_mm: (centroid + axis.point).into(),
        direction: axis.direction.into(),
        diameter_mm: 2.0 * radius,
        unit_covariance: charted(&effects, &covariance),
    })
}

/// The plane of the minimum zone, the directions of its tilts, and the covariance of both tilts and the offset.
///
/// # Errors
/// Fewer than 4 points, collinear points, no convergence; see [`FitError`].
#[expect(
    clippy::type_complexity,
    reason = "the covariance means nothing without the directions of its tilts"
)]
pub(super) fn touching_plane(
    points: &[Point3<f64>],
) -> Result<(Touching, [Vector3<f64>; 2], SMatrix<f64, 3, 3>), FitError> {
    let zone = minimum_zone("plane", points, super::plane::principal)?;
    let plane = zone.model;
    let [first, second] = tilts(&plane.tangents);
    let touching = Touching {
        point_mm: (zone.centroid + plane.normal * plane.offset).into(),
        direction: plane.normal.into(),
        diameter_mm: 0.0,
        unit_covariance: charted(&[first, second, Effect::shift(plane.normal)], &zone.unit_covariance),
    };
    Ok((touching, plane.tangents, zone.unit_covariance))
}

//! Minimum zone: the element that makes the largest |distance| least (Chebyshev), and the width of its zone.
//!
//! Sequential linear programming: the linearised problem is solved exactly ([`chebyshev`]), the step is taken when the
//! zone shrinks and halved when not. At a vertex, where P + 1 points touch, this converges quadratically; the linear
//! optimum at the end is a lower bound for every small motion, which proves a local minimum. Where the zone is thin
//! against the points' extent, as with every measured surface, there is but one.

use nalgebra::{Point3, SMatrix, Vector3};
use serde::Serialize;

use super::FitError;
use super::adjust::{Model, singular};
use super::axis::Axis;
use super::centred::Centred;
use super::elimination::solve_square;
use super::exchange::{Levelled, Row, chebyshev};

/// Most linearisations; from a least-squares start three to six are needed.
const MAX_ROUNDS: usize = 60;

/// Most halvings of a step: below 1e-9 of it nothing is left to gain.
const MAX_HALVINGS: usize = 30;

/// How far the zone may stay above the bound that the linearised problem gives, as a part of the extent.
const GAP: f64 = 1e-12;

/// A minimum zone and its element.
pub(super) struct Zone<M, const P: usize> {
    /// In coordinates about `centroid`.
    pub model: M,
    /// Centroid of the points, mm.
    pub centroid: Vector3<f64>,
    /// Width of the zone, mm.
    pub width_mm: f64,
    /// Covariance of the parameters when each point that holds the zone scatters by 1 mm.
    pub unit_covariance: SMatrix<f64, P, P>,
}

/// Shrinks the zone from a start in coordinates about the centroid. The models have one residual a point.
///
/// # Errors
/// Fewer points than P + 1, coordinates that are no lengths, points that do not determine the element, no convergence.
pub(super) fn minimum_zone<M: Model<P>, const P: usize>(
    element: &'static str,
    points: &[Point3<f64>],
    start: impl Fn(&[Vector3<f64>]) -> Result<M, FitError>,
) -> Result<Zone<M, P>, FitError> {
    if points.len() <= P {
        return Err(FitError::TooFewPoints { element, points: points.len(), needs: P + 1 });
    }
    let Centred { centroid, points } = Centred::new(element, points)?;
    let extent_mm = points.iter().fold(0.0, |most: f64, p| most.max(p.amax()));
    let mut model = start(&points)?;
    let mut half_mm = half_width(&model, &points);
    let mut rows = Vec::with_capacity(points.len());
    for _ in 0..MAX_ROUNDS {
        linearise(&model, &points, &mut rows);
        let linear = chebyshev::<P>(&rows).ok_or_else(|| singular(element))?;
        let mut step = linear.step;
        let mut shrunk = None;
        for _ in 0..MAX_HALVINGS {
            let next = model.moved(&step);
            let width = half_width(&next, &points);
            if width < half_mm {
                shrunk = Some((next, width));
                break;
            }
            step *= 0.5;
        }
        let settled = half_mm - linear.half_width <= GAP * extent_mm;
        let stuck = shrunk.is_none();
        if let Some((next, width)) = shrunk {
            (model, half_mm) = (next, width);
        }
        if settled {
            let unit_covariance = unit_covariance(&rows, &linear);
            return Ok(Zone { model, centroid, width_mm: 2.0 * half_mm, unit_covariance });
        }
        if stuck {
            break;
        }
    }
    Err(FitError::NoConvergence { element, iterations: MAX_ROUNDS })
}

/// Covariance of the parameters when each row of the basis scatters by 1 mm: aᵢ · δ ∓ h = −rᵢ.
fn unit_covariance<const P: usize>(rows: &[Row<P>], linear: &Levelled<P>) -> SMatrix<f64, P, P> {
    let held = || linear.basis.iter().map(|index| &rows[*index]);
    let sign = |row: &Row<P>| (row.residual + row.derivatives.dot(&linear.step)).signum();
    let matrix: Vec<Vec<f64>> =
        held().map(|row| row.derivatives.iter().copied().chain([-sign(row)]).collect()).collect();
    let mut by = SMatrix::<f64, P, P>::zeros();
    for index in 0..=P {
        let right = (0..=P).map(|i| f64::from(u8::from(i == index))).collect();
        let Some(column) = solve_square(matrix.clone(), right) else { return SMatrix::identity() };
        for i in 0..P {
            for j in 0..P {
                by[(i, j)] += column[i] * column[j];
            }
        }
    }
    by
}

/// Largest absolute distance of the points, mm.
fn half_width<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>]) -> f64 {
    points.iter().fold(0.0, |most: f64, p| most.max(model.deviation(p).abs()))
}

/// Residuals and derivatives of all points.
fn linearise<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>], rows: &mut Vec<Row<P>>) {
    rows.clear();
    for point in points {
        model
            .rows(point, &mut |residual, derivatives| rows.push(Row { residual, derivatives: *derivatives }));
    }
}

/// Minimum zone of a plane (flatness by ISO 12781, MZPL): two parallel planes that hold all points.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlaneZone {
    /// Distance of the two planes, mm.
    pub minimum_zone_mm: f64,
    /// Unit normal; its largest component is positive.
    pub normal: [f64; 3],
    /// Signed distance of the middle plane from the origin along the normal, mm.
    pub offset_mm: f64,
}

/// Minimum zone of a sphere: two concentric spheres that hold all points between them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SphereZone {
    /// Difference of their radii, mm.
    pub minimum_zone_mm: f64,
    /// Common centre of both spheres, mm.
    pub center_mm: [f64; 3],
    /// Diameter of the sphere midway, mm.
    pub diameter_mm: f64,
}

/// Minimum zone of a cylinder (cylindricity by ISO 12180, MZCY): two coaxial cylinders.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CylinderZone {
    /// Difference of their radii, mm.
    pub minimum_zone_mm: f64,
    /// Point of the axis nearest to the centroid of the points, mm.
    pub axis_point_mm: [f64; 3],
    /// Unit direction of the axis; its largest component is positive.
    pub axis_direction: [f64; 3],
    /// Diameter of the cylinder midway, mm.
    pub diameter_mm: f64,
}

/// Minimum zone of a circle (roundness by ISO 12181, MZCI) of the points seen along the normal of their plane.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CircleZone {
    /// Difference of the radii of two concentric circles that hold all points between them, mm.
    pub minimum_zone_mm: f64,
    /// Their centre, in the least-squares plane, mm.
    pub center_mm: [f64; 3],
    /// Unit normal of the least-squares circle; its largest component is positive.
    pub normal: [f64; 3],
    /// Diameter of the circle midway, mm.
    pub diameter_mm: f64,
}

/// Minimum zone of a plane.
///
/// # Errors
/// Fewer than 4 points, collinear points; see [`FitError`].
pub fn plane_minimum_zone(points: &[Point3<f64>]) -> Result<PlaneZone, FitError> {
    let zone = minimum_zone("plane", points, super::plane::principal)?;
    let normal = signed(zone.model.normal);
    let offset_mm = normal.dot(&zone.centroid) + normal.dot(&zone.model.normal) * zone.model.offset;
    Ok(PlaneZone { minimum_zone_mm: zone.width_mm, normal: normal.into(), offset_mm })
}

/// Minimum zone of a sphere.
///
/// # Errors
/// Fewer than 5 points, coplanar points; see [`FitError`].
pub fn sphere_minimum_zone(points: &[Point3<f64>]) -> Result<SphereZone, FitError> {
    let zone = minimum_zone("sphere", points, super::sphere::fitted)?;
    Ok(SphereZone {
        minimum_zone_mm: zone.width_mm,
        center_mm: (zone.centroid + zone.model.center).into(),
        diameter_mm: 2.0 * zone.model.radius,
    })
}

/// Minimum zone of a cylinder.
///
/// # Errors
/// Fewer than 6 points, points on one line or in one plane; see [`FitError`].
pub fn cylinder_minimum_zone(points: &[Point3<f64>]) -> Result<CylinderZone, FitError> {
    let zone = minimum_zone("cylinder", points, super::cylinder::fitted)?;
    let Axis { point, direction, .. } = zone.model.axis;
    Ok(CylinderZone {
        minimum_zone_mm: zone.width_mm,
        axis_point_mm: (zone.centroid + point).into(),
        axis_direction: signed(direction).into(),
        diameter_mm: 2.0 * zone.model.radius,
    })
}

/// Minimum zone of a circle.
///
/// # Errors
/// Fewer than 4 points, collinear points; see [`FitError`].
pub fn circle_minimum_zone(points: &[Point3<f64>]) -> Result<CircleZone, FitError> {
    let zone = minimum_zone("circle", points, super::circle::ring)?;
    Ok(CircleZone {
        minimum_zone_mm: zone.width_mm,
        center_mm: (zone.centroid + zone.model.0.center).into(),
        normal: signed(zone.model.0.normal).into(),
        diameter_mm: 2.0 * zone.model.0.radius,
    })
}

/// The direction whose largest component is positive.
fn signed(direction: Vector3<f64>) -> Vector3<f64> {
    if direction[direction.iamax()] < 0.0 { -direction } else { direction }
}

//! Association beyond least squares of a surface: outlines at borders, lines in sections, touching elements.

use nalgebra::{Point3, Vector3};

use super::MeasureError;
use super::criterion::Criterion;
use super::fit_element::rms;
use super::fitted_element::FittedElement;
use super::flatness::OfUsed;
use super::geometry::Geometry;
use super::plan::Element;
use crate::fit::{
    self, Border, ContourFit, Correlation, FitError, FitSettings, Outline, Placed, PlaneFit, Residuals,
    Sheet, Side, border, contour,
};

/// Rounds in which an outline and its border follow each other.
const ROUNDS: usize = 3;

/// Scatter of a border counts as form beyond so many of its standard deviations; the square of a gap (exponential, at most)
/// has the variance 8 of its mean squared.
const FORM_SIGMAS: f64 = 2.0;
const GAP_KURTOSIS: f64 = 8.0;

/// An outline, or a line in its section, with the points of its border and, of an outline, the plane that it bounds.
type Outlined = (FittedElement, Vec<Point3<f64>>, Option<PlaneFit>);

/// Fits an outline to the border of the points, or a line to the points seen in their section.
///
/// # Errors
/// The fit's, or a border that is not there; see [`FitError`].
pub(super) fn outlined(
    element: &Element,
    points: &[Point3<f64>],
    settings: &FitSettings,
) -> Result<Outlined, FitError> {
    match &element.geometry {
        Geometry::Line { point_mm, direction, normal, half_size_mm } => {
            let sheet = Sheet { origin: point_mm.coords, edges: [*direction, *normal] };
            let places: Vec<[f64; 2]> = points.iter().map(|p| sheet.place(&p.coords)).collect();
            let near = Placed { outline: Outline::Edge(half_size_mm[0]), center: [0.0; 2], turn_rad: 0.0 };
            // The residual of an edge is positive on its right; that of a surface is positive above it.
            let mut found = contour(&places, &near, &sheet, None, settings)?;
            found.residuals.deviation_mm.iter_mut().for_each(|d| *d = -*d);
            let flat = places.iter().map(|place| Point3::from(sheet.position(*place))).collect();
            Ok((FittedElement::Line(found), flat, None))
        }
        Geometry::Outline { center_mm, normal, edges, outline, internal, band_mm, inset_mm } => {
            let plane =
                fit::plane(points, &FitSettings { max_reject_fraction: 0.0, ..*settings })?.towards(normal);
            let sheet = sheet_on(&plane, center_mm, &edges[0]);
            let places: Vec<[f64; 2]> = points.iter().map(|p| sheet.place(&p.coords)).collect();
            let mut near = Placed { outline: *outline, center: [0.0; 2], turn_rad: 0.0 };
            for round in 1.. {
                let found = border(&places, &near, *internal, *band_mm, *inset_mm, settings.left_out)?;
                let last = round == ROUNDS;
                // The border is that of the points in their plane: what moves them off it does not move it.
                let in_plane = FitSettings { shared_mm: &[], noise: &[], ..*settings };
                let known = FitSettings { correlation: Correlation::Known(found.u_point_mm), ..in_plane };
                let fitted = contour(&found.points, &near, &sheet, Some(&plane), &known)?;
                if last {
                    let fitted = with_form(fitted, &found, || {
                        contour(&found.points, &near, &sheet, Some(&plane), &in_plane)
                    })?;
                    let fitted = fitted.with_rim(found.u_rim_mm);
                    let behind = found.points.iter().map(|p| Point3::from(sheet.position(*p))).collect();
                    let fitted = match outline {
                        Outline::Circle(_) => FittedElement::Circle(fitted),
                        Outline::Slot(_) => FittedElement::Slot(fitted),
                        Outline::Rectangle(_) => FittedElement::Rectangle(fitted),
                        Outline::Edge(_) => FittedElement::Edge(fitted),
                    };
                    return Ok((fitted, behind, Some(plane)));
                }
                near = Placed::fitted(&near, &fitted, &sheet);
            }
            unreachable_rounds()
        }
        _ => Err(FitError::Degenerate { element: "outline", why: "the element is none" }),
    }
}

/// Adds the uncertainty of form where the points scatter by more than gaps explain; `estimated` fits with the correlation that the
/// residuals show.
fn with_form(
    fitted: ContourFit,
    border: &Border,
    estimated: impl FnOnce() -> Result<ContourFit, FitError>,
) -> Result<ContourFit, FitError> {
    let variance = fitted.form.form_sigma_mm * fitted.form.form_sigma_mm;
    let gaps = border.scatter_mm * border.scatter_mm;
    let noise = (GAP_KURTOSIS / fitted.form.points.max(1) as f64).sqrt();
    if variance <= gaps * (1.0 + FORM_SIGMAS * noise) {
        return Ok(fitted);
    }
    Ok(fitted.with_form(&estimated()?, 1.0 - gaps / variance))
}

/// The loop over rounds always returns.
fn unreachable_rounds() -> Result<Outlined, FitError> {
    Err(FitError::NoConvergence { element: "outline", iterations: ROUNDS })
}

/// Coordinates in a fitted plane about the foot of a nominal point, the first along a nominal direction.
fn sheet_on(plane: &PlaneFit, center: &Point3<f64>, along: &Vector3<f64>) -> Sheet {
    let normal = plane.normal_vector();
    let across = along - normal * normal.dot(along);
    let first = across / across.norm();
    let origin = center.coords - normal * plane.distance_mm(center);
    Sheet { origin, edges: [first, normal.cross(&first)] }
}

/// The fit of another criterion where the plan asks for one, and the points behind it.
///
/// # Errors
/// No touching element, or a criterion that the element does not know.
pub(super) fn associated(
    element: &Element,
    points: Vec<Point3<f64>>,
    fit: FittedElement,
    settings: &FitSettings,
) -> Result<(FittedElement, Vec<Point3<f64>>), MeasureError> {
    let failed = |source| MeasureError::Fit { element: element.name.clone(), source };
    let (behind, plane) = if element.geometry.is_outlined() {
        let (_, behind, plane) = outlined(element, &points, settings).map_err(failed)?;
        (behind, plane)
    } else {
        (points, None)
    };
    let side = match element.criterion {
        Criterion::LeastSquares => return Ok((fit, behind)),
        Criterion::MinimumZone => Side::MinimumZone,
        Criterion::MaximumInscribed => Side::Inscribed,
        Criterion::MinimumCircumscribed => Side::Circumscribed,
    };
    let u = u_touching_mm(fit.residuals(), fit.effect(), rms(settings.shared_mm));
    let replaced = match fit {
        FittedElement::Sphere(sphere) => sphere.replaced(&behind, side, u).map(FittedElement::Sphere),
        FittedElement::Cylinder(cylinder) => cylinder.replaced(&behind, side, u).map(FittedElement::Cylinder),
        FittedElement::Plane(plane) => plane.replaced(&behind, u).map(FittedElement::Plane),
        FittedElement::Circle(circle) => {
            let place = Point3::from(circle.center_mm);
            let of_plane = plane.map_or_else(Default::default, |plane| plane.chart_at(&place));
            let u_rim_mm = circle.u_rim_mm;
            let replaced = circle.circle_replaced(&behind, &of_plane, side, u);
            replaced.map(|circle| FittedElement::Circle(circle.with_rim(u_rim_mm)))
        }
        other => Ok(other),
    };
    Ok((replaced.map_err(failed)?, behind))
}

/// Standard uncertainty of a point that touches: that of one extreme, from the tail of the residuals, and what it may have in
/// common with others.
fn u_touching_mm(residuals: &Residuals, effect: f64, shared_mm: f64) -> f64 {
    let of_noise = OfUsed::new(residuals, effect).extreme_mm;
    (of_noise * of_noise + shared_mm * shared_mm).sqrt()
}

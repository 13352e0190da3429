//! The inspection of a cloud.

use super::MeasureError;
use super::align::{PlacedPart, align, describe};
use super::beyond;
use super::characteristic::{Characteristic, Extracted, Kind};
use super::criterion::Criterion;
use super::extracted;
use super::filter::Filtered;
use super::fit_element::{Measured, REACH_MARGINS, about, measure};
use super::fitted_element::FittedElement;
use super::gather::gather;
use super::joint::{Joint, Part};
use super::location;
use super::plan::{Element, Feature, Plan, Quantity};
use super::reading::{Reading, filtered_flatness, flatness};
use super::region::Region;
use super::result::{AlignmentResult, ConstructedResult, ElementResult, FeatureResult, InspectionResult};
use crate::fit::{
    Correlation, Derived, Form, PlaneFit, SphereFit, centre_distance_mm, plane_angle_rad, plane_distance_mm,
    sphere_height_mm,
};
use crate::verdict::{Verdict, decide, overall};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Inspects a cloud in the world frame.
///
/// Nothing is skipped in silence: an element or feature that cannot be measured carries the reason, and the verdict is
/// then never `pass`.
pub fn evaluate(plan: &Plan, cloud: &[Point]) -> InspectionResult {
    let found = match u32::try_from(cloud.len()) {
        Err(_) => Err(MeasureError::CloudSize { points: cloud.len() }),
        Ok(_) => place(plan, cloud),
    };
    let (elements, alignment, alignment_failure) = match found {
        Ok(found) => (fit_elements(plan, cloud, &found.world_from_part), Some(found.result), None),
        Err(error) => {
            let reason = format!("the part was not found: {error}");
            (plan.elements.iter().map(|_| Err(reason.clone())).collect(), None, Some(error.to_string()))
        }
    };
    let joint = (!plan.characteristics.is_empty() || !plan.constructed.is_empty())
        .then(|| Joint::new(plan, &elements));
    let beyond = beyond::told(plan, &elements);
    let measured = plan.features.par_iter().map(|one| {
        let found = feature(plan, one, &elements, joint.as_ref());
        let rests_on = beyond::elements_of(plan, &one.quantity, joint.as_ref());
        doubted(found, rests_on.into_iter().find_map(|element| beyond[element].as_deref()))
    });
    let features: Vec<FeatureResult> = measured.collect();
    let constructed = joint.as_ref().map(constructed_results).unwrap_or_default();
    drop(joint);
    InspectionResult {
        plan: plan.name.clone(),
        verdict: overall(features.iter().map(|f| f.verdict)),
        alignment,
        alignment_failure,
        elements: plan
            .elements
            .iter()
            .zip(elements.into_iter().zip(beyond))
            .map(|(element, (measured, beyond))| element_result(element, measured, beyond))
            .collect(),
        constructed,
        features,
    }
}

/// Finds the part in a cloud: 3-2-1 on the plan's datums, or where the plan states that it lies.
///
/// # Errors
/// Names the datum element that was not found, or states why the pose is not that of the part.
pub fn locate(plan: &Plan, cloud: &[Point]) -> Result<AlignmentResult, MeasureError> {
    if u32::try_from(cloud.len()).is_err() {
        return Err(MeasureError::CloudSize { points: cloud.len() });
    }
    Ok(place(plan, cloud)?.result)
}

/// Points of a cloud that belong to a fitted element, with their signed distance from it, mm, positive out of the material:
/// each point once, in the order of the cloud. Nothing is fitted again.
///
/// The points are those of each element's region about its fit; [`evaluate`] took those about the last rough fit, which lies
/// within a hundredth of a margin of it.
pub fn deviations(
    plan: &Plan,
    alignment: &AlignmentResult,
    elements: &[ElementResult],
    cloud: &[Point],
) -> Vec<(u32, f32)> {
    let pairs = plan.elements.iter().zip(elements);
    let found: Vec<(Region, &FittedElement)> = pairs
        .filter_map(|(element, result)| Some((element, result.fit.as_ref()?)))
        .map(|(element, fit)| (about(&Region::new(element, element.margin_mm, 0.0), fit), fit))
        .collect();
    let part_from_world = alignment.pose().inverse();
    let distance = |(index, point): (usize, &Point)| {
        let position = part_from_world.point(&Vector3::from(point.position_mm));
        let normal = part_from_world.rotation * point.normal_vector();
        let holds =
            |region: &Region| region.holds_position(&position) && region.holds_normal(&position, &normal);
        let (region, fit) = found.iter().find(|(region, _)| holds(region))?;
        Some((index as u32, fit.distance_mm(&region.geometry, &position) as f32))
    };
    cloud.iter().enumerate().filter_map(distance).collect()
}

/// An element's fit, or why there is none.
type Outcome = Result<Measured, String>;

/// Finds the part, or takes it where it nominally lies.
fn place(plan: &Plan, cloud: &[Point]) -> Result<PlacedPart, MeasureError> {
    let Some(datums) = &plan.datums else {
        let world_from_part = Pose::new(&plan.world_from_part);
        return Ok(PlacedPart { result: describe(&world_from_part, 0.0, 0.0, 0.0, 0), world_from_part });
    };
    align(plan, datums, cloud)
}

/// Fits all elements of the plan, side by side.
fn fit_elements(plan: &Plan, cloud: &[Point], world_from_part: &Pose) -> Vec<Outcome> {
    let regions: Vec<Region> =
        plan.elements.iter().map(|e| Region::new(e, REACH_MARGINS * e.margin_mm, 0.0)).collect();
    let nearby = gather(cloud, &world_from_part.inverse(), &regions);
    let correlation = plan.settings.cluster_mm.map_or(Correlation::Estimated, Correlation::Cells);
    let measured = |index: usize| {
        let filters_mm = filters_mm(plan, index);
        let seen = (plan.rims_left_out_px, &plan.viewpoints[..]);
        measure(&plan.elements[index], &nearby[index], correlation, &filters_mm, seen)
            .map_err(|error| error.to_string())
    };
    (0..plan.elements.len()).into_par_iter().map(measured).collect()
}

/// Edges of the filters after which a plane's flatness is wanted, mm, each once.
fn filters_mm(plan: &Plan, index: usize) -> Vec<f64> {
    let mut edges_mm = Vec::new();
    for feature in &plan.features {
        match feature.quantity {
            Quantity::PlaneFlatness { plane, filter_mm: Some(edge_mm) }
                if plane == index && !edges_mm.contains(&edge_mm) =>
            {
                edges_mm.push(edge_mm);
            }
            _ => {}
        }
    }
    edges_mm
}

/// What is reported of an element. The residuals live on in its points.
fn element_result(element: &Element, outcome: Outcome, beyond: Option<String>) -> ElementResult {
    let criterion = (element.criterion != Criterion::LeastSquares).then_some(element.criterion);
    let name = element.name.clone();
    match outcome {
        Ok(mut measured) => {
            measured.fit.forget_residuals();
            let Measured { fit, points, .. } = measured;
            ElementResult { name, fit: Some(fit), reason: None, criterion, beyond, points }
        }
        Err(reason) => {
            let points = Vec::new();
            ElementResult { name, fit: None, reason: Some(reason), criterion, beyond, points }
        }
    }
}

/// What is reported of elements made of others.
fn constructed_results(joint: &Joint<'_>) -> Vec<ConstructedResult> {
    let parts = joint.measured();
    let result = |(one, part): (&super::references::Constructed, &Part)| {
        let name = one.name.clone();
        match part {
            Err(reason) => ConstructedResult { name, reason: Some(reason.clone()), ..Default::default() },
            Ok(found) => ConstructedResult {
                name,
                shape: Some(found.shape.words().into()),
                point_mm: Some(found.point.into()),
                direction: (found.direction != Vector3::zeros()).then(|| found.direction.into()),
                diameter_mm: (found.sizes[0] > 0.0).then_some(found.sizes[0]),
                reason: None,
            },
        }
    };
    joint.plan.constructed.iter().zip(&parts[joint.plan.elements.len()..]).map(result).collect()
}

/// Measures a feature and decides.
fn feature(plan: &Plan, feature: &Feature, elements: &[Outcome], joint: Option<&Joint<'_>>) -> FeatureResult {
    let measured = match (&feature.quantity, joint) {
        (Quantity::Characteristic { index, .. }, Some(joint)) => {
            characteristic(joint, &plan.characteristics[*index])
        }
        (quantity, _) => self::quantity(quantity, elements),
    };
    let mut result = FeatureResult {
        name: feature.name.clone(),
        value: None,
        unit: feature.quantity.unit(),
        u: None,
        lower: Some(feature.lower).filter(|limit| limit.is_finite()),
        upper: Some(feature.upper).filter(|limit| limit.is_finite()),
        verdict: None,
        nominal: feature.nominal,
        deviation: None,
        u_noise: None,
        u_system: feature.u_system,
        u_calibration: feature.u_calibration,
        form_sigma_mm: None,
        form_range_mm: None,
        filter: None,
        points: 0,
        rejected: 0,
        reason: None,
        detail: None,
    };
    let calibration = feature.u_calibration.unwrap_or(0.0);
    let stated2 = feature.u_system * feature.u_system + calibration * calibration;
    let with_uncertainty = measured.map(|found| {
        let u = (found.u_noise * found.u_noise + stated2).sqrt();
        (found, u)
    });
    match with_uncertainty {
        Ok((found, u)) if found.is_finite() && u.is_finite() => {
            // No range lies below zero, so a flatness has no lower limit to prove.
            let lower = (!feature.quantity.one_sided()).then_some(feature.lower);
            let upper = feature.upper + found.bonus_mm.unwrap_or(0.0);
            result.upper = Some(upper).filter(|limit| limit.is_finite());
            result.verdict = decide(found.value, u, plan.settings.guard_factor, lower, upper);
            result.detail = found.detail;
            result.value = Some(found.value);
            result.deviation = Some(found.value - feature.nominal);
            result.u = Some(u);
            result.u_noise = Some(found.u_noise);
            result.form_sigma_mm = found.form_sigma_mm;
            result.form_range_mm = found.form_range_mm;
            result.filter = found.filter;
            result.points = found.points;
            result.rejected = found.rejected;
        }
        Ok(_) => result.reason = Some("the value or its uncertainty is not finite".into()),
        Err(reason) => result.reason = Some(reason),
    }
    result.described()
}

/// A result whose element does not hold all of its face proves no conformity.
fn doubted(mut result: FeatureResult, beyond: Option<&str>) -> FeatureResult {
    if let Some(beyond) = beyond.filter(|_| result.value.is_some()) {
        result.verdict = result.verdict.map(|verdict| verdict.max(Verdict::Indeterminate));
        let detail = result.detail.iter().map(String::as_str);
        result.detail = Some([beyond].into_iter().chain(detail).collect::<Vec<_>>().join("; "));
    }
    result
}

fn sphere(elements: &[Outcome], index: usize) -> Result<&SphereFit, String> {
    match elements.get(index) {
        Some(Ok(Measured { fit: FittedElement::Sphere(sphere), .. })) => Ok(sphere),
        Some(Err(reason)) => Err(reason.clone()),
        _ => Err(format!("element {index} is no sphere")),
    }
}

/// A plane's flatness after a filter of this edge, mm.
fn filtered(elements: &[Outcome], index: usize, edge_mm: f64) -> Result<&Filtered, String> {
    let found = measured(elements, index).and_then(|m| m.filtered.iter().find(|(edge, _)| *edge == edge_mm));
    match found {
        Some((_, Ok(filtered))) => Ok(filtered),
        Some((_, Err(error))) => Err(error.to_string()),
        None => Err(format!("the flatness of element {index} was not filtered")),
    }
}

/// An element that was measured.
fn measured(elements: &[Outcome], index: usize) -> Option<&Measured> {
    elements.get(index)?.as_ref().ok()
}

/// What errors in common do to a range of an element's points, mm.
fn u_shared_mm(elements: &[Outcome], index: usize) -> f64 {
    measured(elements, index).map_or(0.0, Measured::u_range_shared_mm)
}

fn plane(elements: &[Outcome], index: usize) -> Result<&PlaneFit, String> {
    match elements.get(index) {
        Some(Ok(Measured { fit: FittedElement::Plane(plane), .. })) => Ok(plane),
        Some(Err(reason)) => Err(reason.clone()),
        _ => Err(format!("element {index} is no plane")),
    }
}

/// Computes a quantity from the fitted elements; definitions at [`Quantity`].
fn quantity(quantity: &Quantity, elements: &[Outcome]) -> Result<Reading, String> {
    Ok(match *quantity {
        Quantity::SphereDiameter(index) => {
            let fit = sphere(elements, index)?;
            Reading::new(fit.diameter_mm, fit.u_diameter_mm, &[&fit.form])
        }
        Quantity::CentreDistance([a, b]) => {
            let (a, b) = (sphere(elements, a)?, sphere(elements, b)?);
            Reading::derived(centre_distance_mm(a, b), &[&a.form, &b.form])
        }
        Quantity::PlaneFlatness { plane: index, filter_mm: None } => {
            flatness(plane(elements, index)?).with_shared(u_shared_mm(elements, index))
        }
        Quantity::PlaneFlatness { plane: index, filter_mm: Some(edge_mm) } => {
            filtered_flatness(plane(elements, index)?, filtered(elements, index, edge_mm)?)
                .with_shared(u_shared_mm(elements, index))
        }
        Quantity::PlaneDistance([a, b]) => {
            let (a, b) = (plane(elements, a)?, plane(elements, b)?);
            Reading::derived(plane_distance_mm(a, b), &[&a.form, &b.form])
        }
        Quantity::PlaneAngle { planes: [a, b], supplement } => {
            let (a, b) = (plane(elements, a)?, plane(elements, b)?);
            let Derived { value, u } = plane_angle_rad(a, b);
            let angle_deg = value.to_degrees();
            let value = if supplement { 180.0 - angle_deg } else { angle_deg };
            Reading::new(value, u.to_degrees(), &[&a.form, &b.form])
        }
        Quantity::HemisphereHeight { sphere: top, plane: base } => {
            let (top, base) = (sphere(elements, top)?, plane(elements, base)?);
            Reading::derived(sphere_height_mm(top, base), &[&top.form, &base.form])
        }
        Quantity::Characteristic { index, .. } => {
            return Err(format!("characteristic {index} is measured with all elements together"));
        }
    })
}

/// Measures a geometrical characteristic; definitions at [`Kind`].
fn characteristic(joint: &Joint<'_>, one: &Characteristic) -> Result<Reading, String> {
    let on_points = matches!(
        one.kind,
        Kind::Form(_) | Kind::Profile | Kind::Runout(_) | Kind::Orientation(Extracted::Points)
    ) && !on_axis(joint, one);
    let found = if on_points { extracted::measure(joint, one) } else { location::measure(joint, one) }?;
    let fits = joint.sources(one, true).into_iter().filter_map(|i| joint.base[i].measured);
    let forms: Vec<&Form> = fits.map(|measured| measured.fit.form()).collect();
    let mut reading = Reading::new(found.value, found.u, &forms);
    reading.bonus_mm = found.bonus_mm;
    reading.detail = Some(detail(joint, one, found.bonus_mm));
    Ok(reading)
}

/// Whether an orientation is that of an axis, which is derived and has no points of its own.
fn on_axis(joint: &Joint<'_>, one: &Characteristic) -> bool {
    let axis = |part: &Part| part.as_ref().is_ok_and(|p| p.shape.is_axis());
    matches!(one.kind, Kind::Orientation(_))
        && (axis(&joint.nominal[one.elements[0]]) || one.elements[0] >= joint.plan.elements.len())
}

/// Symbol, datums, criteria and filter of a characteristic in words.
fn detail(joint: &Joint<'_>, one: &Characteristic, bonus_mm: Option<f64>) -> String {
    let mut words = vec![one.symbol().to_owned()];
    if let Some(system) = one.datums {
        let letters = joint.plan.datum_systems[system].letters(&|i| joint.plan.element_name(i));
        words.push(format!("datums {letters}"));
    }
    let criteria = one.elements.iter().filter_map(|i| joint.plan.elements.get(*i)).map(|e| e.criterion);
    let symbols: Vec<String> = criteria.map(|c| format!("{} ({})", c.key(), c.symbol())).collect();
    if !symbols.is_empty() && !matches!(one.kind, Kind::Form(_)) {
        words.push(format!("element by {}", symbols.join(", ")));
    }
    if let Kind::Form(criterion) = one.kind {
        words.push(format!("reference element {} ({})", criterion.key(), criterion.form_symbol()));
    }
    if let Some(edge) = one.filter_mm {
        words.push(format!("means over cubes of {edge} mm"));
    }
    if let Some(bonus) = bonus_mm {
        words.push(format!("Ⓜ adds {bonus:.4} mm to the limit (ISO 2692)"));
    }
    words.join("; ")
}

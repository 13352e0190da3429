//! Characteristics of the extracted surface: form, orientation, profile and run-out of an element's points.
//!
//! A range of single points grows with their noise and their number. `filter_mm` takes the means over cubes of that edge
//! instead; cells with less than a quarter of the median number of points are left out. The uncertainty of a range is that
//! of its two extremes (see [`u_range_mm`], and [`u_of_slope`] where the element itself makes the ends), with that of the datum frame beside it.

use nalgebra::{Point3, Vector3};
use std::f64::consts::SQRT_2;

use super::characteristic::{Characteristic, Extracted, Kind};
use super::criterion::Criterion;
use super::fit_element::Measured;
use super::flatness::{OfUsed, u_range_mm, u_range_of_means_mm};
use super::joint::{Base, Joint, Part};
use super::location::{Value, in_datums};
use super::substitute::Shape;
use crate::fit::{
    FitError, circle_minimum_zone, cylinder_minimum_zone, plane_minimum_zone, sphere_minimum_zone,
    strip_minimum_zone_mm,
};

/// Fewest values from which a range is stated.
const FEWEST: usize = 10;

/// Fewest points of a section of a run-out.
const SECTION_LEAST: usize = 12;

/// Places to which the residuals are moved: the scatter is known to an eighth.
const SHIFTS: usize = 32;

/// Cubes along one axis that a key holds, either side of zero.
const MOST_CELLS: f64 = 1e15;

/// A place with its deviation, mm.
#[derive(Debug, Clone, Copy)]
struct Sample {
    place: Vector3<f64>,
    deviation: f64,
}

/// Measures what the points of an element say.
///
/// # Errors
/// Why it has no value.
pub fn measure(joint: &Joint<'_>, one: &Characteristic) -> Result<Value, String> {
    let base = points_of(joint, one)?;
    match &one.kind {
        Kind::Form(criterion) => form(joint, base, one, *criterion),
        Kind::Orientation(Extracted::Points) => framed(
            joint,
            one,
            &|frame, parts, base| {
                let along = frame.rotation * in_datums(one, joint, parts)?.0.direction;
                Ok(samples(joint, base, one, &|p| along.dot(&p.coords)))
            },
            &|values| Ok((extremes(values)?, false)),
        ),
        Kind::Profile => {
            let geometry = &joint.plan.elements[one.elements[0]].geometry;
            framed(
                joint,
                one,
                &|frame, _, base| {
                    let back = frame.inverse();
                    Ok(samples(joint, base, one, &|p| geometry.distance_mm(&back.point(&p.coords))))
                },
                &|values| {
                    let [low, high] = extremes(values)?;
                    // Twice the one extreme that decides.
                    let most = if high >= -low { [0.0, 2.0 * high] } else { [2.0 * low, 0.0] };
                    Ok((most, true))
                },
            )
        }
        Kind::Runout(section_mm) => runout(joint, one, *section_mm),
        _ => Err("is no characteristic of points".into()),
    }
}

/// The measured element whose points are meant.
fn points_of<'j, 'a>(joint: &'j Joint<'a>, one: &Characteristic) -> Result<&'j Base<'a>, String> {
    let index = one.elements[0];
    let base = joint.base.get(index).ok_or("a constructed element has no points")?;
    base.part.as_ref().map_err(Clone::clone)?;
    Ok(base)
}

/// Lowest and highest value.
fn extremes(values: &[f64]) -> Result<[f64; 2], String> {
    if values.len() < FEWEST {
        return Err(format!(
            "{} values, needs at least {FEWEST}: a smaller filter_mm, or more points on the element",
            values.len()
        ));
    }
    let ends = values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(*v), h.max(*v)]);
    Ok(ends)
}

/// Deviations of the points used, or of their means.
fn samples(
    joint: &Joint<'_>,
    base: &Base<'_>,
    one: &Characteristic,
    deviation: &dyn Fn(&Point3<f64>) -> f64,
) -> Vec<Sample> {
    let single = base.used().map(|(p, _)| Sample { place: p.coords, deviation: deviation(p) });
    let single: Vec<Sample> = single.collect();
    one.filter_mm.map_or(single.clone(), |edge| means(&single, edge, &nominal_of(joint, one)))
}

/// Deviations of the points used from their own element, or of their means, in the order of [`samples`].
fn residuals(joint: &Joint<'_>, base: &Base<'_>, one: &Characteristic) -> Vec<Sample> {
    let single: Vec<Sample> =
        base.used().map(|(p, deviation)| Sample { place: p.coords, deviation }).collect();
    one.filter_mm.map_or(single.clone(), |edge| means(&single, edge, &nominal_of(joint, one)))
}

/// The deviations alone, in the order of their samples.
fn deviations(samples: &[Sample]) -> Vec<f64> {
    samples.iter().map(|sample| sample.deviation).collect()
}

/// The nominal surface of a measured element, on which cubes divide its points.
fn nominal_of<'j>(joint: &'j Joint<'_>, one: &Characteristic) -> impl Fn(&Vector3<f64>) -> Vector3<f64> + 'j {
    let geometry = &joint.plan.elements[one.elements[0]].geometry;
    move |p| p - geometry.normal_at(p) * geometry.distance_mm(p)
}

/// Where a cube begins, as a part of its edge: faces of parts lie at whole numbers, and a cube's side within one would leave it to
/// rounding to which of two cubes a point belongs.
const CUBE_SHIFT: f64 = 0.381_966;

/// Means over cubes, in the order of their keys. A cube holds the points whose foot on the nominal surface it holds: noise must not
/// decide, or a side of the cubes along the surface would part its high points from its low ones.
fn means(samples: &[Sample], edge_mm: f64, foot: &dyn Fn(&Vector3<f64>) -> Vector3<f64>) -> Vec<Sample> {
    let key = |p: &Vector3<f64>| -> [i64; 3] {
        let p = foot(p);
        [p.x, p.y, p.z].map(|v| (v / edge_mm + CUBE_SHIFT).floor().clamp(-MOST_CELLS, MOST_CELLS) as i64)
    };
    let mut keyed: Vec<([i64; 3], usize)> =
        samples.iter().enumerate().map(|(i, s)| (key(&s.place), i)).collect();
    keyed.sort_unstable();
    let groups: Vec<&[([i64; 3], usize)]> = keyed.chunk_by(|a, b| a.0 == b.0).collect();
    let mut counts: Vec<usize> = groups.iter().map(|g| g.len()).collect();
    let least = fringe::math::statistics::median(&mut counts).unwrap_or(0).div_ceil(4).max(1);
    let full = groups.iter().filter(|group| group.len() >= least);
    full.map(|group| {
        let count = group.len() as f64;
        Sample {
            place: group.iter().map(|(_, i)| samples[*i].place).sum::<Vector3<f64>>() / count,
            deviation: group.iter().map(|(_, i)| samples[*i].deviation).sum::<f64>() / count,
        }
    })
    .collect()
}

/// The uncertainty of a range of these values from their tails.
fn u_of_range(values: &[f64], means: bool) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    // Tails are those about the middle of the range.
    let middle = values.iter().sum::<f64>() / values.len() as f64;
    let about: Vec<f64> = values.iter().map(|v| v - middle).collect();
    if means { u_range_of_means_mm(&about) } else { u_range_mm(&about, 0, 1.0) }
}

/// The uncertainty of a range whose ends lie where the element itself does: few points are there, whose extreme scatters more than that of all
/// points. Their residuals are moved along the points, so that others stand at the ends each time.
fn u_of_slope(values: &[f64], residuals: &[f64], reduce: Reduced<'_>) -> f64 {
    let count = values.len();
    let mean = values.iter().sum::<f64>() / count.max(1) as f64;
    // Along a datum they may be counted the other way.
    let side = values.iter().zip(residuals).map(|(v, r)| (v - mean) * r).sum::<f64>().signum();
    let range = |shift: usize| {
        let (behind, before) = residuals.split_at(shift);
        let others = before.iter().chain(behind);
        let own = values.iter().zip(residuals);
        let moved: Vec<f64> = own.zip(others).map(|((v, own), other)| v + side * (other - own)).collect();
        reduce(&moved).map(|([low, high], _)| high - low)
    };
    let shifts = SHIFTS.min(count.saturating_sub(1));
    let ranges: Vec<f64> = (1..=shifts).filter_map(|k| range(k * count / (shifts + 1)).ok()).collect();
    let mean = ranges.iter().sum::<f64>() / ranges.len().max(1) as f64;
    let squares: f64 = ranges.iter().map(|r| (r - mean) * (r - mean)).sum();
    (squares / ranges.len().saturating_sub(1).max(1) as f64).sqrt()
}

/// What the points used of an element span, where it is asked for.
fn of_used(base: &Base<'_>, asked: bool) -> Option<OfUsed> {
    let effect = base.measured.map_or(1.0, |measured| measured.fit.effect());
    base.residuals.filter(|_| asked).map(|residuals| OfUsed::new(residuals, effect))
}

/// What errors in common do to a range of an element's points, mm.
fn u_shared_mm(base: &Base<'_>) -> f64 {
    base.measured.map_or(0.0, Measured::u_range_shared_mm)
}

type Framed<'f> =
    &'f dyn Fn(&fringe::geometry::pose::Pose, &[Part], &Base<'_>) -> Result<Vec<Sample>, String>;
/// Both ends of what the deviations span, and whether it is twice one extreme.
type Reduced<'f> = &'f dyn Fn(&[f64]) -> Result<([f64; 2], bool), String>;

/// A value of the points in the datum frame: its extremes' uncertainty, and that of the frame with the points held.
fn framed(
    joint: &Joint<'_>,
    one: &Characteristic,
    list: Framed<'_>,
    reduce: Reduced<'_>,
) -> Result<Value, String> {
    let base = points_of(joint, one)?;
    let frame = |parts: &[Part]| match one.datums {
        Some(system) => joint.frame(system, parts).map(|f| f.pose),
        None => Ok(fringe::geometry::pose::Pose {
            rotation: nalgebra::Matrix3::identity(),
            translation: Vector3::zeros(),
        }),
    };
    let values =
        |parts: &[Part]| -> Result<Vec<f64>, String> { Ok(deviations(&list(&frame(parts)?, parts, base)?)) };
    let here = values(&joint.measured())?;
    let ([low, high], of_one) = reduce(&here)?;
    let (_, covariance) = joint.propagated(&joint.sources(one, false), &|parts| {
        let ([low, high], _) = reduce(&values(parts)?)?;
        Ok([high - low])
    })?;
    let u_level = match of_used(base, one.filter_mm.is_none()).filter(|u| u.rejected > 0) {
        // The ends are where points were left out.
        Some(u) if of_one => 2.0 * u.extreme_mm,
        Some(u) => u.range_mm,
        // That of one extreme is that of a range over the root of two.
        None => u_of_range(&here, one.filter_mm.is_some()) * if of_one { SQRT_2 } else { 1.0 },
    };
    let about = deviations(&residuals(joint, base, one));
    let u_points = u_level.max(u_of_slope(&here, &about, reduce));
    let u = (u_points * u_points + u_shared_mm(base).powi(2) + covariance[(0, 0)].max(0.0)).sqrt();
    Ok(Value { value: high - low, u, bonus_mm: None })
}

/// Range of the points about their own element.
fn form(
    joint: &Joint<'_>,
    base: &Base<'_>,
    one: &Characteristic,
    criterion: Criterion,
) -> Result<Value, String> {
    let list = residuals(joint, base, one);
    let values = deviations(&list);
    let [low, high] = extremes(&values)?;
    let of_points = of_used(base, one.filter_mm.is_none()).map(|u| u.range_mm);
    let u_points = of_points.unwrap_or_else(|| u_of_range(&values, true));
    let u = (u_points * u_points + u_shared_mm(base).powi(2)).sqrt();
    let value = match criterion {
        Criterion::MinimumZone => minimum_zone(base, &list)?,
        _ => high - low,
    };
    Ok(Value { value, u, bonus_mm: None })
}

/// Width of the minimum zone of places.
fn minimum_zone(base: &Base<'_>, list: &[Sample]) -> Result<f64, String> {
    let part = base.part.clone()?;
    let places: Vec<Point3<f64>> = list.iter().map(|s| Point3::from(s.place)).collect();
    let told = |error: FitError| error.to_string();
    match part.shape {
        Shape::Plane => plane_minimum_zone(&places).map(|z| z.minimum_zone_mm).map_err(told),
        Shape::Sphere => sphere_minimum_zone(&places).map(|z| z.minimum_zone_mm).map_err(told),
        Shape::Cylinder => cylinder_minimum_zone(&places).map(|z| z.minimum_zone_mm).map_err(told),
        Shape::Circle => circle_minimum_zone(&places).map(|z| z.minimum_zone_mm).map_err(told),
        Shape::Line => {
            let flat: Vec<[f64; 2]> =
                list.iter().map(|s| [part.direction.dot(&(s.place - part.point)), s.deviation]).collect();
            strip_minimum_zone_mm(&flat).map_err(told)
        }
        other => {
            Err(format!("a {} has no minimum zone here; take reference = \"least-squares\"", other.words()))
        }
    }
}

/// The datum axis: the first step of the system, one axis.
fn axis(
    joint: &Joint<'_>,
    one: &Characteristic,
    parts: &[Part],
) -> Result<(Vector3<f64>, Vector3<f64>), String> {
    let system = one.datums.ok_or("needs a datum axis")?;
    let first =
        joint.plan.datum_systems[system].steps.first().and_then(|s| s.first()).ok_or("needs a datum axis")?;
    let axis = parts[*first].clone()?;
    if !axis.shape.is_axis() {
        return Err(format!(
            "its datum is a {}; run-out needs an axis: cylinder, cone or line",
            axis.shape.words()
        ));
    }
    Ok((axis.point, axis.direction))
}

/// Largest range of a section with enough values, and which of so many sections it is.
fn worst_section(values: &[f64], sections: &[usize], count: usize) -> Option<(f64, usize)> {
    let mut ends = vec![(f64::INFINITY, f64::NEG_INFINITY, 0); count];
    for (value, section) in values.iter().zip(sections) {
        let (low, high, count) = ends[*section];
        ends[*section] = (value.min(low), value.max(high), count + 1);
    }
    let enough = ends.iter().enumerate().filter(|(_, (_, _, count))| *count >= SECTION_LEAST);
    let ranges = enough.map(|(section, (low, high, _))| (high - low, section));
    ranges.reduce(|most, next| if next.0 > most.0 { next } else { most })
}

/// Range of the distances from the datum axis (of a plane: along it), over all points or the worst section.
fn runout(joint: &Joint<'_>, one: &Characteristic, section_mm: Option<f64>) -> Result<Value, String> {
    let base = points_of(joint, one)?;
    let axial = base.part.clone()?.shape == Shape::Plane;
    let list = |parts: &[Part]| -> Result<(Vec<Sample>, Vec<i64>), String> {
        let (point, direction) = axis(joint, one, parts)?;
        let height = |p: &Vector3<f64>| direction.dot(&(p - point));
        let radius = |p: &Vector3<f64>| (p - point).cross(&direction).norm();
        let list = samples(joint, base, one, &|p| if axial { height(&p.coords) } else { radius(&p.coords) });
        let section = |s: &Sample| {
            section_mm.map_or(0, |edge| {
                let along = if axial { radius(&s.place) } else { height(&s.place) };
                (along / edge).floor().clamp(-MOST_CELLS, MOST_CELLS) as i64
            })
        };
        let keys = list.iter().map(section).collect();
        Ok((list, keys))
    };
    // Sections stay as they are while the axis is moved.
    let (here, keys) = list(&joint.measured())?;
    let mut known = keys.clone();
    known.sort_unstable();
    known.dedup();
    let sections: Vec<usize> = keys.iter().map(|key| known.binary_search(key).unwrap_or_default()).collect();
    let here = deviations(&here);
    let worst = |values: &[f64]| {
        worst_section(values, &sections, known.len()).ok_or_else(|| {
            format!(
                "no section with {SECTION_LEAST} values; a larger section_mm, a smaller filter_mm, or more points"
            )
        })
    };
    let (value, section) = worst(&here)?;
    let in_section = |values: &[f64]| -> Vec<f64> {
        values.iter().zip(&sections).filter(|(_, of)| **of == section).map(|(value, _)| *value).collect()
    };
    let (_, covariance) = joint.propagated(&joint.sources(one, false), &|parts| {
        let [low, high] = extremes(&in_section(&deviations(&list(parts)?.0)))?;
        Ok([high - low])
    })?;
    // An element beside the datum axis has a range of its own: only what its points scatter about the element itself is uncertain.
    let whole = section_mm.is_none() && one.filter_mm.is_none();
    let about = deviations(&residuals(joint, base, one));
    let u_level = match of_used(base, whole).filter(|u| u.rejected > 0) {
        Some(u) => u.range_mm,
        None => u_of_range(&in_section(&about), one.filter_mm.is_some()),
    };
    let u_points = u_level.max(u_of_slope(&here, &about, &|values| Ok(([0.0, worst(values)?.0], false))));
    let u = (u_points * u_points + u_shared_mm(base).powi(2) + covariance[(0, 0)].max(0.0)).sqrt();
    Ok(Value { value, u, bonus_mm: None })
}

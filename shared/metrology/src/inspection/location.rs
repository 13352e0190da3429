//! Sizes, distances, angles, orientation and location: values of the associated elements.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::characteristic::{Characteristic, Kind, MaximumMaterial};
use super::constructed::shortest;
use super::datum::carried;
use super::joint::{Joint, Part, pick};
use super::substitute::{Shape, Substitute};
use crate::fit::share_across;
use fringe::math;

/// Sine of the angle up to which axes count as parallel for their distance: 5°.
const ALMOST_PARALLEL: f64 = 0.087;

/// An open turn that moves a direction by less than this part of itself leaves it where it is.
const OPEN_TURN: f64 = 1e-3;

/// A value with its standard uncertainty, and what widens its upper limit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::struct_field_names, reason = "the value of a value with its uncertainty")]
pub struct Value {
    /// Value in the unit of the characteristic.
    pub value: f64,
    /// Standard uncertainty of the value, or of the value less the bonus.
    pub u: f64,
    /// What the maximum material requirement adds to the limit, mm.
    pub bonus_mm: Option<f64>,
}

/// Measures what only the associated elements say.
///
/// # Errors
/// Why it has no value.
pub fn measure(joint: &Joint<'_>, one: &Characteristic) -> Result<Value, String> {
    let sources = joint.sources(one, true);
    let plain = |value: f64, u: f64| Value { value, u, bonus_mm: None };
    match &one.kind {
        Kind::Size(_) | Kind::HalfAngle | Kind::Distance(_) => {
            let (value, covariance) =
                joint.propagated(&sources, &|parts| scalar(one, joint, parts).map(|v| [v]))?;
            Ok(plain(value[0], covariance[(0, 0)].max(0.0).sqrt()))
        }
        Kind::Angle => {
            let (value, covariance) = joint.propagated(&sources, &|parts| turn(one, parts))?;
            let sine = Vector3::new(value[0], value[1], value[2]);
            let angle = angle_rad(&pick(&joint.measured(), &one.elements)?, &value);
            // Near 0° and 180° the angle of both directions is the length of a vector, elsewhere as smooth as its sine and cosine.
            let u = length_u(&sine, &corner(&covariance));
            let direct = if sine.norm() > 0.0 {
                let along = sine / sine.norm();
                let gradient = nalgebra::SVector::<f64, 4>::from([
                    along.x * value[3],
                    along.y * value[3],
                    along.z * value[3],
                    -sine.norm(),
                ]);
                (covariance * gradient).dot(&gradient).max(0.0).sqrt()
            } else {
                u
            };
            let u = if sine.norm() < 0.1 { u } else { direct };
            Ok(plain(angle.to_degrees(), u.to_degrees()))
        }
        Kind::Orientation(_) => {
            let (value, covariance) = joint.propagated(&sources, &|parts| tilt(one, joint, parts))?;
            zone(one, joint, &value, &covariance)
        }
        Kind::Position(material) => position(joint, one, material.as_ref()),
        Kind::Form(_) | Kind::Profile | Kind::Runout(_) => Err("is measured on points".into()),
    }
}

/// The block of three outputs.
fn corner<const N: usize>(covariance: &SMatrix<f64, N, N>) -> Matrix3<f64> {
    Matrix3::from_fn(|r, c| covariance[(r, c)])
}

/// Standard uncertainty of the length of a vector: that along it, and near zero that across it, too ([`share_across`]).
pub fn length_u(vector: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    let square = vector.norm_squared();
    let along = if square > 0.0 { (covariance * vector).dot(vector) / square } else { 0.0 };
    let across = (covariance.trace() - along).max(0.0);
    (along + share_across(square, across) * across).max(0.0).sqrt()
}

/// A nominal and a measured element in the datum frame. An orientation's nominal direction follows the measured one along
/// the turns that the datums leave open: perpendicular to one plane leaves the turn about its normal to the element.
pub(super) fn in_datums(
    one: &Characteristic,
    joint: &Joint<'_>,
    parts: &[Part],
) -> Result<(Substitute, Substitute), String> {
    let index = one.elements[0];
    let (mut nominal, measured) = (joint.nominal[index].clone()?, parts[index].clone()?);
    let Some(system) = one.datums else { return Ok((nominal, measured)) };
    let frame = joint.frame(system, parts)?;
    let back = frame.pose.inverse();
    let measured = carried(&measured, &back);
    if matches!(one.kind, Kind::Orientation(_)) {
        let mut free: Vec<Vector3<f64>> = Vec::new();
        for motion in &frame.open {
            let turn = back.rotation * Vector3::new(motion[3], motion[4], motion[5]);
            let mut along = turn.cross(&nominal.direction);
            for f in &free {
                along -= f * f.dot(&along);
            }
            if along.norm() > OPEN_TURN {
                free.push(along / along.norm());
            }
        }
        let followed = free.iter().fold(nominal.direction, |d, f| d + f * f.dot(&measured.direction));
        nominal.direction = followed / followed.norm();
        let across = nominal.across - nominal.direction * nominal.direction.dot(&nominal.across);
        nominal.across = if across.norm() > 1e-9 { across / across.norm() } else { across };
    }
    Ok((nominal, measured))
}

fn scalar(one: &Characteristic, joint: &Joint<'_>, parts: &[Part]) -> Result<f64, String> {
    value_of(one, &pick(parts, &one.elements)?, &|v| match one.datums {
        Some(system) => Ok(joint.frame(system, parts)?.pose.rotation * v),
        None => Ok(*v),
    })
}

/// A direction of a datum system in the directions of the cloud, or why there is none.
pub type Turned<'a> = dyn Fn(&Vector3<f64>) -> Result<Vector3<f64>, String> + 'a;

/// Size, half angle or distance of elements; also of the nominal ones, which gives the nominal value.
pub fn value_of(
    one: &Characteristic,
    elements: &[Substitute],
    direction: &Turned<'_>,
) -> Result<f64, String> {
    match (&one.kind, elements) {
        (Kind::Size(index), [a, ..]) => Ok(a.sizes[*index]),
        (Kind::HalfAngle, [a, ..]) => Ok(a.sizes[1].to_degrees()),
        (Kind::Distance(Some(along)), [a, b]) => Ok((b.point - a.point).dot(&direction(along)?)),
        (Kind::Distance(None), [a, b]) => Ok(distance(a, b)),
        _ => Err("names the wrong number of elements".into()),
    }
}

/// Distance of two elements, mm: to a plane along its normal (the first one's where both are planes), to an axis across
/// it, between axes along their shortest connection; of parallel axes and of planes at the second one's point.
fn distance(a: &Substitute, b: &Substitute) -> f64 {
    let to_plane =
        |plane: &Substitute, point: Vector3<f64>| plane.direction.dot(&(point - plane.point)).abs();
    let to_axis = |axis: &Substitute, point: Vector3<f64>| (point - axis.point).cross(&axis.direction).norm();
    match (a.shape, b.shape) {
        (Shape::Plane, _) => to_plane(a, b.point),
        (_, Shape::Plane) => to_plane(b, a.point),
        _ if a.shape.is_axis() && b.shape.is_axis() => match shortest(a, b) {
            // Axes that are meant to be parallel never are: their shortest connection would lie anywhere.
            Some([on_a, on_b]) if a.direction.cross(&b.direction).norm() > ALMOST_PARALLEL => {
                (on_b - on_a).norm()
            }
            _ => to_axis(a, b.point),
        },
        _ if a.shape.is_axis() => to_axis(a, b.point),
        _ if b.shape.is_axis() => to_axis(b, a.point),
        _ => (b.point - a.point).norm(),
    }
}

/// Sine vector and cosine of the angle between the directions of two elements.
fn turn(one: &Characteristic, parts: &[Part]) -> Result<[f64; 4], String> {
    let elements = pick(parts, &one.elements)?;
    let [a, b] = &elements[..] else { return Err("an angle is that of two elements".into()) };
    angle_parts(a, b)
}

fn angle_parts(a: &Substitute, b: &Substitute) -> Result<[f64; 4], String> {
    if [a, b].iter().any(|s| s.direction == Vector3::zeros()) {
        return Err(
            "a point or sphere has no direction; name a plane, line, cylinder, cone, torus or circle".into(),
        );
    }
    let (cross, dot) = (a.direction.cross(&b.direction), a.direction.dot(&b.direction));
    Ok([cross.x, cross.y, cross.z, dot])
}

/// The angle of two elements from the sine vector and the cosine of their directions, rad: that of axis and plane is the complement of that with the normal.
fn angle_rad(elements: &[Substitute], [x, y, z, cosine]: &[f64; 4]) -> f64 {
    let angle = math::atan2(Vector3::new(*x, *y, *z).norm(), *cosine);
    let planes = elements.iter().filter(|element| element.shape == Shape::Plane).count();
    if planes == 1 { (std::f64::consts::FRAC_PI_2 - angle).abs() } else { angle }
}

/// The nominal angle of two elements, deg.
pub fn nominal_angle_deg(elements: &[Substitute]) -> Result<f64, String> {
    let [a, b] = elements else { return Err("an angle is that of two elements".into()) };
    Ok(angle_rad(elements, &angle_parts(a, b)?).to_degrees())
}

/// How far the extent of an element leaves the nominal direction, mm: of an axis a vector, of a plane along both edges.
fn tilt(one: &Characteristic, joint: &Joint<'_>, parts: &[Part]) -> Result<[f64; 3], String> {
    let (nominal, measured) = in_datums(one, joint, parts)?;
    if measured.shape == Shape::Plane {
        let second = nominal.direction.cross(&nominal.across);
        let [a, b] = [nominal.across, second].map(|edge| measured.direction.dot(&edge) * 2.0);
        return Ok([a * nominal.half_mm[0], b * nominal.half_mm[1], 0.0]);
    }
    if !measured.shape.is_axis() {
        return Err(format!("a {} has no orientation; name a plane or an axis", measured.shape.words()));
    }
    let d = measured.direction;
    let off = (d / d.dot(&nominal.direction) - nominal.direction) * (2.0 * nominal.half_mm[0]);
    Ok(zoned(one, off).into())
}

/// The part of a deviation that a zone sees.
fn zoned(one: &Characteristic, off: Vector3<f64>) -> Vector3<f64> {
    one.zone_direction.map_or(off, |along| along * along.dot(&off))
}

/// Width of the zone of an orientation.
fn zone(
    one: &Characteristic,
    joint: &Joint<'_>,
    value: &[f64; 3],
    covariance: &Matrix3<f64>,
) -> Result<Value, String> {
    let plane = joint.nominal[one.elements[0]].clone()?.shape == Shape::Plane;
    if plane {
        // The corners of the rectangle: both tilts add up.
        let (c00, c11, c01) = (covariance[(0, 0)], covariance[(1, 1)], covariance[(0, 1)]);
        let signed = c00 + c11 + 2.0 * c01 * value[0].signum() * value[1].signum();
        let small = |v: f64, c: f64| v * v <= 4.0 * c;
        let variance =
            if small(value[0], c00) || small(value[1], c11) { c00 + c11 + 2.0 * c01.abs() } else { signed };
        return Ok(Value {
            value: value[0].abs() + value[1].abs(),
            u: variance.max(0.0).sqrt(),
            bonus_mm: None,
        });
    }
    let vector = Vector3::from(*value);
    Ok(Value { value: vector.norm(), u: length_u(&vector, covariance), bonus_mm: None })
}

/// Deviations of an element from its nominal place, at one end and the other, mm.
fn offsets(one: &Characteristic, nominal: &Substitute, measured: &Substitute) -> Vec<Vector3<f64>> {
    let normal = nominal.direction;
    let between = measured.point - nominal.point;
    let offs = match nominal.shape {
        Shape::Plane => {
            let second = normal.cross(&nominal.across);
            let [a, b] = [nominal.across * nominal.half_mm[0], second * nominal.half_mm[1]];
            let at = |arm: Vector3<f64>| {
                let along = measured.direction.dot(&(measured.point - nominal.point - arm))
                    / measured.direction.dot(&normal);
                normal * along
            };
            vec![at(a + b), at(a - b), at(-a + b), at(-a - b)]
        }
        Shape::Line | Shape::Cylinder | Shape::Cone => {
            let at = |height: f64| {
                let place = nominal.point + normal * height;
                let way = normal.dot(&(place - measured.point)) / normal.dot(&measured.direction);
                measured.point + measured.direction * way - place
            };
            vec![at(nominal.half_mm[0]), at(-nominal.half_mm[0])]
        }
        Shape::Circle | Shape::Oblong => vec![between - normal * normal.dot(&between)],
        Shape::SurfacePoint => vec![normal * normal.dot(&between)],
        _ => vec![between],
    };
    offs.into_iter().map(|off| zoned(one, off)).collect()
}

/// The largest deviation of an element from its nominal place, mm; for tests of the plan.
pub fn largest_offset_mm(one: &Characteristic, nominal: &Substitute, measured: &Substitute) -> f64 {
    offsets(one, nominal, measured).iter().map(Vector3::norm).fold(0.0, f64::max)
}

fn position(
    joint: &Joint<'_>,
    one: &Characteristic,
    material: Option<&MaximumMaterial>,
) -> Result<Value, String> {
    let sources = joint.sources(one, true);
    let (nominal, measured) = in_datums(one, joint, &joint.measured())?;
    // The end that decides stays the same while the elements are moved.
    let here = offsets(one, &nominal, &measured);
    let worst = (0..here.len()).fold(0, |w, i| if here[i].norm() > here[w].norm() { i } else { w });
    let size = |s: &Substitute| material.map_or(0.0, |m| s.sizes[m.index]);
    let (value, covariance) = joint.propagated(&sources, &|parts| {
        let (nominal, measured) = in_datums(one, joint, parts)?;
        let [x, y, z]: [f64; 3] = offsets(one, &nominal, &measured)[worst].into();
        Ok([x, y, z, size(&measured)])
    })?;
    let off = Vector3::new(value[0], value[1], value[2]);
    let u = 2.0 * length_u(&off, &corner(&covariance));
    let Some(material) = material else { return Ok(Value { value: 2.0 * off.norm(), u, bonus_mm: None }) };
    let (bonus_mm, slope) = material.bonus_mm(value[3]);
    // The decision is about the deviation less the bonus: what both share counts once.
    let shared = if off.norm() > 0.0 {
        let along = off / off.norm();
        let with_size = Vector3::new(covariance[(0, 3)], covariance[(1, 3)], covariance[(2, 3)]);
        4.0 * slope * along.dot(&with_size)
    } else {
        0.0
    };
    let variance = u * u + slope * slope * covariance[(3, 3)] - shared;
    Ok(Value { value: 2.0 * off.norm(), u: variance.max(0.0).sqrt(), bonus_mm: Some(bonus_mm) })
}

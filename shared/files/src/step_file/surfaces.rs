//! Surfaces under faces: elements of plans where they are such, else surfaces of two parameters.

use super::curves::{
    DEEPEST, Form, MOST_POLES, OTHER_EXPORT, deeper, length, points, profile, rows, stated_knots, straight,
};
use super::graph::{Graph, number};
use super::part21::Value;
use super::units::Units;
use crate::error::FileError;
use metrology::cad::{CadShape, Freeform, Knots, Profile, SplineSurface, Surface};
use nalgebra::{Point3, Vector3};

/// Directions count as parallel or perpendicular, and places as one, to within this share.
const SAME: f64 = 1e-9;

/// Types of surfaces, with the form of their knots.
const SPLINES: [(&str, Form); 4] = [
    ("B_SPLINE_SURFACE_WITH_KNOTS", Form::Stated),
    ("QUASI_UNIFORM_SURFACE", Form::QuasiUniform),
    ("UNIFORM_SURFACE", Form::Uniform),
    ("BEZIER_SURFACE", Form::Bezier),
];

/// A surface, and whether its own normal is opposite to that of the file.
pub(super) type Found = (Surface, bool);

/// The surface of an entity, in mm. Corners of its face show on which side of a tip a cone lies.
pub(super) fn surface(
    graph: &Graph,
    units: Units,
    id: u64,
    corners: &[Point3<f64>],
) -> Result<Found, FileError> {
    Reader { graph, units, corners }.surface(id, DEEPEST)
}

struct Reader<'a> {
    graph: &'a Graph,
    units: Units,
    corners: &'a [Point3<f64>],
}

impl Reader<'_> {
    fn surface(&self, id: u64, depth: usize) -> Result<Found, FileError> {
        let graph = self.graph;
        let depth = deeper(graph, id, depth)?;
        if let Some(params) = graph.record(id, "RECTANGULAR_TRIMMED_SURFACE") {
            let (inner, turned) = self.surface(graph.reference(id, params, 1)?, depth)?;
            let against = graph.truth(id, params, 6)? != graph.truth(id, params, 7)?;
            return Ok((inner, turned != against));
        }
        if let Some(params) = graph.record(id, "CURVE_BOUNDED_SURFACE") {
            return self.surface(graph.reference(id, params, 1)?, depth);
        }
        if let Some(params) = graph.record(id, "OFFSET_SURFACE") {
            return self.offset(id, params, depth);
        }
        if let Some(params) = graph.record(id, "SURFACE_OF_LINEAR_EXTRUSION") {
            return self.extruded(id, params);
        }
        if let Some(params) = graph.record(id, "SURFACE_OF_REVOLUTION") {
            return self.revolved(id, params);
        }
        if let Some(shape) = self.element(id)? {
            return Ok((shape, false));
        }
        self.spline(id).map(|free| (Surface::Free(Box::new(free)), false))
    }

    fn length(&self, id: u64, params: &[Value], at: usize) -> Result<f64, FileError> {
        length(self.graph, self.units, id, params, at)
    }

    /// Planes, cylinders, cones, spheres and tori.
    fn element(&self, id: u64) -> Result<Option<Surface>, FileError> {
        let graph = self.graph;
        let named = |name: &'static str| graph.record(id, name).map(|params| (name, params));
        let kinds = [
            "PLANE",
            "CYLINDRICAL_SURFACE",
            "CONICAL_SURFACE",
            "SPHERICAL_SURFACE",
            "DEGENERATE_TOROIDAL_SURFACE",
            "TOROIDAL_SURFACE",
        ];
        let Some((kind, params)) = kinds.into_iter().find_map(named) else { return Ok(None) };
        let frame = graph.frame(graph.reference(id, params, 1)?, self.units.length_mm)?;
        let (at, axis) = (frame.origin, frame.axes.column(2).into_owned());
        Ok(Some(match kind {
            "PLANE" => CadShape::Plane { point_mm: at, normal: axis }.into(),
            "CYLINDRICAL_SURFACE" => {
                CadShape::Cylinder { point_mm: at, axis, radius_mm: self.length(id, params, 2)? }.into()
            }
            "CONICAL_SURFACE" => {
                let half_angle_rad = graph.number(id, params, 3)? * self.units.angle_rad;
                if !(1e-4..1.5705).contains(&half_angle_rad) {
                    let what =
                        format!("its half angle is {half_angle_rad} rad, must be within 0.0001 … 1.5705");
                    return Err(graph.fault(id, &what));
                }
                let radius_mm = graph.number(id, params, 2)? * self.units.length_mm;
                CadShape::Cone { point_mm: at, axis, radius_mm, half_angle_rad }.into()
            }
            "SPHERICAL_SURFACE" => {
                CadShape::Sphere { center_mm: at, radius_mm: self.length(id, params, 2)? }.into()
            }
            _ => {
                let [ring, tube] = [self.length(id, params, 2)?, self.length(id, params, 3)?];
                torus(&at, &frame.axes.column(0).into_owned(), &axis, ring, tube)
            }
        }))
    }

    fn offset(&self, id: u64, params: &[Value], depth: usize) -> Result<Found, FileError> {
        let graph = self.graph;
        let basis = graph.reference(id, params, 1)?;
        let stated = graph.number(id, params, 2)? * self.units.length_mm;
        let (surface, turned) = self.surface(basis, depth)?;
        let distance_mm = if turned { -stated } else { stated };
        let moved = match surface {
            Surface::Free(free) => {
                Some(Surface::Free(Box::new(Freeform::Offset { basis: free, distance_mm })))
            }
            Surface::Element(shape) => offset_element(shape, distance_mm).map(Surface::Element),
        };
        let nothing = || graph.fault(id, &format!("moved by {distance_mm} mm nothing is left of #{basis}"));
        Ok((moved.ok_or_else(nothing)?, turned))
    }

    /// The point and unit direction of a LINE, which may run the other way.
    fn line(&self, (id, turned): (u64, bool)) -> Result<(Point3<f64>, Vector3<f64>), FileError> {
        let params = self.graph.params(id, "LINE")?;
        let at = self.graph.point(self.graph.reference(id, params, 1)?)? * self.units.length_mm;
        let along = self.vector(self.graph.reference(id, params, 2)?)?;
        Ok((at, if turned { -along } else { along }))
    }

    /// The unit direction of a VECTOR.
    fn vector(&self, id: u64) -> Result<Vector3<f64>, FileError> {
        let params = self.graph.params(id, "VECTOR")?;
        self.graph.direction(self.graph.reference(id, params, 1)?)
    }

    fn extruded(&self, id: u64, params: &[Value]) -> Result<Found, FileError> {
        let graph = self.graph;
        let swept = graph.reference(id, params, 1)?;
        let direction = self.vector(graph.reference(id, params, 2)?)?;
        if let Some(line) = straight(graph, swept, DEEPEST)? {
            let (at, along) = self.line(line)?;
            let normal = along.cross(&direction);
            let Some(normal) = normal.try_normalize(SAME) else {
                return Err(graph.fault(id, "moves a line along itself"));
            };
            return Ok((CadShape::Plane { point_mm: at, normal }.into(), false));
        }
        let profile = profile(graph, self.units, swept, DEEPEST)?;
        if let Profile::Ellipse(frame, [a, b]) = &profile {
            let axis = frame.axes.column(2).into_owned();
            if (a - b).abs() <= SAME * a && axis.cross(&direction).norm() <= SAME {
                let shape = CadShape::Cylinder { point_mm: frame.origin, axis: direction, radius_mm: *a };
                // The angle runs about the axis: with the way it is seen from outside.
                return Ok((shape.into(), axis.dot(&direction) < 0.0));
            }
        }
        Ok((Surface::Free(Box::new(Freeform::Extruded { direction, profile })), false))
    }

    fn revolved(&self, id: u64, params: &[Value]) -> Result<Found, FileError> {
        let graph = self.graph;
        let swept = graph.reference(id, params, 1)?;
        let placement = graph.reference(id, params, 2)?;
        let own = graph.params(placement, "AXIS1_PLACEMENT")?;
        let point_mm = graph.point(graph.reference(placement, own, 1)?)? * self.units.length_mm;
        let axis = match own.get(2) {
            Some(Value::Ref(direction)) => graph.direction(*direction)?,
            _ => Vector3::z(),
        };
        if let Some(line) = straight(graph, swept, DEEPEST)? {
            let (at, along) = self.line(line)?;
            let found = turned_line(&point_mm, &axis, &at, &along, self.corners);
            return found.ok_or_else(|| {
                graph.unread(id, "a straight line is turned about an axis beside it: export as STL")
            });
        }
        let profile = profile(graph, self.units, swept, DEEPEST)?;
        if let Some(shape) = turned_circle(&point_mm, &axis, &profile) {
            let free = Freeform::Revolved { point_mm, axis, profile };
            // Seen at a place away from the axis.
            let (place, [first, second]) = free.with_tangents([0.3, 1.1]);
            let turned = first.cross(&second).dot(&shape.normal_at(&place)) < 0.0;
            return Ok((shape.into(), turned));
        }
        Ok((Surface::Free(Box::new(Freeform::Revolved { point_mm, axis, profile })), false))
    }

    /// A B-spline, in one record or in several of one entity.
    fn spline(&self, id: u64) -> Result<Freeform, FileError> {
        let graph = self.graph;
        let Some((own, form)) = Form::of(graph, id, &SPLINES) else {
            return Err(graph.unread(id, OTHER_EXPORT));
        };
        // As a part of several records it has no name and no control points of its own.
        let (base, from, knots) = match graph.record(id, "B_SPLINE_SURFACE") {
            Some(base) => (base, 0, 0),
            None => (own, 1, 8),
        };
        let (ids, counts) = rows(graph, id, base.get(from + 2))?;
        if ids.len() > MOST_POLES {
            return Err(graph.fault(id, &format!("has {} control points, at most {MOST_POLES}", ids.len())));
        }
        let poles = points(graph, self.units, id, &ids)?;
        let direction = |i: usize| -> Result<Knots, FileError> {
            let degree = graph.number(id, base, from + i)?;
            match form {
                Form::Stated => {
                    stated_knots(graph, id, degree, [own, own], [knots + i, knots + 2 + i], counts[i])
                }
                form => form.knots(graph, id, degree, counts[i]),
            }
        };
        let weights = match graph.record(id, "RATIONAL_B_SPLINE_SURFACE") {
            Some(params) => weights(graph, id, params.first())?,
            None => vec![1.0; poles.len()],
        };
        let surface = SplineSurface { knots: [direction(0)?, direction(1)?], poles, weights };
        match surface.fault(counts) {
            None => Ok(Freeform::Spline(surface)),
            Some(fault) => Err(graph.fault(id, &fault)),
        }
    }
}

/// The numbers of a list of lists, row after row.
fn weights(graph: &Graph, id: u64, value: Option<&Value>) -> Result<Vec<f64>, FileError> {
    let Some(Value::List(rows)) = value else { return Err(graph.fault(id, "has no weights")) };
    let mut all = Vec::new();
    for row in rows {
        let Value::List(row) = row else {
            return Err(graph.fault(id, "has a row of weights that is no list"));
        };
        let numbers: Option<Vec<f64>> = row.iter().map(number).collect();
        all.extend(numbers.ok_or_else(|| graph.fault(id, "has a weight that is no number"))?);
    }
    Ok(all)
}

/// A torus, or the surface of a circle that meets the axis about which it is turned.
fn torus(at: &Point3<f64>, x: &Vector3<f64>, axis: &Vector3<f64>, ring: f64, tube: f64) -> Surface {
    if tube < ring {
        return CadShape::Torus { center_mm: *at, axis: *axis, ring_radius_mm: ring, tube_radius_mm: tube }
            .into();
    }
    let axes = nalgebra::Matrix3::from_columns(&[*x, *axis, x.cross(axis)]);
    let frame = metrology::cad::Frame { origin: at + x * ring, axes };
    let profile = Profile::Ellipse(frame, [tube; 2]);
    Surface::Free(Box::new(Freeform::Revolved { point_mm: *at, axis: *axis, profile }))
}

/// An element moved along its own normal.
fn offset_element(shape: CadShape, by: f64) -> Option<CadShape> {
    Some(match shape {
        CadShape::Plane { point_mm, normal } => CadShape::Plane { point_mm: point_mm + normal * by, normal },
        CadShape::Cylinder { point_mm, axis, radius_mm } => {
            CadShape::Cylinder { point_mm, axis, radius_mm: above_zero(radius_mm + by)? }
        }
        CadShape::Cone { point_mm, axis, radius_mm, half_angle_rad } => {
            let radius_mm = radius_mm + by / fringe::math::cos(half_angle_rad);
            CadShape::Cone { point_mm, axis, radius_mm, half_angle_rad }
        }
        CadShape::Sphere { center_mm, radius_mm } => {
            CadShape::Sphere { center_mm, radius_mm: above_zero(radius_mm + by)? }
        }
        CadShape::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => {
            let tube_radius_mm = above_zero(tube_radius_mm + by).filter(|tube| *tube < ring_radius_mm)?;
            CadShape::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm }
        }
    })
}

fn above_zero(length: f64) -> Option<f64> {
    (length > 0.0).then_some(length)
}

/// The surface of a straight line that is turned about an axis: plane, cylinder or cone; `None` where the line passes beside the axis.
fn turned_line(
    on_axis: &Point3<f64>,
    axis: &Vector3<f64>,
    at: &Point3<f64>,
    along: &Vector3<f64>,
    corners: &[Point3<f64>],
) -> Option<Found> {
    let arm = at - on_axis;
    let out = arm - axis * arm.dot(axis);
    let rise = along.dot(axis);
    // The tangent about the axis crossed with the line.
    let normal = |place: &Vector3<f64>| axis.cross(place).cross(along);
    if rise.abs() <= SAME {
        // A line through the axis says nothing at the axis itself.
        let outside = out + along * (1.0 + out.norm());
        let turned = normal(&outside).dot(axis) < 0.0;
        return Some((CadShape::Plane { point_mm: at.to_owned(), normal: *axis }.into(), turned));
    }
    if axis.cross(along).norm() <= SAME {
        let shape =
            CadShape::Cylinder { point_mm: *on_axis, axis: *axis, radius_mm: above_zero(out.norm())? };
        return Some((shape.into(), rise < 0.0));
    }
    let beside = arm.dot(&axis.cross(along)) / axis.cross(along).norm();
    if beside.abs() > 1e-6 {
        return None;
    }
    // The tip is where the line meets the axis; the corners tell on which side of it the face lies.
    let across = along - axis * rise;
    let way = -out.dot(&across) / across.norm_squared();
    let tip = at + along * way;
    let mean: f64 = corners.iter().map(|p| (p - tip).dot(axis)).sum();
    let axis_out = if mean < 0.0 { -*axis } else { *axis };
    let half_angle_rad = fringe::math::atan2(across.norm(), rise.abs());
    let height = arm.norm().max(1.0);
    let radius_mm = height * fringe::math::tan(half_angle_rad);
    let shape =
        CadShape::Cone { point_mm: tip + axis_out * height, axis: axis_out, radius_mm, half_angle_rad };
    // A place of the line on that side.
    let side = if (rise > 0.0) == (mean >= 0.0) { 1.0 } else { -1.0 };
    let place = tip + along * (side * height);
    let turned = normal(&(place - on_axis)).dot(&shape.normal_at(&place)) < 0.0;
    Some((shape.into(), turned))
}

/// The sphere or torus of a circle in a plane through the axis.
fn turned_circle(on_axis: &Point3<f64>, axis: &Vector3<f64>, profile: &Profile) -> Option<CadShape> {
    let Profile::Ellipse(frame, [radius, other]) = profile else { return None };
    let normal = frame.axes.column(2).into_owned();
    let arm = frame.origin - on_axis;
    let out = arm - axis * arm.dot(axis);
    let reach = radius.max(arm.norm());
    let is_flat = normal.dot(axis).abs() <= SAME && out.dot(&normal).abs() <= SAME * reach;
    if (radius - other).abs() > SAME * radius || !is_flat {
        return None;
    }
    let center_mm = on_axis + axis * arm.dot(axis);
    if out.norm() <= SAME * reach {
        return Some(CadShape::Sphere { center_mm, radius_mm: *radius });
    }
    let ring_radius_mm = out.norm();
    (*radius < ring_radius_mm).then_some(CadShape::Torus {
        center_mm,
        axis: *axis,
        ring_radius_mm,
        tube_radius_mm: *radius,
    })
}

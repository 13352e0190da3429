//! Elements made of others: intersection, projection, plane of symmetry, element through elements.

use nalgebra::{Matrix3, Point3, Vector3};

use super::references::Construction;
use super::substitute::{Shape, Substitute};
use crate::fit::{self, FitSettings};
use fringe::math;

/// Sine of the angle below which directions count as parallel: what lies nowhere near the elements is none.
const PARALLEL: f64 = 1e-3;

/// Cosine of the tilt up to which a section across an axis counts as a circle.
const ACROSS: f64 = 0.995;

/// Makes an element of others.
///
/// # Errors
/// States what is degenerate and what would help.
pub fn construct(construction: Construction, parts: &[Substitute]) -> Result<Substitute, String> {
    match construction {
        Construction::Intersection => match parts {
            [a, b] => intersection(a, b),
            [a, b, c] => three_planes([a, b, c]),
            _ => Err("an intersection is that of two or three elements".into()),
        },
        Construction::Projection => match parts {
            [a, b] => projection(a, b),
            _ => Err("a projection is that of the first element onto the second; name two".into()),
        },
        Construction::SymmetryPlane => match parts {
            [one] => of_oblong(one),
            [a, b] => symmetry(a, b),
            _ => Err("a plane of symmetry is that of two elements, or of one slot or rectangle".into()),
        },
        Construction::MiddlePoint => match parts {
            [a, b] => Ok(Substitute::point((a.point + b.point) * 0.5)),
            _ => Err("a middle point is that of two elements; name two".into()),
        },
        Construction::FitLine => line_through(parts),
        Construction::FitPlane => plane_through(parts),
        Construction::FitCircle => circle_through(parts),
    }
}

fn degrees(angle_rad: f64) -> f64 {
    angle_rad.to_degrees()
}

fn cannot(what: &str, a: &Substitute, b: &Substitute) -> String {
    format!("{} and {} have no {what}", a.shape.words(), b.shape.words())
}

fn intersection(a: &Substitute, b: &Substitute) -> Result<Substitute, String> {
    match (a.shape, b.shape) {
        (Shape::Plane, Shape::Plane) => two_planes(a, b),
        (Shape::Plane, Shape::Cylinder | Shape::Cone) => section(a, b),
        (Shape::Cylinder | Shape::Cone, Shape::Plane) => section(b, a),
        (Shape::Plane, Shape::Line) => piercing(a, b).map(Substitute::point),
        (Shape::Line, Shape::Plane) => piercing(b, a).map(Substitute::point),
        (Shape::Plane, Shape::Sphere) => cap(a, b),
        (Shape::Sphere, Shape::Plane) => cap(b, a),
        _ if a.shape.is_axis() && b.shape.is_axis() => two_axes(a, b),
        _ => Err(cannot("intersection that is defined", a, b)),
    }
}

fn two_planes(a: &Substitute, b: &Substitute) -> Result<Substitute, String> {
    let along = a.direction.cross(&b.direction);
    let sine = along.norm();
    if sine < PARALLEL {
        return Err(format!(
            "the planes are parallel within {:.3}°, limit {:.3}°: their intersection lies nowhere; choose planes at an angle",
            degrees(math::asin(sine)),
            degrees(math::asin(PARALLEL))
        ));
    }
    let direction = along / sine;
    let middle = (a.point + b.point) * 0.5;
    let point = meet([(a.direction, a.point), (b.direction, b.point), (direction, middle)])?;
    let half = |s: &Substitute| s.half_mm[0].max(s.half_mm[1]);
    Ok(Substitute::line(point, direction, half(a).min(half(b))))
}

/// The point of three planes, each by normal and point.
fn meet(planes: [(Vector3<f64>, Vector3<f64>); 3]) -> Result<Vector3<f64>, String> {
    let matrix = Matrix3::from_rows(&planes.map(|(normal, _)| normal.transpose()));
    let right = Vector3::from(planes.map(|(normal, point)| normal.dot(&point)));
    if matrix.determinant().abs() < PARALLEL {
        return Err("the three planes have no single point in common; choose planes across each other".into());
    }
    let inverse = matrix.try_inverse().ok_or("the three planes have no single point in common")?;
    Ok(inverse * right)
}

fn three_planes(parts: [&Substitute; 3]) -> Result<Substitute, String> {
    if let Some(other) = parts.iter().find(|p| p.shape != Shape::Plane) {
        return Err(format!(
            "three elements intersect when all are planes; one is a {}",
            other.shape.words()
        ));
    }
    meet(parts.map(|p| (p.direction, p.point))).map(Substitute::point)
}

/// Where an axis meets a plane.
fn piercing(plane: &Substitute, axis: &Substitute) -> Result<Vector3<f64>, String> {
    let speed = plane.direction.dot(&axis.direction);
    if speed.abs() < PARALLEL {
        return Err(format!(
            "the axis runs along the plane within {:.3}°, limit {:.3}°: it meets it nowhere; choose an axis across it",
            degrees(math::asin(speed.abs())),
            degrees(math::asin(PARALLEL))
        ));
    }
    Ok(axis.point + axis.direction * (plane.direction.dot(&(plane.point - axis.point)) / speed))
}

/// The circle of a cylinder or cone across its axis.
fn section(plane: &Substitute, body: &Substitute) -> Result<Substitute, String> {
    let point = piercing(plane, body)?;
    let cosine = plane.direction.dot(&body.direction).abs();
    if cosine < ACROSS {
        return Err(format!(
            "the plane cuts the axis at {:.1}° to its normal, limit {:.1}°: the section is no circle; take the point of axis and plane from a line",
            degrees(math::acos(cosine)),
            degrees(math::acos(ACROSS))
        ));
    }
    let height = (point - body.point).dot(&body.direction);
    let slope = if body.shape == Shape::Cone { math::tan(body.sizes[1]) } else { 0.0 };
    let diameter = body.sizes[0] + 2.0 * height * slope;
    if diameter <= 0.0 {
        return Err("the plane lies beyond the cone's apex; choose one that cuts the cone".into());
    }
    Ok(Substitute::circle(point, body.direction, diameter))
}

fn cap(plane: &Substitute, ball: &Substitute) -> Result<Substitute, String> {
    let height = plane.direction.dot(&(ball.point - plane.point));
    let radius = 0.5 * ball.sizes[0];
    let square = radius * radius - height * height;
    if square <= 0.0 {
        return Err(format!(
            "the plane passes the sphere: {:.3} mm from its centre, radius {radius:.3} mm; choose one that cuts it",
            height.abs()
        ));
    }
    Ok(Substitute::circle(ball.point - plane.direction * height, plane.direction, 2.0 * square.sqrt()))
}

/// Feet of the shortest connection of two axes.
pub(super) fn shortest(a: &Substitute, b: &Substitute) -> Option<[Vector3<f64>; 2]> {
    let across = a.direction.cross(&b.direction);
    let square = across.norm_squared();
    if square < PARALLEL * PARALLEL {
        return None;
    }
    let between = b.point - a.point;
    let on_a = a.point + a.direction * (between.cross(&b.direction).dot(&across) / square);
    let on_b = b.point + b.direction * (between.cross(&a.direction).dot(&across) / square);
    Some([on_a, on_b])
}

fn two_axes(a: &Substitute, b: &Substitute) -> Result<Substitute, String> {
    let [on_a, on_b] = shortest(a, b).ok_or(
        "the axes are parallel within 0.057°: they meet nowhere; choose axes at an angle, or a plane of symmetry",
    )?;
    Ok(Substitute::point((on_a + on_b) * 0.5))
}

fn projection(a: &Substitute, b: &Substitute) -> Result<Substitute, String> {
    let foot = |point: Vector3<f64>| match b.shape {
        Shape::Plane => Some(point - b.direction * b.direction.dot(&(point - b.point))),
        _ if b.shape.is_axis() => Some(b.point + b.direction * b.direction.dot(&(point - b.point))),
        _ => None,
    };
    if a.shape.is_point() {
        return foot(a.point).map(Substitute::point).ok_or_else(|| cannot("projection", a, b));
    }
    if a.shape.is_axis() && b.shape == Shape::Plane {
        let across = a.direction - b.direction * b.direction.dot(&a.direction);
        let length = across.norm();
        if length < PARALLEL {
            return Err(
                "the axis stands on the plane: its projection is a point; take their intersection".into()
            );
        }
        let point = foot(a.point).ok_or_else(|| cannot("projection", a, b))?;
        return Ok(Substitute::line(point, across / length, a.half_mm[0] * length));
    }
    Err(cannot("projection", a, b))
}

fn of_oblong(one: &Substitute) -> Result<Substitute, String> {
    if one.shape != Shape::Oblong {
        return Err(format!(
            "a {} has no plane of symmetry of its own; name two elements",
            one.shape.words()
        ));
    }
    let normal = one.direction.cross(&one.across);
    Ok(Substitute { across: one.across, ..Substitute::plane(one.point, normal, [0.5 * one.sizes[0], 0.0]) })
}

fn symmetry(a: &Substitute, b: &Substitute) -> Result<Substitute, String> {
    let middle = (a.point + b.point) * 0.5;
    if a.shape == Shape::Plane && b.shape == Shape::Plane {
        let other = if a.direction.dot(&b.direction) < 0.0 { -b.direction } else { b.direction };
        let sum = a.direction + other;
        // Beyond 45° either bisector could be meant.
        if a.direction.dot(&other) < 0.7 {
            return Err(format!(
                "the planes are {:.1}° apart, limit 45°: which of their middle planes is meant is open; choose planes that face each other",
                degrees(math::acos(a.direction.dot(&other)))
            ));
        }
        let normal = sum / sum.norm();
        // Halfway between the planes along the common normal, under the middle of both.
        let at = |s: &Substitute| s.direction.dot(&(s.point - middle)) / s.direction.dot(&normal);
        let point = middle + normal * (0.5 * (at(a) + at(b)));
        let half = [0, 1].map(|i| a.half_mm[i].min(b.half_mm[i]));
        let across = a.across - normal * normal.dot(&a.across);
        let across = if across.norm() > 0.1 { across / across.norm() } else { tangents_of(&normal) };
        return Ok(Substitute { across, ..Substitute::plane(point, normal, half) });
    }
    if a.shape.is_axis() && b.shape.is_axis() {
        if a.direction.cross(&b.direction).norm() > 0.7 {
            return Err(
                "the axes are more than 45° apart: they have no middle plane; choose parallel ones".into()
            );
        }
        let along = if a.direction.dot(&b.direction) < 0.0 {
            a.direction - b.direction
        } else {
            a.direction + b.direction
        };
        let along = along / along.norm();
        let between = b.point - a.point;
        let across = between - along * along.dot(&between);
        return through_middle(middle, across, [a.half_mm[0].min(b.half_mm[0]), 0.0], Some(along));
    }
    if a.shape.is_point() && b.shape.is_point() {
        return through_middle(middle, b.point - a.point, [0.0; 2], None);
    }
    Err(cannot("plane of symmetry", a, b))
}

fn tangents_of(normal: &Vector3<f64>) -> Vector3<f64> {
    fit::tangents(normal)[0]
}

fn through_middle(
    middle: Vector3<f64>,
    between: Vector3<f64>,
    half_mm: [f64; 2],
    across: Option<Vector3<f64>>,
) -> Result<Substitute, String> {
    let length = between.norm();
    if length < 1e-6 {
        return Err("the elements coincide: no plane lies in their middle; choose two that are apart".into());
    }
    let plane = Substitute::plane(middle, between / length, half_mm);
    Ok(Substitute { across: across.unwrap_or(plane.across), ..plane })
}

fn points(parts: &[Substitute], needs: usize) -> Result<Vec<Point3<f64>>, String> {
    if let Some(other) = parts.iter().find(|p| !p.shape.is_point()) {
        return Err(format!(
            "a {} is no point to fit through; name elements with a centre",
            other.shape.words()
        ));
    }
    if parts.len() < needs {
        return Err(format!("{} elements, needs at least {needs}; name more", parts.len()));
    }
    Ok(parts.iter().map(|p| Point3::from(p.point)).collect())
}

fn line_through(parts: &[Substitute]) -> Result<Substitute, String> {
    let points = points(parts, 2)?;
    let (first, last) = (points[0], points[points.len() - 1]);
    let (point, direction) = if let [a, b] = points[..] {
        (nalgebra::center(&a, &b).coords, b - a)
    } else {
        let found = fit::line(&points, &FitSettings::default()).map_err(|error| error.to_string())?;
        (Vector3::from(found.axis_point_mm), Vector3::from(found.axis_direction))
    };
    let length = direction.norm();
    if length < 1e-6 {
        return Err("the elements coincide: no line is fixed by them; choose elements that are apart".into());
    }
    let direction = direction / length * if direction.dot(&(last - first)) < 0.0 { -1.0 } else { 1.0 };
    let half = points.iter().map(|p| (p.coords - point).dot(&direction).abs()).fold(0.0, f64::max);
    Ok(Substitute::line(point, direction, half))
}

fn plane_through(parts: &[Substitute]) -> Result<Substitute, String> {
    let points = points(parts, 3)?;
    if lie_on_a_line(&points) {
        return Err("the elements lie on one line: no plane is fixed by them; choose others".into());
    }
    let normal = (points[1] - points[0]).cross(&(points[2] - points[0]));
    let (point, normal) = if points.len() == 3 {
        (points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 3.0, normal)
    } else {
        let found = fit::plane(&points, &FitSettings::default()).map_err(|error| error.to_string())?;
        (Vector3::from(found.centroid_mm), found.towards(&normal).normal_vector())
    };
    let reach = points.iter().map(|p| (p.coords - point).norm()).fold(0.0, f64::max);
    Ok(Substitute::plane(point, normal.normalize(), [reach, reach]))
}

/// Whether all points are nearer to the line through the two that lie farthest apart than a part of their distance: a plane through them turns
/// by as much as they are uncertain.
fn lie_on_a_line(points: &[Point3<f64>]) -> bool {
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(move |b| (*a, *b)));
    let longest = pairs.max_by(|(a, b), (c, d)| (a - b).norm().total_cmp(&(c - d).norm()));
    let Some((a, b)) = longest else { return true };
    let along = b - a;
    points.iter().all(|p| (p - a).cross(&along).norm() <= PARALLEL * along.norm_squared())
}

fn circle_through(parts: &[Substitute]) -> Result<Substitute, String> {
    let points = points(parts, 3)?;
    let plane = plane_through(parts)?;
    if points.len() > 3 {
        let found = fit::circle(&points, &FitSettings::default()).map_err(|error| error.to_string())?;
        let normal = Vector3::from(found.normal);
        let normal = if normal.dot(&plane.direction) < 0.0 { -normal } else { normal };
        return Ok(Substitute::circle(Vector3::from(found.center_mm), normal, found.diameter_mm));
    }
    // Equally far from three points, in their plane.
    let [a, b, c] = [points[0].coords, points[1].coords, points[2].coords];
    let center = meet(
        [(b - a, (a + b) * 0.5), (c - a, (a + c) * 0.5), (plane.direction, a)]
            .map(|(n, p)| (n / n.norm(), p)),
    )?;
    Ok(Substitute::circle(center, plane.direction, 2.0 * (a - center).norm()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Proves: places that lie nearly on one line fix no plane, however long that line is, and in whatever order they come.
    #[test]
    fn nearly_one_line_is_no_plane() {
        let lie = |off_mm: f64, order: [usize; 3]| {
            let places = [[0.0, 0.0], [50.0, off_mm], [100.0, 0.0]];
            let points = order.map(|i| Point3::new(places[i][0], places[i][1], 7.0));
            lie_on_a_line(&points)
        };
        for order in [[0, 1, 2], [1, 0, 2], [2, 0, 1]] {
            assert!(lie(0.05, order) && lie(0.0, order), "{order:?}");
            assert!(!lie(0.5, order), "{order:?}");
        }
        assert!(lie_on_a_line(&[Point3::origin(); 3]));
        let four = [[0.0, 0.0], [50.0, 0.0], [100.0, 0.0], [20.0, 3.0]].map(|[x, y]| Point3::new(x, y, 0.0));
        assert!(lie_on_a_line(&four[..3]) && !lie_on_a_line(&four));
    }
}

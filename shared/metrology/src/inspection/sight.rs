//! What is known of points by whence they were seen: noise lies along the lines of sight, and what lies beyond a limb shifts points near it.

use super::fit_element::Chosen;
use super::gather::Nearby;
use super::geometry::Geometry;
use crate::fit::PointNoise;
use crate::spread::Spread;
use fringe::cloud::Point;
use fringe::geometry::viewpoint::{Viewpoint, Viewpoints};
use nalgebra::{Point3, Vector3};

/// So many points tell what noise does to an element to a fiftieth of it.
const MOST: usize = 4096;

/// Steepest face whose noise along the line of sight is told from that along its normal: no point is seen more steeply.
const LEAST_COSINE: f64 = 0.05;

/// Points whose normals turn away from where they are said to be seen, as a part of all, from which on this is not believed: the cloud was moved since.
const MOST_AWAY: f64 = 0.1;

/// The noise of some of the points that belong to an element, in the frame of the part; none where it is not known whence one of them was seen, or not believed.
pub(super) fn noise(nearby: &Nearby, chosen: &Chosen, viewpoints: &[Option<Viewpoints>]) -> Vec<PointNoise> {
    if viewpoints.is_empty() {
        return Vec::new();
    }
    let (mut known, mut away) = (Vec::new(), 0);
    for index in Spread::of(chosen.positions.len(), MOST).indices() {
        let point = nearby.point(nearby.numbers()[chosen.places[index] as usize]);
        let Some(Some(seen)) = viewpoints.get(point.pair as usize) else { return Vec::new() };
        let eye = &seen.own.place();
        let along_mm = nearby.part_from_world().rotation * along_mm(point, eye);
        if point.normal_vector().dot(&(point.position() - eye)) > 0.0 {
            away += 1;
        } else if along_mm.iter().all(|value| value.is_finite()) {
            known.push(PointNoise { at_mm: chosen.positions[index], along_mm });
        }
    }
    if away as f64 > MOST_AWAY * known.len() as f64 { Vec::new() } else { known }
}

/// The noise of a point along its line of sight, mm: what it states along its normal, without what is no noise.
fn along_mm(point: &Point, eye: &Point3<f64>) -> Vector3<f64> {
    let sight = (point.position() - eye).normalize();
    let normal = point.normal_vector();
    let cosine = if normal == Vector3::zeros() { 1.0 } else { normal.dot(&sight).abs().max(LEAST_COSINE) };
    let [sigma, shared] = [point.sigma_mm, point.shared_mm].map(f64::from);
    sight * ((sigma * sigma - shared * shared).max(0.0).sqrt() / cosine)
}

/// Least part of an element's points that must lie clear of its limbs: of a smaller one, which is small in the picture, all are taken.
const LEAST_CLEAR: f64 = 0.5;

/// Which of the points of a ball or an outer cylinder lie clear of its limbs in the pictures of the cameras that saw them. Derivatives of the phase reach over
/// several pixels, and so near to a limb what lies beyond takes part; the matching drops such points by the turn of the normal, which noise hides on steep faces,
/// and then it chooses. The element itself tells it without noise. `None` for other elements, where nothing is known of the cameras, or too few points are left.
pub(super) fn clear_of_limbs(
    nearby: &Nearby,
    chosen: &Chosen,
    element: &Geometry,
    viewpoints: &[Option<Viewpoints>],
    needs: usize,
) -> Option<Vec<bool>> {
    let outer = Outer::of(element)?;
    let frame = nearby.part_from_world();
    let in_part = |view: &Viewpoint| (frame.point(&view.place().coords), view.limb_rad);
    let eyes: Vec<Option<Vec<_>>> =
        viewpoints.iter().map(|seen| Some(seen.as_ref()?.all().map(in_part).collect())).collect();
    let clear: Option<Vec<bool>> = chosen
        .places
        .iter()
        .zip(&chosen.positions)
        .map(|(place, position)| {
            let pair = nearby.point(nearby.numbers()[*place as usize]).pair as usize;
            let eyes = eyes.get(pair)?.as_ref()?;
            Some(eyes.iter().all(|(eye, limb_rad)| {
                outer.within_mm(eye, position) >= limb_rad * (position.coords - eye).norm()
            }))
        })
        .collect();
    let clear = clear?;
    let count = clear.iter().filter(|clear| **clear).count();
    let enough = count >= needs && count as f64 >= LEAST_CLEAR * clear.len() as f64;
    (enough && count < clear.len()).then_some(clear)
}

/// A body with a limb: a ball, or a cylinder about an axis.
struct Outer {
    middle: Vector3<f64>,
    axis: Option<Vector3<f64>>,
    radius_mm: f64,
}

impl Outer {
    fn of(element: &Geometry) -> Option<Self> {
        match element {
            Geometry::Sphere { center_mm, radius_mm, .. } => {
                Some(Self { middle: center_mm.coords, axis: None, radius_mm: *radius_mm })
            }
            Geometry::Cylinder { point_mm, axis, radius_mm, internal: false, .. } => {
                Some(Self { middle: point_mm.coords, axis: Some(*axis), radius_mm: *radius_mm })
            }
            _ => None,
        }
    }

    /// How far within the limb the line of sight to a place passes, mm: the radius less the distance from the middle or axis.
    fn within_mm(&self, eye: &Vector3<f64>, place: &Point3<f64>) -> f64 {
        let (sight, to) = ((place.coords - eye).normalize(), self.middle - eye);
        let distance = match &self.axis {
            None => to.cross(&sight).norm(),
            Some(axis) => {
                let across = sight.cross(axis);
                let length = across.norm();
                if length > 0.0 { (to.dot(&across) / length).abs() } else { 0.0 }
            }
        };
        self.radius_mm - distance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Proves: along the line of sight a point errs by what it states along its normal over the cosine between both, without what is no noise; without a normal
    /// it states that along the line.
    #[test]
    fn noise_lies_along_the_line_of_sight() {
        let eye = Point3::new(0.0, 0.0, 10.0);
        let point = Point {
            position_mm: [0.0, 0.0, 0.0],
            normal: [0.8, 0.0, 0.6],
            sigma_mm: 0.05,
            shared_mm: 0.03,
            ..bytemuck::Zeroable::zeroed()
        };
        // To the last digits of single precision, in which clouds state it.
        let near = |point: &Point, expected: f64| {
            let along = along_mm(point, &eye);
            assert!((along - Vector3::new(0.0, 0.0, -expected)).norm() < 1e-7, "{along}");
        };
        near(&point, 0.04 / 0.6);
        near(&Point { normal: [0.0; 3], shared_mm: 0.0, ..point }, 0.05);
        near(&Point { normal: [1.0, 0.0, 0.0], shared_mm: 0.0, ..point }, 1.0);
        near(&Point { shared_mm: 0.06, ..point }, 0.0);
    }

    /// Proves: how far within its limb a body is seen, of a ball and of a cylinder, from the side and at the limb itself.
    #[test]
    fn a_limb_is_where_the_line_of_sight_touches() {
        let eye = Vector3::new(0.0, 0.0, 100.0);
        let ball = Outer { middle: Vector3::zeros(), axis: None, radius_mm: 10.0 };
        let tube = Outer { axis: Some(Vector3::y()), ..ball };
        // The tangent from the eye touches at this height, this far from the axis.
        let (up, out) = (1.0, 99.0_f64.sqrt());
        for (body, place, expected) in [
            (&ball, Point3::new(0.0, 0.0, 10.0), 10.0),
            (&ball, Point3::new(out, 0.0, up), 0.0),
            (&ball, Point3::new(0.0, out, up), 0.0),
            (&tube, Point3::new(out, 0.0, up), 0.0),
            (&tube, Point3::new(0.0, 30.0, 10.0), 10.0),
            (&ball, Point3::new(5.0, 0.0, 0.0), 10.0 - 500.0 / 10_025.0_f64.sqrt()),
        ] {
            let found = body.within_mm(&eye, &place);
            assert!((found - expected).abs() < 1e-9, "{place}: {found}, {expected}");
        }
        let bore = Geometry::Cylinder {
            point_mm: Point3::origin(),
            axis: Vector3::y(),
            radius_mm: 10.0,
            half_length_mm: 5.0,
            internal: true,
            sector: None,
        };
        assert!(Outer::of(&bore).is_none());
    }
}

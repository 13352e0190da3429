//! The noise of points of cameras: along the lines of sight on which they lie.

use super::fit_element::Chosen;
use super::gather::Nearby;
use crate::fit::PointNoise;
use crate::spread::Spread;
use fringe::cloud::Point;
use nalgebra::{Point3, Vector3};

/// So many points tell what noise does to an element to a fiftieth of it.
const MOST: usize = 4096;

/// Steepest face whose noise along the line of sight is told from that along its normal: no point is seen more steeply.
const LEAST_COSINE: f64 = 0.05;

/// Points whose normals turn away from where they are said to be seen, as a part of all, from which on this is not believed: the cloud was moved since.
const MOST_AWAY: f64 = 0.1;

/// The noise of some of the points that belong to an element, in the frame of the part; none where it is not known whence one of them was seen, or not believed.
pub(super) fn noise(nearby: &Nearby, chosen: &Chosen, viewpoints: &[Option<Point3<f64>>]) -> Vec<PointNoise> {
    if viewpoints.is_empty() {
        return Vec::new();
    }
    let (mut known, mut away) = (Vec::new(), 0);
    for index in Spread::of(chosen.positions.len(), MOST).indices() {
        let point = nearby.point(nearby.numbers()[chosen.places[index] as usize]);
        let Some(Some(eye)) = viewpoints.get(point.pair as usize) else { return Vec::new() };
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
}

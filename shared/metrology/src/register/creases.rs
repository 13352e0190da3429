//! Points near the edges of a part: their pixels see both faces, and smoothing mixes them, so that they lie off either.

use nalgebra::Point3;
use rayon::prelude::*;

use super::icp::{Level, Refined, refine};
use crate::spatial::{CHUNK, PointTree, TriangleMesh};

/// How near to an edge points stay out, in spacings of the cloud: half a window of five pixels, and the footprint of a pixel
/// of the other view. On the bracket of the documentation points beyond it lie off by less than a fiftieth of their noise.
const APART_SPACINGS: f64 = 4.0;

/// Least share of the points that has to remain: a mesh that is a scan turns sharply everywhere.
const LEAST_SHARE: f64 = 0.5;

/// The points that lie apart from the sharp edges of a mesh under the pose found; `None` where all do, or too few.
pub(super) fn apart(
    positions: &[Point3<f64>],
    mesh: &TriangleMesh,
    found: &Refined,
) -> Option<Vec<Point3<f64>>> {
    let creases = mesh.creases();
    if creases.is_empty() {
        return None;
    }
    let distance_mm = APART_SPACINGS * PointTree::new(positions).spacing_mm();
    let is_apart =
        |p: &&Point3<f64>| !creases.within(&Point3::from(found.pose.point(&p.coords)), distance_mm);
    let kept: Vec<Vec<Point3<f64>>> =
        positions.par_chunks(CHUNK).map(|part| part.iter().filter(is_apart).copied().collect()).collect();
    let kept = kept.concat();
    let enough = kept.len() as f64 >= LEAST_SHARE * positions.len() as f64;
    (enough && kept.len() < positions.len()).then_some(kept)
}

/// The alignment of these points; `None` where they determine less than all points do, or do not settle.
pub(super) fn refined(level: &Level<'_>, before: &Refined) -> Option<Refined> {
    let found = refine(level, before.pose).ok()?;
    let determined = |r: &Refined| r.principal.determined().count();
    (found.converged >= before.converged && determined(&found) >= determined(before)).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::super::{InitialPose, RegisterSettings, register};
    use crate::reference::Reference;
    use crate::spatial::TriangleMesh;
    use fringe::cloud::Point;
    use fringe::geometry::pose::Pose;
    use fringe::synthetic::Noise;
    use nalgebra::{Matrix3, Point3, Vector3};

    const HALF: [f64; 3] = [20.0, 15.0, 10.0];

    fn block() -> TriangleMesh {
        let corner = |i: usize| {
            Point3::from(Vector3::from_fn(|k, _| if i >> k & 1 == 1 { HALF[k] } else { -HALF[k] }))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let of = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]].map(|t| t.map(corner));
        TriangleMesh::new(&quads.into_iter().flat_map(of).collect::<Vec<_>>()).unwrap()
    }

    /// Three faces of the block as a camera sees them; within half a millimetre of the edge at x = 20, y the face on top is rounded off.
    fn seen(rounded_mm: f64) -> Vec<Point> {
        let mut noise = Noise(7);
        let mut points = Vec::new();
        for axis in 0..3 {
            for _ in 0..8000 {
                let mut place = Vector3::from_fn(|k, _| HALF[k] * (2.0 * noise.unit() - 1.0));
                place[axis] = HALF[axis] + 0.01 * noise.gauss();
                if axis == 2 && place.x > HALF[0] - 0.5 {
                    place.z -= rounded_mm;
                }
                points.push(Point { position_mm: place.into(), ..bytemuck::Zeroable::zeroed() });
            }
        }
        points
    }

    /// What lies near the edges moves the alignment no more, and a rounded edge is as good as a sharp one.
    #[test]
    fn a_rounded_edge_does_not_tilt_the_part() {
        let reference = Reference::Mesh(block());
        let start = Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() };
        let turn = |rounded_mm: f64| {
            let settings = RegisterSettings::default();
            let found =
                register(&seen(rounded_mm), &reference, &InitialPose::Given(start), &settings).unwrap();
            assert!(
                found.at_edges > 1000 && found.points == 24_000,
                "{} of {}",
                found.at_edges,
                found.points
            );
            (found.rotation[0][2], found.u_rotation_rad[1])
        };
        let ((sharp, u), (rounded, _)) = (turn(0.0), turn(0.025));
        assert!(sharp.abs() < 3.0 * u && (rounded - sharp).abs() < 0.1 * u, "{sharp:e} {rounded:e} {u:e}");
    }

    /// A mesh that turns sharply everywhere leaves all points in.
    #[test]
    fn of_a_rough_mesh_all_points_count() {
        let mut noise = Noise(2);
        let heights: Vec<f64> = (0..41 * 41).map(|_| noise.unit()).collect();
        let at = |i: usize, j: usize| Point3::new(i as f64, j as f64, heights[41 * i + j]);
        let quads = (0..40).flat_map(|i| (0..40).map(move |j| (i, j)));
        let triangles: Vec<[Point3<f64>; 3]> = quads
            .flat_map(|(i, j)| {
                [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
            })
            .collect();
        let middle = |t: &[Point3<f64>; 3]| Point {
            position_mm: (t.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 3.0).into(),
            ..bytemuck::Zeroable::zeroed()
        };
        let points: Vec<Point> = triangles.iter().map(middle).collect();
        let reference = Reference::Mesh(TriangleMesh::new(&triangles).unwrap());
        let start = Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() };
        let found =
            register(&points, &reference, &InitialPose::Given(start), &RegisterSettings::default()).unwrap();
        assert_eq!(found.at_edges, 0);
    }
}

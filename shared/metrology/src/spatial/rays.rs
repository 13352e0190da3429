//! What rays meet among triangles.

use super::bvh::Bvh;
use super::mesh::TriangleMesh;
use super::triangle::Triangle;
use nalgebra::{Point3, Vector3};

/// Where a ray meets a triangle: distance along its direction, and the triangle's number.
pub type Met = (f64, u32);

/// The first triangle that a ray meets beyond `least_mm`, from either side.
pub fn first_met(
    (tree, triangles): (&Bvh, &[Triangle]),
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    least_mm: f64,
) -> Option<Met> {
    let mut best: Option<Met> = None;
    tree.along_ray(origin, direction, f64::INFINITY, |item, limit| {
        match triangles[item as usize].hit(origin, direction) {
            // On a shared edge the lower number wins: the tree's order must not show.
            Some(t) if t > least_mm && best.is_none_or(|(near, i)| t < near || (t == near && item < i)) => {
                best = Some((t, item));
                t
            }
            _ => limit,
        }
    });
    best
}

/// Whether a ray meets a triangle between two distances, mm.
pub fn is_blocked(
    (tree, triangles): (&Bvh, &[Triangle]),
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    (least_mm, limit_mm): (f64, f64),
) -> bool {
    let mut blocked = false;
    tree.along_ray(origin, direction, limit_mm, |item, limit| {
        let met = triangles[item as usize].hit(origin, direction);
        blocked |= met.is_some_and(|t| t > least_mm && t < limit_mm);
        if blocked { -1.0 } else { limit }
    });
    blocked
}

impl TriangleMesh {
    /// The first triangle that a ray meets beyond `least_mm`, from either side.
    pub fn first_met(&self, origin: &Point3<f64>, direction: &Vector3<f64>, least_mm: f64) -> Option<Met> {
        first_met((self.tree(), self.triangles()), origin, direction, least_mm)
    }

    /// Whether anything lies on a ray between two distances, mm.
    pub fn is_blocked(&self, origin: &Point3<f64>, direction: &Vector3<f64>, span_mm: (f64, f64)) -> bool {
        is_blocked((self.tree(), self.triangles()), origin, direction, span_mm)
    }

    /// How many bodies a point lies in, as a ray from it counts them: leaving one counts up, entering one down.
    pub fn bodies_around(&self, point: &Point3<f64>, direction: &Vector3<f64>) -> i32 {
        let mut bodies = 0;
        self.tree().along_ray(point, direction, f64::INFINITY, |item, limit| {
            let triangle = &self.triangles()[item as usize];
            if triangle.hit(point, direction).is_some_and(|t| t > 0.0) {
                bodies += if triangle.normal.dot(direction) > 0.0 { 1 } else { -1 };
            }
            limit
        });
        bodies
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::synthetic::Noise;

    /// The tree against all triangles one after another, and a ray that stops short.
    #[test]
    fn the_tree_meets_what_all_triangles_give() {
        let mut noise = Noise(7);
        let mut place = || Point3::from(Vector3::from_fn(|_, _| 10.0 * noise.unit()));
        let soup: Vec<[Point3<f64>; 3]> = (0..200).map(|_| [place(), place(), place()]).collect();
        let mesh = TriangleMesh::new(&soup).unwrap();
        let mut met = 0;
        for _ in 0..300 {
            let (origin, towards) = (place(), place());
            let direction = (towards - origin).normalize();
            let all = mesh.triangles().iter().filter_map(|t| t.hit(&origin, &direction));
            let brute = all.filter(|t| *t > 1e-6).fold(f64::INFINITY, f64::min);
            let found = mesh.first_met(&origin, &direction, 1e-6).map_or(f64::INFINITY, |(t, _)| t);
            assert_eq!(found, brute);
            if brute.is_finite() {
                met += 1;
                assert!(mesh.is_blocked(&origin, &direction, (1e-6, brute * 1.001)));
                assert!(!mesh.is_blocked(&origin, &direction, (1e-6, brute * 0.999)));
            }
        }
        assert!(met > 200);
    }

    /// Two boxes, one inside of the other: outside, between and within.
    #[test]
    fn a_ray_counts_the_bodies_around_its_start() {
        let corner = |i: usize, half: f64| {
            let side = |bit: usize| if i >> bit & 1 == 1 { half } else { -half };
            Point3::new(side(0), side(1), side(2))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let cube = |half: f64| {
            let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
            triangles.map(move |t| t.map(|i| corner(i, half))).collect::<Vec<_>>()
        };
        let mesh = TriangleMesh::new(&[cube(2.0), cube(1.0)].concat()).unwrap();
        let direction = Vector3::new(0.3, 0.5, 0.7).normalize();
        for (x, bodies) in [(3.0, 0), (1.5, 1), (0.5, 2), (-3.0, 0)] {
            assert_eq!(mesh.bodies_around(&Point3::new(x, 0.1, 0.2), &direction), bodies, "{x}");
        }
    }
}

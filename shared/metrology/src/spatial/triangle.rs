//! A triangle: intersection with a ray, nearest point.

use fringe::math;
use nalgebra::{Point3, Vector3};

/// A triangle with an area.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangle {
    /// As given: neighbours share their bits, which corner + u would lose; mm.
    pub corners: [Point3<f64>; 3],
    /// Second minus first corner, mm.
    u: Vector3<f64>,
    /// Third minus first corner, mm.
    v: Vector3<f64>,
    /// Unit normal: from its side the corners run counter-clockwise.
    pub normal: Vector3<f64>,
}

impl Triangle {
    /// `None` without an area.
    pub fn new([a, b, c]: [Point3<f64>; 3]) -> Option<Self> {
        let (u, v) = (b - a, c - a);
        let normal = u.cross(&v);
        // Relative: a sliver of 1e-12 of its own size squared has no direction left in its normal.
        let size = u.norm_squared().max(v.norm_squared());
        (normal.norm() > 1e-12 * size && size > 0.0).then(|| Self {
            corners: [a, b, c],
            u,
            v,
            normal: normal.normalize(),
        })
    }

    /// Parameter of a ray where it meets the triangle.
    ///
    /// Möller & Trumbore, Fast minimum storage ray–triangle intersection, 1997; from both sides.
    pub fn hit(&self, origin: &Point3<f64>, d: &Vector3<f64>) -> Option<f64> {
        let across = d.cross(&self.v);
        let determinant = self.u.dot(&across);
        if determinant == 0.0 {
            return None;
        }
        let from_corner = origin - self.corners[0];
        let a = from_corner.dot(&across) / determinant;
        let q = from_corner.cross(&self.u);
        let b = d.dot(&q) / determinant;
        // A hair outside still counts, so that no ray slips between two neighbours.
        (a >= -1e-12 && b >= -1e-12 && a + b <= 1.0 + 1e-12).then(|| self.v.dot(&q) / determinant)
    }

    /// The nearest point of the triangle.
    pub fn nearest(&self, p: &Point3<f64>) -> Point3<f64> {
        self.nearest_part(p).0
    }

    /// The nearest point of the triangle, and on which part of it that lies.
    ///
    /// Ericson, Real-time collision detection, section 5.1.5.
    pub fn nearest_part(&self, p: &Point3<f64>) -> (Point3<f64>, Part) {
        let w = p - self.corners[0];
        let (uu, uv, vv) = (self.u.norm_squared(), self.u.dot(&self.v), self.v.norm_squared());
        let (wu, wv) = (w.dot(&self.u), w.dot(&self.v));
        let determinant = uu * vv - uv * uv;
        let a = (vv * wu - uv * wv) / determinant;
        let b = (uu * wv - uv * wu) / determinant;
        if a >= 0.0 && b >= 0.0 && a + b <= 1.0 {
            return (self.corners[0] + self.u * a + self.v * b, Part::Face);
        }
        let [c0, c1, c2] = self.corners;
        let feet = [(c0, c1), (c1, c2), (c2, c0)].map(|(from, to)| nearest_on_segment(from, to, p));
        let distance2 = |edge: &usize| (p - feet[*edge]).norm_squared();
        let edge =
            [1, 2].into_iter().fold(0, |best, e| if distance2(&e) < distance2(&best) { e } else { best });
        let part = match [edge, (edge + 1) % 3].into_iter().find(|corner| feet[edge] == self.corners[*corner])
        {
            Some(corner) => Part::Corner(corner),
            None => Part::Edge(edge),
        };
        (feet[edge], part)
    }

    /// Interior angle at a corner (0 … 2), rad.
    pub fn angle_rad(&self, corner: usize) -> f64 {
        let [at, next, last] = [corner, (corner + 1) % 3, (corner + 2) % 3].map(|c| self.corners[c]);
        let (a, b) = (next - at, last - at);
        math::atan2(a.cross(&b).norm(), a.dot(&b))
    }
}

/// A part of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Inside the triangle's face.
    Face,
    /// The edge from this corner to the next.
    Edge(usize),
    /// On the corner of this index.
    Corner(usize),
}

/// The nearest point of a segment.
pub fn nearest_on_segment(from: Point3<f64>, to: Point3<f64>, p: &Point3<f64>) -> Point3<f64> {
    let along = to - from;
    let s = (p - from).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
    from + along * s.clamp(0.0, 1.0)
}

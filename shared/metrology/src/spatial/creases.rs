//! Edges at which a surface turns sharply.

use nalgebra::Point3;

use super::bvh::{Aabb, Bvh};
use super::triangle::nearest_on_segment;

/// Cosine of the angle between two triangles beyond which their common edge is one of the part: 20°. The triangles of a
/// curved face turn by less from one to the next.
pub(super) const CREASE_COSINE: f64 = 0.94;

/// Edges of a part, sorted for queries.
#[derive(Debug, Clone)]
pub struct Creases {
    ends: Vec<[Point3<f64>; 2]>,
    tree: Bvh,
}

impl Creases {
    /// Sorts edges given by their ends, mm.
    pub fn new(ends: Vec<[Point3<f64>; 2]>) -> Self {
        let tree = Bvh::over(ends.len(), 4, &|item| Aabb::of(&ends[item as usize]));
        Self { ends, tree }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Whether an edge comes nearer to a place than a distance, mm.
    pub fn within(&self, place: &Point3<f64>, distance_mm: f64) -> bool {
        let mut near = false;
        self.tree.around_point(place, distance_mm, |item, limit| {
            let [a, b] = &self.ends[item as usize];
            near |= (place - nearest_on_segment(*a, *b, place)).norm() < distance_mm;
            if near { -1.0 } else { limit }
        });
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::synthetic::Noise;
    use nalgebra::Vector3;

    /// The tree says what all edges say, and no edges say no.
    #[test]
    fn the_tree_agrees_with_all_edges() {
        let mut noise = Noise(5);
        let mut place = || Point3::from(Vector3::from_fn(|_, _| 10.0 * noise.unit()));
        let ends: Vec<_> = (0..200).map(|_| [place(), place()]).collect();
        let creases = Creases::new(ends.clone());
        let none = Creases::new(Vec::new());
        for _ in 0..300 {
            let p = place();
            let brute = ends
                .iter()
                .map(|[a, b]| (p - nearest_on_segment(*a, *b, &p)).norm())
                .fold(f64::INFINITY, f64::min);
            assert!(creases.within(&p, 1.001 * brute) && !creases.within(&p, 0.999 * brute));
            assert!(!none.within(&p, 100.0));
        }
    }
}

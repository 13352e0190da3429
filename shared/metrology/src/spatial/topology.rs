//! Which corners and edges the triangles of a mesh share.

use nalgebra::Point3;
use rayon::prelude::*;

/// The edges of all triangles, equal ones together: numbers of the ends, triangle, which of its edges. Triangles that have
/// two corners in one place join nothing.
pub(super) fn edges(names: &[[u32; 3]]) -> Vec<([u32; 2], u32, u8)> {
    let of = |(names, item): (&[u32; 3], u32)| {
        let [a, b, c] = *names;
        [(a, b), (b, c), (c, a)]
            .into_iter()
            .zip(0_u8..)
            .map(move |((a, b), e)| ([a.min(b), a.max(b)], item, e))
    };
    let apart = |([a, b, c], _): &(&[u32; 3], u32)| a != b && b != c && c != a;
    let mut edges: Vec<_> = names.iter().zip(0_u32..).filter(apart).flat_map(of).collect();
    edges.par_sort_unstable();
    edges
}

/// Numbers of the corners of each triangle: the same number for the same place.
pub(super) fn corner_names(triangles: &[[Point3<f64>; 3]]) -> Vec<[u32; 3]> {
    // + 0.0 makes −0 and 0 one place.
    let key = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
    let mut places: Vec<([u64; 3], u32)> =
        triangles.iter().flatten().zip(0..).map(|(p, slot)| (key(p), slot)).collect();
    places.par_sort_unstable();
    let mut names = vec![[0; 3]; triangles.len()];
    for (name, same) in (0..).zip(places.chunk_by(|a, b| a.0 == b.0)) {
        for (_, slot) in same {
            names[*slot as usize / 3][*slot as usize % 3] = name;
        }
    }
    names
}

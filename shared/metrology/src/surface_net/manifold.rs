//! A net in which no edge has more than two triangles, and the triangles about a corner are one fan.
//!
//! Where the surface nearly passes a corner of the grid, all four edges of a face of two cells are crossed, and four triangles hang on the edge
//! between their vertices. These lie a small part of a cell apart and become one; a corner at which two fans then meet becomes one for each.

use nalgebra::Point3;

/// Rounds in which edges are drawn together; each leaves far fewer.
const ROUNDS: usize = 32;

/// Corners, mm, and triangles by their numbers.
pub(super) type Net = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// Draws together edges of more than two triangles, and gives each fan its own corner.
pub(super) fn manifold((mut corners, mut triangles): Net) -> Net {
    for _ in 0..ROUNDS {
        let crowded = crowded_edges(&triangles);
        if crowded.is_empty() {
            break;
        }
        let mut names: Vec<u32> = (0..corners.len() as u32).collect();
        let mut moved = vec![false; corners.len()];
        for [a, b] in crowded.iter().map(|edge| edge.map(|corner| corner as usize)) {
            if !moved[a] && !moved[b] {
                (moved[a], moved[b]) = (true, true);
                names[b] = a as u32;
                corners[a] = nalgebra::center(&corners[a], &corners[b]);
            }
        }
        for corner in triangles.iter_mut().flatten() {
            *corner = names[*corner as usize];
        }
        triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        triangles = without_opposites(&triangles);
    }
    split_fans(&mut corners, &mut triangles);
    (corners, triangles)
}

/// Edges of more than two triangles, rising.
pub(super) fn crowded_edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut edges: Vec<[u32; 2]> =
        triangles.iter().flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|equal| equal.len() > 2).map(|equal| equal[0]).collect()
}

fn sides([a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[*a, *b], [*b, *c], [*c, *a]]
}

/// Triangles without those that lie on each other's back, and each once, in their order.
fn without_opposites(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let sorted = |triangle: &[u32; 3]| {
        let mut corners = *triangle;
        corners.sort_unstable();
        corners
    };
    // An even permutation of rising corners faces one way, an odd one the other.
    let faces_up = |[a, b, c]: &[u32; 3]| (a < b) as u8 + (b < c) as u8 + (c < a) as u8 == 2;
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by_key(|index| sorted(&triangles[*index]));
    let mut kept = Vec::with_capacity(order.len());
    for equal in order.chunk_by(|a, b| sorted(&triangles[*a]) == sorted(&triangles[*b])) {
        let up: Vec<usize> = equal.iter().copied().filter(|index| faces_up(&triangles[*index])).collect();
        let down = equal.iter().copied().find(|index| !faces_up(&triangles[*index]));
        kept.extend(match (up.first(), down) {
            (Some(_), Some(_)) => None,
            (one, other) => one.copied().or(other),
        });
    }
    kept.sort_unstable();
    kept.into_iter().map(|index| triangles[index]).collect()
}

/// Triangles about a corner that hang together by edges are a fan; every fan but the first gets a corner of its own.
fn split_fans(corners: &mut Vec<Point3<f64>>, triangles: &mut [[u32; 3]]) {
    let mut about: Vec<(u32, u32)> = (0_u32..)
        .zip(triangles.iter())
        .flat_map(|(index, triangle)| triangle.map(|corner| (corner, index)))
        .collect();
    about.sort_unstable();
    for group in about.chunk_by(|a, b| a.0 == b.0) {
        let corner = group[0].0;
        let mut left: Vec<u32> = group.iter().map(|(_, triangle)| *triangle).collect();
        let mut is_first = true;
        while !left.is_empty() {
            let fan = fan(corner, &mut left, triangles);
            if !is_first {
                let own = corners.len() as u32;
                corners.push(corners[corner as usize]);
                for triangle in fan {
                    for name in triangles[triangle as usize].iter_mut().filter(|name| **name == corner) {
                        *name = own;
                    }
                }
            }
            is_first = false;
        }
    }
}

/// Takes the fan of the first triangle that is left.
fn fan(corner: u32, left: &mut Vec<u32>, triangles: &[[u32; 3]]) -> Vec<u32> {
    let others = |triangle: u32| triangles[triangle as usize].into_iter().filter(move |name| *name != corner);
    let mut fan = vec![left.remove(0)];
    let mut rim: Vec<u32> = others(fan[0]).collect();
    while let Some(place) = left.iter().position(|triangle| others(*triangle).any(|name| rim.contains(&name)))
    {
        let next = left.remove(place);
        rim.extend(others(next));
        fan.push(next);
    }
    fan
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of twelve triangles, its corners by the bits of their numbers, with names.
    fn cube(names: [u32; 8]) -> Vec<[u32; 3]> {
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let cut = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]];
        sides.into_iter().flat_map(cut).map(|t| t.map(|k| names[k])).collect()
    }

    fn open_edges(triangles: &[[u32; 3]]) -> usize {
        let all: Vec<[u32; 2]> = triangles.iter().flat_map(sides).collect();
        all.iter().filter(|[a, b]| !all.contains(&[*b, *a])).count()
    }

    /// Two cubes that touch along an edge: four triangles on it. Two that touch at a corner: two fans.
    #[test]
    fn cubes_that_touch_are_parted() {
        let places =
            |count: u32| (0..count).map(|k| Point3::new(f64::from(k), f64::from(k * k % 7), 0.0)).collect();
        let mut both = cube([0, 1, 2, 3, 4, 5, 6, 7]);
        both.extend(cube([7, 8, 3, 9, 10, 11, 12, 13]));
        assert_eq!(crowded_edges(&both), [[3, 7]]);
        let (corners, parted) = manifold((places(14), both));
        assert!(crowded_edges(&parted).is_empty() && open_edges(&parted) == 0);
        // Each cube lost the two triangles at the edge; the drawn corner is two.
        assert_eq!((parted.len(), corners.len()), (20, 15));
        let mut touching = cube([0, 1, 2, 3, 4, 5, 6, 7]);
        touching.extend(cube([7, 8, 9, 10, 11, 12, 13, 14]));
        let (corners, parted) = manifold((places(15), touching));
        assert_eq!((parted.len(), corners.len(), open_edges(&parted)), (24, 16, 0));
        let lone = cube([0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(manifold((places(8), lone.clone())), (places(8), lone));
    }

    #[test]
    fn what_lies_back_to_back_is_no_skin() {
        assert_eq!(without_opposites(&[[0, 1, 2], [3, 4, 5], [2, 1, 0], [4, 5, 3]]), [[3, 4, 5]]);
    }
}

//! Whole closed surfaces, which no edge bounds.

use nalgebra::{Point3, Vector3};

use super::freeform::Freeform;
use super::inverse::Part;
use super::shape::{CadShape, Surface};
use super::sheet::{SHARE, lattice};

/// Points of a surface, and triangles between them.
pub(super) type Whole = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// Pieces of a circle that keep the chordal error.
fn pieces(radius_mm: f64, chord_mm: f64) -> usize {
    let step = 2.0 * fringe::math::acos((1.0 - 0.5 * chord_mm / radius_mm).clamp(0.0, 1.0));
    (std::f64::consts::TAU / step.clamp(1e-4, super::curve::ANGLE_RAD)).ceil() as usize
}

/// Sine and cosine of a whole circle's parts.
fn turn(k: usize, of: usize) -> (f64, f64) {
    fringe::math::sincos(std::f64::consts::TAU * k as f64 / of as f64)
}

/// A whole closed surface, which nothing bounds; `None` where it does not close, or takes too many triangles.
pub(super) fn whole(surface: &Surface, chord_mm: f64, limit: usize) -> Option<Whole> {
    let shape = match surface {
        Surface::Element(shape) => shape,
        Surface::Free(free) => return whole_freeform(free, chord_mm, limit),
    };
    match *shape {
        CadShape::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => {
            whole_torus(&center_mm, &axis, [ring_radius_mm, tube_radius_mm], chord_mm, limit)
        }
        CadShape::Sphere { center_mm, radius_mm } => whole_sphere(&center_mm, radius_mm, chord_mm, limit),
        _ => None,
    }
}

fn whole_torus(
    center_mm: &Point3<f64>,
    axis: &Vector3<f64>,
    [ring_mm, tube_mm]: [f64; 2],
    chord_mm: f64,
    limit: usize,
) -> Option<Whole> {
    let [x, y] = crate::fit::tangents(axis);
    let (around, about) = (pieces(ring_mm + tube_mm, chord_mm), pieces(tube_mm, chord_mm));
    let mut points = Vec::new();
    if around.checked_mul(about)? > limit {
        return None;
    }
    for i in 0..around {
        let (sin, cos) = turn(i, around);
        let out = x * cos + y * sin;
        for j in 0..about {
            let (s, c) = turn(j, about);
            points.push(center_mm + out * (ring_mm + tube_mm * c) + axis * (tube_mm * s));
        }
    }
    let at = |i: usize, j: usize| ((i % around) * about + j % about) as u32;
    let quad = |(i, j): (usize, usize)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let all = (0..around).flat_map(|i| (0..about).map(move |j| (i, j)));
    Some((points, all.flat_map(quad).collect()))
}

fn whole_sphere(center_mm: &Point3<f64>, radius_mm: f64, chord_mm: f64, limit: usize) -> Option<Whole> {
    let around = pieces(radius_mm, chord_mm).next_multiple_of(2);
    let rings = around / 2;
    if around.checked_mul(rings)? > limit {
        return None;
    }
    let mut points = vec![center_mm + Vector3::z() * radius_mm];
    for j in 1..rings {
        let (s, c) = turn(j, around);
        for i in 0..around {
            let (sin, cos) = turn(i, around);
            points.push(center_mm + Vector3::new(s * cos, s * sin, c) * radius_mm);
        }
    }
    points.push(center_mm - Vector3::z() * radius_mm);
    let last = points.len() as u32 - 1;
    let at = |j: usize, i: usize| (1 + (j - 1) * around + i % around) as u32;
    let mut triangles = Vec::new();
    for i in 0..around {
        triangles.push([0, at(1, i), at(1, i + 1)]);
        triangles.push([last, at(rings - 1, i + 1), at(rings - 1, i)]);
        for j in 1..rings - 1 {
            let [a, b, c, d] = [at(j, i), at(j + 1, i), at(j + 1, i + 1), at(j, i + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Some((points, triangles))
}

/// A corner of a net over the parameters: its point, and its parameters, further round where the surface closes.
#[derive(Clone, Copy)]
struct Corner {
    index: u32,
    place: [f64; 2],
}

/// A surface that closes in both directions, or in one with poles at the ends of the other: finer nets until the distance is kept.
fn whole_freeform(surface: &Freeform, chord_mm: f64, limit: usize) -> Option<Whole> {
    let part = Part::new(surface, &[]);
    let swapped = !part.closed[0];
    let across = usize::from(!swapped);
    let has_poles = !part.closed[across];
    if !part.closed[1 - across] || (has_poles && !(part.is_pole(across, 0) && part.is_pole(across, 1))) {
        return None;
    }
    let mut pieces = surface.breaks(|degree| degree.div_ceil(4)).map(|breaks| breaks.len().max(12));
    while 2 * pieces[0] * pieces[1] <= limit {
        let (points, triangles) = net(&part, pieces, across, has_poles);
        let is_near = |triangle: &[Corner; 3]| {
            let off = |shares: [f64; 3]| {
                let (mut point, mut place) = (Vector3::zeros(), [0.0; 2]);
                for (corner, share) in triangle.iter().zip(shares) {
                    point += points[corner.index as usize].coords * share;
                    place = [place[0] + corner.place[0] * share, place[1] + corner.place[1] * share];
                }
                part.foot(&Point3::from(point), place).1
            };
            lattice().all(|shares| off(shares) <= SHARE * chord_mm)
        };
        if triangles.iter().all(is_near) {
            return Some((points, triangles.into_iter().map(|t| t.map(|c| c.index)).collect()));
        }
        pieces = pieces.map(|count| 2 * count);
    }
    None
}

/// Points over all of a surface and triangles between them; a row at a pole is one point.
fn net(
    part: &Part,
    pieces: [usize; 2],
    across: usize,
    has_poles: bool,
) -> (Vec<Point3<f64>>, Vec<[Corner; 3]>) {
    let [rows, columns] = [pieces[across], pieces[1 - across]];
    let place = |row: usize, column: usize| {
        let at = |direction: usize, k: usize| {
            let [from, to] = part.domain[direction];
            from + (to - from) * k as f64 / pieces[direction] as f64
        };
        let mut place = [0.0; 2];
        place[across] = at(across, row);
        place[1 - across] = at(1 - across, column);
        place
    };
    let mut points = Vec::new();
    let mut names = vec![0; (rows + 1) * columns];
    for row in 0..=rows {
        for column in 0..columns {
            let is_again = if has_poles { (row == 0 || row == rows) && column > 0 } else { row == rows };
            names[row * columns + column] = if !is_again {
                points.push(part.at(place(row, column)).0);
                points.len() as u32 - 1
            } else if has_poles {
                names[row * columns]
            } else {
                names[column]
            };
        }
    }
    let corner = |row: usize, column: usize| Corner {
        index: names[row * columns + column % columns],
        place: place(row, column),
    };
    let mut triangles = Vec::with_capacity(2 * rows * columns);
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let quad = [[0, 0], [0, 1], [1, 1], [1, 0]].map(|[r, c]| corner(row + r, column + c));
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k: usize| quad[k])) {
            // Columns turned towards rows is the own normal where the first parameter is that of the columns.
            let turned = if across == 1 { [a, b, c] } else { [a, c, b] };
            if a.index != b.index && b.index != c.index && c.index != a.index {
                triangles.push(turned);
            }
        }
    }
    (points, triangles)
}

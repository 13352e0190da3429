//! Faces: the loops of 2 × 2 pixels, where residues occur, and the holes of the mask.
//!
//! Face (x, y) is the corner between the pixels (x − 1, y − 1), (x, y − 1), (x − 1, y) and (x, y), for x = 0 … width and
//! y = 0 … height. An edge between two valid pixels separates two faces; where the pixels are not both valid the faces
//! are one, so that each hole of the mask is a single face, and so is all that lies outside. The charge of a face is the
//! sum of the wrapped differences about it, in whole turns (eq. 2.20): of one that is open, the residue.

use super::angle::Angles;
use super::edges::Grid;
use super::forest::Forest;

/// The number of the face that holds the border of the image.
pub const OUTSIDE: usize = 0;

/// The faces of an image.
#[derive(Debug)]
pub struct Faces {
    /// Columns: one more than the image's.
    pub width: usize,
    /// Rows: one more than the image's.
    pub height: usize,
    /// First face of the hole that a face belongs to; itself if open.
    pub hole: Vec<u32>,
    /// Whether a face touches four valid pixels.
    pub open: Vec<bool>,
    /// Whole turns about it, at the first face of a hole for all of it.
    pub charge: Vec<i32>,
}

/// The two faces that an edge separates: its difference counts for the one and against the other.
#[derive(Debug, Clone, Copy)]
struct Sides {
    plus: usize,
    minus: usize,
}

impl Faces {
    /// Finds holes and charges.
    pub fn new(angles: &Angles<'_>, grid: &Grid<'_>) -> Self {
        let (width, height) = (grid.width + 1, grid.height + 1);
        let hole = holes(grid, width, height);
        let open = (0..width * height).map(|face| is_open(grid, face % width, face / width)).collect();
        let mut sum = vec![0_i64; width * height];
        for (number, (a, b)) in grid.edges() {
            let sides = sides(grid, a, number.is_multiple_of(2));
            let difference = i64::from(angles.difference(a, b));
            sum[hole[sides.plus] as usize] += difference;
            sum[hole[sides.minus] as usize] -= difference;
        }
        // Exact: about each face the differences are a multiple of 2³².
        let charge = sum.into_iter().map(|sum| (sum >> 32) as i32).collect();
        Self { width, height, hole, open, charge }
    }
}

fn holes(grid: &Grid<'_>, width: usize, height: usize) -> Vec<u32> {
    let mut forest = Forest::new(width * height);
    for x in 1..width {
        forest.join(OUTSIDE, x, 0);
        forest.join(OUTSIDE, (height - 1) * width + x, 0);
    }
    for y in 1..height {
        forest.join(OUTSIDE, y * width, 0);
        forest.join(OUTSIDE, y * width + width - 1, 0);
    }
    for pixel in 0..grid.valid.len() {
        if pixel % grid.width + 1 < grid.width && grid.right(pixel).is_none() {
            let sides = sides(grid, pixel, true);
            forest.join(sides.plus, sides.minus, 0);
        }
        if pixel + grid.width < grid.valid.len() && grid.down(pixel).is_none() {
            let sides = sides(grid, pixel, false);
            forest.join(sides.plus, sides.minus, 0);
        }
    }
    // Numbered by their first faces, so that the outside is face 0.
    let mut first = vec![u32::MAX; width * height];
    (0..width * height)
        .map(|face| {
            let root = forest.find(face).0;
            if first[root] == u32::MAX {
                first[root] = face as u32;
            }
            first[root]
        })
        .collect()
}

/// Clockwise about a face its upper edge counts to the right, its right one downwards, the others the other way.
fn sides(grid: &Grid<'_>, pixel: usize, rightwards: bool) -> Sides {
    let (x, y) = (pixel % grid.width, pixel / grid.width);
    let face = |x: usize, y: usize| y * (grid.width + 1) + x;
    if rightwards {
        Sides { plus: face(x + 1, y + 1), minus: face(x + 1, y) }
    } else {
        Sides { plus: face(x, y + 1), minus: face(x + 1, y + 1) }
    }
}

fn is_open(grid: &Grid<'_>, x: usize, y: usize) -> bool {
    let inside = x > 0 && y > 0 && x < grid.width && y < grid.height;
    let pixel = |x: usize, y: usize| grid.valid[y * grid.width + x];
    inside && pixel(x - 1, y - 1) && pixel(x, y - 1) && pixel(x - 1, y) && pixel(x, y)
}

//! Faces: the loops of 2 × 2 pixels, where residues occur, and the holes of the mask.
//!
//! Face (x, y) is the corner between the pixels (x − 1, y − 1), (x, y − 1), (x − 1, y) and (x, y), for x = 0 … width and
//! y = 0 … height. An edge between two valid pixels separates two faces; where the pixels are not both valid the faces
//! are one, so that each hole of the mask is a single face, and so is all that lies outside. The charge of a face is the
//! sum of the wrapped differences about it, in whole turns (eq. 2.20): of one that is open, the residue.

use super::angle::{Angles, step};
use super::edges::{Grid, runs};
use super::forest::Forest;
use crate::math::simd::{best_level, vectorised};
use rayon::prelude::*;

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
    /// Pixels that are not valid, run by run, by rising hole and row.
    gaps: Vec<Gap>,
}

/// The two faces that an edge separates: its difference counts for the one and against the other.
#[derive(Debug, Clone, Copy)]
pub struct Sides {
    /// Face, or first face of a hole, for which the edge counts.
    pub plus: usize,
    /// The face on its other side.
    pub minus: usize,
}

/// A run of pixels of a row that are not valid, and the hole it belongs to.
#[derive(Debug, Clone, Copy)]
struct Gap {
    hole: u32,
    row: usize,
    start: usize,
    end: usize,
}

/// Charges by face, and the gaps that make holes of faces.
#[derive(Debug)]
pub struct Charges {
    of_face: Vec<i32>,
    gaps: Vec<Gap>,
}

impl Charges {
    /// Sums the steps about all faces and holes.
    pub fn new(angles: &Angles<'_>, grid: &Grid<'_>) -> Self {
        let (width, height) = (grid.width + 1, grid.height + 1);
        let (gaps, level) = (gaps(grid), best_level());
        let mut of_face = vec![0; width * height];
        of_face
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, row)| vectorised!(level, about(row, y, angles, grid)));
        // At the border and about holes these are the shares of a hole's charge.
        for face in border(width, height) {
            let share = std::mem::take(&mut of_face[face]);
            of_face[OUTSIDE] += share;
        }
        for gap in &gaps {
            for row in [gap.row, gap.row + 1] {
                let faces = &mut of_face[row * width..][gap.start..=gap.end];
                let share: i32 = faces.iter().sum();
                faces.fill(0);
                of_face[gap.hole as usize] += share;
            }
        }
        Self { of_face, gaps }
    }

    /// Whether all loops close.
    pub fn are_zero(&self) -> bool {
        self.of_face.iter().all(|charge| *charge == 0)
    }
}

impl Faces {
    /// Finds which faces are one.
    pub fn new(charges: Charges, grid: &Grid<'_>) -> Self {
        let (width, height) = (grid.width + 1, grid.height + 1);
        let Charges { of_face: charge, mut gaps } = charges;
        let mut hole: Vec<u32> = (0..(width * height) as u32).collect();
        for gap in &gaps {
            for row in [gap.row, gap.row + 1] {
                hole[row * width..][gap.start..=gap.end].fill(gap.hole);
            }
        }
        border(width, height).for_each(|face| hole[face] = OUTSIDE as u32);
        gaps.sort_by_key(|gap| gap.hole);
        Self { width, height, hole, open: open(grid), charge, gaps }
    }

    /// The faces on both sides of an edge by its [`Grid::edge`] number.
    pub fn sides(&self, number: u32) -> Sides {
        let (pixel, columns) = (number / 2, self.width as u32 - 1);
        // The face that touches the pixel at its lower right.
        let corner = (pixel + pixel / columns) as usize + self.width + 1;
        let hole = |face: usize| self.hole[face] as usize;
        if number.is_multiple_of(2) {
            Sides { plus: hole(corner), minus: hole(corner - self.width) }
        } else {
            Sides { plus: hole(corner - 1), minus: hole(corner) }
        }
    }

    /// Calls with the number of each edge about a face or, given its first face, about a hole; some come twice.
    pub fn edges(&self, face: usize, grid: &Grid<'_>, mut each: impl FnMut(u32)) {
        if self.open[face] {
            let pixel = (face / self.width - 1) * grid.width + face % self.width - 1;
            let (pixel, width) = (2 * pixel as u32, 2 * grid.width as u32);
            [pixel, pixel + 1, pixel + 3, pixel + width].into_iter().for_each(each);
            return;
        }
        let first = self.gaps.partition_point(|gap| (gap.hole as usize) < face);
        for gap in self.gaps[first..].iter().take_while(|gap| gap.hole as usize == face) {
            // Pixels from one before the gap to one behind it, in its row and in those beside it.
            for row in gap.row.saturating_sub(1)..(gap.row + 2).min(grid.height) {
                for column in gap.start.saturating_sub(1)..(gap.end + 1).min(grid.width) {
                    let pixel = row * grid.width + column;
                    if column < gap.end && grid.right(pixel).is_some() {
                        each(2 * pixel as u32);
                    }
                    if row <= gap.row && grid.down(pixel).is_some() {
                        each(2 * pixel as u32 + 1);
                    }
                }
            }
        }
    }
}

/// The runs of pixels that are not valid, row by row. Those that touch, be it at a corner, are one hole, and it is numbered by its
/// first face.
fn gaps(grid: &Grid<'_>) -> Vec<Gap> {
    let rows: Vec<Vec<Gap>> =
        grid.valid.par_chunks(grid.width).enumerate().map(|(y, v)| of_row(y, v)).collect();
    // The outside, then all gaps.
    let mut forest = Forest::new(1 + rows.iter().map(Vec::len).sum::<usize>());
    let mut first = 1;
    for (y, row) in rows.iter().enumerate() {
        for (gap, number) in row.iter().zip(first..) {
            if y == 0 || y + 1 == grid.height || gap.start == 0 || gap.end == grid.width {
                forest.join(0, number, 0);
            }
        }
        let below = rows.get(y + 1).map_or(&[][..], Vec::as_slice);
        let (mut a, mut b) = (0, 0);
        while let Some((upper, lower)) = row.get(a).zip(below.get(b)) {
            if upper.start <= lower.end && lower.start <= upper.end {
                forest.join(first + a, first + row.len() + b, 0);
            }
            if upper.end <= lower.end {
                a += 1;
            } else {
                b += 1;
            }
        }
        first += row.len();
    }
    let mut hole = vec![u32::MAX; first];
    hole[forest.find(0).0] = OUTSIDE as u32;
    let numbered = rows.into_iter().flatten().zip(1..).map(|(mut gap, number)| {
        let hole = &mut hole[forest.find(number).0];
        if *hole == u32::MAX {
            *hole = (gap.row * (grid.width + 1) + gap.start) as u32;
        }
        gap.hole = *hole;
        gap
    });
    numbered.collect()
}

fn of_row(row: usize, valid: &[bool]) -> Vec<Gap> {
    let gaps = runs(valid).filter(|(valid, _)| !valid);
    gaps.map(|(_, columns)| Gap { hole: 0, row, start: columns.start, end: columns.end }).collect()
}

/// Turns about each face of a row: clockwise, upper edges count to the right and right ones downwards, the others the other way.
#[inline(always)]
fn about(charge: &mut [i32], y: usize, angles: &Angles<'_>, grid: &Grid<'_>) {
    let row = |y: usize| {
        let pixels = y * grid.width..(y + 1) * grid.width;
        (&angles.turn[pixels.clone()], &angles.valid[pixels])
    };
    let (above, below) = (y.checked_sub(1).map(row), (y < grid.height).then(|| row(y)));
    let last = grid.width - 1;
    for ((turn, valid), sign) in
        [(above, 1), (below, -1)].into_iter().filter_map(|(row, sign)| row.zip(Some(sign)))
    {
        add(&mut charge[1..=last], sign, [&turn[..last], &turn[1..]], [&valid[..last], &valid[1..]]);
    }
    if let Some((above, below)) = above.zip(below) {
        add(&mut charge[..=last], 1, [above.0, below.0], [above.1, below.1]);
        add(&mut charge[1..], -1, [above.0, below.0], [above.1, below.1]);
    }
}

/// Adds the steps from pixels to others where both are valid.
#[inline(always)]
fn add(charge: &mut [i32], sign: i32, [from, to]: [&[u32]; 2], [one, other]: [&[bool]; 2]) {
    let pairs = from.iter().zip(to).zip(one.iter().zip(other));
    for (charge, ((a, b), (one, other))) in charge.iter_mut().zip(pairs) {
        *charge += sign * step(*a, *b) * i32::from(one & other);
    }
}

/// The faces at the border of the image.
fn border(width: usize, height: usize) -> impl Iterator<Item = usize> {
    let across = (0..width).flat_map(move |x| [x, (height - 1) * width + x]);
    across.chain((1..height - 1).flat_map(move |y| [y * width, y * width + width - 1]))
}

fn open(grid: &Grid<'_>) -> Vec<bool> {
    let width = grid.width + 1;
    let mut open = vec![false; width * (grid.height + 1)];
    // The first row and the last one stay closed.
    let inner =
        open.par_chunks_mut(width).skip(1).zip(grid.valid.par_windows(2 * grid.width).step_by(grid.width));
    inner.for_each(|(open, pixels)| {
        let (above, below) = pixels.split_at(grid.width);
        let left = above.iter().zip(below);
        let right = above[1..].iter().zip(&below[1..]);
        for (open, ((a, b), (c, d))) in open[1..].iter_mut().zip(left.zip(right)) {
            *open = a & b & c & d;
        }
    });
    open
}

//! The left pixels in the order of the rectified rows.

use super::report::PART_ROWS;
use crate::rectify::{Directions, RectifiedGrid, range};
use crate::surface::{LANES, Samples, SurfaceBuilder, taken};
use std::ops::Range;

/// First ordinate and number of the rectified rows that both views share; no rows where they share none.
pub(super) fn common_rows(left: &[[f64; 2]], right: &[[f64; 2]], focal_px: f64) -> (f64, usize) {
    let (Some(left), Some(right)) = (range(left, 1), range(right, 1)) else { return (0.0, 0) };
    let (low, high) = (left.0.max(right.0), left.1.min(right.1));
    if low > high { (0.0, 0) } else { (low, ((high - low) * focal_px).round() as usize + 1) }
}

/// Fewer neighbours in the image are worked on together with what follows.
const LEAST_BESIDE: usize = 4;

/// Added to the size of a group whose pixels are no neighbours.
const APART: u8 = 128;

/// The left pixels sorted by rectified row, along a row as they come in the image, in groups that are worked on side by side.
#[derive(Debug, Clone)]
pub(super) struct Order {
    /// First pixel of each group of neighbours in a row of the image; of the other groups, where their pixels begin in `apart`.
    firsts: Vec<u32>,
    /// How many pixels each group has, and [`APART`].
    sizes: Vec<u8>,
    /// The pixels that have too few neighbours.
    apart: Vec<u32>,
    /// Number of the first group of each row, and behind the last row of all groups.
    rows: Vec<usize>,
}

/// Some pixels that follow each other along a rectified row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group<'a> {
    /// So many pixels belong to it.
    pub count: usize,
    /// The first of these pixels.
    first: usize,
    /// All of them where they are no neighbours; empty where they, and as many behind them as fill the group, are neighbours in the image.
    apart: &'a [u32],
}

impl Order {
    /// Of pixels with these directions.
    pub fn new(directions: &[[f64; 2]], grid: &RectifiedGrid) -> Self {
        let (order, starts) = sorted(directions, grid);
        let mut all = Self { firsts: Vec::new(), sizes: Vec::new(), apart: Vec::new(), rows: vec![0] };
        for row in starts.windows(2) {
            let mut pixels = &order[row[0]..row[1]];
            while !pixels.is_empty() {
                pixels = all.take_group(pixels, directions.len());
            }
            all.rows.push(all.firsts.len());
        }
        all
    }

    /// Takes the first group from pixels in the order of a row; the image has `all` pixels.
    fn take_group<'a>(&mut self, pixels: &'a [u32], all: usize) -> &'a [u32] {
        let (first, most) = (pixels[0], pixels.len().min(LANES));
        let joined = |(place, pixel): &(usize, &u32)| **pixel - first == *place as u32;
        let beside = pixels[..most].iter().enumerate().take_while(joined).count();
        let apart = beside < LEAST_BESIDE;
        let count = if apart { most } else { beside };
        if apart || first as usize + LANES > all {
            self.firsts.push(self.apart.len() as u32);
            self.sizes.push(APART + count as u8);
            self.apart.extend(&pixels[..count]);
        } else {
            self.firsts.push(first);
            self.sizes.push(count as u8);
        }
        &pixels[count..]
    }

    /// Number of rectified rows.
    pub fn height(&self) -> usize {
        self.rows.len() - 1
    }

    /// Numbers of the groups of a row.
    pub fn groups(&self, row: usize) -> Range<usize> {
        self.rows[row]..self.rows[row + 1]
    }

    /// A group by its number.
    #[inline(always)]
    pub fn group(&self, number: usize) -> Group<'_> {
        let (first, size) = (self.firsts[number] as usize, self.sizes[number]);
        if size & APART == 0 {
            return Group { count: usize::from(size), first, apart: &[] };
        }
        let apart = &self.apart[first..first + usize::from(size - APART)];
        Group { count: apart.len(), first: apart[0] as usize, apart }
    }

    /// Number of the first group of each part of the rows, and of all groups.
    pub fn parts(&self) -> Vec<usize> {
        let firsts = (0..self.height()).step_by(PART_ROWS).map(|row| self.rows[row]);
        firsts.chain([self.firsts.len()]).collect()
    }

    /// Those of so many pixels that are in no row.
    pub fn others(&self, count: usize) -> Vec<u32> {
        let mut given = vec![false; count];
        for group in (0..self.firsts.len()).map(|number| self.group(number)) {
            (0..group.count).for_each(|l| given[group.pixel(l)] = true);
        }
        (0..count as u32).filter(|pixel| !given[*pixel as usize]).collect()
    }
}

impl Group<'_> {
    /// Its pixel at a place.
    #[inline(always)]
    pub fn pixel(&self, l: usize) -> usize {
        if self.apart.is_empty() { self.first + l } else { self.apart[l] as usize }
    }

    /// Places of its pixels, the last one again and again behind them.
    #[inline(always)]
    fn pixels(&self) -> [usize; LANES] {
        let mut pixels = [self.apart[self.count - 1] as usize; LANES];
        for (pixel, apart) in pixels.iter_mut().zip(self.apart) {
            *pixel = *apart as usize;
        }
        pixels
    }

    /// The values of its pixels, or of neighbours that fill it.
    #[inline(always)]
    pub fn values<T: Copy + Default>(&self, plane: &[T]) -> [T; LANES] {
        if self.apart.is_empty() {
            return taken(plane, self.first);
        }
        let (pixels, mut values) = (self.pixels(), [T::default(); LANES]);
        for l in 0..LANES {
            values[l] = plane[pixels[l]];
        }
        values
    }

    /// Directions of its pixels, x and y.
    #[inline(always)]
    pub fn directions(&self, directions: &Directions) -> [[f64; LANES]; 2] {
        if self.apart.is_empty() {
            return directions.along(self.first);
        }
        let (pixels, mut x, mut y) = (self.pixels(), [0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            [x[l], y[l]] = directions.at(pixels[l]);
        }
        [x, y]
    }

    /// Puts what was found of its pixels in their order.
    #[inline(always)]
    pub fn put(&self, surface: &mut SurfaceBuilder, samples: &Samples) {
        if self.apart.is_empty() && self.count == LANES {
            surface.put_beside(self.first, samples);
            return;
        }
        for l in 0..self.count {
            surface.put(self.pixel(l), &samples.at(l));
        }
    }
}

/// Left pixels sorted by rectified row (a counting sort, so in native order along a row), and where each row begins.
fn sorted(directions: &[[f64; 2]], grid: &RectifiedGrid) -> (Vec<u32>, Vec<usize>) {
    let row = |y: f64| {
        let row = ((y - grid.y0) * grid.focal_px).round();
        // NaN fails the comparison.
        (row >= 0.0 && row < grid.height as f64).then_some(row as usize)
    };
    let mut starts = vec![0_usize; grid.height + 1];
    for row in directions.iter().filter_map(|d| row(d[1])) {
        starts[row + 1] += 1;
    }
    for index in 0..grid.height {
        starts[index + 1] += starts[index];
    }
    let mut next = starts.clone();
    let mut order = vec![0; starts[grid.height]];
    for (pixel, direction) in directions.iter().enumerate() {
        if let Some(row) = row(direction[1]) {
            order[next[row]] = pixel as u32;
            next[row] += 1;
        }
    }
    (order, starts)
}

//! The left pixels in the order of the rectified rows.

use super::report::PART_ROWS;
use crate::rectify::{Directions, RectifiedGrid, range};
use crate::surface::{LANES, Samples, SurfaceBuilder, taken};

/// First ordinate and number of the rectified rows that both views share; no rows where they share none.
pub(super) fn common_rows(left: &[[f64; 2]], right: &[[f64; 2]], focal_px: f64) -> (f64, usize) {
    let (Some(left), Some(right)) = (range(left, 1), range(right, 1)) else { return (0.0, 0) };
    let (low, high) = (left.0.max(right.0), left.1.min(right.1));
    if low > high { (0.0, 0) } else { (low, ((high - low) * focal_px).round() as usize + 1) }
}

/// Left pixels sorted by rectified row (a counting sort, so in native order along a row), and where each row begins.
pub(super) fn order(directions: &[[f64; 2]], grid: &RectifiedGrid) -> (Vec<u32>, Vec<usize>) {
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

/// Those of so many pixels that are not among the given ones.
pub(super) fn others(pixels: &[u32], count: usize) -> Vec<u32> {
    let mut given = vec![false; count];
    for pixel in pixels {
        given[*pixel as usize] = true;
    }
    (0..count as u32).filter(|pixel| !given[*pixel as usize]).collect()
}

/// Fewer neighbours in the image are worked on together with what follows.
const LEAST_BESIDE: usize = 4;

/// Some pixels that follow each other along a rectified row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    /// So many; the others repeat the last one.
    pub count: usize,
    pub pixels: [u32; LANES],
    /// Whether they, and as many behind them as fill the group, are neighbours in a row of the image.
    pub beside: bool,
}

impl Group {
    /// The values of its pixels, or of neighbours that fill it.
    #[inline(always)]
    pub fn values<T: Copy + Default>(&self, plane: &[T]) -> [T; LANES] {
        if self.beside {
            return taken(plane, self.pixels[0] as usize);
        }
        let mut values = [T::default(); LANES];
        for l in 0..LANES {
            values[l] = plane[self.pixels[l] as usize];
        }
        values
    }

    /// Directions of its pixels, x and y.
    #[inline(always)]
    pub fn directions(&self, directions: &Directions) -> [[f64; LANES]; 2] {
        if self.beside {
            return directions.along(self.pixels[0] as usize);
        }
        let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            [x[l], y[l]] = directions.at(self.pixels[l] as usize);
        }
        [x, y]
    }

    /// Puts what was found of its pixels in their order.
    #[inline(always)]
    pub fn put(&self, surface: &mut SurfaceBuilder, samples: &Samples) {
        if self.beside && self.count == LANES {
            surface.put_beside(self.pixels[0] as usize, samples);
            return;
        }
        for l in 0..self.count {
            surface.put(self.pixels[l] as usize, &samples.at(l));
        }
    }
}

/// Takes the first group from pixels in the order of a row; `all` are the pixels of the image.
#[inline(always)]
pub(super) fn next_group(pixels: &[u32], all: usize) -> Option<(Group, &[u32])> {
    let (first, last) = (*pixels.first()?, pixels.len().min(LANES) - 1);
    let whole = last + 1 == LANES && pixels[last] - first == last as u32;
    let beside = if whole {
        LANES
    } else {
        let mut beside = 1;
        while beside <= last && pixels[beside] - first == beside as u32 {
            beside += 1;
        }
        beside
    };
    let apart = beside < LEAST_BESIDE;
    let count = if apart { last + 1 } else { beside.min(LANES) };
    let mut own = [pixels[count - 1]; LANES];
    own[..count].copy_from_slice(&pixels[..count]);
    let group = Group { count, pixels: own, beside: !apart && first as usize + LANES <= all };
    Some((group, &pixels[count..]))
}

/// Number of the first group of each part of the rows, and of all groups.
pub(super) fn parts(order: &[u32], row_starts: &[usize], all: usize) -> Vec<usize> {
    let (mut parts, mut count) = (vec![0], 0);
    let height = row_starts.len() - 1;
    for first in (0..height).step_by(PART_ROWS) {
        for row in first..(first + PART_ROWS).min(height) {
            let mut pixels = &order[row_starts[row]..row_starts[row + 1]];
            while let Some((_, rest)) = next_group(pixels, all) {
                (pixels, count) = (rest, count + 1);
            }
        }
        parts.push(count);
    }
    parts
}

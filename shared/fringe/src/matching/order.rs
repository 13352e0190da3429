//! The left pixels in the order of the rectified rows.

use crate::rectify::{RectifiedGrid, range};

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

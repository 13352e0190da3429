//! Whether a point has others around it, or is isolated.

use super::cells::{Cells, Found, distance2};
use super::grid::{Grid, is_finite};
use super::sites::Sites;
use crate::cloud::Point;
use std::ops::Range;

/// So many points before and behind a point in the list are looked at before the grid is asked.
const BESIDE: usize = 4;

/// Marks points that have so many others beside them in the list: their neighbours along the image row, as a rule. `keep`: a mark for each of
/// the points from `first` on.
pub(super) fn mark_beside(cloud: &[Point], first: usize, limit_mm2: f64, wanted: u32, keep: &mut [bool]) {
    let near = |index: usize, step: usize| {
        let both = cloud.get(index).zip(cloud.get(index.wrapping_add(step)));
        both.map_or(0, |(a, b)| u32::from(distance2(&a.position_mm, &b.position_mm) <= limit_mm2))
    };
    // Both ends of a distance use it: of the nearest and the next but one it is kept.
    let before = |step: usize| near(first.wrapping_sub(step), step);
    let (mut nearest, mut next) = (before(1), [before(2), near(first.wrapping_sub(1), 2)]);
    for (index, keep) in (first..).zip(keep) {
        let ahead = [near(index, 1), near(index, 2)];
        let mut count = nearest + next[0] + ahead[0] + ahead[1];
        (nearest, next) = (ahead[0], [next[1], ahead[1]]);
        for step in 3..=BESIDE {
            if count >= wanted {
                break;
            }
            count += near(index.wrapping_sub(step), step) + near(index, step);
        }
        *keep = count >= wanted && is_finite(&cloud[index]);
    }
}

/// Whether a point has so many others, of any cloud, around it; its own cloud is asked first.
pub(super) fn has_around(
    (per_cloud, own): (&[Cells], usize),
    grid: &Grid,
    point: &Point,
    found: &mut Found,
    (limit_mm2, wanted): (f64, u32),
) -> bool {
    let mut count = 0;
    let mut enough = |sites: &Sites, run: Range<usize>| {
        for site in run {
            count += u32::from(distance2(&sites.position_mm(site), &point.position_mm) <= limit_mm2);
            // The point finds itself.
            if count > wanted {
                return true;
            }
        }
        false
    };
    let mut others = per_cloud[..own].iter().chain(&per_cloud[own + 1..]);
    per_cloud[own].around(grid, &point.position_mm, found, &mut enough)
        || others.any(|cells| cells.around(grid, &point.position_mm, &mut Found::default(), &mut enough))
}

//! Whether a point has others around it, or is isolated.

use super::cells::{Cells, Found, distance2};
use super::grid::{Grid, is_finite};
use super::sites::Sites;
use crate::cloud::Point;
use std::ops::Range;

/// So many points before and behind a point in the list are looked at before the grid is asked.
const BESIDE: usize = 4;

/// Whether a point has so many others beside it in the list: its neighbours along the image row, as a rule.
pub(super) fn has_beside(cloud: &[Point], index: usize, limit_mm2: f64, wanted: u32) -> bool {
    let place = &cloud[index].position_mm;
    let near = |other: usize| {
        cloud.get(other).map_or(0, |o| u32::from(distance2(&o.position_mm, place) <= limit_mm2))
    };
    let mut count = 0;
    for step in 1..=BESIDE {
        if count >= wanted {
            break;
        }
        count += near(index.wrapping_sub(step)) + near(index + step);
    }
    count >= wanted && is_finite(&cloud[index])
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

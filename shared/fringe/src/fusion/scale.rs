//! What neighbours are searched with: it comes from the first cloud that tells it, so that it is known before the others exist.

use super::buffers::clear_and_reserve;
use super::cells::distance2;
use super::grid::is_finite;
use super::{FusionSettings, count};
use crate::cloud::Point;

/// The radius over the spacing of the points, when the settings give none: a disc of about 28 points.
const RADIUS_PER_SPACING: f64 = 3.0;

/// Pairs of pixel neighbours that are sampled for the spacing, and how many of them are enough to know that of a cloud.
const SAMPLES: usize = 4096;
const ENOUGH: usize = 64;

/// The radius of a neighbourhood, and a point in the middle of a cell of the search.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Scale {
    pub radius_mm: f64,
    pub origin_mm: [f64; 3],
}

impl Scale {
    /// As the first clouds tell it: a point of the first one that has any, and the radius of the settings, or else of the first one with
    /// enough neighbours. `None` where they do not. `spacings`: memory.
    pub fn of_first(clouds: &[&[Point]], settings: &FusionSettings, spacings: &mut Vec<f64>) -> Option<Self> {
        let origin_mm = first_place(clouds)?;
        let given = settings.radius_mm.filter(|radius| *radius > 0.0);
        let mut of_cloud = |cloud| spacing(&[cloud], ENOUGH, spacings);
        let found = || clouds.iter().copied().find_map(&mut of_cloud).map(|mm| RADIUS_PER_SPACING * mm);
        Some(Self { radius_mm: given.or_else(found)?, origin_mm })
    }

    /// From the neighbours of all clouds together, however few there are; 1 mm where there are none. `None` where no cloud has a point.
    pub fn of_all(clouds: &[&[Point]], spacings: &mut Vec<f64>) -> Option<Self> {
        let origin_mm = first_place(clouds)?;
        let radius_mm = spacing(clouds, 1, spacings).map_or(1.0, |mm| RADIUS_PER_SPACING * mm);
        Some(Self { radius_mm, origin_mm })
    }
}

fn first_place(clouds: &[&[Point]]) -> Option<[f64; 3]> {
    clouds.iter().find_map(|cloud| cloud.iter().find(|point| is_finite(point))).map(|point| point.position_mm)
}

/// Median distance of row neighbours, sampled evenly, mm; `None` where there are fewer than so many, or most coincide.
fn spacing(clouds: &[&[Point]], fewest: usize, spacings: &mut Vec<f64>) -> Option<f64> {
    let stride = (count(clouds) / SAMPLES).max(1);
    clear_and_reserve(spacings, count(clouds) / stride + clouds.len());
    for cloud in clouds {
        let neighbours =
            cloud.windows(2).step_by(stride).filter(|w| w[1].pixel == w[0].pixel.wrapping_add(1));
        let distances = neighbours.map(|w| distance2(&w[0].position_mm, &w[1].position_mm).sqrt());
        spacings.extend(distances.filter(|d| d.is_finite()));
    }
    spacings.sort_unstable_by(f64::total_cmp);
    let median = spacings.get(spacings.len() / 2).copied().filter(|d| *d > 0.0);
    median.filter(|_| spacings.len() >= fewest)
}

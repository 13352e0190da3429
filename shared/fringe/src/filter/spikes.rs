//! Spikes and dips found with Sobel's kernels (thesis section 3.1.3.3).
//!
//! A spike of height d adds d/4 to the slope that Sobel's kernel gives at its left neighbour and takes d/4 from that at the right one;
//! likewise above and below. So d = 2 (Gₗ − Gᵣ) along both axes, and the slope of the surface cancels. An edge gives that
//! along one axis only. The corner of a step gives it along both, but has three neighbours of its own height.

use super::{FilterReport, value};
use crate::math::statistics::median;
use crate::phase::PhaseMap;
use rayon::prelude::*;
use std::f32::consts::{FRAC_PI_4, TAU};

/// A spike may have this many neighbours of its own height: two wrong pixels side by side.
const MOST_EQUALS: usize = 1;

/// Fewest neighbours that can say what a pixel should be.
const LEAST_NEIGHBOURS: usize = 4;

/// What to do with a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Verdict {
    Keep,
    Turn(f32),
    Mask,
}

/// Corrects or masks all spikes at once: each is compared with the map before the correction.
pub fn remove(map: &mut PhaseMap, height_rad: f32) -> FilterReport {
    let width = map.info.width_px as usize;
    let mut verdicts = vec![Verdict::Keep; map.info.len()];
    let before = &*map;
    verdicts.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, verdict) in row.iter_mut().enumerate() {
            *verdict = classify(before, x as i64, y as i64, height_rad);
        }
    });
    let mut report = FilterReport::default();
    for (i, verdict) in verdicts.into_iter().enumerate() {
        match verdict {
            Verdict::Keep => {}
            Verdict::Turn(turns) => {
                map.phase_rad[i] -= turns * TAU;
                report.corrected += 1;
            }
            Verdict::Mask => {
                map.valid[i] = 0;
                map.phase_rad[i] = f32::NAN;
                map.sigma_rad[i] = f32::NAN;
                report.masked += 1;
            }
        }
    }
    report
}

fn classify(map: &PhaseMap, x: i64, y: i64, height_rad: f32) -> Verdict {
    let Some(centre) = value(map, x, y) else { return Verdict::Keep };
    // Most pixels end here: none of the four next to them is far off.
    let far = |other: Option<f32>| other.is_some_and(|other| (other - centre).abs() > 0.5 * height_rad);
    if ![(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().any(|(dx, dy)| far(value(map, x + dx, y + dy))) {
        return Verdict::Keep;
    }
    let along = |dx: i64, dy: i64| {
        let before = sobel(map, x - dx, y - dy, dx == 1)?;
        let after = sobel(map, x + dx, y + dy, dx == 1)?;
        Some(2.0 * (before - after))
    };
    let Some((height_x, height_y)) = along(1, 0).zip(along(0, 1)) else { return Verdict::Keep };
    if height_x * height_y <= 0.0 || height_x.abs().min(height_y.abs()) < height_rad {
        return Verdict::Keep;
    }
    let mut around: Vec<f32> = (-1..=1)
        .flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)))
        .filter(|offset| *offset != (0, 0))
        .filter_map(|(dx, dy)| value(map, x + dx, y + dy))
        .collect();
    let equals = around.iter().filter(|other| (**other - centre).abs() < 0.5 * height_rad).count();
    if around.len() < LEAST_NEIGHBOURS || equals > MOST_EQUALS {
        return Verdict::Keep;
    }
    let off = centre - median(&mut around).unwrap_or(centre);
    let turns = (off / TAU).round();
    if turns != 0.0 && (off - turns * TAU).abs() < FRAC_PI_4 { Verdict::Turn(turns) } else { Verdict::Mask }
}

/// Sobel's slope along x or y, rad per px: central differences of three rows, weighted 1, 2, 1. Rows that lack a pixel are left
/// out; `None` without the middle one.
fn sobel(map: &PhaseMap, x: i64, y: i64, along_x: bool) -> Option<f32> {
    let difference = |side: i64| {
        let (before, after) = if along_x {
            ((x - 1, y + side), (x + 1, y + side))
        } else {
            ((x + side, y - 1), (x + side, y + 1))
        };
        Some((value(map, after.0, after.1)? - value(map, before.0, before.1)?) / 2.0)
    };
    let (mut sum, mut weights) = (2.0 * difference(0)?, 2.0);
    for slope in [difference(-1), difference(1)].into_iter().flatten() {
        sum += slope;
        weights += 1.0;
    }
    Some(sum / weights)
}

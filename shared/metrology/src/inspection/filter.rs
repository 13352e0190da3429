//! Filtration of a flatness.
//!
//! The range of single points grows with their noise and their number, so it does not measure the form. GPS evaluates
//! flatness after filtration with a stated nesting index (ISO 12781-1, -2). Here the filter is the area mean: the
//! plane is laid out in squares of the nesting index e, and the surface is the mean deviation in each. A wave of
//! length λ along an edge passes by sinc(e/λ): nothing at λ = e, half at 1.66 e (where a Gaussian filter of that
//! cut-off passes half), 0.99 at 13 e.
//!
//! The reference plane is the least-squares plane of the means, each of which weighs the same: that of the points would
//! tilt a bent surface towards where two views overlap.
//!
//! All points count, those too that the plane's fit rejected: a dent must not be filtered out by its own depth.
//!
//! Noise of the means: in a block of 2 × 2 neighbouring cells, m₀₀ − m₀₁ − m₁₀ + m₁₁ holds no offset, no slope and no
//! curvature along the edges, but the noise of four means, correlation within a cell included. Its squares over all
//! blocks, against Σ Σσᵢ²/n² of the points behind with their stated uncertainties σᵢ, give the factor by which means scatter more than
//! means of independent points. Without σᵢ the cells that scatter most, of which the range is made, would pass for average ones. What
//! is correlated over more than a cell cannot be separated from form and counts as form.

use fringe::math::statistics::median;
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::MeasureError;
use super::result::FlatnessFilter;
use crate::counted_order::counted_order;
use fringe::math;

/// Fewest points of each quarter of a cell: in parts of the median over cells (of a quarter's share, a quarter), and
/// absolutely. Where one of two pairs is shadowed half of the points are left. A cell that a shadow or the border cuts
/// has an empty side: its mean would belong to another place, and points at the edge of a shadow are biased.
const MEDIAN_PART: usize = 16;
const LEAST_POINTS: usize = 2;

/// Fewest blocks from which noise is stated: overlapping blocks are worth about half as many independent ones, so 16
/// give the standard deviation to about a quarter.
const FEWEST_BLOCKS: usize = 16;

/// A stated uncertainty counts as no more and no less than this part of the median: a single wrong one must not decide.
const SIGMA_RATIO: f64 = 4.0;

/// Points that a thread takes at least.
const BRANCH: usize = 8192;

/// Cells that are taken as equally uncertain when the range of noise is computed: neighbours in the order of their variances.
const ALIKE: usize = 8;

const DEFINITION: &str = "highest less lowest mean distance over squares of edge filter_mm, about the least-squares \
    plane of these means; all points of the element count; squares with fewer than fewest_points points in one of their quarters are \
    left out; noise is not subtracted";

/// Flatness range after the filter.
#[derive(Debug, Clone)]
pub struct Filtered {
    /// Highest less lowest cell mean, mm.
    pub range_mm: f64,
    /// Its standard uncertainty from noise, mm.
    pub u_mm: f64,
    /// What the filter did, for the result.
    pub report: FlatnessFilter,
}

/// A point of a plane.
#[derive(Debug, Clone, Copy)]
pub struct Across {
    /// Place along the element's two directions from its nominal point, mm.
    pub place_mm: [f64; 2],
    /// Standard uncertainty that the cloud states, mm; not positive where it states none.
    pub sigma_mm: f32,
}

/// A square of the grid.
#[derive(Debug, Clone, Copy)]
struct Cell {
    key: [i64; 2],
    points: usize,
    /// Points of the quarter that has fewest.
    fewest: usize,
    /// Mean place of the points, mm.
    across_mm: Vector2<f64>,
    /// Mean deviation in the cell, mm.
    mean_mm: f64,
    /// Variance of the mean of independent points, mm²; in other units where the cloud states no uncertainties.
    independent: f64,
}

/// Filters the deviations of points at places in the plane, by squares of edge `filter_mm` with corners at whole
/// multiples of it.
///
/// Noise raises a range: on a perfect plane by all of `noise_range_mm`, on a form far above the noise by next to
/// nothing. Which share it is depends on the form, so nothing is subtracted; the uncertainty holds the whole of it,
/// the scatter of the two extreme means, and that of the plane's tilt between them.
///
/// # Errors
/// Too few cells side by side.
pub fn filtered(across: &[Across], deviation_mm: &[f64], filter_mm: f64) -> Result<Filtered, MeasureError> {
    let all = cells(across, deviation_mm, filter_mm);
    let fewest_points = (median_points(&all).div_ceil(MEDIAN_PART)).max(LEAST_POINTS);
    let mut kept: Vec<Cell> = all.iter().copied().filter(|c| c.fewest >= fewest_points).collect();
    let (factor, blocks) = noise_factor(&kept);
    let tilt = if blocks < FEWEST_BLOCKS { None } else { level(&mut kept) };
    let (Some(tilt), Some(low), Some(high)) = (tilt, extreme(&kept, -1.0), extreme(&kept, 1.0)) else {
        let cells = kept.len();
        return Err(MeasureError::FilteredAway {
            filter_mm,
            cells,
            fewest_points,
            blocks,
            needs: FEWEST_BLOCKS,
        });
    };
    let of_mean = |cell: &Cell| factor * cell.independent;
    let noise_range_mm = noise_range_mm(kept.iter().map(of_mean).collect());
    let mean_variance = kept.iter().map(of_mean).sum::<f64>() / kept.len() as f64;
    let arm = high.across_mm - low.across_mm;
    let of_tilt = mean_variance * (tilt * arm).dot(&arm);
    let inside: usize = kept.iter().map(|c| c.points).sum();
    Ok(Filtered {
        range_mm: high.mean_mm - low.mean_mm,
        u_mm: (noise_range_mm * noise_range_mm + of_mean(&low) + of_mean(&high) + of_tilt).sqrt(),
        report: FlatnessFilter {
            definition: DEFINITION.into(),
            filter_mm,
            cells: kept.len(),
            cells_left_out: all.len() - kept.len(),
            points_left_out: all.iter().map(|c| c.points).sum::<usize>() - inside,
            fewest_points,
            u_cell_mm: mean_variance.sqrt(),
            noise_range_mm,
        },
    })
}

/// Takes the means' least-squares plane off them. Gives the cofactors of its two slopes, 1/mm²; `None` when the cells
/// lie on a line.
fn level(cells: &mut [Cell]) -> Option<Matrix2<f64>> {
    let count = cells.len() as f64;
    let centre = cells.iter().map(|c| c.across_mm).sum::<Vector2<f64>>() / count;
    let mean_mm = cells.iter().map(|c| c.mean_mm).sum::<f64>() / count;
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for cell in cells.iter() {
        let arm = cell.across_mm - centre;
        normal += arm * arm.transpose();
        right += arm * (cell.mean_mm - mean_mm);
    }
    let inverse = normal.try_inverse()?;
    let slope = inverse * right;
    for cell in cells {
        cell.mean_mm -= mean_mm + slope.dot(&(cell.across_mm - centre));
    }
    Some(inverse)
}

/// The squares that hold points, in the order of their keys; sums in the order of the points.
fn cells(across: &[Across], deviation_mm: &[f64], filter_mm: f64) -> Vec<Cell> {
    // A quotient beyond the integers ends at their border: such a cell is too small to hold enough points anyway.
    let half = |p: f64| {
        let quotient = (2.0 * p / filter_mm).clamp(-1e15, 1e15);
        // The floor, without the call that it is on plain processors.
        quotient as i64 - i64::from(quotient < (quotient as i64) as f64)
    };
    let key = |halves: &[i64; 2]| halves.map(|h| h.div_euclid(2));
    let quarter = |halves: &[i64; 2]| halves.iter().fold(0, |q, h| 2 * q + h.rem_euclid(2) as usize);
    let numbered = across.par_iter().with_min_len(BRANCH).zip(deviation_mm);
    let halves: Vec<[i64; 2]> = numbered.map(|(p, _)| p.place_mm.map(half)).collect();
    let (order, variance) = rayon::join(|| ordered(&halves, key), || variances(across));
    let groups = order.chunk_by(|a, b| key(&halves[*a as usize]) == key(&halves[*b as usize]));
    let groups: Vec<&[u32]> = groups.collect();
    groups
        .into_par_iter()
        .map(|group| {
            let members = || group.iter().map(|i| *i as usize);
            let count = group.len() as f64;
            let sum: f64 = members().map(|i| deviation_mm[i]).sum();
            let places: Vector2<f64> = members().map(|i| Vector2::from(across[i].place_mm)).sum();
            let mut quarters = [0; 4];
            members().for_each(|i| quarters[quarter(&halves[i])] += 1);
            let fewest = quarters.into_iter().min().unwrap_or(0);
            Cell {
                key: key(&halves[group[0] as usize]),
                points: group.len(),
                fewest,
                across_mm: places / count,
                mean_mm: sum / count,
                independent: members().map(|i| variance(&across[i])).sum::<f64>() / (count * count),
            }
        })
        .collect()
}

/// Variance that a point states, mm²; one for all where any states none.
fn variances(across: &[Across]) -> impl Fn(&Across) -> f64 {
    let stated = across.iter().all(|p| p.sigma_mm > 0.0 && p.sigma_mm.is_finite());
    let mut sigmas: Vec<f32> = across.iter().map(|p| p.sigma_mm).collect();
    let middle = median(&mut sigmas).filter(|_| stated).map(f64::from);
    move |point| {
        middle.map_or(1.0, |middle| {
            let sigma = f64::from(point.sigma_mm).clamp(middle / SIGMA_RATIO, middle * SIGMA_RATIO);
            sigma * sigma
        })
    }
}

/// Points in the order of their squares, those of a square in their own order: counted where the squares are few, sorted
/// otherwise.
fn ordered(halves: &[[i64; 2]], key: impl Fn(&[i64; 2]) -> [i64; 2]) -> Vec<u32> {
    let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
    for key in halves.iter().map(&key) {
        for axis in 0..2 {
            (low[axis], high[axis]) = (low[axis].min(key[axis]), high[axis].max(key[axis]));
        }
    }
    let [rows, columns] =
        [0, 1].map(|axis| high[axis].saturating_sub(low[axis]).saturating_add(1).max(0) as usize);
    let squares = rows.saturating_mul(columns);
    if squares > 1024 + 4 * halves.len() {
        let mut order: Vec<u32> = (0..halves.len() as u32).collect();
        order.sort_unstable_by_key(|i| (key(&halves[*i as usize]), *i));
        return order;
    }
    let square = |halves: &[i64; 2]| {
        let key = key(halves);
        ((key[0] - low[0]) as usize * columns + (key[1] - low[1]) as usize) as u32
    };
    counted_order(&halves.iter().map(square).collect::<Vec<u32>>(), squares)
}

/// Median of the points of a cell; 0 without cells.
fn median_points(cells: &[Cell]) -> usize {
    let mut counts: Vec<usize> = cells.iter().map(|c| c.points).collect();
    median(&mut counts).unwrap_or(0)
}

/// The first cell of largest `sign` · mean.
fn extreme(cells: &[Cell], sign: f64) -> Option<Cell> {
    let larger = |a: Cell, b: &Cell| if sign * b.mean_mm > sign * a.mean_mm { *b } else { a };
    cells.split_first().map(|(first, rest)| rest.iter().fold(*first, larger))
}

/// Variance of a mean over that of independent points, and the number of blocks it rests on.
fn noise_factor(cells: &[Cell]) -> (f64, usize) {
    let find = |key: [i64; 2]| cells.binary_search_by_key(&key, |c| c.key).ok().map(|i| &cells[i]);
    let (mut squares, mut weights, mut blocks) = (0.0, 0.0, 0);
    for corner in cells {
        let [i, j] = corner.key;
        let (Some(a), Some(b), Some(c)) = (find([i, j + 1]), find([i + 1, j]), find([i + 1, j + 1])) else {
            continue;
        };
        let twist = corner.mean_mm - a.mean_mm - b.mean_mm + c.mean_mm;
        squares += twist * twist;
        weights += [corner, a, b, c].iter().map(|cell| cell.independent).sum::<f64>();
        blocks += 1;
    }
    (if blocks == 0 { 0.0 } else { squares / weights }, blocks)
}

/// Expected range of independent normal values of these variances about zero, mm.
///
/// Twice the expected maximum, ∫ (1 − Π Φ(x/σ)) dx from zero: below it the product of 25 or more factors under one half
/// adds less than 1e-7 σ. The integrand leaves 1 and reaches 0 flat, so the trapezoidal rule is as good as exact.
fn noise_range_mm(mut variances: Vec<f64>) -> f64 {
    const STEPS_PER_SIGMA: f64 = 10.0;
    const SIGMAS: usize = 9;
    variances.sort_unstable_by(|a, b| b.total_cmp(a));
    let alike = |group: &[f64]| ((group.iter().sum::<f64>() / group.len() as f64).sqrt(), group.len() as f64);
    let groups: Vec<(f64, f64)> = variances.chunks(ALIKE).map(alike).collect();
    let Some((largest_mm, _)) = groups.first().filter(|g| g.0 > 0.0) else { return 0.0 };
    let step_mm = largest_mm / STEPS_PER_SIGMA;
    let exceeded = |x_mm: f64| {
        let below = |(sigma_mm, count): &(f64, f64)| {
            let upper_tail = 0.5 * math::erfc(x_mm / (sigma_mm * std::f64::consts::SQRT_2));
            math::pow(1.0 - upper_tail, *count)
        };
        1.0 - groups.iter().map(below).product::<f64>()
    };
    let steps = SIGMAS * STEPS_PER_SIGMA as usize;
    let inner: Vec<f64> = (1..steps).into_par_iter().map(|i| exceeded(i as f64 * step_mm)).collect();
    2.0 * step_mm * (0.5 * exceeded(0.0) + inner.iter().sum::<f64>())
}

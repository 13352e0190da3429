//! The footprint of a camera's pixels from the blur of straight edges.
//!
//! An edge whose normal is n is blurred by σ² = σx² n_x² + σy² n_y²: edges of two directions tell both. A pixel's area is part of it.

use crate::target::BlurredEdge;
use fringe::math::statistics::{SIGMA_OF_MEDIAN, median};
use fringe::sensor::{Footprint, MEAN_FIELD};

/// Edges farther from the model than so many robust standard deviations belong to something else: dirt, a shadow.
const OUTLIER: f64 = 3.5;
/// Fewer edges than this give no footprint.
const LEAST_EDGES: usize = 40;
/// What the shape of a real point spread leaves open where two parameters describe it, px: up to 0.004 px for a discrete Gaussian.
const SHAPE_U_PX: f64 = 0.004;
/// The same of tails, as a part of the footprint for each unit of the excess found: where a tenth of the light has a second Gaussian of twice
/// the width, an excess of 0.4 is found and a footprint that is too small by 2 to 3 %.
const TAILS_PART: f64 = 0.06;
/// Least spread of directions that tells x from y: the determinant of the mean of (n_x², n_y²) pairs; 1/4 for edges along both axes.
const LEAST_SPREAD: f64 = 2e-3;
/// A trend over the field counts from so many standard uncertainties on.
const TREND: f64 = 2.0;
/// One from side to side, which no lens should have, from so many.
const ACROSS: f64 = 4.0;

/// A footprint with what it rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootprintEstimate {
    /// Standard deviations along x and y as the mean over the picture with their uncertainties, and the change over the picture where
    /// the edges tell it.
    pub footprint: Footprint,
    /// Edges that were used.
    pub edges: usize,
    /// Median excess of their line spreads: 0 of a Gaussian, positive with tails.
    pub excess: f64,
    /// Change of the variance from one side of the picture to the other, px², where it is more than the middle and the corner can show: it is part of
    /// the uncertainties.
    pub across_px2: Option<f64>,
}

/// An edge as the model sees it.
#[derive(Debug, Clone, Copy)]
struct Reading {
    /// Squares of the normal's components.
    along: [f64; 2],
    variance_px2: f64,
    /// Variance of the former.
    noise_px4: f64,
    excess: f64,
    /// Squared distance from the middle of the picture over that of the corner.
    field: f64,
    /// Place in the picture, from −1 to 1 along both sides.
    place: [f64; 2],
    view: usize,
}

/// The footprint of a camera of so many pixels from edges, view by view; `None` from too few.
pub fn footprint(views: &[Vec<BlurredEdge>], size_px: [u32; 2]) -> Option<FootprintEstimate> {
    let middle = size_px.map(|length| 0.5 * (f64::from(length) - 1.0));
    let corner2 = middle[0] * middle[0] + middle[1] * middle[1];
    let reading = |view: usize, edge: &BlurredEdge| {
        let along = [edge.normal.x * edge.normal.x, edge.normal.y * edge.normal.y];
        let seen_px2 = edge.sigma_px * edge.sigma_px;
        let (x, y) = (edge.pixel.x - middle[0], edge.pixel.y - middle[1]);
        Reading {
            along,
            variance_px2: seen_px2,
            noise_px4: 4.0 * seen_px2 * edge.u_px * edge.u_px,
            excess: edge.excess,
            field: (x * x + y * y) / corner2,
            place: [x / middle[0].max(1.0), y / middle[1].max(1.0)],
            view,
        }
    };
    let all = views.iter().enumerate().flat_map(|(view, edges)| edges.iter().map(move |e| reading(view, e)));
    let all: Vec<Reading> = all.filter(|r| r.variance_px2.is_finite() && r.noise_px4.is_finite()).collect();
    let kept = robust(all)?;
    let best = solve(kept.iter())?;
    let u_px2 = uncertainties(&kept, views.len(), best)?;
    let trend = trend(&kept, views.len(), best);
    let across_px2 = across(&kept, views.len(), best, trend);
    // The mean over the picture, of which the edges see a part.
    let mean = best.map(|variance| variance + trend.field_px2 * (MEAN_FIELD - trend.seen));
    let sigma_px = mean.map(|variance| variance.max(0.0).sqrt());
    let mut footprint = Footprint { sigma_px, u_px: None, field_px2: trend.field_px2 };
    let ends = [0.0, 1.0].map(|field| footprint.variances_at_px2(field));
    // What changes by a from side to side is off by a/√12 in the mean over the picture.
    let u_across_px2 = across_px2.map_or(0.0, |across| across / 12.0_f64.sqrt());
    let mut u_field_px2 = trend.u_px2;
    if ends.as_flattened().iter().any(|variance| *variance < 0.0) {
        // No parabola over the whole picture: what it changes by is uncertainty.
        u_field_px2 = trend.u_px2.max(trend.field_px2.abs() * trend.spread);
        footprint = Footprint { sigma_px: best.map(|v| v.max(0.0).sqrt()), u_px: None, field_px2: 0.0 };
    }
    let excess = median(&mut kept.iter().map(|r| r.excess).collect::<Vec<f64>>()).unwrap_or(0.0);
    let u = [0, 1].map(|axis| {
        let sigma = footprint.sigma_px[axis].max(1e-3);
        let squares = u_px2[axis] * u_px2[axis] + u_field_px2 * u_field_px2 + u_across_px2 * u_across_px2;
        let by_sigma = squares.sqrt() / (2.0 * sigma);
        let tails = TAILS_PART * excess.max(0.0) * sigma;
        (by_sigma * by_sigma + SHAPE_U_PX * SHAPE_U_PX + tails * tails).sqrt()
    });
    footprint.u_px = Some(u);
    Some(FootprintEstimate { footprint, edges: kept.len(), excess, across_px2 })
}

/// Without what is far from the model.
fn robust(mut kept: Vec<Reading>) -> Option<Vec<Reading>> {
    for _ in 0..4 {
        let best = solve(kept.iter())?;
        let mut sizes: Vec<f64> = kept.iter().map(|r| residual(r, best).abs()).collect();
        let limit = OUTLIER * SIGMA_OF_MEDIAN * median(&mut sizes)?;
        let before = kept.len();
        kept.retain(|r| residual(r, best).abs() <= limit.max(1e-9));
        if kept.len() == before {
            break;
        }
    }
    (kept.len() >= LEAST_EDGES).then_some(kept)
}

/// What the model leaves of an edge.
fn residual(r: &Reading, [x, y]: [f64; 2]) -> f64 {
    r.variance_px2 - x * r.along[0] - y * r.along[1]
}

/// σx² and σy² by least squares; one value for both where the edges do not tell them apart.
fn solve<'a>(readings: impl Iterator<Item = &'a Reading>) -> Option<[f64; 2]> {
    let (mut xx, mut xy, mut yy, mut xv, mut yv, mut weight, mut v) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for r in readings {
        // The scatter from edge to edge (print, light, focus) is of the order of the best edges' noise.
        let w = 1.0 / (r.noise_px4 + 1e-4);
        let [a, b] = r.along;
        xx += w * a * a;
        xy += w * a * b;
        yy += w * b * b;
        xv += w * a * r.variance_px2;
        yv += w * b * r.variance_px2;
        weight += w;
        v += w * r.variance_px2;
    }
    if weight <= 0.0 {
        return None;
    }
    let determinant = xx * yy - xy * xy;
    if determinant < LEAST_SPREAD * weight * weight {
        return Some([v / weight; 2]);
    }
    Some([(yy * xv - xy * yv) / determinant, (xx * yv - xy * xv) / determinant])
}

/// Standard uncertainties of σx² and σy²: by leaving out views; of one or two only the scatter of the edges is known, and what they share counts three
/// times.
fn uncertainties(kept: &[Reading], views: usize, best: [f64; 2]) -> Option<[f64; 2]> {
    let without = |view: usize| solve(kept.iter().filter(|r| r.view != view));
    jackknife(kept, views, best, without).or_else(|| {
        let scatter = kept.iter().map(|r| residual(r, best).powi(2)).sum::<f64>() / (kept.len() as f64 - 2.0);
        scatter.is_finite().then(|| [3.0 * (2.0 * scatter / kept.len() as f64).sqrt(); 2])
    })
}

/// Standard uncertainties of fitted values by leaving out one view after the other: edges of a view share its focus and its light. `None` with fewer than
/// three views.
fn jackknife<const N: usize>(
    kept: &[Reading],
    views: usize,
    best: [f64; N],
    without: impl Fn(usize) -> Option<[f64; N]>,
) -> Option<[f64; N]> {
    let shown = (0..views).filter(|view| kept.iter().any(|r| r.view == *view));
    let left_out: Vec<[f64; N]> = shown.filter_map(without).collect();
    let n = left_out.len() as f64;
    let squares = |k: usize| left_out.iter().map(|other| (other[k] - best[k]).powi(2)).sum::<f64>();
    (left_out.len() >= 3).then(|| std::array::from_fn(|k| (squares(k) * (n - 1.0) / n).sqrt()))
}

/// How the footprint changes over the picture.
#[derive(Debug, Clone, Copy)]
struct Trend {
    /// Change of the variance from the middle to the corner, px²; 0 where none was found.
    field_px2: f64,
    /// Standard uncertainty of the mean over the picture that comes from the change, px².
    u_px2: f64,
    /// Mean of the edges' places, as squared distance from the middle over that of the corner.
    seen: f64,
    /// Standard deviation of the same.
    spread: f64,
}

/// The straight line of the variance against the squared distance from the middle.
fn trend(kept: &[Reading], views: usize, best: [f64; 2]) -> Trend {
    let n = kept.len() as f64;
    let mean = kept.iter().map(|r| r.field).sum::<f64>() / n;
    let spread = kept.iter().map(|r| (r.field - mean).powi(2)).sum::<f64>() / n;
    let none = Trend { field_px2: 0.0, u_px2: 0.0, seen: mean, spread: spread.sqrt() };
    match slope(kept, views, |r| (r.field, residual(r, best))) {
        Some((slope, u)) if slope.abs() > TREND * u => {
            Trend { field_px2: slope, u_px2: u * (MEAN_FIELD - mean).abs().max(none.spread), ..none }
        }
        _ => none,
    }
}

/// The change of the variance from one side of the picture to the other that is left beside the trend, px²; `None` where noise explains it.
fn across(kept: &[Reading], views: usize, best: [f64; 2], trend: Trend) -> Option<f64> {
    let left = |r: &Reading| residual(r, best) - trend.field_px2 * (r.field - trend.seen);
    let clear = |axis: usize| {
        let found = slope(kept, views, |r| (r.place[axis], left(r)));
        found.filter(|(slope, u)| slope.abs() > ACROSS * u).map_or(0.0, |(slope, _)| 2.0 * slope)
    };
    let [x, y] = [0, 1].map(clear);
    let both = (x * x + y * y).sqrt();
    (both > 0.0).then_some(both)
}

/// Slope of the second value of each edge against the first, with its standard uncertainty: by the scatter of the edges, or by leaving out one view
/// after the other where that is more, since edges of a view share its focus. `None` where the first hardly differs.
fn slope(kept: &[Reading], views: usize, values: impl Fn(&Reading) -> (f64, f64)) -> Option<(f64, f64)> {
    let fit = |without: Option<usize>| {
        let pairs = || kept.iter().filter(|r| Some(r.view) != without).map(&values);
        let n = pairs().count() as f64;
        let mean = pairs().fold([0.0; 2], |sum, (x, y)| [sum[0] + x / n, sum[1] + y / n]);
        let spread = pairs().map(|(x, _)| (x - mean[0]).powi(2)).sum::<f64>();
        let slope = pairs().map(|(x, y)| (x - mean[0]) * (y - mean[1])).sum::<f64>() / spread;
        let left = pairs().map(|(x, y)| (y - mean[1] - slope * (x - mean[0])).powi(2)).sum::<f64>();
        (spread > 1e-9 * n && n > 2.0).then(|| (slope, (left / (n - 2.0) / spread).sqrt()))
    };
    let (slope, u) = fit(None)?;
    let without = |view: usize| Some([fit(Some(view))?.0]);
    Some((slope, jackknife(kept, views, [slope], without).map_or(u, |[by_view]| u.max(by_view))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::random::{Key, normal_quantile};
    use fringe::math::sincos;
    use nalgebra::{Point2, Vector2};

    const SIZE_PX: [u32; 2] = [1124, 750];

    /// Edges in all directions, blurred by σx and σy, more by `field` px² in the corners.
    fn edges([x, y]: [f64; 2], field: f64, turn: impl Fn(f64) -> f64) -> Vec<Vec<BlurredEdge>> {
        let key = Key::new(7);
        let edge = |number: u64| {
            let (sin, cos) = sincos(turn(3.2 * key.open(4 * number)));
            let pixel = Point2::new(1123.0 * key.open(4 * number + 1), 749.0 * key.open(4 * number + 2));
            let (u, v) = (pixel.x - 561.5, pixel.y - 374.5);
            let at = field * (u * u + v * v) / (561.5 * 561.5 + 374.5 * 374.5);
            let variance = x * x * cos * cos + y * y * sin * sin + at;
            let sigma_px = variance.sqrt() + 0.02 * normal_quantile(key.open(4 * number + 3));
            BlurredEdge { sigma_px, u_px: 0.02, excess: 0.0, normal: Vector2::new(cos, sin), pixel }
        };
        (0..10).map(|view| (0..60).map(|i| edge(60 * view + i)).collect()).collect()
    }

    #[test]
    fn both_directions_are_found_within_their_uncertainty() {
        for truth in [[0.5, 0.5], [0.35, 0.55], [0.7, 0.45]] {
            let found = footprint(&edges(truth, 0.0, |turn| turn), SIZE_PX).unwrap();
            let u = found.footprint.u_px.unwrap();
            for axis in 0..2 {
                let error = found.footprint.sigma_px[axis] - truth[axis];
                assert!(error.abs() < 3.0 * u[axis] && u[axis] < 0.01, "{truth:?}: {found:?}");
            }
        }
    }

    #[test]
    fn edges_of_one_slant_give_one_value_and_too_few_none() {
        let slanted = footprint(&edges([0.5, 0.5], 0.0, |_| 0.8), SIZE_PX).unwrap().footprint;
        assert_eq!(slanted.sigma_px[0], slanted.sigma_px[1]);
        assert!((slanted.sigma_px[0] - 0.5).abs() < 0.01);
        let few: Vec<_> = edges([0.5, 0.5], 0.0, |turn| turn).into_iter().map(|v| v[..3].to_vec()).collect();
        assert_eq!(footprint(&few, SIZE_PX), None);
        assert_eq!(footprint(&[], SIZE_PX), None);
    }

    #[test]
    fn dirt_is_left_out_and_a_blurred_corner_is_found() {
        let mut dirty = edges([0.5, 0.5], 0.0, |turn| turn);
        for edge in dirty.iter_mut().flat_map(|view| view.iter_mut().step_by(12)) {
            edge.sigma_px = 1.4;
        }
        let found = footprint(&dirty, SIZE_PX).unwrap();
        assert!((found.footprint.sigma_px[0] - 0.5).abs() < 0.01 && found.edges < 560, "{found:?}");
        let field = footprint(&edges([0.4, 0.4], 0.2, |turn| turn), SIZE_PX).unwrap();
        let u = field.footprint.u_px.unwrap();
        assert!((field.footprint.field_px2 - 0.2).abs() < 0.03, "{field:?}");
        for (sigma_px, u_px) in field.footprint.sigma_px.into_iter().zip(u) {
            // The mean over the picture of what grows by 0.2 px² up to the corner.
            let off = sigma_px - (0.16 + 0.2 * MEAN_FIELD).sqrt();
            assert!(off.abs() < 3.0 * u_px && u_px < 0.012, "{off}: {field:?}");
        }
    }

    /// A lens that is tilted, or a focus that changed: neither is a blur that grows from the middle to the corners.
    #[test]
    fn blur_from_side_to_side_and_from_view_to_view_is_uncertainty() {
        let mut tilted = edges([0.6, 0.6], 0.0, |turn| turn);
        for edge in tilted.iter_mut().flatten() {
            edge.sigma_px =
                (edge.sigma_px * edge.sigma_px + 0.2 * (edge.pixel.x / 561.5 - 1.0)).max(0.01).sqrt();
        }
        let found = footprint(&tilted, SIZE_PX).unwrap();
        assert!((found.across_px2.unwrap() - 0.4).abs() < 0.04, "{found:?}");
        // 0.4/√12 px² over 2σ.
        assert!((found.footprint.u_px.unwrap()[0] - 0.096).abs() < 0.015, "{found:?}");
        let mut refocused = edges([0.5, 0.5], 0.0, |turn| turn);
        for (view, edges) in refocused.iter_mut().enumerate() {
            let more = if view % 2 == 0 { 0.3 } else { 0.0 };
            for edge in edges.iter_mut() {
                edge.sigma_px = (edge.sigma_px * edge.sigma_px + more).sqrt();
            }
            // Half of the views fill the middle only.
            edges.retain(|edge| view % 2 == 1 || (edge.pixel.x - 561.5).abs() < 300.0);
        }
        let found = footprint(&refocused, SIZE_PX).unwrap();
        assert!(found.footprint.u_px.unwrap()[0] > 0.03 && found.across_px2.is_none(), "{found:?}");
        let still = footprint(&edges([0.5, 0.5], 0.0, |turn| turn), SIZE_PX).unwrap();
        assert!(still.across_px2.is_none(), "{still:?}");
    }
}

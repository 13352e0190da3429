//! The footprint from the edges of drawn boards, against what was drawn: the lens' second moment and the pixel's own area.

use super::super::{BlurredEdge, TargetKind, TargetSettings, detect};
use super::scene::{Scene, drawn_px2};
use crate::sensor::{FootprintEstimate, footprint};
use fringe::geometry::camera::Lens;
use fringe::sensor::MEAN_FIELD;

const LENS: Lens = Lens::brown_conrady([-0.12, 0.05, 0.0], [2e-4, -1e-4]);
/// Variance of an even distribution over one pixel, px².
const PIXEL_PX2: f64 = 1.0 / 12.0;

/// Tilts about x, y, z, rad.
const TILTS: [[f64; 3]; 8] = [
    [0.35, -0.3, 0.2],
    [-0.3, 0.25, -0.4],
    [0.1, 0.4, 0.9],
    [-0.35, -0.1, 1.4],
    [0.2, 0.2, -0.1],
    [0.4, 0.05, 0.5],
    [-0.15, -0.4, -0.8],
    [0.05, -0.2, 0.05],
];

/// What the edges of eight pictures of a board say of a camera with this blur.
fn estimate(blur_px: f64, wide: Option<(f64, [f64; 2])>, seed: u64) -> FootprintEstimate {
    let views: Vec<Vec<BlurredEdge>> = TILTS
        .iter()
        .enumerate()
        .map(|(pose, tilt)| {
            let mut scene = Scene::new(TargetKind::Checkerboard, 9, 6, *tilt, LENS);
            (scene.blur_px, scene.wide) = (blur_px, wide);
            let frame = scene.frame(&scene.clean(), 100 * seed + pose as u64 + 1);
            let settings = TargetSettings { edge_blur: true, ..TargetSettings::default() };
            let found = detect(&frame.view(), &scene.spec, &settings).expect("detected");
            found.points.iter().filter_map(|point| point.edges).flatten().collect()
        })
        .collect();
    footprint(&views, [360, 280]).expect("enough edges")
}

/// Errors over stated uncertainties along x and y.
fn judged(truth_px: f64, found: &FootprintEstimate) -> [f64; 2] {
    let (sigma, u) = (found.footprint.sigma_px, found.footprint.u_px.unwrap());
    [0, 1].map(|axis| (sigma[axis] - truth_px) / u[axis])
}

#[test]
fn a_round_blur_is_found_within_its_uncertainty() {
    for (seed, total_px) in [0.35_f64, 0.45, 0.577, 0.7].into_iter().enumerate() {
        let blur_px = (total_px * total_px - PIXEL_PX2).sqrt();
        let found = estimate(blur_px, None, seed as u64);
        let errors = judged((drawn_px2(blur_px) + PIXEL_PX2).sqrt(), &found);
        assert!(errors.iter().all(|e| e.abs() < 3.0), "{total_px} px: {errors:?}, {found:?}");
        assert!(found.footprint.u_px.unwrap().iter().all(|u| *u < 0.02), "{found:?}");
    }
}

#[test]
fn tails_count_with_their_second_moment() {
    for (seed, (narrow_px, wide_px, part)) in
        [(0.35_f64, 0.8_f64, 0.15), (0.4, 1.0, 0.1)].into_iter().enumerate()
    {
        let found = estimate(narrow_px, Some((wide_px, [part; 2])), 10 + seed as u64);
        let truth_px = ((1.0 - part) * drawn_px2(narrow_px) + part * drawn_px2(wide_px) + PIXEL_PX2).sqrt();
        let errors = judged(truth_px, &found);
        assert!(errors.iter().all(|e| e.abs() < 3.0), "{truth_px} px: {errors:?}, {found:?}");
    }
}

/// Over the field the estimate is the mean over the picture, whatever part of it the edges see.
#[test]
fn a_blur_that_varies_over_the_field_is_stated() {
    let found = estimate(0.35, Some((0.75, [0.0, 1.0])), 20);
    let truth = |field: f64| ((1.0 - field) * drawn_px2(0.35) + field * drawn_px2(0.75) + PIXEL_PX2).sqrt();
    let errors = judged(truth(MEAN_FIELD), &found);
    assert!(errors.iter().all(|e| e.abs() < 3.0), "{errors:?}, {found:?}");
    assert!((found.footprint.field_px2 - (0.75 * 0.75 - 0.35 * 0.35)).abs() < 0.1, "{found:?}");
}

//! Matching against exact surfaces. What these tests do not prove: anything about a pixel's finite footprint, which
//! the twin has and these maps do not.

use super::*;
use crate::phase::PhaseMap;
use crate::testing::{Scene, Surface, pixel_of, rig};

fn blank() -> Point {
    bytemuck::Zeroable::zeroed()
}

fn scene(surfaces: &[Surface], projector: &Camera) -> Scene {
    Scene { surfaces: surfaces.to_vec(), projector: projector.clone(), period_px: 16.0 }
}

fn matched(
    cameras: &[Camera; 2],
    left: &PhaseMap,
    right: &PhaseMap,
    settings: &MatchSettings,
) -> (Vec<Point>, MatchReport) {
    let mut matcher = Matcher::new(&cameras[0], &cameras[1], settings).unwrap();
    let mut points = vec![blank(); matcher.capacity()];
    let report = matcher.run(&left.view(), &right.view(), 3, &mut points).unwrap();
    let lost = report.unmatched + report.ambiguous + report.inconsistent + report.discontinuous;
    let surface = report.surface;
    assert_eq!(
        report.valid,
        lost + surface.spikes + surface.crumbs + surface.steep + report.points,
        "{report:?}"
    );
    points.truncate(report.points as usize);
    (points, report)
}

/// Mean and rms of the deviation along the line of sight, in pixels of disparity.
fn disparity_errors(camera: &Camera, other: &Camera, scene: &Scene, points: &[Point]) -> (f64, f64) {
    let baseline = (camera.centre_mm() - other.centre_mm()).norm();
    let errors: Vec<f64> = points
        .iter()
        .map(|point| {
            let ray = camera.ray(pixel_of(point.pixel as usize, camera.width_px)).unwrap();
            let (truth, _) = scene.trace(&ray).unwrap();
            let depth = (truth - ray.origin_mm).norm();
            ((point.position() - ray.origin_mm).norm() - depth) * camera.focal_px[0] * baseline
                / (depth * depth)
        })
        .collect();
    let n = errors.len() as f64;
    (errors.iter().sum::<f64>() / n, (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt())
}

#[test]
fn an_ideal_plane_is_matched_without_bias() {
    let [left, right, projector] = rig(400, 267);
    for normal in [[0.0, 0.0, 1.0], [0.4, 0.3, 1.0], [-0.5, 0.1, 1.0]] {
        let scene = scene(&[Surface::plane(normal, 3.0)], &projector);
        let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 0));
        for interpolation in [Interpolation::Quadratic, Interpolation::Cubic, Interpolation::Bilinear] {
            let settings = MatchSettings { interpolation, ..MatchSettings::default() };
            let (points, report) = matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &settings);
            assert!(report.points > 60_000, "{report:?}");
            let (mean, rms) = disparity_errors(&left, &right, &scene, &points);
            assert!(mean.abs() < 3e-4 && rms < 1e-3, "{interpolation:?} {normal:?}: {mean} {rms} px");
            for point in points.iter().step_by(97) {
                let off = (point.normal_vector() - scene.surfaces[0].normal(&point.position())).norm();
                assert!(off < 2e-3, "normal {off} off at {}", point.pixel);
            }
        }
    }
}

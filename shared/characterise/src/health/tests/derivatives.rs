//! Derivatives of an epipolar residual by the parameters of both views.

use super::super::parameters::{COUNT, Sensitivity, step};
use super::*;
use crate::calibration::{PARAMETERS, StereoGeometry, moved};
use fringe::geometry::camera::{Lens, LensKind};

/// A lens of a kind with all coefficients that the kind has.
fn lens(kind: LensKind) -> Lens {
    let mut coefficients = [-0.08, 0.05, 0.01, 2e-4, -1.5e-4, 0.02, 0.01, 0.003, 1e-3, -2e-3, -1e-3, 5e-4];
    if kind == LensKind::BrownConrady {
        coefficients[5..].fill(0.0);
    }
    Lens::from_coefficients(kind, coefficients)
}

/// Beside pairs whose lens is inverted anew for each parameter, which is what the derivatives stand for.
#[test]
fn derivatives_are_those_of_pairs_whose_parameters_moved() {
    for kind in [LensKind::BrownConrady, LensKind::Rational, LensKind::ThinPrism] {
        let [left, right, _] = rig(1124, 750);
        let cameras = [left, right].map(|camera| Camera { distortion: lens(kind), ..camera });
        let sensitivity = Sensitivity::new(&cameras[0], &cameras[1]);
        for (left, right) in [([100.0, 90.0], [130.0, 95.0]), ([900.0, 600.0], [870.0, 610.0])] {
            let (left, right) = (Point2::from(left), Point2::from(right));
            let answer = sensitivity.at(left, right).unwrap();
            let error = |cameras: &[Camera; 2], right: Point2<f64>| {
                StereoGeometry::new(&cameras[0], &cameras[1]).epipolar_error_px(left, right).unwrap()
            };
            assert!((answer.error_px - error(&cameras, right)).abs() < 1e-9);
            for (axis, slope) in answer.slope.into_iter().enumerate() {
                let at = |by: f64| error(&cameras, right + Vector2::ith(axis, by));
                assert!((slope - (at(0.01) - at(-0.01)) / 0.02).abs() < 1e-6, "{kind:?} {axis}");
            }
            for (place, by) in answer.by.into_iter().enumerate() {
                let size = step(PARAMETERS[place % COUNT]);
                let at = |by: f64| {
                    let mut steps = [0.0; COUNT];
                    steps[place % COUNT] = by;
                    let mut moved_cameras = cameras.clone();
                    moved_cameras[place / COUNT] = moved(&cameras[place / COUNT], &steps);
                    error(&moved_cameras, right)
                };
                let brute = (at(size) - at(-size)) / (2.0 * size);
                assert!(
                    (by - brute).abs() < 1e-5 * brute.abs().max(1e-3),
                    "{kind:?} {place} {}: {by} beside {brute}",
                    PARAMETERS[place % COUNT]
                );
            }
        }
    }
}

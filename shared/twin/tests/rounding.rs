//! A projector that rounds its levels to 8 bits: what that does to the phase.

use crate::common::{body, scene, small_rig};
use fringe::math::{atan2, cos, sin, wrap_rad};
use fringe::pattern::{Axis, PatternSet};
use std::f64::consts::TAU;
use twin::{Twin, TwinSettings};

const STEPS: u32 = 10;

/// Sums of the light of the steps times sine and cosine, for each pixel.
fn sums(twin: &Twin, sequence: &[PatternSet]) -> Vec<(f64, f64)> {
    let view = twin.view("cam1", 0).unwrap();
    let mut renderer = twin.renderer("proj1", sequence).unwrap();
    let mut sums = vec![(0.0, 0.0); (view.width_px() * view.height_px()) as usize];
    for step in 0..STEPS as usize {
        let delta = TAU * step as f64 / f64::from(STEPS);
        for (sum, value) in sums.iter_mut().zip(renderer.irradiance(&view, step).unwrap()) {
            sum.0 += f64::from(*value) * sin(delta);
            sum.1 += f64::from(*value) * cos(delta);
        }
    }
    sums
}

/// Proves: a projector of 8 bits moves the readings of its columns and rows to and fro, but not all of them to one side.
#[test]
fn a_projector_that_rounds_moves_no_phase_in_the_mean() {
    let settings = TwinSettings {
        projector_pixels: true,
        projector_8bit: true,
        projector_blur_px: 0.6,
        projector_gamma: 1.05,
        ..TwinSettings::ideal()
    };
    let geometry = r#"{ shape = "plane", size_mm = [160.0, 160.0], thickness_mm = 5.0 }"#;
    let twin = Twin::new(&scene(&body("plate", [0.0, 0.0, 15.0], geometry)), settings, &small_rig()).unwrap();
    let view = twin.view("cam1", 0).unwrap();
    for (axis, period_px) in [(Axis::X, 16.0), (Axis::Y, 16.0), (Axis::X, 24.0), (Axis::Y, 18.0)] {
        let (mut sum, mut count) = (0.0, 0.0);
        for (index, (s, c)) in sums(&twin, &[PatternSet::sine(axis, period_px, STEPS)]).iter().enumerate() {
            let Some(at) = view.truth_coordinate("proj1", index).unwrap() else { continue };
            let at_px = if axis == Axis::X { at.x } else { at.y };
            // Whole periods, away from the border of the chip.
            if (144.0..432.0).contains(&at_px) {
                let error_px = wrap_rad(atan2(*s, *c) - TAU * at_px / period_px) * period_px / TAU;
                (sum, count) = (sum + error_px, count + 1.0);
            }
        }
        let mean = sum / count;
        assert!(count > 5000.0 && mean.abs() < 5e-5, "{axis:?}, {period_px} px: {mean} px");
    }
}

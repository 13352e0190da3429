//! Motion between frames: found where there is one, with its size; not where there is none, whatever the projector and the light do.

use super::super::{DecodeSettings, Decoder, Motion};
use crate::frame::FrameView;
use crate::math::{cos, pow};
use crate::pattern::{Axis, PatternSet};
use crate::phase::PhaseMap;
use crate::synthetic::Noise;

const SIZE: [usize; 2] = [320, 200];
const STEPS: usize = 10;

/// The motion that a decoder reports of ten steps and a code, whose fringes stand `shift(frame)` rad beside their place.
fn reported(
    shift: impl Fn(usize) -> f64,
    response: impl Fn(f64) -> f64,
    light: impl Fn(usize) -> f64,
) -> Motion {
    let sequence = [PatternSet::sine(Axis::X, 16.0, STEPS as u32), PatternSet::gray(Axis::X, 6, 8.0)];
    let [width, height] = SIZE;
    let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
    let mut decoder =
        Decoder::new(&sequence, width as u32, height as u32, 255, [320, 200], &settings).unwrap();
    let mut noise = Noise(3);
    for frame in 0..decoder.frames() {
        let value = |index: usize| {
            let x = (index % width) as f64 + 0.02 * (index / width) as f64;
            let level = if frame < STEPS {
                let step = std::f64::consts::TAU * frame as f64 / STEPS as f64;
                0.5 + 0.5 * cos(std::f64::consts::TAU * x / 16.0 - step + shift(frame))
            } else {
                let bit = frame - STEPS;
                let stripe = ((x + 0.5) / 8.0).floor() as u32;
                f64::from(((stripe ^ (stripe >> 1)) >> (5 - bit)) & 1)
            };
            (20.0 + 160.0 * light(frame) * response(level) + 1.5 * noise.gauss()).round().clamp(0.0, 255.0)
                as u8
        };
        let bytes: Vec<u8> = (0..width * height).map(value).collect();
        let view = FrameView::from_bytes(width as u32, height as u32, 255, &bytes).unwrap();
        decoder.push(frame, &view).unwrap();
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    decoder.finish(Axis::X, &mut map.view_mut()).unwrap().motion.unwrap()
}

#[test]
fn a_part_at_rest_did_not_move_whatever_projector_and_light_do() {
    let steady = |_: usize| 1.0;
    let still = reported(|_| 0.0, |level| level, steady);
    assert!(
        !still.moved && still.rms_rad < 5e-4 && still.drift_rad.abs() < 4.0 * still.u_drift_rad,
        "{still:?}"
    );
    let gamma = reported(|_| 0.0, |level| pow(level.max(1e-9), 2.2), steady);
    assert!(!gamma.moved && gamma.rms_rad < 2e-3, "{gamma:?}");
    let flicker = reported(|_| 0.0, |level| level, |frame| 1.0 + 0.01 * cos(frame as f64 * 2.1));
    assert!(!flicker.moved && flicker.rms_rad < 2e-3, "{flicker:?}");
}

#[test]
fn a_drift_and_a_vibration_are_found_with_their_size() {
    let drift = reported(|frame| 0.004 * frame as f64, |level| level, |_| 1.0);
    // 16 frames of the sequence.
    assert!((drift.drift_rad - 0.064).abs() < 0.004 && drift.moved, "{drift:?}");
    assert!((drift.drift_rad - 0.064).abs() < 4.0 * drift.u_drift_rad, "{drift:?}");
    let shifts = [3.0, -2.0, 1.0, 4.0, -5.0, 2.0, 0.0, -3.0, 1.0, -1.0];
    let vibration = reported(|frame| 0.01 * shifts.get(frame).unwrap_or(&0.0), |level| level, |_| 1.0);
    let rms = 0.01 * (70.0_f64 / 10.0).sqrt();
    // Part of it may as well be light that changes: what is stated is the least.
    assert!((0.6..1.05).contains(&(vibration.rms_rad / rms)) && vibration.moved, "{vibration:?}, {rms}");
}

#[test]
fn a_motion_within_the_uncertainty_is_stated_and_not_blamed() {
    let small = reported(|frame| 0.0001 * frame as f64, |level| level, |_| 1.0);
    assert!(!small.moved && small.drift_rad > 0.0, "{small:?}");
    assert!(small.warning("cam1").is_none());
    let large = reported(|frame| 0.004 * frame as f64, |level| level, |_| 1.0);
    assert!(large.warning("cam1").is_some_and(|text| text.contains("\"cam1\"") && text.contains("mrad")));
}

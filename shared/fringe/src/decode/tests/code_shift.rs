//! A part that moved between fringes and code: said where it is so, with its size, and nowhere else.

use super::super::CodeShift;
use super::*;

/// What a decoder says of a ramp whose code stands off by so many projector pixels, through a lens that sees the light of a projector as `level` does.
fn reported(stands_off_px: f64, stripe_px: f64, level: impl Fn(f64) -> f64) -> (CodeShift, Vec<String>) {
    let mut scene = Scene::ramp(320, 200, 0.71, 0.05, 304).eight_bits();
    scene.noise = (1.0, 0.02);
    let sequence = [
        sine(Axis::X, 16.0, 6),
        gray(Axis::X, if stripe_px > 8.0 { 5 } else { 6 }, stripe_px),
        PatternSet::White {},
        PatternSet::Black {},
    ];
    let mut moved = scene.clone();
    moved.coordinates_px.iter_mut().for_each(|x| *x -= stands_off_px);
    let (still, moved) = (scene.frames(&sequence), moved.frames(&sequence));
    let mut frames: Vec<Frame> = still[..6].iter().chain(&moved[6..]).cloned().collect();
    for frame in &mut frames {
        if let PixelBuffer::Mono8(values) = &mut frame.pixels {
            for value in values.iter_mut() {
                *value = (200.0 * level(f64::from(*value) / 200.0)).round() as u8;
            }
        }
    }
    let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
    let (_, report) = scene.decode_frames(&sequence, &frames, Axis::X, &settings);
    assert!(report.findings.is_empty(), "{:?}", report.findings);
    (report.code_shift.unwrap(), report.warnings("cam1"))
}

#[test]
fn a_code_that_stands_where_the_fringes_do_is_not_blamed() {
    for stripe_px in [8.0, 16.0] {
        for gamma in [1.0, 1.3, 0.8] {
            let (shift, warnings) =
                reported(0.0, stripe_px, |level| crate::math::pow(level.max(1e-9), gamma));
            assert!(!shift.moved && shift.shift_px.abs() < 0.3, "{stripe_px} {gamma}: {shift:?}");
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }
}

#[test]
fn a_code_that_stands_off_is_told_with_its_size() {
    for by_px in [-2.4, -1.0, 0.5, 2.0, 3.0] {
        let (shift, warnings) = reported(by_px, 8.0, |level| level);
        assert!((shift.shift_px - by_px).abs() < 0.3, "{by_px}: {shift:?}");
        assert_eq!(shift.moved, f64::abs(by_px) > 1.6, "{by_px}: {shift:?}");
        let told =
            warnings.iter().any(|text| text.contains("\"cam1\"") && text.contains("beside the fringes"));
        assert_eq!(told, shift.moved, "{warnings:?}");
    }
}

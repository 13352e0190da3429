//! Sequences and frames that are refused, and pixels that are masked.

use super::*;
use crate::decode::Finding;
use crate::frame::Pixels;

fn refusal(sequence: &[PatternSet]) -> DecodeError {
    Scene::ramp(64, 2, 1.0, 0.0, 608).decoder(sequence, &DecodeSettings::default()).unwrap_err()
}

#[test]
fn sequences_without_an_absolute_order_say_what_is_missing() {
    let x = Axis::X;
    let text = refusal(&[sine(x, 16.0, 4)]).to_string();
    assert!(text.contains("there is no gray set") && text.contains("608"), "{text}");
    let text = refusal(&[sine(x, 28.0, 4), sine(x, 26.0, 4)]).to_string();
    assert!(text.contains("364.0"), "{text}");
    let text = refusal(&[sine(x, 16.0, 4), gray(x, 6, 32.0)]).to_string();
    assert!(text.contains("stripe of 32 px is longer"), "{text}");
    let error = refusal(&[sine(x, 16.0, 4), gray(x, 5, 16.0), PatternSet::White {}, PatternSet::Black {}]);
    assert_eq!(error, DecodeError::CodeTooShort { index: 1, axis: x, covers_px: 512.0, extent_px: 608 });
}

/// The same frame twice, in the files of a camera whose pictures have noise or none.
#[test]
fn a_step_that_is_a_copy_of_another_is_named() {
    let sequence = demo(16.0, 6);
    let outcome = |scene: &Scene, frames: &[Frame]| {
        let mut decoder = scene.decoder(&sequence, &DecodeSettings::default())?;
        for (index, frame) in frames.iter().enumerate() {
            decoder.push(index, &frame.view())?;
        }
        let mut map = PhaseMap::new(decoder.info(Axis::X)?);
        decoder.finish(Axis::X, &mut map.view_mut())
    };
    let mut scene = Scene::ramp(64, 16, 1.0, 0.3, 608).eight_bits();
    for noise in [(0.0, 0.0), (0.5, 0.02)] {
        scene.noise = noise;
        for (from, to) in [(3, 4), (0, 2), (4, 1)] {
            let mut frames = scene.frames(&sequence);
            frames[to] = frames[from].clone();
            let (first, second) = (from.min(to) + 1, from.max(to) + 1);
            match outcome(&scene, &frames) {
                Err(refused) => {
                    assert_eq!(refused, DecodeError::CopiedStep { set: 0, axis: Axis::X, first, second });
                    assert!(refused.to_string().contains("noise never repeats"), "{refused}");
                }
                // Left out for what it shows.
                Ok(report) => {
                    let named = |finding: &Finding| {
                        finding.step.is_some_and(|step| [first - 1, second - 1].contains(&step))
                    };
                    assert!(report.findings.iter().any(named), "{from} for {to}: {:?}", report.findings);
                }
            }
        }
    }
    // Light of two opposite phases, which two steps show alike where there is no noise, is no copy.
    let opposite =
        Scene::new(64, (0..1024).map(|i| 16.0 + 8.0 * f64::from(i % 3)).collect(), 608).eight_bits();
    let copied =
        matches!(outcome(&opposite, &opposite.frames(&sequence)), Err(DecodeError::CopiedStep { .. }));
    assert!(!copied);
}

#[test]
fn broken_sequences_are_refused() {
    let x = Axis::X;
    assert!(matches!(refusal(&[sine(x, 608.0, 2)]), DecodeError::Pattern { index: 0, .. }));
    assert_eq!(refusal(&[]), DecodeError::NothingToDecode);
    assert_eq!(refusal(&[PatternSet::White {}]), DecodeError::NothingToDecode);
    let twice = [sine(x, 608.0, 3), sine(x, 608.0, 4)];
    assert_eq!(refusal(&twice), DecodeError::Duplicate { first: 0, second: 1, name: "sine", axis: x });
    let twice = [gray(x, 7, 8.0), gray(x, 7, 8.0)];
    assert!(matches!(refusal(&twice), DecodeError::Duplicate { name: "gray", .. }));
    assert!(matches!(refusal(&[gray(x, 7, 8.0)]), DecodeError::MissingThreshold { index: 0, .. }));
    let wanted = |threshold| PatternSet::Gray {
        axis: x,
        bits: 7,
        stripe_px: 8.0,
        shift_px: 0.0,
        invert: false,
        code: Code::Gray,
        threshold: Some(threshold),
    };
    for threshold in [Threshold::Complement, Threshold::WhiteBlack] {
        let error = refusal(&[sine(x, 16.0, 4), wanted(threshold)]);
        assert!(matches!(error, DecodeError::MissingThreshold { index: 1, .. }), "{error}");
    }
    assert!(matches!(refusal(&[PatternSet::Random { frames: u32::MAX }]), DecodeError::TooManyFrames { .. }));
    let many: Vec<_> = (0..7).map(|i| sine(x, 700.0 + f64::from(i), 3)).collect();
    assert!(matches!(refusal(&many), DecodeError::TooManySines { count: 7, .. }));
}

#[test]
fn settings_and_sizes_outside_their_range_are_refused() {
    let scene = Scene::ramp(8, 2, 1.0, 0.0, 608);
    let bad = DecodeSettings { max_sigma_rad: f64::NAN, ..DecodeSettings::default() };
    assert!(matches!(
        scene.decoder(&demo(8.0, 7), &bad),
        Err(DecodeError::Setting { key: "max_sigma_rad", .. })
    ));
    let good = DecodeSettings::default();
    let make = |w, h, full, extent| Decoder::new(&demo(8.0, 7), w, h, full, extent, &good).unwrap_err();
    assert!(matches!(make(0, 5, 255, [608, 684]), DecodeError::Size { .. }));
    assert!(matches!(make(u32::MAX, u32::MAX, 255, [608, 684]), DecodeError::Size { .. }));
    assert_eq!(make(8, 5, 0, [608, 684]), DecodeError::FullScale);
    assert_eq!(make(8, 5, 255, [0, 684]), DecodeError::Extent { axis: Axis::X });
    let text = toml::to_string(&good).unwrap();
    assert_eq!(toml::from_str::<DecodeSettings>(&text).unwrap(), good);
    assert!(toml::from_str::<DecodeSettings>("max_sigma = 1.0").is_err());
}

#[test]
fn frames_that_do_not_fit_are_refused_and_change_nothing() {
    let scene = Scene::ramp(64, 2, 1.0, 0.0, 608).eight_bits();
    let sequence = demo(8.0, 7);
    let frames = scene.frames(&sequence);
    let mut decoder = scene.decoder(&sequence, &DecodeSettings::default()).unwrap();
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    let refused = decoder.push(1, &frames[1].view());
    assert_eq!(refused, Err(DecodeError::FrameOrder { expected: 0, got: 1, count: 19 }));
    decoder.push(0, &frames[0].view()).unwrap();
    assert!(matches!(decoder.push(0, &frames[0].view()), Err(DecodeError::FrameOrder { .. })));
    let narrow = Scene::ramp(32, 4, 1.0, 0.0, 608).eight_bits().frames(&sequence);
    assert!(matches!(decoder.push(1, &narrow[1].view()), Err(DecodeError::FrameSize { .. })));
    let truncated = FrameView { pixels: Pixels::Mono8(&[0; 100]), ..frames[1].view() };
    assert!(matches!(decoder.push(1, &truncated), Err(DecodeError::FrameSize { pixels: 100, .. })));
    let deeper = FrameView { full_scale_dn: 1023, ..frames[1].view() };
    assert!(matches!(decoder.push(1, &deeper), Err(DecodeError::FrameFullScale { got_dn: 1023, .. })));
    let shifted = [4080_u16; 128];
    let error = decoder.push(1, &FrameView { pixels: Pixels::Mono16(&shifted), ..frames[1].view() });
    assert!(matches!(error, Err(DecodeError::AboveFullScale { value_dn: 4080, .. })));
    let early = decoder.finish(Axis::X, &mut map.view_mut());
    assert_eq!(early, Err(DecodeError::Incomplete { axis: Axis::X, landed: 1, needed: 19 }));
    for (index, frame) in frames.iter().enumerate().skip(1) {
        decoder.push(index, &frame.view()).unwrap();
    }
    assert!(matches!(decoder.push(19, &frames[0].view()), Err(DecodeError::FrameOrder { .. })));
    assert!(matches!(decoder.finish(Axis::Y, &mut map.view_mut()), Err(DecodeError::NoSuchAxis { .. })));
    let mut small = PhaseMap::new(PhaseInfo { width_px: 1, ..map.info });
    assert_eq!(decoder.finish(Axis::X, &mut small.view_mut()), Err(DecodeError::Output));
    let report = decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
    assert_eq!(report.valid, 128);
}

#[test]
fn clipped_and_dark_pixels_are_masked() {
    let scene = Scene::ramp(64, 16, 1.0, 0.0, 608).eight_bits();
    let sequence = demo(8.0, 7);
    let mut frames = scene.frames(&sequence);
    for (index, frame) in frames.iter_mut().enumerate() {
        if let PixelBuffer::Mono8(values) = &mut frame.pixels {
            values[70] = values[70].saturating_add(100);
            values[200] = 0;
            values[300] = 255;
            // A clipped white frame is no harm.
            if index == 17 {
                values[400] = 255;
            }
        }
    }
    let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
    assert_eq!((report.saturated, report.dark, report.noisy), (2, 1, 0));
    assert_eq!(report.valid, 64 * 16 - 3);
    assert_eq!((map.valid[70], map.valid[200], map.valid[300], map.valid[400]), (0, 0, 0, 1));
}

#[test]
fn a_new_cycle_forgets_the_old_one() {
    let scene = Scene::ramp(64, 4, 1.0, 0.0, 608).eight_bits();
    let sequence = demo(8.0, 7);
    let frames = scene.frames(&sequence);
    let (fresh, fresh_report) = scene.decode(&sequence, Axis::X);
    let mut decoder = scene.decoder(&sequence, &DecodeSettings::default()).unwrap();
    let white = scene.frame(vec![255; 256]);
    (0..15).for_each(|index| decoder.push(index, &white.view()).unwrap());
    decoder.begin();
    for (index, frame) in frames.iter().enumerate() {
        decoder.push(index, &frame.view()).unwrap();
    }
    let mut map = PhaseMap::new(fresh.info);
    for _ in 0..2 {
        assert_eq!(decoder.finish(Axis::X, &mut map.view_mut()).unwrap(), fresh_report);
        assert_eq!(map, fresh);
    }
}

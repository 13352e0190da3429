//! Faults of frames: found, named and made up for; none is found where there is none.

use super::*;

/// Fringes over a camera with faces of different brightness.
struct Dirt {
    scene: Scene,
    sequence: Vec<PatternSet>,
    frames: Vec<Frame>,
}

impl Dirt {
    fn new(period_px: f64, steps: u32) -> Self {
        let mut scene = Scene::ramp(320, 200, 0.71, 0.05, 304).eight_bits();
        scene.noise = (1.0, 0.02);
        let sequence = vec![
            sine(Axis::X, period_px, steps),
            gray(Axis::X, 6, 0.5 * period_px),
            PatternSet::White {},
            PatternSet::Black {},
        ];
        let frames = scene.frames(&sequence);
        Self { scene, sequence, frames }
    }

    /// Changes the grey values of one frame by their pixel and the value that they had.
    fn change(&mut self, frame: usize, change: impl Fn(usize, f64) -> f64) {
        if let PixelBuffer::Mono8(values) = &mut self.frames[frame].pixels {
            for (pixel, value) in values.iter_mut().enumerate() {
                *value = change(pixel, f64::from(*value)).round().clamp(0.0, 255.0) as u8;
            }
        }
    }

    /// (findings, root mean square of error over σ, valid share) of the map.
    fn decode(&self) -> (Vec<Finding>, f64, f64) {
        let settings = DecodeSettings::default();
        let (map, report) = self.scene.decode_frames(&self.sequence, &self.frames, Axis::X, &settings);
        let scale = map.info.period_px / std::f64::consts::TAU;
        let (mut squares, mut count) = (0.0, 0.0);
        for (i, x) in self.scene.coordinates_px.iter().enumerate().filter(|(i, _)| map.valid[*i] == 1) {
            let off = (f64::from(map.phase_rad[i]) - x / scale) / f64::from(map.sigma_rad[i]);
            squares += off * off;
            count += 1.0;
        }
        (report.findings, f64::sqrt(squares / count), count / map.valid.len() as f64)
    }

    fn refusal(&self) -> DecodeError {
        let mut decoder = self.scene.decoder(&self.sequence, &DecodeSettings::default()).unwrap();
        for (index, frame) in self.frames.iter().enumerate() {
            decoder.push(index, &frame.view()).unwrap();
        }
        let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
        decoder.finish(Axis::X, &mut map.view_mut()).unwrap_err()
    }
}

#[test]
fn clean_frames_have_no_fault() {
    for steps in [3, 4, 5, 6, 8, 10, 12] {
        for period_px in [12.0, 16.0, 36.0, 76.0, 152.0, 304.0] {
            let (findings, ratio, share) = Dirt::new(period_px, steps).decode();
            assert!(findings.is_empty(), "{steps} steps of {period_px} px: {findings:?}");
            assert!((0.9..1.15).contains(&ratio) && share > 0.98, "{steps} of {period_px}: {ratio} {share}");
        }
    }
}

/// A projector that is not linear, a dim part, and fringes longer than the picture: no fault of single frames.
#[test]
fn a_gamma_dim_parts_and_long_fringes_are_no_fault() {
    for steps in [4_u32, 5, 8] {
        let mut dirt = Dirt::new(16.0, steps);
        for frame in 0..steps as usize {
            dirt.change(frame, |_, value| {
                20.0 + 180.0 * crate::math::pow((value - 20.0).max(0.0) / 180.0, 2.2)
            });
        }
        let (findings, ..) = dirt.decode();
        assert!(findings.is_empty(), "gamma, {steps} steps: {findings:?}");
        let mut dim = Dirt::new(16.0, steps);
        for frame in 0..dim.frames.len() {
            dim.change(frame, |_, value| 0.2 * value);
        }
        let (findings, ..) = dim.decode();
        assert!(findings.is_empty(), "dim, {steps} steps: {findings:?}");
        let mut scene = Scene::ramp(320, 200, 0.71, 0.05, 304).eight_bits();
        scene.noise = (1.0, 0.02);
        let sequence = [sine(Axis::X, 304.0, steps)];
        let (_, report) = scene.decode(&sequence, Axis::X);
        assert!(report.findings.is_empty(), "one fringe, {steps} steps: {:?}", report.findings);
    }
}

/// Room light that differs from frame to frame by up to 6 % of the level.
#[test]
fn a_changing_room_light_is_named_and_normalised() {
    for (steps, most) in [(3, 1.3), (4, 1.25), (5, 1.2), (10, 1.2)] {
        let mut dirt = Dirt::new(16.0, steps);
        let offsets = [6.0, -5.0, 3.0, 7.0, -6.0, 2.0, -7.0, 5.0, -4.0, 1.0];
        for (frame, offset) in offsets.into_iter().enumerate().take(steps as usize) {
            dirt.change(frame, |_, value| value + offset);
        }
        let (findings, ratio, share) = dirt.decode();
        assert!(
            matches!(findings[..], [Finding { step: None, fault: Fault::Flicker(rms), set: 0, .. }] if (0.03..0.08).contains(&rms)),
            "{steps}: {findings:?}"
        );
        assert!(ratio < most && share > 0.98, "{steps} steps: error over sigma {ratio}, {share} valid");
    }
}

/// A lamp or an exposure that differs: all light of a frame is scaled.
#[test]
fn a_changing_exposure_is_named_and_normalised() {
    let mut dirt = Dirt::new(16.0, 8);
    let factors = [1.0, 0.93, 1.04, 0.97, 1.06, 0.95, 1.02, 0.9];
    for (frame, factor) in factors.into_iter().enumerate() {
        dirt.change(frame, |_, value| factor * value);
    }
    let (findings, ratio, _) = dirt.decode();
    assert!(matches!(findings[..], [Finding { step: None, fault: Fault::Flicker(_), .. }]), "{findings:?}");
    assert!(ratio < 1.3, "error over sigma {ratio}");
}

#[test]
fn a_black_frame_is_named_and_left_out() {
    for steps in [5, 8, 10] {
        let mut dirt = Dirt::new(16.0, steps);
        dirt.change(2, |_, _| 1.0);
        let (findings, ratio, share) = dirt.decode();
        assert!(
            matches!(findings[..], [Finding { set: 0, step: Some(2), fault: Fault::Black, .. }]),
            "{steps}: {findings:?}"
        );
        assert!(findings[0].to_string().starts_with("frame 3 of set 1 is black"), "{}", findings[0]);
        assert!((0.85..1.2).contains(&ratio) && share > 0.98, "{steps}: {ratio} {share}");
    }
}

#[test]
fn a_blurred_frame_is_named_and_left_out() {
    for steps in [6, 10] {
        let mut dirt = Dirt::new(16.0, steps);
        let view: Vec<f64> = {
            let view = dirt.frames[3].view();
            (0..view.pixels.len()).map(|i| f64::from(view.pixels.get(i))).collect()
        };
        // Half a fringe of motion along the row: 11 pixels.
        dirt.change(3, |pixel, _| {
            let near = |shift: usize| view[(pixel + shift).saturating_sub(5).min(view.len() - 1)];
            (0..11).map(near).sum::<f64>() / 11.0
        });
        let (findings, ratio, share) = dirt.decode();
        assert!(
            matches!(findings[..], [Finding { set: 0, step: Some(3), fault: Fault::Blurred(left), .. }] if (0.4..0.74).contains(&left)),
            "{steps}: {findings:?}"
        );
        assert!((0.85..1.2).contains(&ratio) && share > 0.98, "{steps}: {ratio} {share}");
    }
}

#[test]
fn a_shifted_frame_is_named_and_left_out() {
    for steps in [6, 10] {
        let mut dirt = Dirt::new(16.0, steps);
        let shifted = {
            let mut scene = Scene::ramp(320, 200, 0.71, 0.05, 304).eight_bits();
            scene.noise = (1.0, 0.02);
            scene.coordinates_px.iter_mut().for_each(|x| *x += 2.0);
            scene.frames(&dirt.sequence).swap_remove(4)
        };
        dirt.frames[4] = shifted;
        let (findings, ratio, share) = dirt.decode();
        assert!(
            matches!(findings[..], [Finding { set: 0, step: Some(4), fault: Fault::Moved(_), .. }]),
            "{steps}: {findings:?}"
        );
        assert!((0.85..1.2).contains(&ratio) && share > 0.98, "{steps}: {ratio} {share}");
    }
}

/// A hand in front of the part, in one frame.
#[test]
fn a_frame_that_shows_something_else_is_named_and_left_out() {
    let mut dirt = Dirt::new(16.0, 10);
    dirt.change(6, |pixel, value| if pixel % 320 < 150 { 90.0 } else { value });
    let (findings, ratio, share) = dirt.decode();
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert_eq!(findings[0].step, Some(6), "{findings:?}");
    assert!((0.85..1.2).contains(&ratio) && share > 0.98, "{ratio} {share}");
}

#[test]
fn more_bad_frames_than_one_in_eight_are_refused() {
    let mut dirt = Dirt::new(16.0, 10);
    dirt.change(2, |_, _| 1.0);
    dirt.change(5, |_, _| 1.0);
    assert!(matches!(dirt.refusal(), DecodeError::Disorder { .. }));
    let mut four = Dirt::new(16.0, 4);
    four.change(2, |_, _| 1.0);
    four.frames.swap(0, 1);
    assert!(matches!(four.refusal(), DecodeError::Disorder { .. }));
}

/// The next sequence is decoded as if nothing had happened.
#[test]
fn a_fault_does_not_reach_the_next_sequence() {
    let mut dirt = Dirt::new(16.0, 8);
    let clean = dirt.frames.clone();
    dirt.change(2, |_, _| 1.0);
    let settings = DecodeSettings::default();
    let (expected, _) = dirt.scene.decode_frames(&dirt.sequence, &clean, Axis::X, &settings);
    let mut decoder = dirt.scene.decoder(&dirt.sequence, &settings).unwrap();
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    for (frames, faults) in [(&dirt.frames, 1), (&clean, 0)] {
        decoder.begin();
        for (index, frame) in frames.iter().enumerate() {
            decoder.push(index, &frame.view()).unwrap();
        }
        let report = decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
        assert_eq!(report.findings.len(), faults, "{:?}", report.findings);
    }
    assert_eq!(
        map.phase_rad.iter().map(|p| p.to_bits()).collect::<Vec<_>>(),
        expected.phase_rad.iter().map(|p| p.to_bits()).collect::<Vec<_>>()
    );
}

/// Spoils the second frame; the kind of fault that it should be found to be.
fn spoil(dirt: &mut Dirt, kind: &str) -> Fault {
    match kind {
        "black" => dirt.change(1, |_, _| 1.0),
        "blurred" => {
            let view: Vec<f64> = {
                let view = dirt.frames[1].view();
                (0..view.pixels.len()).map(|i| f64::from(view.pixels.get(i))).collect()
            };
            dirt.change(1, |pixel, _| {
                let near = |shift: usize| view[(pixel + shift).saturating_sub(5).min(view.len() - 1)];
                (0..11).map(near).sum::<f64>() / 11.0
            });
        }
        "moved" => {
            let mut scene = Scene::ramp(320, 200, 0.71, 0.05, 304).eight_bits();
            scene.noise = (1.0, 0.02);
            scene.coordinates_px.iter_mut().for_each(|x| *x += 2.0);
            dirt.frames[1] = scene.frames(&dirt.sequence).swap_remove(1);
        }
        "hand" => dirt.change(1, |pixel, value| if pixel % 320 < 150 { 90.0 } else { value }),
        "exposure" => dirt.change(1, |_, value| 0.5 * value),
        _ => dirt.frames[1] = dirt.frames[0].clone(),
    }
    match kind {
        "black" => Fault::Black,
        "blurred" | "exposure" => Fault::Blurred(0.5),
        "moved" | "twice" => Fault::Moved(-0.8),
        _ => Fault::Strange,
    }
}

/// A pixel alone cannot tell which of three or four frames is wrong; whole fringes can. Of four it is left out, three are refused.
#[test]
fn a_wrong_frame_among_three_or_four_is_named() {
    for kind in ["black", "blurred", "moved", "hand", "exposure", "twice"] {
        for period_px in [10.0, 16.0] {
            let mut dirt = Dirt::new(period_px, 4);
            let expected = spoil(&mut dirt, kind);
            let (findings, ratio, share) = dirt.decode();
            let same = |fault: Fault| std::mem::discriminant(&fault) == std::mem::discriminant(&expected);
            assert!(
                matches!(findings[..], [Finding { set: 0, step: Some(1), fault, .. }] if same(fault)),
                "{kind}, {period_px}: {findings:?}"
            );
            assert!((0.85..1.2).contains(&ratio) && share > 0.98, "{kind}, {period_px}: {ratio} {share}");
            let mut dirt = Dirt::new(period_px, 3);
            spoil(&mut dirt, kind);
            let error = dirt.refusal();
            let DecodeError::WrongFrame { finding, steps: 3 } = &error else { panic!("{kind}: {error}") };
            assert!(same(finding.fault), "{kind}: {finding:?}");
            // Of two frames that show the same, either may be the wrong one.
            assert_eq!(finding.step, (kind != "twice").then_some(1), "{kind}: {finding:?}");
            assert!(error.to_string().contains("3 steps do not determine the phase"), "{error}");
        }
    }
}

//! What a pixel's order rests on, against counted errors and closed forms.

use super::*;

fn diagnosed(scene: &Scene, sequence: &[PatternSet], settings: &DecodeSettings) -> Vec<Diagnosis> {
    let mut decoder = scene.decoder(sequence, settings).unwrap();
    for (index, frame) in scene.frames(sequence).iter().enumerate() {
        decoder.push(index, &frame.view()).unwrap();
    }
    decoder.diagnose(Axis::X).unwrap()
}

fn known(read_noise_dn: f64, gain_dn: f64) -> DecodeSettings {
    let camera_noise = Some(CameraNoise { read_noise_dn, gain_dn });
    DecodeSettings { camera_noise, certainty_sigmas: 0.0, ..DecodeSettings::default() }
}

fn mean(found: &[Diagnosis], part: fn(&Diagnosis) -> f32) -> f64 {
    let valid: Vec<f64> = found.iter().map(part).filter(|v| !v.is_nan()).map(f64::from).collect();
    valid.iter().sum::<f64>() / valid.len() as f64
}

/// Threshold and uncertainty scatter as stated; bits and orders are wrong as often as stated.
#[test]
fn bits_are_wrong_as_often_as_stated() {
    let with = |threshold| PatternSet::Gray {
        axis: Axis::X,
        bits: 7,
        stripe_px: 8.0,
        shift_px: 0.0,
        invert: false,
        code: Code::Gray,
        threshold: Some(threshold),
    };
    let levels = [PatternSet::White {}, PatternSet::Black {}];
    let by_levels = [vec![sine(Axis::X, 16.0, 10), with(Threshold::WhiteBlack)], levels.to_vec()].concat();
    let by_mean = vec![sine(Axis::X, 16.0, 10), with(Threshold::SineMean)];
    for (name, sequence, steps, noise_dn) in
        [("white and black", by_levels, 2.0, 3400.0), ("mean", by_mean, 10.0, 4000.0)]
    {
        let mut scene = Scene::ramp(560, 400, 1.0, 0.13, 1024);
        scene.coordinates_px.iter_mut().for_each(|x| *x += 200.0);
        (scene.ambient_dn, scene.projected_dn) = (20_000.0, 25_000.0);
        scene.noise = (noise_dn, 0.0);
        let found = diagnosed(&scene, &sequence, &known(noise_dn, 0.0));
        let pairs = || found.iter().zip(&scene.coordinates_px).filter(|(d, _)| !d.wrong_order.is_nan());
        let wrong = pairs().filter(|(d, x)| (f64::from(d.own_px) - **x).abs() > 8.0).count();
        let expected: f64 = pairs().map(|(d, _)| f64::from(d.wrong_order)).sum();
        assert!(expected > 500.0, "{name}: {expected}");
        let spread = 4.0 / expected.sqrt();
        let ratio = wrong as f64 / expected;
        assert!((ratio - 1.0).abs() < 0.05 + spread, "{name}: {wrong} of {expected}");
        // Half of 20000 + 45000 DN; the uncertainty of a mean of two or ten frames.
        let threshold: Vec<f64> = pairs().map(|(d, _)| f64::from(d.threshold_dn)).collect();
        let n = threshold.len() as f64;
        let middle = threshold.iter().sum::<f64>() / n;
        let sd = (threshold.iter().map(|t| (t - middle).powi(2)).sum::<f64>() / n).sqrt();
        let stated = mean(&found, |d| d.u_threshold_dn);
        assert!((middle - 32_500.0).abs() < 30.0, "{name}: {middle}");
        assert!((stated / (noise_dn / f64::sqrt(steps)) - 1.0).abs() < 0.01, "{name}: {stated}");
        assert!((0.98..1.02).contains(&(sd / stated)), "{name}: {sd} and {stated}");
    }
}

/// Without noise worth speaking of no error is expected, and the own coordinate is the truth; dark pixels give no information.
#[test]
fn without_noise_nothing_is_expected_to_be_wrong() {
    let mut scene = Scene::ramp(600, 20, 1.0, 0.1, 608).eight_bits();
    scene.noise = (0.5, 0.0);
    let found = diagnosed(&scene, &demo(8.0, 7), &known(0.6, 0.0));
    assert!(found.iter().all(|d| d.wrong_order < 1e-12 && d.wrong_bits < 1e-12));
    let off = found.iter().zip(&scene.coordinates_px).map(|(d, x)| (f64::from(d.own_px) - x).abs());
    assert!(off.fold(0.0, f64::max) < 0.2);
    assert!((mean(&found, |d| d.contrast_dn) - 90.0).abs() < 1.0);
    scene.projected_dn = 0.0;
    let dark = diagnosed(&scene, &demo(8.0, 7), &known(0.6, 0.0));
    assert!(dark.iter().all(|d| d.wrong_order.is_nan() && d.threshold_dn.is_nan()));
    // Sines alone have no threshold, but an order.
    scene.projected_dn = 180.0;
    let found = diagnosed(&scene, &[sine(Axis::X, 16.0, 10), sine(Axis::X, 608.0, 10)], &known(0.6, 0.0));
    assert!(found.iter().all(|d| d.threshold_dn.is_nan() && d.wrong_order < 1e-6));
    let decoder = scene.decoder(&demo(8.0, 7), &DecodeSettings::default()).unwrap();
    assert!(matches!(decoder.diagnose(Axis::X), Err(DecodeError::Incomplete { .. })));
    assert!(matches!(decoder.diagnose(Axis::Y), Err(DecodeError::NoSuchAxis { .. })));
}

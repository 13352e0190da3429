//! The predicted uncertainty against the scatter of many noisy measurements.

use super::*;

/// Root mean square of the phase error over the predicted sigma, for one noisy flat scene.
fn normalised_scatter(
    mut scene: Scene,
    sequence: &[PatternSet],
    settings: &DecodeSettings,
) -> (f64, NoiseModel) {
    let (mut sum, mut count) = (0.0, 0_usize);
    let mut model = None;
    for seed in 0..6 {
        scene.seed = 100 + seed;
        let (map, report) = scene.decode_frames(sequence, &scene.frames(sequence), Axis::X, settings);
        let scale = std::f64::consts::TAU / map.info.period_px;
        for (i, x) in scene.coordinates_px.iter().enumerate() {
            if map.valid[i] == 1 {
                let error = (f64::from(map.phase_rad[i]) - x * scale) / f64::from(map.sigma_rad[i]);
                sum += error * error;
                count += 1;
            }
        }
        model = Some(report.noise);
    }
    ((sum / count as f64).sqrt(), model.unwrap())
}

#[test]
fn the_predicted_sigma_is_the_scatter() {
    let cases = [
        ("8 bits, read and shot", Scene::ramp(400, 100, 1.3, 0.05, 608).eight_bits(), (1.5, 0.03), 10),
        ("8 bits, read only", Scene::ramp(400, 100, 1.3, 0.05, 608).eight_bits(), (2.0, 0.0), 5),
        ("16 bits", Scene::ramp(400, 100, 1.3, 0.05, 608), (150.0, 3.0), 8),
    ];
    for (name, mut scene, noise, steps) in cases {
        scene.noise = noise;
        // Reflectances from 1 to 0.3 spread the background, so that read and shot noise can be distinguished.
        let mut sequence = demo(8.0, 7);
        sequence[0] = sine(Axis::X, 16.0, steps);
        let (ratio, model) = normalised_scatter(scene, &sequence, &DecodeSettings::default());
        assert!((ratio - 1.0).abs() < 0.02, "{name}: {ratio} with {model:?}");
        assert!(matches!(model.source, NoiseSource::Estimated { .. }));
    }
}

#[test]
fn a_given_noise_serves_where_three_steps_leave_no_residual() {
    let mut scene = Scene::ramp(400, 100, 1.3, 0.05, 608).eight_bits();
    scene.noise = (2.0, 0.0);
    let sequence =
        [sine(Axis::X, 16.0, 3), gray(Axis::X, 7, 8.0), PatternSet::White {}, PatternSet::Black {}];
    let camera_noise = Some(CameraNoise { read_noise_dn: (4.0_f64 + 1.0 / 12.0).sqrt(), gain_dn: 0.0 });
    let settings = DecodeSettings { camera_noise, ..DecodeSettings::default() };
    let (ratio, model) = normalised_scatter(scene, &sequence, &settings);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio} with {model:?}");
}

/// Frames of a scene whose reflectance varies, seen through a projector with a gamma.
fn gamma_frames(scene: &Scene, gamma: f64, sequence: &[PatternSet]) -> Vec<Frame> {
    let mut random = Random(7);
    let mut frames = Vec::new();
    for set in sequence {
        for step in 0..set.frames() {
            let values = scene.coordinates_px.iter().enumerate().map(|(i, x)| {
                let light = crate::math::pow(set.intensity(step, *x, scene.extent_px).unwrap(), gamma);
                let reflectance = 0.3 + 0.7 * ((i * 7919) % 1000) as f64 / 1000.0;
                let level = reflectance * (scene.ambient_dn + scene.projected_dn * light);
                let sigma = (scene.noise.0 * scene.noise.0 + scene.noise.1 * level).sqrt();
                (level + sigma * random.normal()).round().clamp(0.0, f64::from(scene.full_scale_dn)) as u16
            });
            frames.push(scene.frame(values.collect()));
        }
    }
    frames
}

#[test]
fn the_noise_model_is_found_beside_the_harmonics_of_a_gamma() {
    for gamma in [1.0, 2.2] {
        let mut scene = Scene::ramp(600, 150, 0.9, 0.05, 608).eight_bits();
        scene.noise = (1.5, 0.04);
        let sequence = demo(8.0, 7);
        let frames = gamma_frames(&scene, gamma, &sequence);
        let (_, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
        let read_dn = (report.noise.read_variance_dn2 - 1.0 / 12.0).sqrt();
        assert!((read_dn - 1.5).abs() < 0.1, "gamma {gamma}: {:?}", report.noise);
        assert!((report.noise.gain_dn - 0.04).abs() < 0.003, "gamma {gamma}: {:?}", report.noise);
    }
}

/// Three steps let the second harmonic of a gamma into the phase, which white and black tell; more steps need no warning.
#[test]
fn three_steps_of_a_gamma_are_told() {
    let mut scene = Scene::ramp(300, 100, 0.9, 0.05, 608).eight_bits();
    scene.noise = (1.5, 0.0);
    let told = |steps: u32, gamma: f64| {
        let mut sequence = demo(8.0, 7);
        sequence[0] = sine(Axis::X, 16.0, steps);
        let frames = gamma_frames(&scene, gamma, &sequence);
        let (_, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
        let warned = report.warnings("cam1").iter().any(|warning| warning.contains("gamma of the projector"));
        (report.linearity.map(|linearity| linearity.gamma), warned)
    };
    let (gamma, warned) = told(3, 2.2);
    assert!(warned && gamma.is_some_and(|gamma| (gamma - 2.2).abs() < 0.1), "{gamma:?}");
    let (gamma, warned) = told(3, 1.0);
    assert!(!warned && gamma.is_some_and(|gamma| (gamma - 1.0).abs() < 0.1), "{gamma:?}");
    assert_eq!(told(5, 2.2), (None, false));
}

#[test]
fn outliers_do_not_reach_the_noise_model() {
    let mut scene = Scene::ramp(600, 150, 0.9, 0.05, 608).eight_bits();
    scene.noise = (1.5, 0.0);
    let sequence = demo(8.0, 7);
    let mut frames = scene.frames(&sequence);
    // One pixel in twenty saw something else in frame 3.
    if let PixelBuffer::Mono8(values) = &mut frames[3].pixels {
        values.iter_mut().step_by(20).for_each(|v| *v = 255 - *v);
    }
    let (_, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
    let sigma_dn = (report.noise.read_variance_dn2 + report.noise.gain_dn * 110.0).sqrt();
    assert!((sigma_dn / (2.25_f64 + 1.0 / 12.0).sqrt() - 1.0).abs() < 0.02, "{:?}", report.noise);
}

/// With four steps there is one residual: too little to estimate noise, enough to distinguish frames out of order from a gamma.
#[test]
fn four_steps_out_of_order_are_refused_and_a_gamma_is_not() {
    let mut scene = Scene::ramp(300, 100, 0.9, 0.05, 608).eight_bits();
    scene.noise = (1.5, 0.04);
    let sequence =
        [sine(Axis::X, 16.0, 4), gray(Axis::X, 7, 8.0), PatternSet::White {}, PatternSet::Black {}];
    let settings = DecodeSettings::default();
    let disorder = |order: [usize; 4], gamma: f64| {
        let frames = gamma_frames(&scene, gamma, &sequence);
        let mut decoder = scene.decoder(&sequence, &settings).unwrap();
        for index in 0..frames.len() {
            let shown = order.get(index).copied().unwrap_or(index);
            decoder.push(index, &frames[shown].view()).unwrap();
        }
        let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
        match decoder.finish(Axis::X, &mut map.view_mut()) {
            Err(DecodeError::Disorder { residual, .. }) => Some(residual),
            _ => None,
        }
    };
    for gamma in [1.0, 2.2, 3.0] {
        assert_eq!(disorder([0, 1, 2, 3], gamma), None, "gamma {gamma}");
    }
    for (gamma, least) in [(1.0, 1.2), (2.2, 0.5)] {
        for order in [[0, 2, 1, 3], [0, 1, 3, 2], [1, 0, 2, 3], [3, 1, 2, 0]] {
            let residual = disorder(order, gamma);
            assert!(residual.is_some_and(|r| r > least), "gamma {gamma}, {order:?}: {residual:?}");
        }
    }
}

/// Of a part that fills 0.3 % of the picture the probed pixels, one of nine, are too few: its noise is found from all of its pixels, by residuals or,
/// of four steps, by neighbours.
#[test]
fn the_noise_of_a_small_part_is_not_assumed() {
    let (width, height, edge) = (640, 480, 32);
    let mut scene = Scene::ramp(width, height, 0.8, 0.05, 608).eight_bits();
    scene.noise = (3.0, 0.04);
    for (steps, off) in [(8, 0.05), (4, 0.12)] {
        let mut sequence = demo(8.0, 7);
        sequence[0] = sine(Axis::X, 16.0, steps);
        let mut frames = scene.frames(&sequence);
        for frame in &mut frames {
            let PixelBuffer::Mono8(values) = &mut frame.pixels else { unreachable!("8 bits") };
            for (i, value) in values.iter_mut().enumerate() {
                let inside = [i % width, i / width].iter().all(|at| (200..200 + edge).contains(at));
                *value = if inside { *value } else { (i * 7919 % 5) as u8 };
            }
        }
        let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
        let stated_dn = (report.noise.read_variance_dn2 + report.noise.gain_dn * 110.0).sqrt();
        let true_dn = (9.0_f64 + 1.0 / 12.0 + 0.04 * 110.0).sqrt();
        assert!((stated_dn / true_dn - 1.0).abs() < off, "{steps} steps: {:?}", report.noise);
        assert!(matches!(report.noise.source, NoiseSource::Estimated { .. }), "{:?}", report.noise);
        assert!(report.valid > edge * edge * 9 / 10, "{}", report.valid);
        let (mut sum, mut count) = (0.0, 0.0);
        for (i, x) in scene.coordinates_px.iter().enumerate().filter(|(i, _)| map.valid[*i] == 1) {
            let error = f64::from(map.phase_rad[i]) - x * std::f64::consts::TAU / 16.0;
            (sum, count) = (sum + (error / f64::from(map.sigma_rad[i])).powi(2), count + 1.0);
        }
        let ratio = (sum / count).sqrt();
        assert!((ratio - 1.0).abs() < 0.05 + off, "{steps} steps: {ratio}");
        assert_eq!(report.bounced, Bounced::default());
    }
}

//! Lines, micro and modulated phase shifting and single frames: the coordinate, σ beside the scatter, and what is refused.

use super::*;
use crate::math::cos;
use std::f64::consts::TAU;

/// Periods of a published kind: nearly alike, told apart over the projector.
const MICRO_PX: [f64; 5] = [16.0, 16.6, 17.4, 18.7, 20.3];

fn micro(periods_px: &[f64]) -> PatternSet {
    PatternSet::Micro {
        axis: Axis::X,
        periods_px: periods_px.to_vec(),
        direction: Direction::Forward,
        shifts_rad: Vec::new(),
    }
}

fn modulated(steps: u32, carrier_steps: u32) -> PatternSet {
    PatternSet::Modulated {
        axis: Axis::X,
        period_px: 19.0,
        steps,
        carrier_px: 11.0,
        carrier_steps,
        direction: Direction::Forward,
    }
}

/// A code of half periods with its inverse.
fn code(period_px: f64, bits: u32) -> [PatternSet; 2] {
    let gray = |invert| PatternSet::Gray {
        axis: Axis::X,
        bits,
        stripe_px: 0.5 * period_px,
        shift_px: 0.0,
        invert,
        code: Code::Gray,
        threshold: None,
    };
    [gray(false), gray(true)]
}

/// (phase − truth)/σ over the valid pixels: root mean square, mean, and the largest distance in px; and the valid share.
fn against_truth(scene: &Scene, map: &PhaseMap) -> (f64, f64, f64, f64) {
    let scale = map.info.period_px / TAU;
    let (mut squares, mut sum, mut worst, mut count) = (0.0, 0.0, 0.0_f64, 0.0);
    for (i, x) in scene.coordinates_px.iter().enumerate() {
        if map.valid[i] == 1 {
            let off_px = f64::from(map.phase_rad[i]) * scale - x;
            let z = off_px / (f64::from(map.sigma_rad[i]) * scale);
            squares += z * z;
            sum += z;
            worst = worst.max(off_px.abs());
            count += 1.0;
        }
    }
    ((squares / count).sqrt(), sum / count, worst, count / scene.coordinates_px.len() as f64)
}

/// Frames of a smooth light instead of whole columns: each line blurred by half a column, as lenses do.
fn blurred(scene: &Scene, sequence: &[PatternSet]) -> Vec<Frame> {
    let mut random = Random(scene.seed);
    let mut frames = Vec::new();
    // Weights of a Gaussian of half a column, in steps fine beside the noise.
    let taps: Vec<(f64, f64)> = (-64..=64)
        .map(|k| (f64::from(k) / 32.0, crate::math::exp(-0.5 * f64::from(k * k) / 1024.0 / 0.25)))
        .collect();
    let total: f64 = taps.iter().map(|tap| tap.1).sum();
    for set in sequence {
        for step in 0..set.frames() {
            let values = scene.coordinates_px.iter().map(|x| {
                let light = |at: f64| set.intensity(step, at, scene.extent_px).unwrap();
                let mean = taps.iter().map(|(at, weight)| weight * light(x + at)).sum::<f64>() / total;
                (scene.ambient_dn + scene.projected_dn * mean, random.normal())
            });
            let values = values.enumerate().map(|(i, (level, normal))| {
                // Faces of different brightness, so that read and shot noise can be told apart.
                let level = level * (0.5 + 0.125 * ((i / scene.width) % 5) as f64);
                let sigma = (scene.noise.0 * scene.noise.0 + scene.noise.1 * level).sqrt();
                (level + sigma * normal).round().clamp(0.0, f64::from(scene.full_scale_dn)) as u16
            });
            frames.push(scene.frame(values.collect()));
        }
    }
    frames
}

#[test]
fn line_shift_gives_the_coordinate_with_its_sigma() {
    // Read noise, then shot noise: a line is bright in few of its frames. The last time the camera's noise is known.
    for (noise, known) in [((2.0, 0.0), false), ((0.5, 0.1), false), ((0.5, 0.1), true)] {
        let camera_noise = known.then_some(CameraNoise { read_noise_dn: 0.58, gain_dn: 0.1 });
        let settings = DecodeSettings { camera_noise, ..DecodeSettings::default() };
        for (period_px, steps, bits) in [(8.0, 8, 7), (6.0, 6, 7)] {
            let mut scene = Scene::ramp(256, 64, 0.53, 0.03, 144).eight_bits();
            scene.noise = noise;
            let mut sequence = vec![PatternSet::lines(Axis::X, period_px, steps)];
            sequence.extend(code(period_px, bits));
            let frames = blurred(&scene, &sequence);
            let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &settings);
            assert_eq!(map.info.period_px, period_px);
            let (rms, mean, worst_px, share) = against_truth(&scene, &map);
            assert!((0.9..1.15).contains(&rms), "{period_px} px, noise {noise:?}: {rms} {report:?}");
            assert!(mean.abs() < 0.1 && worst_px < 1.0 && share > 0.99, "{mean} {worst_px} {share}");
        }
    }
}

#[test]
fn lines_in_another_order_are_refused() {
    let mut scene = Scene::ramp(256, 64, 0.4, 0.03, 108).eight_bits();
    scene.noise = (1.0, 0.0);
    let mut sequence = vec![PatternSet::lines(Axis::X, 8.0, 8)];
    sequence.extend(code(8.0, 7));
    let mut frames = blurred(&scene, &sequence);
    for (first, other) in [(1, 4), (2, 6), (3, 5)] {
        frames.swap(first, other);
    }
    assert!(matches!(refusal(&scene, &sequence, &frames), DecodeError::Disorder { .. }));
}

fn refusal(scene: &Scene, sequence: &[PatternSet], frames: &[Frame]) -> DecodeError {
    let mut decoder = scene.decoder(sequence, &DecodeSettings::default()).unwrap();
    for (index, frame) in frames.iter().enumerate() {
        decoder.push(index, &frame.view()).unwrap();
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    decoder.finish(Axis::X, &mut map.view_mut()).unwrap_err()
}

#[test]
fn micro_phase_shifting_numbers_its_fringes_and_all_frames_count() {
    let mut scene = Scene::ramp(400, 64, 1.4, 0.2, 608).eight_bits();
    for (noise, least_share) in [((1.0, 0.0), 0.995), ((3.0, 0.0), 0.9), ((0.5, 0.03), 0.98)] {
        scene.noise = noise;
        let sequence = [micro(&MICRO_PX)];
        let (map, report) = scene.decode(&sequence, Axis::X);
        let (rms, mean, worst_px, share) = against_truth(&scene, &map);
        assert!((0.9..1.15).contains(&rms), "noise {noise:?}: {rms} {report:?}");
        assert!(mean.abs() < 0.1 && worst_px < 4.0 && share > least_share, "{mean} {worst_px} {share}");
        // Seven frames hold more than three.
        let three =
            vec![sine(Axis::X, 16.0, 3), gray(Axis::X, 7, 8.0), PatternSet::White {}, PatternSet::Black {}];
        let (plain, _) = scene.decode(&three, Axis::X);
        let mean_sigma = |map: &PhaseMap| {
            let valid: Vec<f64> =
                map.sigma_rad.iter().filter(|s| !s.is_nan()).map(|s| f64::from(*s)).collect();
            valid.iter().sum::<f64>() / valid.len() as f64
        };
        assert!(mean_sigma(&map) < 0.85 * mean_sigma(&plain), "{} {}", mean_sigma(&map), mean_sigma(&plain));
    }
}

/// Wrong orders of single pixels, counted over many, beside the bound that is stated.
#[test]
fn wrong_orders_of_micro_phase_shifting_stay_below_what_is_stated() {
    let mut scene = Scene::ramp(400, 160, 1.4, 0.2, 608).eight_bits();
    scene.noise = (11.0, 0.0);
    let sequence = [micro(&MICRO_PX)];
    let mut decoder = scene.decoder(&sequence, &DecodeSettings::default()).unwrap();
    for (index, frame) in scene.frames(&sequence).iter().enumerate() {
        decoder.push(index, &frame.view()).unwrap();
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
    let (mut wrong, mut expected) = (0.0, 0.0);
    for (pixel, x) in decoder.diagnose(Axis::X).unwrap().iter().zip(&scene.coordinates_px) {
        if !pixel.wrong_order.is_nan() {
            wrong += f64::from(u8::from((f64::from(pixel.own_px) - x).abs() > 8.0));
            expected += f64::from(pixel.wrong_order);
        }
    }
    assert!(wrong > 50.0, "too few to compare: {wrong}");
    assert!((0.3..1.2).contains(&(wrong / expected)), "{wrong} counted, {expected} stated");
}

#[test]
fn micro_sets_that_number_nothing_or_do_not_fit_are_refused() {
    let scene = Scene::ramp(400, 64, 1.4, 0.2, 608).eight_bits();
    let alike = scene.decoder(&[micro(&[16.0, 16.0, 32.0])], &DecodeSettings::default()).unwrap_err();
    assert!(alike.to_string().contains("the same grey values again"), "{alike}");
    // Frames of other periods than stated.
    let frames = scene.frames(&[micro(&[16.0, 18.1, 19.3, 21.9, 25.0])]);
    let error = refusal(&scene, &[micro(&MICRO_PX)], &frames);
    assert!(matches!(error, DecodeError::Contradiction { .. }), "{error}");
}

#[test]
fn modulated_fringes_are_decoded_without_the_light_of_other_places() {
    for (steps, carrier_steps, glow_dn) in [(3, 3, 0.0), (4, 5, 40.0)] {
        let scene = Scene::ramp(256, 64, 1.07, 0.03, 288).eight_bits();
        let set = modulated(steps, carrier_steps);
        let sequence: Vec<PatternSet> = std::iter::once(set.clone()).chain(code(19.0, 5)).collect();
        let mut random = Random(7);
        let mut frames = Vec::new();
        for set in &sequence {
            for step in 0..set.frames() {
                let values = scene.coordinates_px.iter().enumerate().map(|(i, x)| {
                    let light = set.intensity(step, *x, scene.extent_px).unwrap();
                    let across = (i / scene.width) as f64 * 1.3;
                    let carried =
                        set.carrier(step).map(|(set, step)| set.intensity(step, across, 288).unwrap());
                    // Light from a place half a period away that lost the carrier on its way.
                    let glow =
                        carried.map_or(0.0, |_| 0.5 + 0.5 * cos(TAU * (x + 9.5) / 19.0 - set.step_rad(step)));
                    let level = 20.0 + 160.0 * light * carried.unwrap_or(1.0) + glow_dn * glow;
                    (level + 1.5 * random.normal()).round().clamp(0.0, 255.0) as u16
                });
                frames.push(scene.frame(values.collect()));
            }
        }
        let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
        let (rms, mean, worst_px, share) = against_truth(&scene, &map);
        assert!((0.9..1.15).contains(&rms), "{steps} x {carrier_steps}: {rms} {report:?}");
        assert!(mean.abs() < 0.1 && worst_px < 2.0 && share > 0.99, "{mean} {worst_px} {share}");
    }
}

#[test]
fn three_steps_in_any_order_give_the_same_phase() {
    let scene = Scene::ramp(256, 32, 1.07, 0.03, 288).eight_bits();
    let third = TAU / 3.0;
    let (reference, _) =
        scene.decode(&[vec![sine(Axis::X, 16.0, 3)], code(16.0, 6).to_vec()].concat(), Axis::X);
    for order in
        [[0.0, 1.0, 2.0], [0.0, 2.0, 1.0], [1.0, 0.0, 2.0], [1.0, 2.0, 0.0], [2.0, 0.0, 1.0], [2.0, 1.0, 0.0]]
    {
        let set = PatternSet::Sine {
            axis: Axis::X,
            period_px: 16.0,
            steps: 3,
            first_step_rad: 0.0,
            direction: Direction::Forward,
            shifts_rad: order.map(|k| k * third).to_vec(),
        };
        let (map, _) = scene.decode(&[vec![set], code(16.0, 6).to_vec()].concat(), Axis::X);
        assert_eq!(map.valid, reference.valid);
        for (a, b) in map.phase_rad.iter().zip(&reference.phase_rad) {
            assert!((a - b).abs() < 1e-4 || a.is_nan(), "{a} {b}");
        }
    }
}

/// A shiny part: the brightest third of the fringe is clipped.
#[test]
fn pixels_that_are_clipped_in_some_frames_are_decoded_from_the_others() {
    for (steps, projected_dn, least) in
        [(10, 330.0, 0.99), (5, 290.0, 0.99), (4, 280.0, 0.9), (3, 280.0, 0.3)]
    {
        let mut scene = Scene::ramp(256, 64, 0.9, 0.03, 288).eight_bits();
        scene.projected_dn = projected_dn;
        scene.noise = (1.5, 0.0);
        let sequence = [vec![sine(Axis::X, 16.0, steps)], code(16.0, 6).to_vec()].concat();
        let frames = scene.frames(&sequence);
        let (_, masked) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
        let camera_noise = Some(CameraNoise { read_noise_dn: 1.53, gain_dn: 0.0 });
        let settings = DecodeSettings { use_clipped: true, camera_noise, ..DecodeSettings::default() };
        let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &settings);
        let (rms, _, worst_px, share) = against_truth(&scene, &map);
        assert_eq!(masked.recovered, 0);
        assert!(
            masked.saturated > 4000 && report.saturated + report.recovered == masked.saturated,
            "{report:?}"
        );
        assert!((0.9..1.15).contains(&rms) && worst_px < 2.0, "{steps} steps: {rms} {worst_px}");
        assert!(
            if steps > 3 { share > least } else { report.recovered == 0 },
            "{steps} steps: {share} {report:?}"
        );
    }
}

/// A mosaic of colours is a camera whose pixels differ in gain: each has the phase of its place, none is interpolated.
#[test]
fn a_raw_mosaic_of_colours_decodes_pixel_by_pixel() {
    let mut scene = Scene::ramp(256, 64, 1.07, 0.03, 288).eight_bits();
    scene.noise = (0.0, 0.0);
    let sequence: Vec<PatternSet> = std::iter::once(sine(Axis::X, 16.0, 5)).chain(code(16.0, 6)).collect();
    let mut random = Random(3);
    let frames: Vec<Frame> = scene
        .frames(&sequence)
        .iter()
        .map(|frame| {
            let view = frame.view();
            let values = (0..view.pixels.len()).map(|i| {
                // Red, green, green, blue under white light.
                let gain = [[0.6, 1.0], [1.0, 0.45]][(i / 256) % 2][i % 2];
                let level = gain * f64::from(view.pixels.get(i)) + 1.2 * random.normal();
                level.round().clamp(0.0, 255.0) as u16
            });
            scene.frame(values.collect())
        })
        .collect();
    let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
    let (rms, mean, worst_px, share) = against_truth(&scene, &map);
    assert!((0.9..1.15).contains(&rms), "{rms} {report:?}");
    assert!(mean.abs() < 0.1 && worst_px < 1.0 && share > 0.99, "{mean} {worst_px} {share}");
}

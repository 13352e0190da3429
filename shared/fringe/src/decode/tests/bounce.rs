//! Light from other faces: its share of the uncertainty is that of the errors, and nothing else is taken for it.

use super::*;
use crate::sensor::Sensor;

const WIDTH: usize = 320;
const HEIGHT: usize = 200;
const EXTENT: u32 = 640;

/// Frames of 8 bits with noise: a ramp of this albedo, and on its right half light of another ramp, of this share.
fn frames(sequence: &[PatternSet], share: f64, albedo: fn(usize) -> f64) -> (Scene, Vec<Frame>) {
    let seen = Scene::ramp(WIDTH, HEIGHT, 1.2, 0.1, EXTENT);
    let other = (0..WIDTH * HEIGHT).map(|i| 400.0 - 0.1 * (i % WIDTH) as f64 - 0.9 * (i / WIDTH) as f64);
    let thrown = Scene::new(WIDTH, other.collect(), EXTENT);
    let shown = Scene { noise: (0.8, 0.02), ..seen.clone().eight_bits() };
    let mut random = Random(5);
    let mixed = seen.frames(sequence).into_iter().zip(thrown.frames(sequence)).map(|(own, thrown)| {
        let (PixelBuffer::Mono16(own), PixelBuffer::Mono16(thrown)) = (&own.pixels, &thrown.pixels) else {
            unreachable!("16 bits")
        };
        let values = own.iter().zip(thrown).enumerate().map(|(i, (own, thrown))| {
            let share = if i % WIDTH >= WIDTH / 2 { share } else { 0.0 };
            let light = (f64::from(*own) - 6000.0 + share * (f64::from(*thrown) - 6000.0)) / 50_000.0;
            let level = 20.0 + 150.0 * albedo(i) * light;
            let sigma = (0.8 * 0.8 + 0.02 * level).sqrt();
            (level + sigma * random.normal()).round().clamp(0.0, 255.0) as u16
        });
        shown.frame(values.collect())
    });
    let frames = mixed.collect();
    (shown, frames)
}

fn decoded(share: f64, most_rad: f64) -> (Scene, PhaseMap, DecodeReport) {
    let sequence = demo(8.0, 7);
    let (scene, frames) = frames(&sequence, share, |_| 1.0);
    of(&sequence, (scene, &frames), most_rad)
}

fn of(
    sequence: &[PatternSet],
    (scene, frames): (Scene, &[Frame]),
    most_rad: f64,
) -> (Scene, PhaseMap, DecodeReport) {
    let settings = DecodeSettings { max_bounce_rad: most_rad, ..DecodeSettings::default() };
    let (map, report) = scene.decode_frames(sequence, frames, Axis::X, &settings);
    (scene, map, report)
}

/// Root mean squares of the errors and of what is stated, of some columns.
fn both(scene: &Scene, map: &PhaseMap, columns: std::ops::Range<usize>) -> [f64; 2] {
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for (i, x) in scene.coordinates_px.iter().enumerate() {
        if map.valid[i] == 1 && columns.contains(&(i % WIDTH)) {
            let error = f64::from(map.phase_rad[i]) - x * std::f64::consts::TAU / 16.0;
            let stated = f64::from(map.sigma_rad[i]);
            sums = [sums[0] + error * error, sums[1] + stated * stated];
            count += 1.0;
        }
    }
    sums.map(|sum| (sum / count).sqrt())
}

#[test]
fn bounced_light_is_in_the_uncertainty() {
    for share in [0.03, 0.05] {
        let (scene, map, report) = decoded(share, 1.0);
        let [error, stated] = both(&scene, &map, WIDTH / 2 + 8..WIDTH);
        assert!((0.9..1.15).contains(&(stated / error)), "share {share}: {stated} stated, {error} found");
        let [error, stated] = both(&scene, &map, 0..WIDTH / 2 - 8);
        assert!((0.95..1.05).contains(&(stated / error)), "beside it: {stated} stated, {error} found");
        assert!(report.bounced.raised > WIDTH * HEIGHT / 4 && report.bounced.masked == 0);
        // Without the test the errors are larger than stated by far.
        let (scene, map, report) = decoded(share, 0.0);
        let [error, stated] = both(&scene, &map, WIDTH / 2 + 8..WIDTH);
        assert!(stated / error < 0.8, "share {share}: {stated} stated, {error} found");
        assert_eq!(report.bounced, Bounced::default());
    }
}

#[test]
fn too_much_bounced_light_is_masked_and_counted() {
    let (scene, map, report) = decoded(0.15, 0.03);
    let masked = (0..map.info.len()).filter(|i| i % WIDTH >= WIDTH / 2 + 8 && map.valid[*i] == 0).count();
    assert!(masked > 9 * (WIDTH / 2 - 8) * HEIGHT / 10, "{masked}");
    assert!(report.bounced.masked >= masked);
    let valid: usize = map.valid.iter().map(|v| usize::from(*v)).sum();
    assert_eq!(report.valid, valid);
    // In the corners of the image a window has too few smooth pixels.
    let inner = |i: &usize| i % WIDTH < WIDTH - 8 && (8..HEIGHT - 8).contains(&(i / WIDTH));
    for i in (0..map.info.len()).filter(|i| inner(i) && map.valid[*i] == 1) {
        let error_px = f64::from(map.phase_rad[i]) * 16.0 / std::f64::consts::TAU - scene.coordinates_px[i];
        assert!(error_px.abs() < 0.3, "pixel {i}: {error_px}");
    }
}

/// Noise alone, a print of two greys and faulty pixels are no bounced light.
#[test]
fn nothing_else_is_taken_for_bounced_light() {
    let (sequence, few) = (demo(8.0, 7), WIDTH * HEIGHT / 200);
    let found = |scene: Scene, frames: &[Frame]| {
        let bounced = of(&sequence, (scene, frames), 0.03).2.bounced;
        bounced.raised + bounced.masked
    };
    let (scene, mut faulty) = frames(&sequence, 0.0, |_| 1.0);
    assert!(found(scene.clone(), &faulty) < few);
    let (printed, of_print) =
        frames(&sequence, 0.0, |i| if (i / WIDTH + i % WIDTH) % 40 < 20 { 0.5 } else { 1.0 });
    assert!(found(printed, &of_print) < few);
    let PixelBuffer::Mono8(white) = &mut faulty[17].pixels else { unreachable!("8 bits") };
    (0..HEIGHT * WIDTH).step_by(40 * WIDTH + 40).for_each(|i| white[i] = white[i] / 4 * 3);
    assert!(found(scene, &faulty) < 2 * few);
}

/// Frames as a lens of this standard deviation, px, blurs them, in 8 bits with noise.
fn blurred(scene: &Scene, sequence: &[PatternSet], sigma_px: f64) -> (Scene, Vec<Frame>) {
    let shown = Scene { noise: (0.8, 0.02), ..scene.clone().eight_bits() };
    let weights: Vec<f64> =
        (-4..=4).map(|i| crate::math::exp(-0.5 * f64::from(i * i) / (sigma_px * sigma_px))).collect();
    let total: f64 = weights.iter().sum();
    let along = |values: &[f64], step: usize, at: usize, length: usize| -> f64 {
        let place = at / step % length;
        let of = |k: usize| (place + k).saturating_sub(4).min(length - 1);
        (0..9).map(|k| weights[k] * values[at - place * step + of(k) * step]).sum::<f64>() / total
    };
    let mut random = Random(7);
    let frames = scene.frames(sequence).into_iter().map(|sharp| {
        let PixelBuffer::Mono16(sharp) = &sharp.pixels else { unreachable!("16 bits") };
        let light: Vec<f64> =
            sharp.iter().map(|grey| 20.0 + 150.0 * (f64::from(*grey) - 6000.0) / 50_000.0).collect();
        let rows: Vec<f64> = (0..light.len()).map(|i| along(&light, 1, i, WIDTH)).collect();
        let values = (0..light.len()).map(|i| {
            let level = along(&rows, WIDTH, i, HEIGHT);
            (level + (0.64 + 0.02 * level).sqrt() * random.normal()).round().clamp(0.0, 255.0) as u16
        });
        shown.frame(values.collect())
    });
    let frames = frames.collect();
    (shown, frames)
}

/// Fine fringes on a ball lose the more modulation to a blur the steeper the ball is: by e^(−½ s² |∇φ|²), which a straight line in |∇φ|² does
/// not explain.
#[test]
fn fine_fringes_through_a_blur_are_no_bounced_light() {
    let sequence = demo(8.0, 7);
    let coordinates = (0..WIDTH * HEIGHT).map(|i| {
        let x = (i % WIDTH) as f64 / WIDTH as f64;
        // From 0.8 to 1.6 columns a pixel.
        WIDTH as f64 * (0.8 * x + 0.4 * x * x)
    });
    let ball = Scene::new(WIDTH, coordinates.collect(), EXTENT);
    let (shown, frames) = blurred(&ball, &sequence, 0.85);
    let (_, _, report) = of(&sequence, (shown, &frames), 0.05);
    let bounced = report.bounced.raised + report.bounced.masked;
    assert!(bounced < WIDTH * HEIGHT / 200, "{:?}", report.bounced);
    assert!(report.footprint_px.is_some_and(|px| (px - 0.85).abs() < 0.03), "{:?}", report.footprint_px);
}

/// Noise that the calibration understates by a fifth is no light, and the warning says so; real light with true noise has none of it.
#[test]
fn a_larger_gain_is_not_called_light_without_a_word() {
    let sequence = demo(8.0, 7);
    for (share, factor, expected) in [(0.0, 1.22, true), (0.05, 1.0, false), (0.0, 1.0, false)] {
        let (scene, frames) = frames(&sequence, share, |_| 1.0);
        let noise = CameraNoise { read_noise_dn: 0.8 / factor, gain_dn: 0.02 / (factor * factor) };
        let sensor = Sensor { noise: Some(noise), ..Sensor::default() };
        let settings = DecodeSettings { sensor, max_bounce_rad: 0.5, ..DecodeSettings::default() };
        let (_, report) = scene.decode_frames(&sequence, &frames, Axis::X, &settings);
        let warned = report.warnings("cam1").iter().any(|warning| warning.contains("another gain"));
        assert_eq!(warned, expected, "{share}, {factor}: {:?} {:?}", report.bounced, report.sensor.noise);
    }
}

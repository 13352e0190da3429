//! Light from other faces: its share of the uncertainty is that of the errors, and nothing else is taken for it.

use super::*;

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

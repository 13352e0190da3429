//! Something that stands before a frame of a code: seen by its own brightness, where no other surface beside it tells.

use super::*;

const WIDTH: usize = 320;
const ROWS: usize = 200;
const BITS: u32 = 6;
const STEPS: usize = 4;

/// A textured part of six faces, whose fringes do not run on from one to another.
struct Faces {
    scene: Scene,
    sequence: Vec<PatternSet>,
    frames: Vec<Frame>,
}

impl Faces {
    fn new() -> Self {
        let mut scene = Scene::ramp(WIDTH, ROWS, 0.71, 0.05, 304).eight_bits();
        scene.noise = (1.0, 0.02);
        for (i, x) in scene.coordinates_px.iter_mut().enumerate() {
            let (row, column) = (i / WIDTH, i % WIDTH);
            *x += [0.0, 24.5, 11.3, 37.9, 5.2, 29.6][row / 100 * 3 + column * 3 / WIDTH];
        }
        let sequence = vec![sine(Axis::X, 16.0, STEPS as u32), gray(Axis::X, BITS, 8.0)];
        let mut frames = scene.frames(&sequence);
        for frame in &mut frames {
            paint(frame, |i, value| value * albedo(i));
        }
        Self { scene, sequence, frames }
    }

    /// Findings, wrong orders, and valid pixels.
    fn decode(&self) -> (Vec<Finding>, usize, usize) {
        let mut decoder = self.scene.decoder(&self.sequence, &DecodeSettings::default()).unwrap();
        for (index, frame) in self.frames.iter().enumerate() {
            decoder.push(index, &frame.view()).unwrap();
        }
        let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
        let report = decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
        let scale = map.info.period_px / std::f64::consts::TAU;
        let valid = || (0..map.valid.len()).filter(|i| map.valid[*i] == 1);
        let off_px = |i: &usize| f64::from(map.phase_rad[*i]) * scale - self.scene.coordinates_px[*i];
        let wrong = valid().filter(|i| off_px(i).abs() > 0.5 * map.info.period_px).count();
        (report.findings, wrong, valid().count())
    }
}

/// Share of the light that a pixel's surface sends back: patches of 7 px from dark to white.
fn albedo(i: usize) -> f64 {
    let (row, column) = (i / WIDTH / 7, i % WIDTH / 7);
    0.35 + 0.65 * ((row * 5 + column * 3) % 8) as f64 / 7.0
}

fn paint(frame: &mut Frame, new: impl Fn(usize, f64) -> f64) {
    if let PixelBuffer::Mono8(values) = &mut frame.pixels {
        values.iter_mut().enumerate().for_each(|(i, v)| *v = new(i, f64::from(*v)).round() as u8);
    }
}

/// Two of the faces lie wholly under it, and two in part; the same part without it has no fault.
#[test]
fn a_hand_over_whole_faces_is_named_and_their_orders_stay_right() {
    let (findings, wrong, all) = Faces::new().decode();
    assert!(findings.is_empty() && wrong == 0 && all == WIDTH * ROWS, "{findings:?}, {wrong} of {all}");
    for bit in 1..BITS as usize {
        for lit in [false, true] {
            let mut faces = Faces::new();
            // Of one brightness, or with stripes of its own that stand elsewhere.
            let hand = |i: usize| if lit && (i % WIDTH / 11).is_multiple_of(2) { 110.0 } else { 60.0 };
            paint(&mut faces.frames[STEPS + bit], |i, value| if i % WIDTH < 140 { hand(i) } else { value });
            let (findings, wrong, left) = faces.decode();
            let name = format!("bit {bit}, lit {lit}: {wrong} wrong of {left} of {all}, {findings:?}");
            let covered = |share: f64| (share - 140.0 / 320.0).abs() < 0.1;
            assert!(
                matches!(findings[..], [Finding { set: 1, step: Some(step), fault: Fault::Covered(share), remedy: Remedy::Phase }]
                    if step == bit && covered(share)),
                "{name}"
            );
            assert!(wrong * 100 <= left && left * 100 > all * 70, "{name}");
        }
    }
}

//! Sequences are drawn, seen by a camera with another scale, colour and noise, and found again.

use super::*;
use fringe::frame::{Frame, PixelBuffer};
use fringe::math::random::{Key, Normal};
use fringe::pattern::{Code, Direction, frame_count, locate};

const WIDTH: u32 = 260;
const HEIGHT: u32 = 170;

/// Frames of a camera that sees 1.4 projector pixels in each of its own, slightly turned, with uneven colour and 1.5 DN of noise.
fn seen(sequence: &[PatternSet], size_px: [u32; 2], mirrored: bool) -> Vec<Frame> {
    let normal = Normal::default();
    let frame = |number: usize| {
        let (set, step) = locate(sequence, number).unwrap();
        let set = &sequence[set];
        let value = |pixel: u32| {
            let (u, v) = (f64::from(pixel % WIDTH), f64::from(pixel / WIDTH));
            let u = if mirrored { f64::from(WIDTH) - u } else { u };
            let (x, y) = (30.0 + 1.4 * u + 0.05 * v, 20.0 + 1.4 * v - 0.04 * u);
            // A camera pixel sees some projector pixels.
            let at = |shift: f64| match set.axis() {
                Some(Axis::Y) => set.intensity(step, y + shift, size_px[1]),
                _ => set.intensity(step, x + shift, size_px[0]),
            };
            let light: f64 = (0..5).map(|i| at(0.5 * f64::from(i) - 1.0).unwrap()).sum::<f64>() / 5.0;
            let colour = 0.6 + 0.3 * fringe::math::sin(0.03 * u) * fringe::math::cos(0.05 * v);
            let noise = 1.5 * f64::from(normal.draw(Key::new(7).with(number as u64).bits(u64::from(pixel))));
            (12.0 + 190.0 * colour * light + noise).round().clamp(0.0, 255.0) as u8
        };
        let pixels = PixelBuffer::Mono8((0..WIDTH * HEIGHT).map(value).collect());
        Frame { width_px: WIDTH, height_px: HEIGHT, full_scale_dn: 255, pixels }
    };
    (0..frame_count(sequence)).map(frame).collect()
}

fn explored(sequence: &[PatternSet], size_px: [u32; 2], mirrored: bool) -> Exploration {
    let frames = seen(sequence, size_px, mirrored);
    let views: Vec<_> = frames.iter().map(Frame::view).collect();
    explore(&views, Some(size_px)).unwrap()
}

fn sine(axis: Axis, period_px: f64, steps: u32, first_step_rad: f64, direction: Direction) -> PatternSet {
    PatternSet::Sine { axis, period_px, steps, first_step_rad, direction, shifts_rad: Vec::new() }
}

fn gray(axis: Axis, bits: u32, stripe_px: f64, invert: bool, code: Code) -> PatternSet {
    PatternSet::Gray { axis, bits, stripe_px, shift_px: 0.0, invert, code, threshold: None }
}

#[test]
fn steps_code_white_and_black_are_found_whatever_their_sense_and_origin() {
    for (steps, first, direction) in [
        (10, 0.0, Direction::Forward),
        (4, std::f64::consts::PI, Direction::Backward),
        (3, std::f64::consts::FRAC_PI_2, Direction::Forward),
    ] {
        let sequence = [
            sine(Axis::X, 16.0, steps, first, direction),
            gray(Axis::X, 6, 8.0, false, Code::Gray),
            PatternSet::White {},
            PatternSet::Black {},
        ];
        for mirrored in [false, true] {
            let found = explored(&sequence, [512, 400], mirrored);
            assert_eq!(found.sequence(), sequence, "{steps} steps, mirrored: {mirrored}");
            assert!(found.unexplained.is_empty());
        }
    }
}

#[test]
fn both_axes_complements_and_plain_binary_are_found() {
    for code in [Code::Gray, Code::Binary] {
        let sequence = [
            PatternSet::White {},
            PatternSet::Black {},
            gray(Axis::X, 6, 8.0, false, code),
            gray(Axis::X, 6, 8.0, true, code),
            gray(Axis::Y, 5, 13.0, false, code),
            gray(Axis::Y, 5, 13.0, true, code),
        ];
        assert_eq!(explored(&sequence, [512, 400], false).sequence(), sequence, "{code:?}");
    }
}

/// Bits from the finest stripes on, each followed by its complement: the frames are named in the order of a recording.
#[test]
fn frames_in_another_order_are_put_in_order() {
    let sequence = [gray(Axis::X, 6, 8.0, false, Code::Gray), gray(Axis::X, 6, 8.0, true, Code::Gray)];
    let frames = seen(&sequence, [512, 400], false);
    let order: Vec<usize> = (0..6).rev().flat_map(|bit| [bit, 6 + bit]).collect();
    let views: Vec<_> = order.iter().map(|k| frames[*k].view()).collect();
    let found = explore(&views, Some([512, 400])).unwrap();
    assert_eq!(found.sequence(), sequence);
    assert_eq!(found.sets[0].frames, [10, 8, 6, 4, 2, 0]);
    assert_eq!(found.sets[1].frames, [11, 9, 7, 5, 3, 1]);
}

#[test]
fn several_periods_keep_their_ratios_and_a_long_one_covers_the_projector() {
    let periods = |found: &Exploration| -> Vec<f64> {
        let period = |set: &FoundSet| match set.set {
            PatternSet::Sine { period_px, .. } => period_px,
            _ => 0.0,
        };
        found.sets.iter().map(period).collect()
    };
    let beat = [28.0, 26.0, 24.0].map(|p| sine(Axis::X, p, 6, 0.0, Direction::Forward));
    let found = explored(&beat, [512, 400], false);
    let ratios: Vec<f64> = periods(&found).iter().map(|p| p / periods(&found)[2]).collect();
    assert!((ratios[0] - 28.0 / 24.0).abs() < 0.01 && (ratios[1] - 26.0 / 24.0).abs() < 0.01, "{ratios:?}");
    assert!(found.sets.iter().all(|set| set.doubts.iter().any(|d| d.contains("only ratios"))));
    let cue = [16.0, 512.0].map(|p| sine(Axis::X, p, 5, 0.0, Direction::Forward));
    let found = explored(&cue, [512, 400], false);
    assert_eq!(periods(&found)[1], 512.0);
    assert!((periods(&found)[0] - 16.0).abs() < 0.2, "{:?}", periods(&found));
}

#[test]
fn what_shows_nothing_is_refused_by_name() {
    let frames = seen(&[sine(Axis::X, 16.0, 4, 0.0, Direction::Forward)], [512, 400], false);
    let same: Vec<_> = (0..5).map(|_| frames[0].view()).collect();
    assert!(explore(&same, None).unwrap_err().to_string().contains("no pattern"));
    assert_eq!(explore(&same[..2], None), Err(ExploreError::Count { count: 2 }));
    let small = Frame { width_px: 1, height_px: 1, full_scale_dn: 255, pixels: PixelBuffer::Mono8(vec![0]) };
    let mixed = [frames[0].view(), frames[1].view(), small.view()];
    assert!(explore(&mixed, None).unwrap_err().to_string().contains("frame 2 has 1 × 1 px"));
}

//! Something that stands before a frame of a code: seen by its own brightness, where no other surface beside it tells.

use super::code_dirt::Coded;
use super::*;

const WIDTH: usize = 320;
const ROWS: usize = 200;
const BITS: u32 = 6;
const STEPS: usize = 4;

/// A textured part of six faces, whose fringes do not run on from one to another.
fn faces() -> Coded {
    let mut scene = Scene::ramp(WIDTH, ROWS, 0.71, 0.05, 304).eight_bits();
    scene.noise = (1.0, 0.02);
    for (i, x) in scene.coordinates_px.iter_mut().enumerate() {
        let (row, column) = (i / WIDTH, i % WIDTH);
        *x += [0.0, 24.5, 11.3, 37.9, 5.2, 29.6][row / 100 * 3 + column * 3 / WIDTH];
    }
    let sequence = vec![sine(Axis::X, 16.0, STEPS as u32), gray(Axis::X, BITS, 8.0)];
    let frames = scene.frames(&sequence);
    let mut coded = Coded { scene, sequence, frames, first: STEPS };
    for frame in 0..coded.frames.len() {
        let light = coded.values(frame);
        coded.put(frame, |i| light[i] * albedo(i));
    }
    coded
}

/// Share of the light that a pixel's surface sends back: patches of 7 px from dark to white.
fn albedo(i: usize) -> f64 {
    let (row, column) = (i / WIDTH / 7, i % WIDTH / 7);
    0.35 + 0.65 * ((row * 5 + column * 3) % 8) as f64 / 7.0
}

/// Two of the faces lie wholly under it, and two in part; the same part without it has no fault.
#[test]
fn a_hand_over_whole_faces_is_named_and_their_orders_stay_right() {
    let (findings, wrong, all) = faces().decode().unwrap();
    assert!(findings.is_empty() && wrong == 0 && all == WIDTH * ROWS, "{findings:?}, {wrong} of {all}");
    for bit in 1..BITS as usize {
        for lit in [false, true] {
            let mut faces = faces();
            // Of one brightness, or with stripes of its own that stand elsewhere.
            let hand = |i: usize| if lit && (i % WIDTH / 11).is_multiple_of(2) { 110.0 } else { 60.0 };
            let light = faces.values(STEPS + bit);
            faces.put(STEPS + bit, |i| if i % WIDTH < 140 { hand(i) } else { light[i] });
            let (findings, wrong, left) = faces.decode().unwrap();
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

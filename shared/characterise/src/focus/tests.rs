//! Images of checkerboards with known blur.

use super::carrier::{find, usual_region};
use super::curve::evaluate;
use super::*;
use crate::response::Roi;
use fringe::frame::{Frame, PixelBuffer};
use fringe::math::fourier::transform_2d;
use fringe::math::{cos, erf, exp, sin};
use fringe::synthetic::Noise;
use std::f64::consts::{PI, TAU};

/// Level of a square wave of half period `square`, blurred by a Gaussian: −1 … 1.
fn wave(x: f64, square: f64, sigma: f64) -> f64 {
    let nearest = (x / square).round();
    (-9..=9)
        .map(|k| {
            let edge = nearest + f64::from(k);
            let sign = if edge.rem_euclid(2.0) == 0.0 { 1.0 } else { -1.0 };
            sign * erf((x - edge * square) / (sigma * 2.0_f64.sqrt()))
        })
        .sum()
}

/// A checkerboard, turned and blurred, under shading, with noise.
fn picture(size: (u32, u32), square: f64, angle: f64, sigma: f64, noise: &mut Noise) -> Frame {
    let value = |i: u32, noise: &mut Noise| {
        let (x, y) = (f64::from(i % size.0), f64::from(i / size.0));
        let (u, v) = (x * cos(angle) + y * sin(angle) + 3.1, y * cos(angle) - x * sin(angle) + 7.7);
        let board = wave(u, square, sigma) * wave(v, square, sigma);
        let light = (110.0 + 0.1 * x) * (1.0 + 0.8 * board);
        (light + 2.0 * noise.gauss()).round().clamp(0.0, 255.0) as u8
    };
    let values = (0..size.0 * size.1).map(|i| value(i, noise)).collect();
    Frame { width_px: size.0, height_px: size.1, full_scale_dn: 255, pixels: PixelBuffer::Mono8(values) }
}

#[test]
fn the_transform_is_the_sum_that_defines_it() {
    let mut noise = Noise(1);
    let (width, height) = (8, 4);
    let values: Vec<(f64, f64)> = (0..width * height).map(|_| (noise.gauss(), noise.gauss())).collect();
    let mut fast = values.clone();
    transform_2d(&mut fast, width, height);
    for (index, found) in fast.iter().enumerate() {
        let (u, v) = (index % width, index / width);
        let (mut re, mut im) = (0.0, 0.0);
        for (place, value) in values.iter().enumerate() {
            let (x, y) = (place % width, place / width);
            let turn = -TAU * ((u * x) as f64 / width as f64 + (v * y) as f64 / height as f64);
            re += value.0 * cos(turn) - value.1 * sin(turn);
            im += value.0 * sin(turn) + value.1 * cos(turn);
        }
        assert!((found.0 - re).abs() < 1e-12 && (found.1 - im).abs() < 1e-12, "{u} {v}");
    }
    let mut one = [(3.0, 4.0)];
    transform_2d(&mut one, 1, 1);
    assert_eq!(one, [(3.0, 4.0)]);
}

/// sign(cos) · sign(cos) has (4/π)² cos cos as its fundamental, which is two waves of half that amplitude; blur σ damps each by
/// exp(−2π²σ²f²), f² = 2 / (2 square)².
#[test]
fn the_carrier_of_a_checkerboard_is_the_closed_form() {
    for (square, angle, sigma) in [(14.0, 0.0, 0.5), (14.0, 0.1, 3.0), (9.3, 0.7, 1.5)] {
        let frame = picture((300, 280), square, angle, sigma, &mut Noise(5));
        let roi = usual_region(300, 280);
        let found = find(&frame.view(), &roi, None).unwrap();
        let f2 = 0.5 / (square * square);
        let expected = 0.8 * 0.5 * (4.0 / PI).powi(2) * exp(-2.0 * PI * PI * sigma * sigma * f2);
        assert!((found.contrast / expected - 1.0).abs() < 0.01, "{found:?} {expected}");
        assert!((found.square_px() / square - 1.0).abs() < 1e-3, "{}", found.square_px());
    }
}

fn stack(best_mm: f64, per_mm: f64, positions: &[f64]) -> Vec<(f64, Frame)> {
    let mut noise = Noise(11);
    let blur = |z: f64| (0.36 + (per_mm * (z - best_mm)).powi(2)).sqrt();
    // The board grows with the distance.
    let frame = |z: f64, noise: &mut Noise| picture((160, 140), 14.0 + 0.004 * z, 0.05, blur(z), noise);
    positions.iter().map(|z| (*z, frame(*z, &mut noise))).collect()
}

fn views(stack: &[(f64, Frame)]) -> Vec<(f64, fringe::frame::FrameView<'_>)> {
    stack.iter().map(|(z, frame)| (*z, frame.view())).collect()
}

/// The blur grows by 0.1 px/mm, so the contrast falls by a Gaussian of width 1/(2πf · 0.1 px/mm).
#[test]
fn best_focus_and_depth_are_found() {
    let positions: Vec<f64> = (0..13).map(|i| -130.0 + 20.0 * f64::from(i)).collect();
    let pictures = stack(-13.0, 0.1, &positions);
    let mut shuffled = views(&pictures);
    shuffled.swap(2, 9);
    let focus = evaluate(&shuffled, None, 0.5).unwrap();
    let f = 0.5_f64.sqrt() / 14.0;
    let width = 1.0 / (TAU * f * 0.1);
    let best = focus.best_focus_mm.unwrap();
    assert!((best + 13.0).abs() < 1.0, "{best} {:?}", focus.fit);
    assert!((best + 13.0).abs() < 5.0 * focus.u_best_focus_mm.unwrap());
    let depth = focus.depth_of_focus_mm.unwrap();
    let expected = 2.0 * width * (2.0 * std::f64::consts::LN_2).sqrt();
    assert!((depth / expected - 1.0).abs() < 0.05, "{depth} {expected}");
    assert!((focus.depth_by_points_mm.unwrap() / expected - 1.0).abs() < 0.08, "{focus:?}");
    assert!(focus.curve.windows(2).all(|p| p[0].position_mm < p[1].position_mm));
}

#[test]
fn a_focus_outside_of_the_positions_is_not_invented() {
    let positions: Vec<f64> = (0..6).map(|i| 20.0 * f64::from(i)).collect();
    let pictures = stack(-30.0, 0.1, &positions);
    let focus = evaluate(&views(&pictures), None, 0.5).unwrap();
    assert_eq!((focus.best_focus_mm, focus.depth_of_focus_mm, focus.sharpest_mm), (None, None, 0.0));
    // In focus everywhere: the depth is at least all that was measured.
    let pictures = stack(50.0, 0.0005, &positions);
    let focus = evaluate(&views(&pictures), None, 0.5).unwrap();
    assert_eq!((focus.depth_of_focus_mm, focus.depth_at_least_mm), (None, 100.0));
}

#[test]
fn pictures_that_show_no_board_are_refused() {
    let even = |dn: u8| Frame {
        width_px: 64,
        height_px: 64,
        full_scale_dn: 255,
        pixels: PixelBuffer::Mono8(vec![dn; 64 * 64]),
    };
    let four = |frame: &Frame| (0..4).map(|i| (f64::from(i), frame.clone())).collect::<Vec<_>>();
    for dn in [0, 80] {
        let constant = four(&even(dn));
        assert!(matches!(evaluate(&views(&constant), None, 0.5), Err(FocusError::NoPattern { .. })));
    }
    let full = four(&even(255));
    assert!(matches!(evaluate(&views(&full), None, 0.5), Err(FocusError::Saturated { .. })));
    let mut random = Noise(3);
    let mut noisy = even(0);
    noisy.pixels = PixelBuffer::Mono8((0..64 * 64).map(|_| (120.0 + 20.0 * random.gauss()) as u8).collect());
    assert!(matches!(evaluate(&views(&four(&noisy)), None, 0.5), Err(FocusError::NoPattern { .. })));
    let board = picture((64, 64), 6.0, 0.0, 1.0, &mut Noise(2));
    let good = four(&board);
    assert!(evaluate(&views(&good), None, 0.5).is_ok());
    assert!(matches!(evaluate(&views(&good), None, 1.0), Err(FocusError::Fraction(_))));
    assert!(matches!(
        evaluate(&views(&good[..3]), None, 0.5),
        Err(FocusError::TooFewPositions { found: 3, .. })
    ));
    assert!(matches!(evaluate(&[], None, 0.5), Err(FocusError::TooFewPositions { found: 0, .. })));
    let outside = Roi { x: 1, y: 0, width_px: 64, height_px: 64 };
    assert!(matches!(evaluate(&views(&good), Some(outside), 0.5), Err(FocusError::Region(_))));
    let tiny = Roi { x: 0, y: 0, width_px: 8, height_px: 64 };
    assert!(matches!(evaluate(&views(&good), Some(tiny), 0.5), Err(FocusError::RegionSize { .. })));
}

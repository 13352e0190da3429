//! Every method gives back the phase that was drawn, with the scatter that it predicts, and no more than it saw.

use super::harmonics::PhaseHarmonics;
use super::windowed::{WindowedSettings, filter};
use super::*;
use crate::frame::{Frame, PixelBuffer};
use crate::math::random::{Key, Normal};
use crate::math::{cos, pow, wrap_rad};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const WIDTH: usize = 160;
const HEIGHT: usize = 96;
const NOISE_DN: f64 = 60.0;
const B_DN: f64 = 18_000.0;

fn limits(noise_dn: f64) -> Limits {
    Limits {
        least_modulation_dn: 1000.0,
        clipped_dn: 65_000,
        read_variance_dn2: noise_dn * noise_dn + 1.0 / 12.0,
        gain_dn: 0.0,
    }
}

/// Fringes of some 11 px, bent.
fn phase(x: usize, y: usize) -> f64 {
    let (x, y) = (x as f64, y as f64);
    0.57 * x + 0.05 * y + 0.6 * cos(0.02 * x - 0.03 * y)
}

fn frame(size: (usize, usize), value: impl Fn(usize, usize) -> f64) -> Frame {
    let (width, height) = size;
    let pixels = (0..width * height)
        .map(|i| value(i % width, i / width).round().clamp(0.0, 65_535.0) as u16)
        .collect();
    Frame {
        width_px: width as u32,
        height_px: height as u32,
        full_scale_dn: 65_535,
        pixels: PixelBuffer::Mono16(pixels),
    }
}

/// Frames of true shifts, with noise.
fn frames(shifts: &[f64], noise_dn: f64, phase: impl Fn(usize, usize) -> f64) -> Vec<Frame> {
    let normal = Normal::default();
    let draw = |number: usize, x: usize, y: usize| {
        let key = Key::new(5).with(number as u64);
        noise_dn * f64::from(normal.draw(key.bits((y * WIDTH + x) as u64)))
    };
    let one = |(number, shift): (usize, &f64)| {
        frame((WIDTH, HEIGHT), |x, y| 25_000.0 + B_DN * cos(phase(x, y) - shift) + draw(number, x, y))
    };
    shifts.iter().enumerate().map(one).collect()
}

fn wrap(frames: &[Frame], shifts: &[f64], method: Method, limits: &Limits) -> Result<Wrapped, WrapError> {
    let views: Vec<_> = frames.iter().map(Frame::view).collect();
    Stack::new(&views, shifts)?.wrap(method, limits)
}

fn even(steps: usize) -> Vec<f64> {
    (0..steps).map(|i| TAU * i as f64 / steps as f64).collect()
}

/// Root mean square error, largest error, root mean square of error over σ, valid share.
fn statistics(map: &Wrapped, phase: impl Fn(usize, usize) -> f64) -> (f64, f64, f64, f64) {
    let (mut sum, mut worst, mut ratio, mut n) = (0.0, 0.0_f64, 0.0, 0.0);
    for i in 0..map.len() {
        let (x, y) = (i % map.width_px as usize, i / map.width_px as usize);
        if map.valid[i] == 0 {
            assert!(map.phase_rad[i].is_nan() && map.sigma_rad[i].is_nan());
            continue;
        }
        let error = wrap_rad(f64::from(map.phase_rad[i]) - phase(x, y));
        sum += error * error;
        worst = worst.max(error.abs());
        ratio += (error / f64::from(map.sigma_rad[i])).powi(2);
        n += 1.0;
    }
    ((sum / n).sqrt(), worst, (ratio / n).sqrt(), n / map.len() as f64)
}

/// Nominal shifts of each method of several frames.
fn cases() -> Vec<(Method, Vec<f64>)> {
    let quarter = |n: usize, sign: f64| (0..n).map(|i| sign * FRAC_PI_2 * i as f64).collect::<Vec<_>>();
    vec![
        (Method::LeastSquares, even(3)),
        (Method::LeastSquares, vec![0.1, 1.3, 2.2, 3.9, 4.4]),
        (Method::ThreeStep, even(3)),
        (Method::ThreeStep, vec![0.7, -0.5, -1.7]),
        (Method::Carre, quarter(4, 1.0)),
        (Method::Carre, quarter(4, -1.0)),
        (Method::Hariharan, quarter(5, 1.0)),
        (Method::Hariharan, quarter(5, -1.0)),
    ]
}

#[test]
fn every_method_gives_back_what_was_drawn_and_predicts_its_scatter() {
    for (method, shifts) in cases() {
        let clean = wrap(&frames(&shifts, 0.0, phase), &shifts, method, &limits(0.0)).unwrap();
        let (_, worst, _, share) = statistics(&clean, phase);
        // Rounding to whole DN at B = 18 000 DN; Carré's root doubles it near θ = 0.
        assert!(worst < 3e-3 && share == 1.0, "{method:?} {shifts:?}: {worst} {share}");
        let noisy = wrap(&frames(&shifts, NOISE_DN, phase), &shifts, method, &limits(NOISE_DN)).unwrap();
        let (_, _, ratio, _) = statistics(&noisy, phase);
        // 15 360 pixels give a scatter to 0.6 %; five standard deviations of that.
        assert!((ratio - 1.0).abs() < 0.03, "{method:?} {shifts:?}: {ratio}");
        let b = f64::from(noisy.modulation[777]);
        assert!((b / B_DN - 1.0).abs() < 0.05, "{method:?}: B {b}");
        assert!((f64::from(noisy.background[777]) / 25_000.0 - 1.0).abs() < 0.05, "{method:?}");
    }
}

#[test]
fn three_steps_in_closed_form_are_their_least_squares() {
    let shifts = even(3);
    let frames = frames(&shifts, 500.0, phase);
    let one = wrap(&frames, &shifts, Method::ThreeStep, &limits(500.0)).unwrap();
    let other = wrap(&frames, &shifts, Method::LeastSquares, &limits(500.0)).unwrap();
    for i in 0..one.len() {
        assert!(wrap_rad(f64::from(one.phase_rad[i] - other.phase_rad[i])).abs() < 1e-6);
        assert!((one.sigma_rad[i] / other.sigma_rad[i] - 1.0).abs() < 1e-5);
        assert!((one.modulation[i] / other.modulation[i] - 1.0).abs() < 1e-5);
    }
}

#[test]
fn self_calibrating_methods_do_not_trust_the_steps() {
    let nominal = |n: usize| (0..n).map(|i| FRAC_PI_2 * i as f64).collect::<Vec<_>>();
    for (method, n, most) in [(Method::Carre, 4, 2e-3), (Method::Hariharan, 5, 4e-3)] {
        // The projector steps by 94° where 90° were meant.
        let shifts: Vec<f64> = nominal(n).iter().map(|s| s * 94.0 / 90.0).collect();
        let frames = frames(&shifts, 0.0, phase);
        let (rms, ..) = statistics(&wrap(&frames, &nominal(n), method, &limits(1.0)).unwrap(), phase);
        let trusting = wrap(&frames, &nominal(n), Method::LeastSquares, &limits(1.0)).unwrap();
        let (naive, ..) = statistics(&trusting, phase);
        assert!(rms < most && naive > 5.0 * rms, "{method:?}: {rms} against {naive}");
    }
}

#[test]
fn one_frame_is_enough_where_the_surface_is_smooth() {
    for method in [Method::FourierRows, Method::Fourier] {
        for sign in [1.0, -1.0] {
            let shifts = [0.4, 0.4 + sign * FRAC_PI_2];
            let turned = |x: usize, y: usize| sign * phase(x, y);
            let map = wrap(&frames(&shifts, 0.0, turned), &shifts, method, &limits(1.0)).unwrap();
            let inner = |x: usize, y: usize| (20..WIDTH - 20).contains(&x) && (20..HEIGHT - 20).contains(&y);
            let mut sum = (0.0, 0.0);
            for i in (0..map.len()).filter(|i| inner(i % WIDTH, i / WIDTH)) {
                assert_eq!(map.valid[i], 1);
                let error = wrap_rad(f64::from(map.phase_rad[i]) - turned(i % WIDTH, i / WIDTH));
                sum = (sum.0 + error * error, sum.1 + 1.0);
            }
            let rms = (sum.0 / sum.1).sqrt();
            assert!(rms < 0.03, "{method:?} {sign}: {rms}");
        }
    }
}

/// Surfaces that one frame cannot show: an edge of brightness, a step, a crease, texture, a gamma. The error there is a
/// systematic one; σ states its size, and for the smooth surface the noise alone. Texture about as fine as the fringes is a
/// fringe to a line alone: only the plane tells it.
#[test]
fn the_sigma_of_one_frame_holds_its_systematic_part() {
    type Of<'a> = &'a dyn Fn(usize, usize) -> f64;
    let right = |x: usize| if x > WIDTH / 2 { 1.0 } else { 0.0 };
    let texture =
        |x: usize, y: usize| 1.0 + 0.1 * cos(0.9 * x as f64 + 0.4 * y as f64) * cos(0.23 * x as f64);
    let smooth: Of = &phase;
    let step: Of = &|x, y| phase(x, y) + 1.2 * right(x);
    let crease: Of = &|x, y| phase(x, y) + 0.06 * right(x) * (x as f64 - WIDTH as f64 / 2.0);
    let one: Of = &|_, _| 1.0;
    let edge: Of = &|x, _| 1.0 - 0.5 * right(x);
    let cases: [(&str, Of, Of, f64); 6] = [
        ("smooth", smooth, one, 1.0),
        ("edge of brightness", smooth, edge, 1.0),
        ("step", step, one, 1.0),
        ("crease", crease, one, 1.0),
        ("texture", smooth, &texture, 1.0),
        ("gamma", smooth, one, 1.6),
    ];
    let mut found = Vec::new();
    for (name, surface, bright, gamma) in cases {
        let lines = if name == "texture" { None } else { Some(Method::FourierRows) };
        for method in lines.into_iter().chain([Method::Fourier]) {
            for noise_dn in [20.0, 400.0] {
                let normal = Normal::default();
                let key = Key::new(11);
                let drawn = frame((WIDTH, HEIGHT), |x, y| {
                    let light = pow(0.5 + 0.36 * cos(surface(x, y)), gamma);
                    let noise = f64::from(normal.draw(key.bits((y * WIDTH + x) as u64)));
                    50_000.0 * bright(x, y) * light + noise_dn * noise
                });
                let map = wrap(&[drawn], &[0.0], method, &limits(noise_dn)).unwrap();
                let (rms, _, ratio, share) = statistics(&map, surface);
                found.push((
                    ratio,
                    format!("{name}, {method:?}, {noise_dn}: {ratio:.2} at {rms:.4} rad, valid {share:.2}"),
                ));
            }
        }
    }
    let lines: Vec<&str> = found.iter().map(|(_, line)| line.as_str()).collect();
    assert!(found.iter().all(|(ratio, _)| (0.5..1.5).contains(ratio)), "{}", lines.join("\n"));
}

#[test]
fn the_windowed_filter_takes_out_noise_and_says_how_much() {
    let shifts = even(3);
    let map = wrap(&frames(&shifts, 3000.0, phase), &shifts, Method::LeastSquares, &limits(3000.0)).unwrap();
    let clear = filter(&map, &WindowedSettings::default());
    let ((before, ..), (after, _, ratio, share)) = (statistics(&map, phase), statistics(&clear, phase));
    assert!(after < 0.25 * before && share == 1.0, "{before} {after} {share}");
    assert!((0.7..1.4).contains(&ratio), "{ratio}");
}

#[test]
fn the_error_of_a_gamma_is_found_in_the_phase_and_removed() {
    let shifts = even(3);
    let light = |x, y, s: f64| 50_000.0 * pow(0.5 + 0.5 * cos(phase(x, y) - s), 2.2);
    let drawn: Vec<Frame> = shifts.iter().map(|s| frame((WIDTH, HEIGHT), |x, y| light(x, y, *s))).collect();
    let mut map = wrap(&drawn, &shifts, Method::LeastSquares, &limits(1.0)).unwrap();
    let (before, ..) = statistics(&map, phase);
    let found = PhaseHarmonics::find(&map, 3).unwrap();
    found.remove(&mut map);
    let (after, ..) = statistics(&map, phase);
    assert!(before > 0.1 && after < 0.15 * before, "{before} {after}");
    // A phase without harmonics is left as it is.
    let clean = wrap(&frames(&shifts, 0.0, phase), &shifts, Method::LeastSquares, &limits(1.0)).unwrap();
    assert!(PhaseHarmonics::find(&clean, 3).unwrap().amplitude_rad() < 0.01);
    assert_eq!(PhaseHarmonics::find(&Wrapped::new(40, 40), 3), None);
}

#[test]
fn frames_that_a_method_does_not_take_are_named() {
    let drawn = frames(&even(4), 0.0, phase);
    let error =
        |shifts: &[f64], method| wrap(&drawn[..shifts.len()], shifts, method, &limits(1.0)).unwrap_err();
    assert!(matches!(error(&even(4)[..2], Method::LeastSquares), WrapError::Frames { got: 2, .. }));
    assert!(matches!(error(&[0.0, 1.0, 1.0], Method::LeastSquares), WrapError::Shifts { .. }));
    assert!(matches!(error(&even(4), Method::ThreeStep), WrapError::Frames { got: 4, .. }));
    assert!(matches!(error(&even(3), Method::Carre), WrapError::Frames { got: 3, .. }));
    assert!(matches!(error(&[0.0, 1.0, 2.0, 4.0], Method::Carre), WrapError::Shifts { .. }));
    let five = [drawn.clone(), drawn.clone()].concat();
    let tight = wrap(&five[..5], &[0.0, 0.5, 1.0, 1.5, 2.0], Method::Hariharan, &limits(1.0)).unwrap_err();
    assert!(tight.to_string().contains("0.0, 28.6, 57.3"), "{tight}");
    assert!(matches!(wrap(&[], &[], Method::Fourier, &limits(1.0)), Err(WrapError::Frames { got: 0, .. })));
    let mut unequal = drawn.clone();
    unequal[2] = frame((WIDTH, 5), |_, _| 1.0);
    let size = wrap(&unequal, &even(4), Method::LeastSquares, &limits(1.0)).unwrap_err();
    assert!(matches!(size, WrapError::Size { index: 2, .. }));
}

#[test]
fn constant_frames_and_lines_of_one_pixel_have_defined_results() {
    for size in [(32, 32), (1, 40), (40, 1), (1, 1)] {
        let flat: Vec<Frame> = (0..5).map(|_| frame(size, |_, _| 30_000.0)).collect();
        let quarter: Vec<f64> = (0..5).map(|i| FRAC_PI_2 * f64::from(i)).collect();
        for method in [Method::LeastSquares, Method::ThreeStep] {
            let n = if method == Method::ThreeStep { 3 } else { 5 };
            let map = wrap(&flat[..n], &quarter[..n], method, &limits(1.0)).unwrap();
            assert_eq!(map.valid_count(), 0, "{method:?} {size:?}");
            assert_eq!(filter(&map, &WindowedSettings::default()).valid_count(), 0);
        }
        for (method, n) in [(Method::Carre, 4), (Method::Hariharan, 5)] {
            let refused = wrap(&flat[..n], &quarter[..n], method, &limits(1.0));
            assert!(matches!(refused, Err(WrapError::NoStep { .. })), "{method:?}");
        }
        for method in [Method::FourierRows, Method::Fourier] {
            let refused = wrap(&flat[..1], &[0.0], method, &limits(1.0));
            assert!(matches!(refused, Err(WrapError::NoCarrier { .. })), "{method:?} {size:?}");
        }
    }
}

#[test]
fn uneven_shifts_multiply_the_noise_as_their_covariance_says() {
    assert!((LeastSquares::new(&even(10)).unwrap().mean_noise() - 0.2_f64.sqrt()).abs() < 1e-12);
    assert_eq!(LeastSquares::new(&[0.0, PI, TAU, 3.0 * PI]), None);
    assert_eq!(LeastSquares::new(&[]), None);
    assert!(LeastSquares::new(&[0.0, 0.3, 0.6]).unwrap().mean_noise() > 8.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_whole_turn_changes_nothing_and_the_mask_is_never_filled(
        which in 0..8_usize,
        turns in -3..4_i32,
        holes in proptest::collection::vec(0..WIDTH * HEIGHT, 1..40),
    ) {
        let (method, shifts) = cases().swap_remove(which);
        let mut drawn = frames(&shifts, 30.0, phase);
        for hole in &holes {
            if let PixelBuffer::Mono16(values) = &mut drawn[hole % shifts.len()].pixels {
                values[*hole] = 65_535;
            }
        }
        let map = wrap(&drawn, &shifts, method, &limits(30.0)).unwrap();
        let turned: Vec<f64> = shifts.iter().map(|s| s + TAU * f64::from(turns)).collect();
        let again = wrap(&drawn, &turned, method, &limits(30.0)).unwrap();
        for i in 0..map.len() {
            prop_assert_eq!(map.valid[i], again.valid[i]);
            prop_assert_eq!(map.valid[i] == 0, holes.contains(&i));
            prop_assert_eq!(map.phase_rad[i].is_nan(), holes.contains(&i));
            if map.valid[i] == 1 {
                prop_assert!(wrap_rad(f64::from(map.phase_rad[i] - again.phase_rad[i])).abs() < 1e-5);
            }
        }
        let clear = filter(&map, &WindowedSettings::default());
        prop_assert!(holes.iter().all(|hole| clear.valid[*hole] == 0 && clear.phase_rad[*hole].is_nan()));
    }
}

//! The response against closed forms.

use super::fringes::{FringeResponse, Fringes};
use super::*;
use fringe::frame::{Frame, PixelBuffer};
use fringe::math::{cos, pow};
use fringe::pattern::LevelTable;
use proptest::prelude::*;
use std::f64::consts::TAU;

/// Means of `count` levels of a response from 10 to 210 DN.
fn levels(count: usize, light: impl Fn(f64) -> f64) -> Vec<GreyLevel> {
    let level = |i: usize| i as f64 / (count - 1) as f64;
    let mean =
        |i| GreyLevel { level: level(i), mean_dn: 10.0 + 200.0 * light(level(i)), sd_dn: 0.0, saturated: 0 };
    (0..count).map(mean).collect()
}

fn even(dn: u16, width: u32, height: u32) -> Frame {
    let values = vec![dn; (width * height) as usize];
    Frame { width_px: width, height_px: height, full_scale_dn: 4095, pixels: PixelBuffer::Mono16(values) }
}

#[test]
fn a_power_law_comes_back() {
    for gamma in [0.45, 1.0, 2.2, 5.0] {
        let fit = PowerLaw::fit(&levels(52, |x| pow(x, gamma))).unwrap();
        assert!((fit.gamma - gamma).abs() < 1e-6, "{fit:?}");
        assert!((fit.gain_dn - 200.0).abs() < 1e-4 && (fit.offset_dn - 10.0).abs() < 1e-4, "{fit:?}");
    }
}

/// The scatter of γ over many noisy sets is what each set predicts: a χ² of 200 degrees of freedom, 99.9 % limits.
#[test]
fn the_uncertainty_of_gamma_is_its_scatter() {
    let mut random = fringe::synthetic::Noise(7);
    let squares: f64 = (0..200)
        .map(|_| {
            let mut noisy = levels(52, |x| pow(x, 2.2));
            for g in &mut noisy {
                g.mean_dn += 0.5 * random.gauss();
            }
            let fit = PowerLaw::fit(&noisy).unwrap();
            ((fit.gamma - 2.2) / fit.u_gamma).powi(2)
        })
        .sum();
    assert!((142.0..273.0).contains(&squares), "{squares}");
}

#[test]
fn a_polynomial_response_gives_back_its_own_coefficients_and_their_scatter() {
    let a = [0.0, 1.4, -0.9, 0.2, 0.6, -0.8, 0.7, -0.2];
    let drawn = |y: f64| a.iter().rev().fold(0.0, |sum, c| sum * y + c);
    let set = |i: usize| {
        let y = i as f64 / 60.0;
        GreyLevel { level: drawn(y), mean_dn: 10.0 + 200.0 * y, sd_dn: 0.0, saturated: 0 }
    };
    let exact: Vec<GreyLevel> = (0..=60).map(set).collect();
    let fit = InversePolynomial::fit(&exact, [10.0, 210.0]).unwrap();
    for (found, expected) in fit.coefficients.iter().zip(a) {
        assert!((found - expected).abs() < 1e-9, "{:?}", fit.coefficients);
    }
    assert!(fit.monotonic && fit.residual_max < 1e-12);
    let mut random = fringe::synthetic::Noise(3);
    let mut squares = [0.0; COEFFICIENTS];
    for _ in 0..200 {
        let mut noisy = exact.clone();
        for g in &mut noisy {
            g.level += 1e-3 * random.gauss();
        }
        let fit = InversePolynomial::fit(&noisy, [10.0, 210.0]).unwrap();
        let u = fit.u_coefficients();
        for k in 0..COEFFICIENTS {
            squares[k] += ((fit.coefficients[k] - a[k]) / u[k]).powi(2);
        }
    }
    // Student's t of 53 degrees of freedom has the variance 1.04; 99.9 % limits of 200 squares.
    assert!(squares.iter().all(|s| (145.0..288.0).contains(s)), "{squares:?}");
}

#[test]
fn an_inverse_power_law_is_no_polynomial_but_the_curve_follows_it() {
    let measured = levels(256, |x| pow(x, 2.2));
    let curve = ResponseCurve::new(&measured, 255).unwrap();
    let polynomial = InversePolynomial::fit(&measured, curve.range_dn()).unwrap();
    let truth = |light: f64| pow(light, 1.0 / 2.2);
    let worst = |f: &dyn Fn(f64) -> f64| (0..=500).map(|i| f(f64::from(i) / 500.0)).fold(0.0, f64::max);
    let by_curve = worst(&|y| (pow(curve.level(y), 2.2) - y).abs());
    let by_polynomial = worst(&|y| (polynomial.level(y) - truth(y)).abs());
    assert!(by_curve < 2e-5, "{by_curve}");
    assert!((0.01..0.2).contains(&by_polynomial), "{by_polynomial}");
}

#[test]
fn noise_is_pooled_and_a_fall_is_refused() {
    let mut noisy = levels(64, |x| pow(x, 2.2));
    (noisy[3].mean_dn, noisy[4].mean_dn) = (noisy[4].mean_dn, noisy[3].mean_dn);
    let curve = ResponseCurve::new(&noisy, 255).unwrap();
    let table = LevelTable::sample(256, |y| curve.level(y)).unwrap();
    assert!(table.values().windows(2).all(|pair| pair[0] <= pair[1]));
    noisy.swap(20, 40);
    (noisy[20].level, noisy[40].level) = (noisy[40].level, noisy[20].level);
    assert!(matches!(ResponseCurve::new(&noisy, 255), Err(ResponseError::NotMonotonic { .. })));
    let falling = levels(64, |x| 1.0 - x);
    assert!(matches!(ResponseCurve::new(&falling, 255), Err(ResponseError::NotMonotonic { .. })));
    assert!(matches!(ResponseCurve::new(&levels(64, |_| 0.5), 255), Err(ResponseError::Flat { .. })));
    let few = ResponseCurve::new(&levels(8, |x| x), 255);
    assert_eq!(few.unwrap_err(), ResponseError::TooFewLevels { found: 8, needed: 9 });
}

/// A projector that is dark below a tenth and full above nine tenths.
#[test]
fn flat_ends_are_not_drawn() {
    let clipped = levels(101, |x| ((x - 0.1) / 0.8).clamp(0.0, 1.0));
    let curve = ResponseCurve::new(&clipped, 255).unwrap();
    assert!((curve.level(0.0) - 0.1).abs() < 1e-9 && (curve.level(1.0) - 0.9).abs() < 1e-9);
    assert!((curve.level(0.5) - 0.5).abs() < 1e-9);
}

#[test]
fn one_wrong_pixel_set_would_bend_the_curve_so_saturated_pixels_leave_all_levels() {
    let mut stack = Stack::new(Some(Roi { x: 0, y: 0, width_px: 10, height_px: 10 }));
    for step in 0..=16_u16 {
        let mut frame = even(step * 200, 20, 20);
        if let PixelBuffer::Mono16(values) = &mut frame.pixels {
            // Ten pixels of the region are twice as bright.
            values[..10].iter_mut().for_each(|v| *v = (*v * 2).min(4095));
        }
        stack.push(f64::from(step) / 16.0, &frame.view()).unwrap();
    }
    let levels = stack.levels().unwrap();
    assert_eq!(stack.saturated_pixels(), 10);
    assert_eq!(levels[16].saturated, 10);
    assert!(levels.iter().all(|g| (g.mean_dn - 3200.0 * g.level).abs() < 1e-9 && g.sd_dn == 0.0));
}

#[test]
fn regions_and_frames_that_do_not_fit_are_refused() {
    let outside = Roi { x: 15, y: 0, width_px: 10, height_px: 10 };
    let refused = Stack::new(Some(outside)).push(0.0, &even(5, 20, 20).view());
    assert!(matches!(refused, Err(ResponseError::RoiOutside { .. })));
    let far = Roi { x: u32::MAX, y: u32::MAX, width_px: u32::MAX, height_px: 1 };
    assert!(far.check(20, 20).is_err());
    let mut stack = Stack::new(None);
    stack.push(0.0, &even(5, 20, 20).view()).unwrap();
    assert!(matches!(
        stack.push(1.0, &even(5, 20, 21).view()),
        Err(ResponseError::Unequal { number: 1, .. })
    ));
    let mut full = Stack::new(None);
    (0..9).for_each(|i| full.push(f64::from(i) / 8.0, &even(4095, 20, 20).view()).unwrap());
    assert!(matches!(full.levels(), Err(ResponseError::Saturated { saturated: 100, pixels: 100, .. })));
    assert!("0,0,10".parse::<Roi>().is_err() && "0,0,0,5".parse::<Roi>().is_err());
    assert_eq!(Roi::centre(1124, 750), "512,325,100,100".parse().unwrap());
}

#[test]
fn frames_of_one_level_are_averaged() {
    let mut stack = Stack::new(None);
    for dn in [100, 103, 106] {
        stack.push(0.5, &even(dn, 8, 8).view()).unwrap();
    }
    let levels = stack.levels().unwrap();
    assert_eq!((levels.len(), levels[0].mean_dn), (1, 103.0));
}

/// v² = (½ + ½ cos φ)² = 3/8 + ½ cos φ + ⅛ cos 2φ: a quarter of the first harmonic, and no other.
#[test]
fn harmonics_of_a_square_law_are_the_closed_form() {
    let found = waveform::harmonics(|v| v * v);
    assert!((found[0] - 0.25).abs() < 1e-12 && found[1..].iter().all(|h| *h < 1e-12), "{found:?}");
    assert!(waveform::harmonics(|v| v).iter().all(|h| *h < 1e-12));
    // Three steps take the second harmonic h for an error of h sin 3φ (to first order), four steps do not see it.
    let three = waveform::phase_error(3, |v| v + 0.01 * v * v).unwrap();
    let h = waveform::harmonics(|v| v + 0.01 * v * v)[0];
    assert!((three.peak_rad - h).abs() < 0.01 * h && (three.rms_rad - h / 2.0_f64.sqrt()).abs() < 0.01 * h);
    assert!(waveform::phase_error(4, |v| v + 0.01 * v * v).unwrap().peak_rad < 1e-12);
    assert!(waveform::phase_error(2, |v| v).is_err());
}

/// Fringes of 40 px with γ under shading, with `steps` steps.
fn fringes(gamma: f64, steps: u32, offset: f64) -> Vec<Frame> {
    let frame = |light: &dyn Fn(u32) -> f64| {
        let value = |i: u32| (100.0 + (2000.0 + 5.0 * f64::from(i / 120)) * light(i % 120)).round() as u16;
        let values = (0..120 * 80).map(value).collect();
        Frame { width_px: 120, height_px: 80, full_scale_dn: 4095, pixels: PixelBuffer::Mono16(values) }
    };
    let step = |k: u32| {
        let shift = TAU * f64::from(k) / f64::from(steps);
        frame(&|x| {
            offset + (1.0 - 2.0 * offset) * pow(0.5 + 0.5 * cos(TAU * f64::from(x) / 40.7 - shift), gamma)
        })
    };
    (0..steps).map(step).chain([frame(&|_| 1.0), frame(&|_| 0.0)]).collect()
}

#[test]
fn recorded_fringes_show_the_harmonics_and_the_error_that_theory_predicts() {
    let frames = fringes(2.2, 60, 0.0);
    let views: Vec<_> = frames[..60].iter().map(Frame::view).collect();
    let found = recorded::analyse(&views, None, 3).unwrap();
    let theory = waveform::harmonics(|v| pow(v, 2.2));
    for (found, theory) in found.harmonics.iter().zip(theory) {
        assert!((found.unwrap() - theory).abs() < 2e-4, "{found:?} {theory}");
    }
    let theory = waveform::phase_error(3, |v| pow(v, 2.2)).unwrap();
    let error = found.phase_error.unwrap();
    assert!((error.rms_rad / theory.rms_rad - 1.0).abs() < 0.02, "{error:?} {theory:?}");
    assert!((error.peak_rad / theory.peak_rad - 1.0).abs() < 0.05, "{error:?} {theory:?}");
    // Seven frames say nothing about the fourth harmonic, and there is no better phase to compare with.
    let few = recorded::analyse(&views[..7], None, 7).unwrap();
    assert!(few.harmonics[2..] == [None, None] && few.phase_error.is_none());
    let dark = [even(5, 30, 30), even(5, 30, 30), even(5, 30, 30)];
    let dark: Vec<_> = dark.iter().map(Frame::view).collect();
    assert!(matches!(recorded::analyse(&dark, None, 3), Err(ResponseError::NoFringes { .. })));
}

#[test]
fn fringes_with_white_and_black_tell_gamma() {
    for (gamma, steps, offset) in [(2.2, 3, 0.0), (1.5, 3, 0.04), (1.0, 10, 0.0)] {
        let frames = fringes(gamma, steps, offset);
        let views: Vec<_> = frames.iter().map(Frame::view).collect();
        let n = steps as usize;
        let set = Fringes { steps: &views[..n], white: views[n], black: views[n + 1] };
        let fit = FringeResponse::fit(&set, None).unwrap();
        assert!((fit.gamma - gamma).abs() < 2e-3, "{fit:?}");
        assert!(
            (fit.offset - offset).abs() < 1e-3 && (fit.gain - 1.0 + 2.0 * offset).abs() < 1e-3,
            "{fit:?}"
        );
        assert!((fit.level(fit.light(0.3)) - 0.3).abs() < 1e-9);
        let none = Fringes { steps: &views[..n], white: views[n + 1], black: views[n] };
        assert!(FringeResponse::fit(&none, None).is_err());
    }
}

#[test]
fn tables_that_cannot_be_are_refused() {
    for values in [vec![0.5], vec![0.0, 1.5], vec![0.5, 0.2], vec![0.3, 0.3], vec![0.0, f64::NAN]] {
        assert!(LevelTable::new(values).is_err());
    }
    assert!(LevelTable::sample(70_000, |x| x).is_err() && LevelTable::sample(1, |x| x).is_err());
    assert!(serde_json::from_str::<LevelTable>("[0.0, 2.0]").is_err());
}

proptest! {
    #[test]
    fn the_curve_and_its_inverse_undo_each_other(steps in proptest::collection::vec(0.0_f64..1.0, 9..60), at in 0.0_f64..1.0) {
        let total: f64 = steps.iter().map(|s| s + 0.01).sum();
        let mut dn = 0.0;
        let count = steps.len();
        let mut measured = Vec::new();
        for (i, step) in steps.iter().enumerate() {
            dn += 200.0 * (step + 0.01) / total;
            measured.push(GreyLevel { level: i as f64 / (count - 1) as f64, mean_dn: dn, sd_dn: 0.0, saturated: 0 });
        }
        let curve = ResponseCurve::new(&measured, 255).unwrap();
        prop_assert!((curve.light(curve.level(at)) - at).abs() < 1e-9);
        prop_assert!(curve.light(at) <= curve.light(at + 0.01) + 1e-12);
        let table = LevelTable::sample(1024, |y| curve.level(y)).unwrap();
        prop_assert!((0.0..=1.0).contains(&table.at(at)));
    }
}

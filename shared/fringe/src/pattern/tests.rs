//! Patterns as the contract writes and draws them.

use super::*;
use crate::math::{atan2, cos, sin};

const SINE: PatternSet = PatternSet::sine(Axis::X, 16.0, 10);

#[test]
fn the_phase_of_a_sine_is_zero_at_the_centre_of_the_first_column() {
    assert_eq!(SINE.intensity(0, 0.0, 608).unwrap(), 1.0);
    assert!(SINE.intensity(0, 8.0, 608).unwrap() < 1e-15);
    assert!((SINE.intensity(5, 8.0, 608).unwrap() - 1.0).abs() < 1e-15);
}

#[test]
fn neighbouring_gray_stripes_differ_in_one_bit() {
    let gray = PatternSet::gray(Axis::X, 6, 16.0);
    let bits = |x: f64| (0..6).map(|b| gray.intensity(b, x, 608).unwrap() as u8).collect::<Vec<_>>();
    for stripe in 0..37 {
        let (a, b) = (bits(f64::from(stripe) * 16.0), bits(f64::from(stripe + 1) * 16.0));
        assert_eq!(a.iter().zip(&b).filter(|(a, b)| a != b).count(), 1, "stripe {stripe}");
    }
    // A code edge lies half a column before the phase zero of its stripe.
    assert_ne!(bits(15.49), bits(15.51));
    assert_eq!(bits(15.51), bits(16.0));
}

#[test]
fn a_sequence_is_written_as_in_the_contract() {
    #[derive(Serialize, Deserialize)]
    struct Holder {
        sequence: Vec<PatternSet>,
    }
    let text = r#"sequence = [
        { set = "sine", axis = "x", period_px = 16.0, steps = 10 },
        { set = "gray", axis = "x", bits = 6, stripe_px = 16.0 },
        { set = "white" }, { set = "black" },
    ]"#;
    let holder: Holder = toml::from_str(text).unwrap();
    assert_eq!(holder.sequence[0], SINE);
    assert_eq!(frame_count(&holder.sequence), 18);
    assert_eq!(locate(&holder.sequence, 10), Some((1, 0)));
    assert_eq!(locate(&holder.sequence, 17), Some((3, 0)));
    assert_eq!(locate(&holder.sequence, 18), None);
    let again: Holder = toml::from_str(&toml::to_string(&holder).unwrap()).unwrap();
    assert_eq!(again.sequence, holder.sequence);
    assert!(toml::from_str::<Holder>(r#"sequence = [{ set = "white", axis = "x" }]"#).is_err());
}

#[test]
fn a_ramp_is_one_frame_along_an_axis_or_even_frames_of_grey_levels() {
    let ramp = |text: &str| toml::from_str::<PatternSet>(&format!("set = \"ramp\"\n{text}")).unwrap();
    let along = ramp("axis = \"x\"");
    assert_eq!((along.frames(), along.axis(), along.grey_levels()), (1, Some(Axis::X), None));
    assert_eq!(along.intensity(0, 607.0, 608), Ok(1.0));
    for text in ["levels = 52", "frames = 52", "steps = 52"] {
        let even = ramp(text);
        assert_eq!((even.frames(), even.axis()), (52, None));
        assert_eq!(even.intensity(17, 100.0, 608), Ok(17.0 / 51.0));
    }
    assert_eq!(ramp("").grey_levels().unwrap().len(), 256);
    assert_eq!(ramp("levels = [0, 51, 255]").grey_levels().unwrap(), [0.0, 0.2, 1.0]);
    for text in ["levels = 1", "levels = [0, 256]", "levels = [0, nan]", "levels = 3\naxis = \"y\""] {
        assert!(ramp(text).check().is_err(), "{text}");
    }
}

#[test]
fn a_correction_acts_before_the_rounding() {
    let table = LevelTable::new(vec![0.0, 0.7, 1.0]).unwrap();
    let values = SINE.columns_u8(0, 608, Some(&table)).unwrap();
    // Level 1, 0.5 and 0 of the sine.
    assert_eq!((values[0], values[4], values[8]), (255, 179, 0));
}

#[test]
fn sets_that_no_decoder_can_use_are_refused() {
    let PatternSet::Sine { axis, period_px, first_step_rad, direction, .. } = SINE else { unreachable!() };
    let two =
        PatternSet::Sine { axis, period_px, steps: 2, first_step_rad, direction, shifts_rad: Vec::new() };
    assert_eq!(two.check(), Err(PatternError::Steps { steps: 2 }));
    let nan = PatternSet::Sine {
        axis,
        period_px: f64::NAN,
        steps: 4,
        first_step_rad,
        direction,
        shifts_rad: Vec::new(),
    };
    assert!(nan.check().is_err());
}

/// What rounding shifts the phase by at each column, projector px: brute force from the levels that the projector shows.
fn shifts_px(set: &PatternSet, columns: u32, rounded: impl Fn(f64) -> u8) -> Vec<f64> {
    let period_px = set.period_px().unwrap();
    let shift = |column: u32| {
        let phase = TAU * f64::from(column) / period_px;
        let mut sum = [0.0; 2];
        for step in 0..set.frames() {
            let level = f64::from(rounded(set.intensity(step, f64::from(column), columns).unwrap()));
            // Turned back by the phase: without rounding the sum is real.
            let angle = set.step_rad(step) - phase;
            sum = [sum[0] + level * cos(angle), sum[1] + level * sin(angle)];
        }
        atan2(sum[1], sum[0]) * period_px / TAU
    };
    (0..columns).map(shift).collect()
}

/// The same in closed form, of a period of whole columns: e(θ) = Σ E_k cos kθ, the rounding error of the level ½ + ½ cos θ, is even, and N
/// steps let its harmonics k = 1 + mN pass, so that the phasor becomes 127.5 + 2 Σ E_k e^{i(k−1)φ} over 127.5.
fn closed_form_px(period: u32, steps: u32, columns: u32) -> Vec<f64> {
    let angles = period * steps;
    let at = |k: u32, angle: u32| f64::from((k * angle) % angles) * TAU / f64::from(angles);
    let error = |angle: u32| {
        let level = 0.5 + 0.5 * cos(at(1, angle));
        f64::from(level_u8(level)) - 255.0 * level
    };
    let errors: Vec<f64> = (0..angles).map(error).collect();
    let harmonic = |k: u32| {
        let terms = (0..angles).map(|angle| errors[angle as usize] * cos(at(k, angle)));
        (k, terms.sum::<f64>() / f64::from(angles))
    };
    let passed: Vec<_> = (0..period).map(|m| harmonic(1 + m * steps)).collect();
    let shift = |column: u32| {
        let (mut along, mut across) = (127.5, 0.0);
        for (k, e) in &passed {
            let angle = at(k - 1, column * steps);
            (along, across) = (along + 2.0 * e * cos(angle), across + 2.0 * e * sin(angle));
        }
        atan2(across, along) * f64::from(period) / TAU
    };
    (0..columns).map(shift).collect()
}

#[test]
fn rounding_shifts_the_phase_by_the_harmonics_that_the_steps_let_pass() {
    for (period, steps) in [(16, 10), (16, 3), (18, 12), (20, 7), (7, 5)] {
        let set = PatternSet::sine(Axis::X, f64::from(period), steps);
        let (brute, closed) = (shifts_px(&set, 180, level_u8), closed_form_px(period, steps, 180));
        for (column, (brute, closed)) in brute.iter().zip(&closed).enumerate() {
            assert!(
                (brute - closed).abs() < 1e-12,
                "{period} px, {steps} steps, column {column}: {brute} {closed}"
            );
        }
        let period = period as usize;
        // Even errors: what a column is moved by, its mirror image is moved by to the other side, and nothing is left in the mean.
        assert!((1..period).all(|column| (closed[column] + closed[period - column]).abs() < 1e-12));
        assert!(closed.iter().any(|shift| shift.abs() > 2e-4));
    }
}

#[test]
fn rounding_moves_no_phase_in_the_mean() {
    let mean = |shifts: Vec<f64>| shifts.iter().sum::<f64>() / shifts.len() as f64;
    let mut of_digits = 0.0_f64;
    for (period, steps) in [(16, 10), (16, 8), (16, 16), (6, 24), (8, 8), (18, 12), (24, 4), (16, 3)] {
        let set = PatternSet::sine(Axis::X, f64::from(period), steps);
        let columns = 1140 - 1140 % period;
        let moved = mean(shifts_px(&set, columns, level_u8));
        assert!(moved.abs() < 1e-12, "{period} px, {steps} steps: {moved} px");
        // Where the last digits of the cosine decide about 127.5, it moves all phases.
        of_digits =
            of_digits.max(mean(shifts_px(&set, columns, |level| (level * 255.0).round() as u8)).abs());
    }
    assert!(of_digits > 5e-4, "{of_digits}");
}

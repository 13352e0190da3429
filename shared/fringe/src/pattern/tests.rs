//! Patterns as the contract writes and draws them.

use super::*;

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

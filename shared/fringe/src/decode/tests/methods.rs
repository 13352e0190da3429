//! Orders by every method, uneven steps, the fused estimate, and the chance of a wrong order.

use super::*;
use crate::decode::chain::{Sine, widest};
use crate::decode::number::{ResidueError, Residues};
use crate::decode::{OrderMethod, OrderRisk};
use crate::math::random::{Key, Normal};
use proptest::prelude::*;
use std::f64::consts::TAU;

fn by(order: OrderMethod) -> DecodeSettings {
    DecodeSettings { order, ..DecodeSettings::default() }
}

fn moved(bits: u32, stripe_px: f64) -> PatternSet {
    let (axis, shift_px) = (Axis::X, 0.5 * stripe_px);
    PatternSet::Gray { axis, bits, stripe_px, shift_px, invert: false, code: Code::Gray, threshold: None }
}

fn stair(stair_px: f64, steps: u32) -> PatternSet {
    PatternSet::Stair { axis: Axis::X, stair_px, steps }
}

/// A sequence for each order.
fn sequences() -> Vec<(OrderMethod, Vec<PatternSet>)> {
    let x = Axis::X;
    let levels = [PatternSet::White {}, PatternSet::Black {}];
    let with = |sets: Vec<PatternSet>| [sets, levels.to_vec()].concat();
    let binary = PatternSet::Gray {
        axis: x,
        bits: 7,
        stripe_px: 8.0,
        shift_px: 0.0,
        invert: false,
        code: Code::Binary,
        threshold: None,
    };
    vec![
        (OrderMethod::Gray, with(vec![sine(x, 16.0, 6), gray(x, 7, 8.0)])),
        (OrderMethod::Binary, with(vec![sine(x, 16.0, 6), binary])),
        (OrderMethod::ShiftedGray, with(vec![sine(x, 16.0, 6), gray(x, 6, 16.0), moved(6, 16.0)])),
        (OrderMethod::Stair, vec![sine(x, 32.0, 6), stair(16.0, 6)]),
        (OrderMethod::Stair, with(vec![sine(x, 32.0, 6), stair(16.0, 1)])),
        (OrderMethod::Hierarchical, vec![sine(x, 16.0, 6), sine(x, 96.0, 6), sine(x, 608.0, 6)]),
        (OrderMethod::Heterodyne, vec![sine(x, 24.0, 6), sine(x, 26.0, 6), sine(x, 28.0, 6)]),
        (OrderMethod::NumberTheoretical, vec![sine(x, 16.0, 6), sine(x, 39.0, 6)]),
        (OrderMethod::NumberTheoretical, vec![sine(x, 9.0, 6), sine(x, 10.0, 6), sine(x, 13.0, 6)]),
        (OrderMethod::NumberTheoretical, vec![sine(x, 12.5, 6), sine(x, 51.0, 6)]),
    ]
}

#[test]
fn every_order_leads_to_the_same_coordinates_in_noise() {
    for (order, sequence) in sequences() {
        let mut scene = Scene::ramp(600, 12, 1.0, 0.083, 608).eight_bits();
        scene.noise = (0.5, 0.0);
        for fuse in [false, true] {
            let settings = DecodeSettings { fuse, ..by(order) };
            let (map, report) = scene.decode_frames(&sequence, &scene.frames(&sequence), Axis::X, &settings);
            let (worst, valid) = scene.worst_px(&map);
            assert!(worst < 0.25, "{order:?}, fused {fuse}: {worst} {report:?}");
            assert!(valid > 7150, "{order:?}, fused {fuse}: {valid} {report:?}");
        }
    }
}

#[test]
fn an_order_without_its_set_says_which_one_is_missing() {
    let scene = Scene::ramp(64, 2, 1.0, 0.0, 608);
    let error = |sequence: &[PatternSet], order| scene.decoder(sequence, &by(order)).unwrap_err().to_string();
    let demo = demo(8.0, 7);
    for (order, word) in [
        (OrderMethod::Binary, "code = \"binary\""),
        (OrderMethod::ShiftedGray, "shift_px = stripe_px / 2"),
        (OrderMethod::Stair, "a stair set"),
        (OrderMethod::Hierarchical, "no gray set"),
        (OrderMethod::NumberTheoretical, "a second sine set"),
    ] {
        let text = error(&demo, order);
        assert!(text.contains(word), "{order:?}: {text}");
    }
    let x = Axis::X;
    let text = error(&[sine(x, 16.0, 4), sine(x, 20.0, 4)], OrderMethod::NumberTheoretical);
    assert!(text.contains("repeat after 80 px") && text.contains("608"), "{text}");
    let text = error(&[sine(x, 16.0, 4), stair(16.0, 1)], OrderMethod::Stair);
    assert!(text.contains("a white and a black frame"), "{text}");
    let bad = moved(6, 16.0);
    let PatternSet::Gray { axis, bits, stripe_px, invert, code, threshold, .. } = bad else { unreachable!() };
    let bad = PatternSet::Gray { axis, bits, stripe_px, shift_px: 16.0, invert, code, threshold };
    assert!(error(&[sine(x, 16.0, 4), bad], OrderMethod::Auto).contains("set 2"));
    assert!(matches!(stair(16.0, 2).check(), Err(crate::pattern::PatternError::StairSteps { steps: 2 })));
}

#[test]
fn uneven_steps_give_the_phase_with_their_own_noise() {
    let shifts_rad = vec![0.1, 0.9, 2.4, 3.0, 4.9];
    let x = Axis::X;
    let uneven = PatternSet::Sine {
        axis: x,
        period_px: 16.0,
        steps: 5,
        first_step_rad: 0.2,
        direction: Direction::Backward,
        shifts_rad: shifts_rad.clone(),
    };
    let sequence = [uneven.clone(), gray(x, 7, 8.0), PatternSet::White {}, PatternSet::Black {}];
    let mut scene = Scene::ramp(600, 40, 1.0, 0.31, 640);
    let (worst, valid) = scene.worst_px(&scene.decode(&sequence, x).0);
    assert!(worst < 1e-3 && valid == 24_000, "{worst} {valid}");
    scene.noise = (300.0, 0.0);
    let noise = CameraNoise { read_noise_dn: 300.0, gain_dn: 0.0 };
    let settings = DecodeSettings { camera_noise: Some(noise), ..DecodeSettings::default() };
    let (map, _) = scene.decode_frames(&sequence, &scene.frames(&sequence), x, &settings);
    let scatter: f64 = (0..24_000)
        .map(|i| {
            let error = f64::from(map.phase_rad[i]) - scene.coordinates_px[i] * TAU / 16.0;
            (error / f64::from(map.sigma_rad[i])).powi(2)
        })
        .sum();
    assert!(((scatter / 24_000.0).sqrt() - 1.0).abs() < 0.025, "{scatter}");
    let PatternSet::Sine { axis, period_px, first_step_rad, direction, .. } = uneven else { unreachable!() };
    for bad in [vec![0.0, 1.0], vec![0.0, 1.0, f64::NAN, 2.0, 3.0], vec![0.0, 0.1, 0.2, 0.0, 0.1]] {
        let set = PatternSet::Sine {
            axis,
            period_px,
            steps: 5,
            first_step_rad,
            direction,
            shifts_rad: bad.clone(),
        };
        assert!(set.check().is_err(), "{bad:?}");
    }
}

#[test]
fn the_fused_estimate_is_better_by_what_it_says() {
    let sequence = [sine(Axis::X, 24.0, 6), sine(Axis::X, 26.0, 6), sine(Axis::X, 28.0, 6)];
    let mut scene = Scene::ramp(600, 60, 1.0, 0.31, 640);
    scene.noise = (200.0, 0.0);
    let frames = scene.frames(&sequence);
    let errors = |fuse| {
        let settings = DecodeSettings { fuse, ..by(OrderMethod::Heterodyne) };
        let (map, _) = scene.decode_frames(&sequence, &frames, Axis::X, &settings);
        let one = |i: usize| f64::from(map.phase_rad[i]) - scene.coordinates_px[i] * TAU / 24.0;
        let rms = ((0..36_000).map(|i| one(i).powi(2)).sum::<f64>() / 36_000.0).sqrt();
        let ratio = (0..36_000).map(|i| (one(i) / f64::from(map.sigma_rad[i])).powi(2)).sum::<f64>();
        (rms, (ratio / 36_000.0).sqrt())
    };
    let ((single, _), (fused, ratio)) = (errors(false), errors(true));
    let gain = (1.0_f64 + (24.0_f64 / 26.0).powi(2) + (24.0_f64 / 28.0).powi(2)).sqrt();
    assert!((single / fused / gain - 1.0).abs() < 0.03, "{single} {fused} {gain}");
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// Share of wrong orders of phases with normal noise, and the predicted one.
fn rates(periods: &[f64], extent_px: u32, sigma_rad: f64, table: bool, pixels: u64) -> (f64, f64) {
    let list: Vec<Sine> = periods.iter().map(|p| Sine { period_px: *p, steps: 6 }).collect();
    let sines: Vec<(f64, u32)> = periods.iter().map(|p| (*p, 6)).collect();
    let residues = Residues::new(&sines, extent_px).ok().filter(|_| table);
    let by_beats = widest(&list, None, f64::from(extent_px));
    let chain = by_beats.unwrap_or_else(|| crate::decode::chain::Chain::of_residues(periods[0]));
    let risk = OrderRisk { chain: &chain, stripe_px: 0.0, residues: None, micro: None };
    let (normal, key) = (Normal::default(), Key::new(11));
    let mut wrong = 0_u64;
    for i in 0..pixels {
        // A period that covers the projector is ambiguous with itself at the ends.
        let margin = if table { 1.0 } else { 0.1 * f64::from(extent_px) };
        let x = margin + (f64::from(extent_px) - 0.5 - 2.0 * margin) * Key::new(3).open(i);
        let noise = |j: usize| sigma_rad * f64::from(normal.draw(key.with(j as u64).bits(i)));
        let phases: Vec<f64> = periods
            .iter()
            .enumerate()
            .map(|(j, p)| crate::math::wrap_positive_rad(TAU * x / p + noise(j)))
            .collect();
        let found = match &residues {
            Some(residues) => residues.resolve(|j| phases[j]).0,
            None => chain.coordinate_px(&phases, 0.5 * f64::from(extent_px)),
        };
        wrong += u64::from((found - x).abs() > 0.5 * periods[0]);
    }
    let predicted = residues.map_or_else(|| risk.probability(sigma_rad), |r| r.wrong_order(sigma_rad));
    (wrong as f64 / pixels as f64, predicted)
}

#[test]
fn the_predicted_rate_of_wrong_orders_is_the_observed_one() {
    for (periods, extent_px, sigma_rad, table) in [
        (vec![16.0, 608.0], 608, 0.035, false),
        (vec![24.0, 26.0, 28.0], 1280, 0.09, false),
        (vec![16.0, 39.0], 624, 0.035, true),
        (vec![9.0, 10.0, 13.0], 608, 0.09, true),
        (vec![24.0, 26.0, 29.0], 608, 0.15, true),
    ] {
        let (observed, predicted) = rates(&periods, extent_px, sigma_rad, table, 300_000);
        assert!(observed > 0.002, "{periods:?}: too few events for a rate: {observed}");
        // Five standard deviations of the count.
        let spread = 5.0 / (observed * 300_000.0).sqrt();
        assert!((observed / predicted - 1.0).abs() < spread.max(0.05), "{periods:?}: {observed} {predicted}");
    }
}

#[test]
fn the_risk_of_a_code_grows_as_its_margin_shrinks() {
    let list = [Sine { period_px: 16.0, steps: 4 }];
    let at = |stripe_px: f64, sigma_rad: f64| {
        let chain = widest(&list, Some(stripe_px), 608.0).unwrap();
        OrderRisk { chain: &chain, stripe_px, residues: None, micro: None }.probability(sigma_rad)
    };
    assert_eq!(at(8.0, 0.0), 0.0);
    assert!(at(8.0, 0.1) < 1e-12 && at(8.0, 0.8) > 1e-3);
    assert!(at(15.9, 0.1) > 1e-3, "a stripe of a period has no margin");
    assert!(at(8.0, 50.0) <= 1.0);
}

#[test]
fn residues_refuse_what_they_cannot_number() {
    assert!(matches!(Residues::new(&[(16.0, 4)], 608), Err(ResidueError::One { .. })));
    assert!(
        matches!(Residues::new(&[(16.0, 4), (24.0, 4)], 608), Err(ResidueError::Short { lcm_px, .. }) if lcm_px == 48.0)
    );
    assert!(matches!(Residues::new(&[(16.0, 4), (17.123_456, 4)], 608), Err(ResidueError::Broken { .. })));
    assert!(matches!(
        Residues::new(&[(2.0, 4), (65_521.0, 4), (65_519.0, 4)], 60_000),
        Err(ResidueError::Large { .. })
    ));
}

/// Every half pixel of a projector of 300 px comes back from the phases of its sines, the finest first; `false` where they number none.
fn every_place_comes_back(periods: &[f64], turns: i32) -> Result<bool, String> {
    let sines: Vec<(f64, u32)> = periods.iter().map(|p| (*p, 4)).collect();
    let Ok(residues) = Residues::new(&sines, 300) else { return Ok(false) };
    for i in -1..600 {
        let x = 0.5 * f64::from(i) + 0.1;
        let phase = |j: usize| crate::math::wrap_positive_rad(TAU * x / periods[j] + TAU * f64::from(turns));
        let (found, border) = residues.resolve(phase);
        // The last place lies a tenth of a pixel beyond the projector: it is the first one again where the periods repeat after 300 px.
        let is_first = i == 599 && (found - (x - 300.0)).abs() < 1e-9;
        if !((found - x).abs() < 1e-9 || is_first) || border >= 0.9 {
            return Err(format!("{periods:?}: {x} px became {found} px, border {border}"));
        }
    }
    Ok(true)
}

#[test]
fn periods_that_repeat_just_after_the_end_tell_it_from_the_beginning() {
    let mut numbered = 0;
    for a in 7..40_u32 {
        for b in (a + 1..40).filter(|b| (300..=340).contains(&(a * b))) {
            numbered += usize::from(every_place_comes_back(&[f64::from(a), f64::from(b)], 0).unwrap());
        }
    }
    assert_eq!(numbered, 19, "pairs of coprime periods whose product is 300 to 340 px");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn coprime_periods_give_the_coordinate_back(a in 7..40_u32, b in 7..40_u32, c in 7..40_u32, turns in -2..3_i32) {
        let periods: Vec<f64> = [a, b, c].iter().map(|p| f64::from(*p)).collect();
        let mut sorted = periods.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.dedup();
        let all = every_place_comes_back(&sorted, turns);
        prop_assert!(all.is_ok(), "{:?}", all);
    }
}

//! Properties over random patterns.

use super::*;
use proptest::prelude::*;

fn any_sequence() -> impl Strategy<Value = (Vec<PatternSet>, Axis, u32)> {
    let axis = prop_oneof![Just(Axis::X), Just(Axis::Y)];
    let direction = prop_oneof![Just(Direction::Forward), Just(Direction::Backward)];
    let code = prop_oneof![Just(Code::Gray), Just(Code::Binary)];
    (8.0..64.0_f64, 3..=16_u32, -7.0..7.0_f64, axis, direction, code, 1..=3_u32).prop_map(
        |(period_px, steps, first_step_rad, axis, direction, code, parts)| {
            let stripe_px = period_px / f64::from(1_u32 << parts);
            let fringes = PatternSet::Sine {
                axis,
                period_px,
                steps,
                first_step_rad,
                direction,
                shifts_rad: Vec::new(),
            };
            let stripes = PatternSet::Gray {
                axis,
                bits: 9,
                stripe_px,
                shift_px: 0.0,
                invert: false,
                code,
                threshold: None,
            };
            // Integer columns: the last stripe may be cut.
            let extent_px = ((stripe_px * 512.0).floor() as u32).min(700);
            (vec![stripes, PatternSet::Black {}, fringes, PatternSet::White {}], axis, extent_px)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn the_coordinate_comes_back((sequence, axis, extent_px) in any_sequence(), shift in 0.0..1.0_f64) {
        prop_assume!(extent_px >= 64);
        let mut scene = Scene::ramp(extent_px as usize, 2, 1.0, 0.0, extent_px);
        scene.coordinates_px.iter_mut().for_each(|x| *x = (*x + shift).min(f64::from(extent_px) - 0.51));
        let (map, report) = scene.decode(&sequence, axis);
        let (worst, _) = scene.worst_px(&map);
        prop_assert!(worst < 1e-2, "{} {:?}", worst, report);
        prop_assert_eq!(report.valid, scene.coordinates_px.len(), "{:?}", report);
    }

    #[test]
    fn ambient_light_and_contrast_do_not_move_the_phase(
        (sequence, axis, extent_px) in any_sequence(),
        ambient in 1000.0..20_000.0_f64,
        projected in 10_000.0..44_000.0_f64,
    ) {
        let mut scene = Scene::ramp(64, 2, 0.77, 0.1, extent_px);
        let (one, _) = scene.decode(&sequence, axis);
        (scene.ambient_dn, scene.projected_dn) = (ambient, projected);
        let (other, _) = scene.decode(&sequence, axis);
        for (a, b) in one.phase_rad.iter().zip(&other.phase_rad) {
            // Rounding to whole DN is all that is left: √(2/3)/√12/5000 DN, five sigma, both.
            prop_assert!((a - b).abs() < 5e-4, "{} {}", a, b);
        }
    }
}

#[test]
fn phase_zero_is_a_phase_like_any_other() {
    let scene = Scene::new(5, vec![-0.3, 0.0, 16.0, 32.0, 160.0], 608);
    let settings = DecodeSettings::default();
    let sequence = demo(8.0, 7);
    let (map, report) = scene.decode_frames(&sequence, &scene.frames(&sequence), Axis::X, &settings);
    assert_eq!(report.valid, 5, "{report:?}");
    for (phase, x) in map.phase_rad.iter().zip(&scene.coordinates_px) {
        assert!((f64::from(*phase) - x * std::f64::consts::TAU / 16.0).abs() < 1e-4);
    }
    assert!(map.phase_rad[0] < 0.0);
}

#[test]
fn one_thread_and_four_give_the_same_bytes() {
    let mut scene = Scene::ramp(701, 301, 0.8, 0.013, 608).eight_bits();
    scene.noise = (4.0, 0.05);
    let sequence = demo(16.0, 6);
    let frames = scene.frames(&sequence);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default()))
    };
    let ((one, report), (four, again)) = (run(1), run(4));
    assert_eq!(report, again);
    let bits = |plane: &[f32]| plane.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&one.phase_rad), bits(&four.phase_rad));
    assert_eq!(bits(&one.sigma_rad), bits(&four.sigma_rad));
    assert_eq!(bits(&one.modulation), bits(&four.modulation));
    assert_eq!(one.valid, four.valid);
    assert!(report.ambiguous > 0);
}

#[test]
fn the_depth_of_the_grey_values_does_not_matter() {
    for full_scale_dn in [255_u16, 1023, 4095, 65535] {
        let mut scene = Scene::ramp(600, 2, 1.0, 0.3, 608);
        scene.full_scale_dn = full_scale_dn;
        scene.ambient_dn = 0.1 * f64::from(full_scale_dn);
        scene.projected_dn = 0.8 * f64::from(full_scale_dn);
        let (map, report) = scene.decode(&demo(8.0, 7), Axis::X);
        assert_eq!(report.valid, 1200, "{full_scale_dn}: {report:?}");
        assert!(scene.worst_px(&map).0 < 5.0 / f64::from(full_scale_dn) + 1e-4);
    }
}

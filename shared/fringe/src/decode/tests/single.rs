//! One sine after one code: the short way in single precision beside the general one in double precision.

use super::*;
use crate::decode::blocks::decode_blocks;
use crate::decode::order::Kernel;

/// A map by both ways, as the blocks leave it before any neighbour was asked.
fn both_ways(scene: &Scene, sequence: &[PatternSet]) -> Option<[PhaseMap; 2]> {
    let mut decoder = scene.decoder(sequence, &DecodeSettings::default()).unwrap();
    for (index, frame) in scene.frames(sequence).iter().enumerate() {
        decoder.push(index, &frame.view()).unwrap();
    }
    let mut maps = [0, 1].map(|_| PhaseMap::new(decoder.info(Axis::X).unwrap()));
    let kernel = decoder.kernel(0, &decoder.plan.axes[0]);
    kernel.single.as_ref()?;
    decode_blocks(&kernel, decoder.level, &mut maps[0].view_mut());
    let general = Kernel { single: None, ..kernel };
    decode_blocks(&general, decoder.level, &mut maps[1].view_mut());
    Some(maps)
}

#[test]
fn both_ways_give_the_same_orders_and_phases_to_the_last_digit() {
    let mut small = Scene::ramp(307, 90, 1.9, 0.07, 608).eight_bits();
    small.noise = (2.5, 0.03);
    let mut words = Scene::ramp(1001, 20, 0.6, 0.11, 608);
    words.noise = (300.0, 2.0);
    let mut open = 0;
    for scene in [&small, &words] {
        for sequence in [demo(8.0, 7), demo(16.0, 6), demo(10.0, 6)] {
            let [short, general] = both_ways(scene, &sequence).unwrap();
            assert_eq!(short.valid, general.valid);
            open += short.valid.iter().filter(|state| **state > 1).count();
            let (mut worst, mut away) = (0.0_f32, 0_usize);
            for (a, b) in short.phase_rad.iter().zip(&general.phase_rad) {
                assert_eq!(a.is_nan(), b.is_nan());
                if !a.is_nan() {
                    // Of what is stored no more than the last digit differs, or what the arctangent itself leaves near zero.
                    let digit = (b.abs() * f32::EPSILON).max(2e-7);
                    worst = worst.max((a - b).abs() / digit);
                    away += usize::from(a.to_bits() != b.to_bits());
                }
            }
            assert!(worst <= 1.0, "{worst} of the last digit");
            assert!(away * 10 < short.phase_rad.len(), "{away} pixels differ");
            let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&short.sigma_rad), bits(&general.sigma_rad));
        }
    }
    assert!(open > 20, "only {open} open orders were tried");
}

#[test]
fn a_chain_without_a_code_goes_the_general_way() {
    let scene = Scene::ramp(203, 40, 0.7, 0.11, 608).eight_bits();
    assert!(both_ways(&scene, &[sine(Axis::X, 608.0, 5), sine(Axis::X, 32.0, 12)]).is_none());
}

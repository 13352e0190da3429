//! Slopes, edges and masks survive; spikes and noise do not.

use super::*;
use crate::math::random::{Key, Normal};
use crate::pattern::Axis;
use crate::phase::PhaseInfo;
use proptest::prelude::*;
use std::f32::consts::TAU;

const FILTERS: [Filter; 3] =
    [Filter::SPIKES, Filter::Gaussian { sigma_px: 1.2, edge_rad: 1.5 }, Filter::Median { radius_px: 2 }];

fn map(width: u32, height: u32, phase: impl Fn(f32, f32) -> f32) -> PhaseMap {
    let info = PhaseInfo { width_px: width, height_px: height, axis: Axis::X, period_px: 16.0 };
    let mut map = PhaseMap::new(info);
    for i in 0..info.len() {
        map.phase_rad[i] = phase((i % width as usize) as f32, (i / width as usize) as f32);
    }
    map.sigma_rad.fill(0.01);
    map.valid.fill(1);
    map
}

fn mask(map: &mut PhaseMap, share: f64, seed: u64) {
    for i in 0..map.info.len() {
        if Key::new(seed).symmetric(i as u64) < 2.0 * share - 1.0 {
            (map.valid[i], map.phase_rad[i], map.sigma_rad[i]) = (0, f32::NAN, f32::NAN);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// On any plane under any mask nothing happens, and nothing is ever filled.
    #[test]
    fn planes_stay(a in -2.0_f32..2.0, b in -2.0_f32..2.0, share in 0.0_f64..0.9, seed in any::<u64>(),
        width in 1_u32..24, height in 1_u32..24) {
        let mut plane = map(width, height, |x, y| a * x + b * y);
        mask(&mut plane, share, seed);
        for filter in FILTERS {
            let mut after = plane.clone();
            let report = filter.apply(&mut after).unwrap();
            prop_assert_eq!((report.corrected, report.masked), (0, 0));
            prop_assert_eq!(&after.valid, &plane.valid);
            for (new, old) in after.phase_rad.iter().zip(&plane.phase_rad) {
                prop_assert!(new.is_nan() && old.is_nan() || (new - old).abs() < 1e-4, "{filter:?}: {new}, {old}");
            }
        }
    }

    /// Of rubbish only the mask can be kept, and it is.
    #[test]
    fn the_mask_only_shrinks(share in 0.0_f64..1.0, seed in any::<u64>()) {
        let mut rubbish = map(17, 13, |_, _| 0.0);
        for i in 0..rubbish.info.len() {
            rubbish.phase_rad[i] = (30.0 * Key::new(seed).symmetric(1000 + i as u64)) as f32;
        }
        mask(&mut rubbish, share, seed);
        rubbish.phase_rad[20] = f32::INFINITY;
        for filter in FILTERS {
            let mut after = rubbish.clone();
            filter.apply(&mut after).unwrap();
            for i in 0..rubbish.info.len() {
                prop_assert!(after.valid[i] <= rubbish.valid[i]);
                prop_assert!(after.valid[i] == 0 || after.phase_rad[i].is_finite() == rubbish.phase_rad[i].is_finite());
            }
        }
    }
}

#[test]
fn spikes_are_corrected_or_masked_and_edges_and_corners_kept() {
    let step = |x: f32, y: f32| 0.4 * x + if x >= 20.0 && y >= 10.0 { 3.0 * TAU } else { 0.0 };
    let mut spiky = map(40, 30, step);
    let at = |x: usize, y: usize| y * 40 + x;
    spiky.phase_rad[at(8, 8)] += TAU;
    spiky.phase_rad[at(30, 20)] -= 2.0 * TAU;
    spiky.phase_rad[at(12, 20)] += TAU;
    spiky.phase_rad[at(13, 20)] += TAU;
    spiky.phase_rad[at(5, 22)] += 4.0;
    let report = Filter::SPIKES.apply(&mut spiky).unwrap();
    assert_eq!((report.corrected, report.masked), (4, 1));
    let clean = map(40, 30, step);
    for i in 0..clean.info.len() {
        let off = spiky.phase_rad[i] - clean.phase_rad[i];
        assert!(i == at(5, 22) || off.abs() < 1e-4, "pixel {i}: {off}");
    }
    assert_eq!(spiky.valid[at(5, 22)], 0);
}

/// A step of several turns stays where it is, the pixels beside it too.
#[test]
fn smoothing_keeps_steps() {
    let mut steps = map(40, 20, |x, _| 0.3 * x + if x >= 20.0 { 12.0 } else { 0.0 });
    let before = steps.clone();
    for filter in [Filter::gaussian(1.5), Filter::Median { radius_px: 2 }] {
        filter.apply(&mut steps).unwrap();
        for (new, old) in steps.phase_rad.iter().zip(&before.phase_rad) {
            assert!((new - old).abs() < 1e-3, "{filter:?}: {new} and {old}");
        }
    }
}

/// The standard uncertainty that the map states is the scatter that is left.
#[test]
fn noise_falls_as_stated() {
    let normal = Normal::default();
    for filter in [
        Filter::gaussian(0.8),
        Filter::gaussian(1.5),
        Filter::Median { radius_px: 1 },
        Filter::Median { radius_px: 2 },
    ] {
        let mut noisy = map(200, 200, |_, _| 0.0);
        for i in 0..noisy.info.len() {
            noisy.phase_rad[i] = 0.01 * normal.draw(Key::new(4).bits(i as u64));
        }
        filter.apply(&mut noisy).unwrap();
        let inner = |v: &[f32]| -> Vec<f64> {
            (0..v.len())
                .filter(|i| (10..190).contains(&(i % 200)) && (10..190).contains(&(i / 200)))
                .map(|i| f64::from(v[i]))
                .collect()
        };
        let phase = inner(&noisy.phase_rad);
        let scatter = (phase.iter().map(|p| p * p).sum::<f64>() / phase.len() as f64).sqrt();
        let stated = inner(&noisy.sigma_rad)[0];
        let ratio = scatter / stated;
        assert!((0.95..1.05).contains(&ratio), "{filter:?}: {ratio}");
    }
}

#[test]
fn settings_out_of_range_are_named() {
    let mut one = map(3, 3, |_, _| 0.0);
    for filter in [
        Filter::Spikes { height_rad: f64::NAN },
        Filter::Gaussian { sigma_px: 0.0, edge_rad: 1.0 },
        Filter::Gaussian { sigma_px: 1.0, edge_rad: -1.0 },
        Filter::Median { radius_px: 0 },
    ] {
        assert!(filter.apply(&mut one).unwrap_err().to_string().contains("must be"));
    }
}

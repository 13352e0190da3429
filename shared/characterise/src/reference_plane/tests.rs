//! Heights of a pinhole pair come back; what was not calibrated stays unknown.

use super::*;
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;

const WIDTH: u32 = 24;

fn map(phase: impl Fn(f64) -> f64) -> PhaseMap {
    let info = PhaseInfo { width_px: WIDTH, height_px: 3, axis: Axis::X, period_px: 16.0 };
    let mut map = PhaseMap::new(info);
    for i in 0..info.len() {
        map.phase_rad[i] = phase(f64::from(i as u32 % WIDTH)) as f32;
        map.valid[i] = 1;
        map.sigma_rad[i] = 0.01;
    }
    map
}

/// Eq. 2.18 solved for the phase: Δφ = 2π f d Z / (L − Z), with a slope of its own in each column.
fn plane(z_mm: f64) -> PhaseMap {
    map(|x| 20.0 + 0.3 * x + (40.0 + x) * z_mm / (500.0 - z_mm))
}

fn calibrated(heights: &[f64], degree: usize) -> (PlaneCalibration, PlaneReport) {
    let maps: Vec<PhaseMap> = heights.iter().map(|z| plane(*z)).collect();
    let planes: Vec<_> = heights.iter().zip(&maps).map(|(z, map)| (*z, map.view())).collect();
    calibrate(&planes, degree, 6.0).unwrap()
}

#[test]
fn heights_between_the_planes_come_back_better_with_the_degree() {
    let heights: Vec<f64> = (0..=8).map(|i| f64::from(i) * 5.0).collect();
    let worst = |degree: usize| {
        let (calibration, report) = calibrated(&heights, degree);
        assert_eq!(report.calibrated, 72);
        let found = calibration.measure(&plane(17.3).view()).unwrap();
        let worst = found.height_mm.iter().map(|z| (z - 17.3).abs()).fold(0.0, f32::max);
        assert!(f64::from(worst) < 4.0 * report.rms_mm.unwrap() + 1e-4, "degree {degree}: {worst}");
        worst
    };
    let [line, square, cube] = [worst(1), worst(2), worst(3)];
    // Eq. 2.19 against eq. 2.18: over 40 mm of 500 mm the approximation costs half a millimetre.
    assert!(line > 0.2 && square < 0.1 * line && cube < 1e-3, "{line}, {square}, {cube}");
}

/// K₀ of eq. 2.19 is the slope at the reference: L / (2π f d).
#[test]
fn k0_is_the_slope_and_carries_the_noise() {
    let (calibration, report) = calibrated(&[0.0, 0.5, 1.0], 1);
    let median = report.k0_mm_per_rad.unwrap()[0];
    // Columns 0 … 23: the median is that of column 12.
    assert!((median - 500.0 / 52.0).abs() < 0.05, "{median}");
    let found = calibration.measure(&plane(0.4).view()).unwrap();
    let sigma = f64::from(found.sigma_mm[0]);
    assert!((sigma - 0.01 * 500.0 / 40.0).abs() < 1e-3, "{sigma}");
}

#[test]
fn what_was_not_calibrated_stays_unknown() {
    let mut maps = [plane(0.0), plane(10.0), plane(20.0)];
    maps[1].valid[5] = 0;
    maps[2].phase_rad[7] = f32::NAN;
    maps[0].valid[9] = 0;
    let planes: Vec<_> = [0.0, 10.0, 20.0].iter().zip(&maps).map(|(z, map)| (*z, map.view())).collect();
    let (calibration, report) = calibrate(&planes, 2, 6.0).unwrap();
    assert_eq!((report.calibrated, report.rms_mm), (69, None));
    let mut object = plane(12.0);
    object.valid[0] = 0;
    object.phase_rad[1] += 100.0;
    let found = calibration.measure(&object.view()).unwrap();
    for i in 0..72 {
        assert_eq!(found.height_mm[i].is_nan(), [0, 1, 5, 7, 9].contains(&i), "{i}");
    }
    assert_eq!(found.beyond, 1, "far above the highest plane");
    // With a line, two planes suffice for the pixels that miss one other than the reference.
    assert_eq!(calibrate(&planes, 1, 6.0).unwrap().1.calibrated, 71);
}

#[test]
fn impossible_planes_are_named() {
    let maps = [plane(0.0), plane(1.0)];
    let two = [(0.0, maps[0].view()), (1.0, maps[1].view())];
    assert!(matches!(calibrate(&two, 0, 6.0), Err(PlaneError::Degree { .. })));
    assert!(matches!(calibrate(&two, 2, 6.0), Err(PlaneError::Few { needed: 3, .. })));
    assert!(matches!(
        calibrate(&[two[0], (0.0, maps[1].view())], 1, 6.0),
        Err(PlaneError::Height { number: 2, .. })
    ));
    assert!(matches!(
        calibrate(&[two[0], (f64::NAN, maps[1].view())], 1, 6.0),
        Err(PlaneError::Height { .. })
    ));
    let mut other = plane(1.0);
    other.info.period_px = 20.0;
    assert!(matches!(calibrate(&[two[0], (1.0, other.view())], 1, 6.0), Err(PlaneError::Pattern { .. })));
    // Planes of one phase give no slope: a camera that looks along the projector's rays.
    let flat = map(|x| x);
    let (_, report) = calibrate(&[(0.0, flat.view()), (1.0, flat.view())], 1, 6.0).unwrap();
    assert_eq!((report.calibrated, report.k0_mm_per_rad), (0, None));
}

/// Phases of noisy planes, some of them a whole turn off or slightly bent.
fn noisy(heights: &[f64], damage: impl Fn(usize, usize) -> f64) -> Vec<PhaseMap> {
    let normal = fringe::math::random::Normal::default();
    let of = |(number, z_mm): (usize, &f64)| {
        let mut map = plane(*z_mm);
        for (i, phase) in map.phase_rad.iter_mut().enumerate() {
            let noise = normal.draw(fringe::math::random::Key::new(5).with(number as u64).bits(i as u64));
            *phase += 0.01 * noise + damage(number, i) as f32;
        }
        map
    };
    heights.iter().enumerate().map(of).collect()
}

#[test]
fn a_plane_seen_wrongly_by_a_pixel_is_left_out_there_and_counted() {
    let heights = [0.0, 8.0, 16.0, 24.0, 32.0];
    let turn = std::f64::consts::TAU;
    // Whole turns, a fraction of one, and the reference itself.
    let wrong = [(2, 10, turn), (4, 20, -turn), (1, 33, 0.4), (0, 40, turn), (3, 55, 2.0 * turn)];
    let damage =
        |plane: usize, pixel: usize| wrong.iter().find(|w| (w.0, w.1) == (plane, pixel)).map_or(0.0, |w| w.2);
    let maps = noisy(&heights, damage);
    let planes: Vec<_> = heights.iter().zip(&maps).map(|(z, map)| (*z, map.view())).collect();
    let (kept, _) = calibrate(&planes, 2, f64::INFINITY).unwrap();
    let (cured, report) = calibrate(&planes, 2, 6.0).unwrap();
    assert_eq!(report.rejected, [1, 1, 1, 1, 1]);
    assert_eq!((report.calibrated, report.inconsistent), (72, 0));
    let error = |calibration: &PlaneCalibration, pixel: usize| {
        let mut object = plane(13.0);
        // A wrong reference is wrong in the object's difference, too.
        if pixel == 40 {
            assert!((calibration.reference_rad[40] - plane(0.0).phase_rad[40]).abs() > 6.0);
        }
        object.valid.iter_mut().enumerate().for_each(|(i, valid)| *valid = u8::from(i == pixel));
        f64::from((calibration.measure(&object.view()).unwrap().height_mm[pixel] - 13.0).abs())
    };
    for (plane, pixel, _) in wrong {
        let (before, after) = (error(&kept, pixel), error(&cured, pixel));
        assert!(after < 0.35, "plane {plane}: {after} mm");
        assert!(before.is_nan() || before > 3.0 * after, "plane {plane}: {before} and {after} mm");
    }
}

/// Noise alone loses next to nothing, and with one plane to spare a contradiction is said, not shared out.
#[test]
fn good_planes_are_kept_and_contradictions_without_a_spare_plane_are_said() {
    let heights = [0.0, 8.0, 16.0, 24.0, 32.0];
    let maps = noisy(&heights, |_, _| 0.0);
    let planes: Vec<_> = heights.iter().zip(&maps).map(|(z, map)| (*z, map.view())).collect();
    for degree in [1, 2, 3] {
        let (_, report) = calibrate(&planes, degree, 6.0).unwrap();
        assert_eq!((report.rejected.iter().sum::<usize>(), report.inconsistent), (0, 0), "degree {degree}");
    }
    let maps = noisy(&heights[..4], |plane, pixel| if (plane, pixel) == (2, 7) { 6.3 } else { 0.0 });
    let planes: Vec<_> = heights.iter().zip(&maps).map(|(z, map)| (*z, map.view())).collect();
    let (calibration, report) = calibrate(&planes, 2, 6.0).unwrap();
    assert_eq!((report.rejected.iter().sum::<usize>(), report.inconsistent, report.calibrated), (0, 1, 71));
    assert!(calibration.coefficients[0][7].is_nan());
    assert!(matches!(calibrate(&planes, 2, 0.0), Err(PlaneError::Reject { .. })));
}

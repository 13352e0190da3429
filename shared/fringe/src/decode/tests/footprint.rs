//! The footprint: found from the frames, its bias removed, steps left alone.

use super::super::contrast_bins::Reflectance;
use super::super::footprint::{Footprint, Line};
use super::super::rasters::Rasters;
use super::super::roles::Levels;
use crate::decode::DecodeSettings;
use crate::frame::Pixels;
use crate::math::simd::best_level;
use crate::math::{atan2, cos, exp, hypot, sin, wrap_rad};
use crate::pattern::{Axis, PatternSet};
use crate::phase::{PhaseInfo, PhaseMap};

const WIDTH: usize = 240;
const HEIGHT: usize = 200;
const ROUND: [f32; 2] = [1.0; 2];

/// A curved, shaded surface: phase and reflectance at a place, px.
fn surface(x: f64, y: f64) -> (f64, f64) {
    let (u, v) = (x - 120.0, y - 100.0);
    let phase = 40.0 + 0.35 * x + 0.0011 * u * u + 0.0006 * v * v;
    (phase, 110.0 - 0.25 * u + 0.15 * v - 0.001 * u * u)
}

fn surface_phase(x: f64, y: f64) -> f64 {
    surface(x, y).0
}

/// Phase, modulation, white and black as a Gaussian footprint of variance s² sees them, by brute-force sums.
fn blurred(variance_px2: f64) -> (PhaseMap, Rasters) {
    blurred_phase(&surface_phase, variance_px2)
}

/// The same of another phase, in the light of [`surface`].
fn blurred_phase(phase: &dyn Fn(f64, f64) -> f64, variance_px2: f64) -> (PhaseMap, Rasters) {
    blurred_scene(phase, &|x, y| surface(x, y).1, variance_px2)
}

/// The same of another phase and another reflectance.
fn blurred_scene(
    phase: &dyn Fn(f64, f64) -> f64,
    reflectance: &dyn Fn(f64, f64) -> f64,
    variance_px2: f64,
) -> (PhaseMap, Rasters) {
    let info = PhaseInfo { width_px: WIDTH as u32, height_px: HEIGHT as u32, axis: Axis::X, period_px: 16.0 };
    let mut map = PhaseMap::new(info);
    let (mut white, black) = (vec![0_u16; info.len()], vec![300; info.len()]);
    let s = variance_px2.sqrt();
    let nodes: Vec<f64> = (-6..=6).map(|k| f64::from(k) * 0.5).collect();
    for (index, white) in white.iter_mut().enumerate() {
        let (x, y) = ((index % WIDTH) as f64, (index / WIDTH) as f64);
        let (mut re, mut im, mut light, mut weight) = (0.0, 0.0, 0.0, 0.0);
        for u in &nodes {
            for v in &nodes {
                let w = exp(-0.5 * (u * u + v * v));
                let (turn, reflectance) = (phase(x + s * u, y + s * v), reflectance(x + s * u, y + s * v));
                re += w * reflectance * cos(turn);
                im += w * reflectance * sin(turn);
                light += w * reflectance;
                weight += w;
            }
        }
        let ideal = phase(x, y);
        map.phase_rad[index] = (ideal + wrap_rad(atan2(im, re) - ideal)) as f32;
        map.modulation[index] = (0.45 * hypot(re, im) / weight) as f32;
        map.sigma_rad[index] = 0.002;
        map.valid[index] = 1;
        *white = (light / weight * 100.0).round() as u16 + 300;
    }
    // White in hundredths of the modulation's unit: the estimate needs only the ratio up to a constant.
    let mut rasters = Rasters::new(2, info.len(), u16::MAX);
    for (number, level) in [&white, &black].into_iter().enumerate() {
        rasters.keep(number, Pixels::Mono16(level));
    }
    (map, rasters)
}

fn told_by(rasters: &Rasters) -> Reflectance<'_> {
    Reflectance { rasters, levels: Levels { white: 0, black: 1 }, clipped_dn: u16::MAX }
}

fn errors(map: &PhaseMap, phase: &dyn Fn(f64, f64) -> f64) -> (f64, f64) {
    let inner = (0..map.info.len()).filter(|i| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        (4..WIDTH - 4).contains(&x) && (4..HEIGHT - 4).contains(&y)
    });
    let all: Vec<f64> =
        inner.map(|i| f64::from(map.phase_rad[i]) - phase((i % WIDTH) as f64, (i / WIDTH) as f64)).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    (mean, all.iter().fold(0.0, |most: f64, e| most.max(e.abs())))
}

#[test]
fn the_footprint_is_found_from_the_frames_and_its_bias_removed() {
    for variance_px2 in [0.1, 0.33, 0.6] {
        let (mut map, rasters) = blurred(variance_px2);
        let before = errors(&map, &surface_phase);
        let mut footprint = Footprint::new(WIDTH, map.info.len());
        let found = footprint.survey(&map.view_mut(), Some(told_by(&rasters)), ROUND, best_level()).line;
        let found = found.map(Line::joined_px2).unwrap();
        assert!((found / variance_px2 - 1.0).abs() < 0.05, "{found} instead of {variance_px2}");
        footprint.correct(found, 0.0, &mut map.view_mut(), best_level());
        let after = errors(&map, &surface_phase);
        // Parts of opposite curvature and shading cancel in the mean, so the largest error is the measure of both.
        assert!(after.0.abs() < 0.03 * before.1, "(mean, largest) {before:?} became {after:?}");
        assert!(after.1 < 0.15 * before.1, "(mean, largest) {before:?} became {after:?}");
    }
}

/// A phase of fine fringes that is steep and curved, so that what is of fourth order in s shows.
#[test]
fn fine_fringes_leave_no_bias_of_fourth_order() {
    let phase = |x: f64, y: f64| {
        let (u, v) = (x - 120.0, y - 100.0);
        40.0 + 0.8 * x - 0.0012 * u * u - 0.0007 * v * v
    };
    let variance_px2 = 0.4;
    let (before, rasters) = blurred_phase(&phase, variance_px2);
    let left = |part_of_fourth: f32| {
        let mut map = before.clone();
        let mut footprint = Footprint::new(WIDTH, map.info.len());
        let found = footprint.survey(&map.view_mut(), Some(told_by(&rasters)), ROUND, best_level()).line;
        let found = found.map(Line::joined_px2).unwrap();
        assert!((found / variance_px2 - 1.0).abs() < 0.05, "{found} instead of {variance_px2}");
        footprint.fourth.iter_mut().for_each(|part| *part *= part_of_fourth);
        footprint.correct(found, 0.0, &mut map.view_mut(), best_level());
        errors(&map, &phase)
    };
    let (second, fourth) = (left(0.0), left(1.0));
    assert!(fourth.0.abs() < 0.2 * second.0.abs(), "mean error {second:?} became {fourth:?}");
}

/// Paint with a grain of two pixels: derivatives over 5 × 5 pixels would leave three quarters of what it does.
#[test]
fn a_texture_as_fine_as_pixels_moves_the_phase_by_little() {
    let phase = |x: f64, _: f64| 40.0 + 0.3 * x;
    let reflectance = |x: f64, y: f64| 110.0 + 11.0 * sin(1.4 * x + 0.5 * y);
    let variance_px2 = 0.33;
    let (mut map, _) = blurred_scene(&phase, &reflectance, variance_px2);
    let before = errors(&map, &phase);
    let mut footprint = Footprint::new(WIDTH, map.info.len());
    footprint.survey(&map.view_mut(), None, ROUND, best_level());
    footprint.correct(variance_px2, 0.0, &mut map.view_mut(), best_level());
    let after = errors(&map, &phase);
    assert!(after.1 < 0.25 * before.1, "(mean, largest) {before:?} became {after:?}");
}

#[test]
fn no_footprint_is_found_where_there_is_none_or_where_nothing_tells_it() {
    let (mut map, rasters) = blurred(0.0);
    let mut footprint = Footprint::new(WIDTH, map.info.len());
    let found = footprint.survey(&map.view_mut(), Some(told_by(&rasters)), ROUND, best_level()).line;
    assert!(found.map(Line::joined_px2).is_none_or(|s2| s2 < 0.005), "{found:?}");
    map.valid.fill(0);
    assert_eq!(footprint.survey(&map.view_mut(), Some(told_by(&rasters)), ROUND, best_level()).line, None);
}

#[test]
fn a_step_is_left_alone() {
    let (mut map, _) = blurred(0.0);
    for index in 0..map.info.len() {
        if index % WIDTH >= 120 {
            map.phase_rad[index] += 9.0;
        }
    }
    let before = map.clone();
    let mut footprint = Footprint::new(WIDTH, map.info.len());
    assert_eq!(footprint.survey(&map.view_mut(), None, ROUND, best_level()).line, None);
    footprint.correct(0.33, 0.0, &mut map.view_mut(), best_level());
    for row in 2..HEIGHT - 2 {
        for column in 118..122 {
            let index = row * WIDTH + column;
            assert_eq!(map.phase_rad[index], before.phase_rad[index], "row {row}, column {column}");
        }
    }
}

/// Proves: what pixels at a rim see of the dark beyond, so that their phases are off, bends no phase farther in. Without the limit of the
/// cubic it shifts the third pixel by 12 mrad.
#[test]
fn pixels_at_a_rim_bend_nothing_farther_in() {
    const RIM: usize = 60;
    let slope = |column: usize| 0.49 * column as f32;
    let info = PhaseInfo { width_px: WIDTH as u32, height_px: HEIGHT as u32, axis: Axis::X, period_px: 16.0 };
    let mut map = PhaseMap::new(info);
    for index in (0..info.len()).filter(|index| index % WIDTH >= RIM) {
        let column = index % WIDTH;
        // The middle of what they see of the surface lies farther in, by 0.65 and 0.14 px.
        let off = [0.32, 0.068].get(column - RIM).copied().unwrap_or(0.0);
        map.phase_rad[index] = slope(column) + off;
        (map.valid[index], map.modulation[index], map.sigma_rad[index]) = (1, 80.0, 0.0087);
    }
    let mut footprint = Footprint::new(WIDTH, info.len());
    footprint.survey(&map.view_mut(), None, ROUND, best_level());
    footprint.correct(0.29, 0.0, &mut map.view_mut(), best_level());
    for index in (2 * WIDTH..info.len() - 2 * WIDTH).filter(|index| index % WIDTH >= RIM + 2) {
        let off = (map.phase_rad[index] - slope(index % WIDTH)).abs();
        assert!(off < 4e-3, "{index}: {off}");
    }
}

#[test]
fn tiny_images_have_no_inside() {
    for (width, height) in [(1, 1), (1, 50), (4, 4), (50, 3)] {
        let info = PhaseInfo { width_px: width, height_px: height, axis: Axis::X, period_px: 16.0 };
        let mut map = PhaseMap::new(info);
        map.valid.fill(1);
        map.phase_rad.fill(1.0);
        let mut footprint = Footprint::new(width as usize, info.len());
        let rasters = Rasters::new(2, info.len(), 255);
        assert_eq!(
            footprint.survey(&map.view_mut(), Some(told_by(&rasters)), ROUND, best_level()).line,
            None
        );
        footprint.correct(0.33, 0.0, &mut map.view_mut(), best_level());
        assert!(map.phase_rad.iter().all(|phase| *phase == 1.0));
    }
}

/// A footprint that grows towards the corners takes off its own share at each pixel, of the mean over the picture in the mean.
#[test]
fn the_footprint_of_a_place_is_taken_off_there() {
    let corrected = |mean_px2: f64, field_px2: f64| {
        let (mut map, _) = blurred(0.3);
        let before = map.phase_rad.clone();
        let mut footprint = Footprint::new(WIDTH, map.info.len());
        footprint.survey(&map.view_mut(), None, ROUND, best_level());
        footprint.correct(mean_px2, field_px2, &mut map.view_mut(), best_level());
        before.iter().zip(&map.phase_rad).map(|(a, b)| f64::from(a - b)).collect::<Vec<f64>>()
    };
    let (even, grown) = (corrected(0.3, 0.0), corrected(0.3, 0.12));
    let corner2 = 119.5 * 119.5 + 99.5 * 99.5;
    let mut asked = 0;
    for (index, (even, grown)) in
        even.iter().zip(grown).enumerate().filter(|(_, (even, _))| even.abs() > 2e-4)
    {
        let (x, y) = ((index % WIDTH) as f64 - 119.5, (index / WIDTH) as f64 - 99.5);
        let expected = even * (0.3 + 0.12 * ((x * x + y * y) / corner2 - 1.0 / 3.0)) / 0.3;
        // Phases of 40 rad and more in single precision.
        assert!((grown - expected).abs() < 3e-5, "pixel {index}: {grown} instead of {expected}");
        asked += 1;
    }
    assert!(asked > 1000, "{asked}");
}

/// Proves: the report says what is left of the variance where settings take another one off than the calibration has, or nothing; and that of any
/// lens is taken off where nothing is known.
#[test]
fn what_was_not_taken_off_is_told() {
    let coordinates = (0..WIDTH * HEIGHT).map(|i| {
        let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
        20.0 + x + 0.0025 * x * x + 0.0015 * y * y
    });
    let scene = super::Scene::new(WIDTH, coordinates.collect(), 512).eight_bits();
    let with_levels = super::demo(16.0, 5);
    let without = &with_levels[..2];
    let footprint = crate::sensor::Footprint { sigma_px: [0.5; 2], u_px: Some([0.0; 2]), field_px2: 0.0 };
    let told = |sequence: &[PatternSet], footprint_px: Option<f64>, known: bool| {
        let mut settings = DecodeSettings { footprint_px, ..DecodeSettings::default() };
        settings.sensor.footprint = known.then_some(footprint);
        let (_, report) = scene.decode_frames(sequence, &scene.frames(sequence), Axis::X, &settings);
        assert!(report.valid > WIDTH * HEIGHT / 2, "{}", report.valid);
        assert!(
            report.footprint_left_px2.is_none() || report.footprint_off_px2() == report.footprint_left_px2
        );
        (report.footprint_px.is_some(), report.footprint_left_px2)
    };
    assert_eq!(told(&with_levels, None, false).1, None, "white and black show it");
    for sequence in [&with_levels[..], without] {
        assert_eq!(told(sequence, None, true), (true, None), "the calibration found it");
        for (stated_px, known, expected) in [
            (0.0, false, Some(0.2)),
            (0.5, false, None),
            (0.0, true, Some(0.25)),
            (0.5, true, None),
            (0.6, true, Some(-0.11)),
        ] {
            let (taken, left) = told(sequence, Some(stated_px), known);
            assert_eq!(taken, stated_px > 0.0);
            let rounded = left.map(|left_px2| (1e6 * left_px2).round() / 1e6);
            assert_eq!(rounded, expected, "{stated_px} px stated, known: {known}");
        }
    }
    assert_eq!(
        told(without, None, false),
        (true, None),
        "nothing shows it, and that of any lens is taken off"
    );
    // Of a flat part white and black show no footprint, and none is missed.
    let flat = super::Scene::ramp(WIDTH, HEIGHT, 1.0, 0.0, 512).eight_bits();
    let (_, report) =
        flat.decode_frames(&with_levels, &flat.frames(&with_levels), Axis::X, &DecodeSettings::default());
    assert_eq!(
        (report.footprint_px, report.footprint_assumed, report.footprint_off_px2()),
        (None, false, None)
    );
}

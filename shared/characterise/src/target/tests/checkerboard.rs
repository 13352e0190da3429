//! Checkerboards.

use super::super::{Ambiguity, Detection, TargetError, TargetKind, TargetSettings, TargetSpec, detect};
use super::scene::{Scene, clutter};
use fringe::frame::{Frame, FrameView, PixelBuffer, Pixels};
use fringe::geometry::camera::Lens;
use nalgebra::{Point2, Vector2};

const TILT: [f64; 3] = [0.35, -0.3, 0.2];
const LENS: Lens = Lens::brown_conrady([-0.25, 0.1, 0.0], [2e-4, -1e-4]);

fn board(columns: u32, rows: u32) -> Scene {
    Scene::new(TargetKind::Checkerboard, columns, rows, TILT, LENS)
}

fn found(scene: &Scene, frame: &Frame) -> Detection {
    detect(&frame.view(), &scene.spec, &TargetSettings::default()).expect("detected")
}

fn refused(frame: &FrameView, spec: &TargetSpec) -> TargetError {
    detect(frame, spec, &TargetSettings::default()).expect_err("refused")
}

#[test]
fn corners_reach_the_noise_limit_and_their_covariance_is_their_scatter() {
    let scene = board(9, 6);
    let clean = scene.clean();
    let (mut sum, mut squares, mut mahalanobis, mut count) = (Vector2::zeros(), 0.0, 0.0, 0.0);
    for seed in 1..=16 {
        let detection = found(&scene, &scene.frame(&clean, seed));
        assert_eq!((detection.points.len(), detection.ambiguity), (54, Ambiguity::None));
        for point in &detection.points {
            let error = point.pixel - scene.truth(point.index);
            sum += error;
            squares += error.norm_squared();
            let inverse = point.covariance_px2.try_inverse().expect("regular");
            mahalanobis += (error.transpose() * inverse * error)[0];
            count += 1.0;
        }
    }
    let (mean, sd) = (sum / count, (squares / count / 2.0_f64).sqrt());
    let ratio = (mahalanobis / count / 2.0).sqrt();
    assert!(mean.norm() < 0.001, "mean error {mean:?} px");
    assert!(sd < 0.01, "standard deviation {sd} px");
    assert!((0.9..1.1).contains(&ratio), "scatter over prediction {ratio}");
}

#[test]
fn numbering_follows_colours_and_says_when_they_do_not_tell() {
    for (columns, rows, ambiguity) in [
        (9, 6, Ambiguity::None),
        (6, 4, Ambiguity::HalfTurn),
        (5, 5, Ambiguity::HalfTurn),
        (6, 6, Ambiguity::QuarterTurn),
    ] {
        for turn_rad in [0.1, 1.4, 3.0, -1.8] {
            let scene = Scene::new(TargetKind::Checkerboard, columns, rows, [0.2, 0.3, turn_rad], LENS);
            let mut detection = found(&scene, &scene.frame(&scene.clean(), 3));
            assert_eq!(detection.ambiguity, ambiguity, "{columns} x {rows}");
            let near = |d: &Detection| d.points.iter().all(|p| (p.pixel - scene.truth(p.index)).norm() < 0.1);
            let turns = match ambiguity {
                Ambiguity::None => 1,
                Ambiguity::HalfTurn => 2,
                Ambiguity::QuarterTurn => 4,
            };
            let mut matches = 0;
            for _ in 0..turns {
                matches += usize::from(near(&detection));
                let next = if turns == 4 { detection.quarter_turned() } else { detection.half_turned() };
                detection = next.unwrap_or(detection);
            }
            assert_eq!(matches, 1, "{columns} x {rows} turned by {turn_rad}");
        }
    }
}

#[test]
fn a_partly_hidden_board_gives_only_true_corners() {
    for centre in [(150.0, 140.0), (205.0, 95.0), (240.0, 190.0)] {
        let mut scene = board(9, 6);
        scene.hidden = Some((Point2::new(centre.0, centre.1), 32.0));
        let detection = found(&scene, &scene.frame(&scene.clean(), 5));
        assert!((36..54).contains(&detection.points.len()), "{} points", detection.points.len());
        for point in &detection.points {
            let error = (point.pixel - scene.truth(point.index)).norm();
            assert!(error < 0.12, "{:?} is off by {error} px", point.index);
        }
        let whole = TargetSettings { min_visible_fraction: 1.0, ..TargetSettings::default() };
        let error = detect(&scene.frame(&scene.clean(), 5).view(), &scene.spec, &whole).expect_err("hidden");
        assert!(matches!(error, TargetError::Hidden { count: 54, needed: 54, .. }), "{error}");
    }
}

#[test]
fn a_board_whose_extent_is_hidden_is_refused_with_what_was_seen() {
    let mut scene = board(9, 6);
    // The first column lies under the disc.
    scene.hidden = Some((scene.truth((0, 2)) - Vector2::new(160.0, -30.0), 190.0));
    let error = refused(&scene.frame(&scene.clean(), 5).view(), &scene.spec);
    assert!(matches!(&error, TargetError::OtherSize { found, .. } if found[0].0 < 9), "{error}");
}

#[test]
fn another_board_no_board_and_two_boards_are_told_apart() {
    let scene = board(7, 6);
    let frame = scene.frame(&scene.clean(), 1);
    let other = TargetSpec { columns: 9, ..scene.spec.clone() };
    let error = refused(&frame.view(), &other);
    assert!(matches!(&error, TargetError::OtherSize { found, .. } if found == &[(7, 6)]), "{error}");
    for seed in 1..6 {
        let error = refused(&clutter(360, 280, seed * 77).view(), &scene.spec);
        assert!(matches!(error, TargetError::NoTarget { .. }), "{error}");
    }
    let error = refused(&side_by_side(&frame).view(), &scene.spec);
    assert!(matches!(error, TargetError::Several { count: 2, .. }), "{error}");
}

/// The same frame twice.
fn side_by_side(frame: &Frame) -> Frame {
    let PixelBuffer::Mono8(values) = &frame.pixels else { panic!("8 bits") };
    let rows = values.chunks_exact(frame.width_px as usize);
    let doubled = rows.flat_map(|row| row.iter().chain(row).copied()).collect();
    Frame { width_px: 2 * frame.width_px, pixels: PixelBuffer::Mono8(doubled), ..frame.clone() }
}

#[test]
fn saturated_squares_do_not_pull_the_corners() {
    let scene = board(9, 6);
    let mut clean = scene.clean();
    clean.values.iter_mut().for_each(|v| *v *= 1.7);
    let detection = found(&scene, &scene.frame(&clean, 9));
    assert_eq!(detection.points.len(), 54);
    let errors: Vec<f64> =
        detection.points.iter().map(|p| (p.pixel - scene.truth(p.index)).norm_squared()).collect();
    let rms = (errors.iter().sum::<f64>() / 108.0).sqrt();
    assert!(rms < 0.012, "{rms} px with a third of the squares saturated");
}

#[test]
fn strange_frames_are_refused_without_panic() {
    let spec = board(9, 6).spec;
    for (width_px, height_px, values) in [(0, 0, 0), (8, 8, 64), (100, 100, 99), (16, 65_536, 16 * 65_536)] {
        let data = vec![0_u8; values];
        let frame = FrameView { width_px, height_px, full_scale_dn: 255, pixels: Pixels::Mono8(&data) };
        assert!(matches!(refused(&frame, &spec), TargetError::Size { .. }));
    }
    for level in [0, 255] {
        let data = vec![level; 16 * 400];
        let frame =
            FrameView { width_px: 16, height_px: 400, full_scale_dn: 255, pixels: Pixels::Mono8(&data) };
        assert!(matches!(refused(&frame, &spec), TargetError::NoTarget { candidates: 0, .. }));
    }
}

/// Columns `from..to` of a frame.
fn cropped(frame: &Frame, from: f64, to: f64) -> Frame {
    let PixelBuffer::Mono8(values) = &frame.pixels else { panic!("8 bits") };
    let (from, to) = (from as usize, to as usize);
    let rows = values.chunks_exact(frame.width_px as usize);
    let pixels = PixelBuffer::Mono8(rows.flat_map(|row| &row[from..to]).copied().collect());
    Frame { width_px: (to - from) as u32, pixels, ..frame.clone() }
}

#[test]
fn a_part_that_could_be_of_a_larger_board_is_refused_and_one_that_shows_an_end_is_not() {
    let scene =
        Scene::new(TargetKind::Checkerboard, 12, 6, [0.0; 3], Lens::brown_conrady([0.0; 3], [0.0; 2]));
    let frame = scene.frame(&scene.clean(), 4);
    let declared = TargetSpec { columns: 8, ..scene.spec.clone() };
    let x = |column: u32| scene.truth((column, 0)).x;
    let middle = cropped(&frame, x(2) - 12.0, x(9) + 12.0);
    let error = refused(&middle.view(), &declared);
    assert!(matches!(error, TargetError::Endless { columns: 8, rows: 6, .. }), "{error}");
    let first = cropped(&frame, x(0) - 40.0, x(7) + 12.0);
    let detection =
        detect(&first.view(), &declared, &TargetSettings::default()).expect("its left end is seen");
    assert_eq!(detection.points.len(), 48);
}

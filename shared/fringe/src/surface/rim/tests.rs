//! Rims: what is marked, what is dropped, and what that does to the neighbours.

use super::super::{Sample, SurfaceSettings};
use super::*;
use crate::cloud::Point;
use crate::rectify::Directions;
use bytemuck::Zeroable;
use nalgebra::Vector3;

const LINK: Link = Link { max_step: 0.01 };

fn samples(picture: &[&str]) -> (usize, Vec<Sample>) {
    let depth = |c: u8| if c == b'.' { f64::NAN } else { 0.002 + 0.001 * f64::from(c - b'0') };
    let sample = |c| Sample { inverse_depth: depth(c), sigma: 0.0, modulation: 1.0, ..Sample::NONE };
    (picture[0].len(), picture.iter().flat_map(|line| line.bytes()).map(sample).collect())
}

/// A silhouette, a step to another surface and a speck; the border of the picture is none of them.
#[test]
fn rims_go_and_specks_and_borders_stay() {
    let picture = ["1111111....", "1111111....", "11.11112222", "11111112222", "11111112222", "11111112222"];
    let (width, samples) = samples(&picture);
    let at = |column, row| {
        at_rim(
            (width, picture.len()),
            &samples[..].into(),
            &vec![0; samples.len()],
            row * width + column,
            LINK,
            2,
        )
    };
    assert!((0..5).all(|column| !at(column, 4)), "three pixels away, beside the border");
    assert!([5, 6, 7, 8].iter().all(|column| at(*column, 4)), "on both sides of a step");
    assert!(!at(1, 1) && !at(2, 3), "one sample is a speck");
}

/// One missing neighbour is a speck in the smallest window too; the three of a silhouette are a rim.
#[test]
fn one_missing_neighbour_is_no_rim() {
    let picture = ["1111...", "1111...", "1.11...", "1111...", "1111..."];
    let (width, samples) = samples(&picture);
    let at = |column, row| {
        at_rim(
            (width, picture.len()),
            &samples[..].into(),
            &vec![0; samples.len()],
            row * width + column,
            LINK,
            1,
        )
    };
    assert!(!at(0, 2) && !at(1, 1) && !at(2, 3));
    assert!(at(3, 1) && at(3, 2));
}

#[test]
fn marks_agree_with_the_test_of_one_pixel() {
    let (width, height) = (23, 17);
    let inside = |i: usize| {
        let (x, y) = ((i % width) as f64 - 10.0, (i / width) as f64 - 8.0);
        x * x + y * y < 42.0 && !i.is_multiple_of(61)
    };
    let values: Vec<f32> = (0..width * height).map(|i| if inside(i) { 1.0 } else { f32::NAN }).collect();
    let sample = |i| {
        if inside(i) {
            Sample { inverse_depth: 0.002, sigma: 0.0, modulation: 1.0, ..Sample::NONE }
        } else {
            Sample::NONE
        }
    };
    let samples: Vec<Sample> = (0..width * height).map(sample).collect();
    let raster = Raster::from(&samples[..]);
    let mut rims = vec![0; width * height];
    let (mut missing, none) = (vec![0; width * height], vec![0; width * height]);
    mark_missing((width, &values), -1.0, &mut missing);
    for edge in [1, 2, 3] {
        mark_rims(width, edge, &missing, &mut rims);
        for pixel in (0..width * height).filter(|i| inside(*i)) {
            assert_eq!(
                rims[pixel] != 0,
                at_rim((width, height), &raster, &none, pixel, LINK, edge),
                "{pixel}"
            );
        }
    }
    mark_rims(width, 0, &missing, &mut rims);
    assert!(rims.iter().all(|rim| *rim == 0));
}

const SIDE: usize = 40;
const PITCH: f64 = 0.001;
/// Inverse depth of the middle, and what a length of one pixel on the surface changes it by.
const MIDDLE: f64 = 0.002;
const UNIT: f64 = MIDDLE * PITCH;

/// Causes and points of a slanting plane of which each column stands off by so many pixels, or is dark.
fn built(off_px: impl Fn(usize) -> Option<f64>) -> (Vec<Cause>, Vec<Point>) {
    let at = |i: usize| [i % SIDE, i / SIDE].map(|v| (v as f64 - 20.0) * PITCH);
    let directions = Directions::kept(SIDE, (0..SIDE * SIDE).map(at).collect());
    let sample = |i: usize| {
        let Some(off) = off_px(i % SIDE) else { return Sample::NONE };
        let inverse_depth = MIDDLE * (1.0 + 0.5 * at(i)[0] - 0.2 * at(i)[1]) + off * UNIT;
        let sigma = (0.07 * UNIT) as f32;
        Sample { inverse_depth, sigma, modulation: 1.0, ..Sample::without(Cause::Point) }
    };
    let samples: Vec<Sample> = (0..SIDE * SIDE).map(sample).collect();
    let mut builder = SurfaceBuilder::new(SIDE, SIDE, SurfaceSettings::default());
    builder.load(&samples);
    let mut points = vec![Point::zeroed(); samples.len()];
    let view = View::along_the_axes([SIDE, SIDE], &directions, PITCH);
    let report = builder.build(&view, 0, &mut points);
    points.truncate(report.points as usize);
    let rims = builder.causes().iter().filter(|cause| **cause == Cause::Rim).count();
    assert_eq!(report.rims as usize, rims);
    (builder.causes().to_vec(), points)
}

/// Proves: the pixels at a rim, which stand off, are no points, and turn the normals of their neighbours by nothing.
#[test]
fn what_stands_off_at_a_rim_turns_no_normal() {
    let (causes, points) = built(|column| match column {
        0..10 => None,
        10 => Some(2.5),
        11 => Some(0.55),
        _ => Some(0.0),
    });
    for (pixel, cause) in causes.iter().enumerate() {
        let wanted = match pixel % SIDE {
            0..10 => Cause::Dark,
            10 | 11 => Cause::Rim,
            _ => Cause::Point,
        };
        assert_eq!(*cause, wanted, "{pixel}");
    }
    let normal = |point: &Point| Vector3::from(point.normal.map(f64::from));
    let inside = normal(points.iter().find(|point| point.pixel as usize == 20 * SIDE + 30).unwrap());
    let turn = points.iter().map(|point| normal(point).cross(&inside).norm()).fold(0.0, f64::max);
    assert!(points.len() == SIDE * 28 && turn < 1e-3, "{} points, {turn} rad", points.len());
}

/// Proves: a narrow shadow beyond which another surface begins has rims on both sides; a dark line across a face has none.
#[test]
fn a_shadow_has_rims_and_a_dark_line_has_none() {
    for width in 1..=3 {
        for step_px in [0.0, 4.0, -4.0] {
            let beyond = 20 + width;
            let (causes, _) = built(|column| {
                (!(20..beyond).contains(&column)).then_some(if column < 20 { 0.0 } else { step_px })
            });
            let is_rim = |column: usize| step_px != 0.0 && (18..beyond + 2).contains(&column);
            for (pixel, cause) in causes.iter().enumerate() {
                let wanted = match pixel % SIDE {
                    column if (20..beyond).contains(&column) => Cause::Dark,
                    column if is_rim(column) => Cause::Rim,
                    _ => Cause::Point,
                };
                assert_eq!(*cause, wanted, "{width} px, {step_px} px off: {pixel}");
            }
        }
    }
}

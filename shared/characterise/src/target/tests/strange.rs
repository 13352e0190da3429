//! Frames that no camera took: whatever they hold, an answer and no panic.

use super::super::{MarkerDictionary, TargetKind, TargetSettings, TargetSpec, detect};
use fringe::frame::{FrameView, Pixels};
use proptest::prelude::*;

/// How the grey values of a frame come about.
#[derive(Debug, Clone)]
enum Content {
    Constant(u16),
    /// Change by column and row, wrapped at 16 bits.
    Gradient(u16, u16),
    /// Grey values of blocks of the given side, repeated.
    Blocks(usize, Vec<u16>),
    /// Squares of two levels, of which every n-th is inverted.
    Squares(usize, u16, u16, usize),
    /// Discs of a radius at a pitch.
    Discs(usize, usize),
}

fn content() -> impl Strategy<Value = Content> {
    let level = prop_oneof![Just(0_u16), Just(255), Just(u16::MAX), any::<u16>()];
    prop_oneof![
        level.clone().prop_map(Content::Constant),
        (any::<u16>(), any::<u16>()).prop_map(|(x, y)| Content::Gradient(x, y)),
        (1..9_usize, prop::collection::vec(level.clone(), 1..400))
            .prop_map(|(side, values)| Content::Blocks(side, values)),
        (3..20_usize, level.clone(), level, 2..99_usize)
            .prop_map(|(side, a, b, wrong)| Content::Squares(side, a, b, wrong)),
        (2..9_usize, 5..24_usize).prop_map(|(radius, pitch)| Content::Discs(radius, pitch)),
    ]
}

fn value(content: &Content, x: usize, y: usize) -> u16 {
    match content {
        Content::Constant(value) => *value,
        Content::Gradient(by_x, by_y) => {
            by_x.wrapping_mul(x as u16).wrapping_add(by_y.wrapping_mul(y as u16))
        }
        Content::Blocks(side, values) => values[(x / side + 97 * (y / side)) % values.len()],
        Content::Squares(side, a, b, wrong) => {
            let (u, v) = (x / side, y / side);
            let odd = (u + v) % 2 + usize::from((u + 31 * v) % wrong == 0);
            if odd == 1 { *a } else { *b }
        }
        Content::Discs(radius, pitch) => {
            let off = |at: usize| (at % pitch) as i64 - (*pitch / 2) as i64;
            if off(x).pow(2) + off(y).pow(2) <= (radius * radius) as i64 { 20 } else { 60_000 }
        }
    }
}

fn spec() -> impl Strategy<Value = TargetSpec> {
    let kind = prop_oneof![
        2 => Just(TargetKind::Checkerboard),
        1 => Just(TargetKind::Circles),
        1 => Just(TargetKind::AsymmetricCircles),
        1 => Just(TargetKind::Charuco),
    ];
    (kind, 3..9_u32, 3..9_u32).prop_map(|(kind, columns, rows)| {
        let marked = kind == TargetKind::Charuco;
        TargetSpec {
            format: None,
            kind,
            columns,
            rows,
            pitch_mm: 10.0,
            diameter_mm: None,
            dictionary: marked.then_some(MarkerDictionary::D4x4n50),
            marker_mm: marked.then_some(7.0),
            first_marker: None,
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn any_frame_is_answered(
        content in content(),
        spec in spec(),
        size in prop_oneof![(0..20_u32, 0..140_u32), (0..140_u32, 0..20_u32), (16..140_u32, 16..140_u32)],
        narrow in any::<bool>(),
    ) {
        let (width_px, height_px) = size;
        let at = |i: usize| (i % width_px as usize, i / width_px as usize);
        let count = width_px as usize * height_px as usize;
        let words: Vec<u16> = (0..count).map(at).map(|(x, y)| value(&content, x, y)).collect();
        let bytes: Vec<u8> = words.iter().map(|word| (word >> 8) as u8).collect();
        let pixels = if narrow { Pixels::Mono8(&bytes) } else { Pixels::Mono16(&words) };
        let full_scale_dn = if narrow { 255 } else { u16::MAX };
        let frame = FrameView { width_px, height_px, full_scale_dn, pixels };
        let settings = TargetSettings { min_visible_fraction: 0.25, ..TargetSettings::default() };
        let first = detect(&frame, &spec, &settings);
        if let Ok(detection) = &first {
            prop_assert!(detection.points.len() <= spec.count());
            for point in &detection.points {
                prop_assert!(point.index.0 < spec.columns && point.index.1 < spec.rows);
                prop_assert!(point.pixel.x > 0.0 && point.pixel.x < f64::from(width_px), "{point:?}");
                prop_assert!(point.pixel.y > 0.0 && point.pixel.y < f64::from(height_px), "{point:?}");
                prop_assert!(point.covariance_px2.cholesky().is_some(), "{point:?}");
            }
        }
        prop_assert_eq!(first, detect(&frame, &spec, &settings));
    }
}

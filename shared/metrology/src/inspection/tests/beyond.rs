//! Material that an element's margin leaves out.

use crate::inspection::{InspectionResult, Plan, evaluate};
use crate::verdict::Verdict;
use fringe::cloud::Point;

/// A plate of 40 mm with a face of 10 mm square in the middle, which is another element where `boss` says so.
fn plan(boss: bool) -> Plan {
    let element = |name: &str, z: f64, size: f64| {
        format!(
            "[[element]]\nkind = \"plane\"\nname = \"{name}\"\npoint_mm = [0.0, 0.0, {z:?}]\nnormal = [0.0, 0.0, 1.0]\n\
             direction = [1.0, 0.0, 0.0]\nsize_mm = [{size:?}, {size:?}]\nmargin_mm = 0.8\nmin_points = 100\n"
        )
    };
    let boss = if boss { element("boss", 1.2, 10.0) } else { String::new() };
    let feature =
        "[[feature]]\nkind = \"plane-flatness\"\nname = \"flatness\"\nelement = \"plate\"\nlimit_mm = 0.1\n";
    let text = format!(
        "format = \"fringecell-plan/1\"\nname = \"plate\"\n{}{boss}{feature}",
        element("plate", 0.0, 40.0)
    );
    Plan::from_toml(&text).unwrap()
}

/// The plate on a grid of 0.25 mm; a square of this half width stands so much higher, and has this normal.
fn measured(boss: bool, half_mm: f64, height_mm: f64, normal: [f32; 3]) -> InspectionResult {
    let point = |i: usize| {
        let [x, y] = [i % 160, i / 160].map(|k| 0.25 * k as f64 - 19.9);
        let raised = x.abs() < half_mm && y.abs() < half_mm;
        // A pattern of some micrometres instead of noise.
        let ripple = 0.002 * f64::from(((i * 7919) % 13) as u32) / 13.0;
        Point {
            position_mm: [x, y, ripple + if raised { height_mm } else { 0.0 }],
            normal: if raised { normal } else { [0.0, 0.0, 1.0] },
            sigma_mm: 0.001,
            modulation: 80.0,
            pair: 0,
            pixel: i as u32,
            shared_mm: 0.0,
        }
    };
    let cloud: Vec<Point> = (0..160 * 160).map(point).collect();
    evaluate(&plan(boss), &cloud)
}

#[test]
fn a_face_with_a_boss_beyond_the_margin_does_not_pass() {
    const UP: [f32; 3] = [0.0, 0.0, 1.0];
    for (case, result, doubted) in [
        ("a boss", measured(false, 5.0, 1.2, UP), true),
        ("a pit", measured(false, 5.0, -1.2, UP), true),
        ("a boss that is another element", measured(true, 5.0, 1.2, UP), false),
        ("within the margin the flatness shows it", measured(false, 5.0, 0.5, UP), false),
        ("dust", measured(false, 0.8, 1.2, UP), false),
        ("a wall", measured(false, 5.0, 1.2, [1.0, 0.0, 0.0]), false),
        ("without normals", measured(false, 5.0, 1.2, [0.0; 3]), false),
        ("twice the margin away", measured(false, 5.0, 1.7, UP), false),
    ] {
        let feature = &result.features[0];
        let told = result.elements[0].beyond.as_ref().is_some_and(|text| text.contains("\"plate\""));
        assert_eq!(told, doubted, "{case}: {:?}", result.elements[0].beyond);
        assert!(feature.value.is_some(), "{case}: {feature:?}");
        if doubted {
            assert_eq!(
                (feature.verdict, result.verdict),
                (Some(Verdict::Indeterminate), Verdict::Indeterminate)
            );
            assert!(feature.detail.as_ref().unwrap().contains("beyond its margin_mm"), "{case}");
        } else if case.starts_with("within") {
            assert_eq!(feature.verdict, Some(Verdict::Fail), "{case}");
        } else {
            assert_eq!(feature.verdict, Some(Verdict::Pass), "{case}: {feature:?}");
        }
    }
}

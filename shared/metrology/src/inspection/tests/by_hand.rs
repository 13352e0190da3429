//! Characteristics of a turned part, computed by hand, and by brute force on the points themselves.

use fringe::cloud::Point;
use nalgebra::Vector3;

use super::characteristics::{limit, size};
use super::turned::{Turned, elements, rings};
use crate::fit::tests::Noise;
use crate::inspection::{FeatureResult, Plan, evaluate};
use crate::verdict::Verdict;

fn results(features: &[String], part: &Turned) -> Vec<FeatureResult> {
    let plan = Plan::from_toml(&format!("{}\n{}", elements(part.hole), features.concat())).unwrap();
    evaluate(&plan, &part.cloud()).features
}

fn value(features: &[FeatureResult], name: &str) -> f64 {
    let found = features.iter().find(|f| f.name == name).unwrap();
    found.value.unwrap_or_else(|| panic!("{name}: {:?}", found.reason))
}

fn range(values: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

fn place(p: &Point) -> Vector3<f64> {
    Vector3::from(p.position_mm)
}

/// Journal off by 0.05: axis 0.1 (coaxiality) and run-out 0.1; circle of the balls off by (0.03, 0.04): 0.1; groove off by 0.03:
/// 0.06; face with a slope of 0.002 over 7 mm: 0.014.
#[test]
fn coaxiality_concentricity_symmetry_and_run_out_are_those_of_the_drawing() {
    let part = Turned {
        journal_off: [0.05, 0.0],
        balls_off: [0.03, 0.04],
        groove_off: 0.03,
        face_slope: 0.002,
        ..Turned::default()
    };
    let of = |kind: &str, element: &str, rest: &str| limit(kind, kind, element, rest);
    let features = [
        of("coaxiality", "journal", "datums = \"seat\""),
        of("concentricity", "pitch", "datums = \"seat\""),
        of("symmetry", "groove", "datums = \"body\""),
        of("circular-runout", "journal", "datums = \"seat\"\nsection_mm = 2.0"),
        of("total-runout", "journal", "datums = \"seat\""),
        limit("total-runout", "axial", "face", "datums = \"seat\""),
        limit("circular-runout", "axial ring", "face", "datums = \"seat\"\nsection_mm = 0.5"),
        limit("perpendicularity", "square", "face", "datums = \"seat\""),
    ];
    let found = results(&features, &part);
    for (name, expected) in [
        ("coaxiality", 0.1),
        ("concentricity", 0.1),
        ("symmetry", 0.06),
        ("circular-runout", 0.1),
        ("total-runout", 0.1),
        ("axial", 0.014),
        ("square", 0.014),
    ] {
        assert!(
            (value(&found, name) - expected).abs() < 1e-9,
            "{name}: {} for {expected}",
            value(&found, name)
        );
    }
    // Rings of the face by brute force: of those with twelve points or more the worst.
    let mut rings: std::collections::BTreeMap<i64, Vec<f64>> = std::collections::BTreeMap::new();
    for p in part.face().iter().map(place) {
        rings.entry((p.xy().norm() / 0.5).floor() as i64).or_default().push(p.z);
    }
    let worst =
        rings.values().filter(|r| r.len() >= 12).map(|r| range(r.iter().copied())).fold(0.0, f64::max);
    assert!(
        (value(&found, "axial ring") - worst).abs() < 1e-12,
        "{} for {worst}",
        value(&found, "axial ring")
    );
}

/// A journal that is off, tilted and lobed, planes and lines with bumps: ranges of the points about what is known exactly.
#[test]
fn ranges_of_points_agree_with_brute_force() {
    let part = Turned {
        journal_off: [0.02, -0.03],
        journal_slope: 0.003,
        lobes: 0.015,
        bumps: 0.02,
        slope: 0.001,
        ..Turned::default()
    };
    let features = [
        limit("total-runout", "total", "journal", "datums = \"seat\""),
        limit("circular-runout", "circular", "journal", "datums = \"seat\"\nsection_mm = 1.0"),
        limit("angularity", "angularity", "slope", "datums = \"AB\""),
        limit("surface-profile", "journal profile", "journal", "datums = \"seat\""),
        limit("surface-profile", "slope profile", "slope", ""),
        limit("line-profile", "line profile", "trace", ""),
        limit("parallelism", "axis", "journal", "datums = \"seat\""),
    ];
    let found = results(&features, &part);
    let radii: Vec<(i64, f64)> =
        part.journal().iter().map(|p| (place(p).z.round() as i64, place(p).xy().norm())).collect();
    let section = |z: i64| range(radii.iter().filter(|(at, _)| *at == z).map(|(_, r)| *r));
    let normal = Vector3::new(0.5, 0.0, 0.75f64.sqrt());
    let twice = |values: Vec<f64>| 2.0 * values.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    for (name, expected) in [
        ("total", range(radii.iter().map(|(_, r)| *r))),
        ("circular", (50..=70).map(section).fold(0.0, f64::max)),
        ("angularity", range(part.slope().iter().map(|p| normal.dot(&place(p))))),
        ("journal profile", twice(radii.iter().map(|(_, r)| r - 6.0).collect())),
        (
            "slope profile",
            twice(part.slope().iter().map(|p| normal.dot(&(place(p) - Vector3::x() * 40.0))).collect()),
        ),
        ("line profile", twice(part.trace().iter().map(|p| place(p).z + 60.0).collect())),
    ] {
        let value = value(&found, name);
        assert!((value - expected).abs() < 1e-9, "{name}: {value} for {expected}");
    }
    // The axis leans by 0.003 over its length of 20.5 mm; lobes of three periods lean it no further.
    assert!((value(&found, "axis") - 0.003 * 20.5).abs() < 1e-6, "{}", value(&found, "axis"));
}

/// The largest pin that fits between the points, by dense search over its places, refined about the best ten times.
fn largest_pin_mm(points: &[Point]) -> (f64, [f64; 2]) {
    let fits = |x: f64, y: f64| {
        points
            .iter()
            .map(|p| (place(p).xy() - nalgebra::Vector2::new(x, y)).norm())
            .fold(f64::INFINITY, f64::min)
    };
    let (mut best, mut step) = ((fits(0.0, 0.0), [0.0, 0.0]), 0.02);
    for _ in 0..12 {
        let [x, y] = best.1;
        for (i, j) in (-8..=8).flat_map(|i| (-8..=8).map(move |j| (i, j))) {
            let at = [x + step * f64::from(i), y + step * f64::from(j)];
            let radius = fits(at[0], at[1]);
            if radius > best.0 {
                best = (radius, at);
            }
        }
        step *= 0.25;
    }
    (2.0 * best.0, best.1)
}

/// The mating size of a lobed hole is that of the largest pin; with Ⓜ it widens the tolerance.
#[test]
fn the_mating_size_of_a_hole_is_its_largest_pin() {
    let part = Turned {
        hole: true,
        lobes: 0.02,
        journal_off: [0.04, -0.02],
        journal_oversize: 0.1,
        ..Turned::default()
    };
    let text = elements(true).replacen(
        "name = \"journal\"",
        "name = \"journal\"\ncriterion = \"maximum-inscribed\"",
        1,
    );
    let features = [
        "[[feature]]\nkind = \"size\"\nname = \"mating\"\nelement = \"journal\"\ntolerance_mm = [0.0, 0.2]\n"
            .to_owned(),
        limit("position", "place", "journal", "datums = \"seat\"\nmaximum_material = \"mating\""),
    ];
    let plan = Plan::from_toml(&format!("{text}\n{}", features.concat())).unwrap();
    let found = evaluate(&plan, &part.cloud()).features;
    let (pin_mm, [x, y]) = largest_pin_mm(&part.journal());
    assert!((value(&found, "mating") - pin_mm).abs() < 1e-6, "{} for {pin_mm}", value(&found, "mating"));
    let off = 2.0 * (x * x + y * y).sqrt();
    assert!((value(&found, "place") - off).abs() < 1e-5, "{} for {off}", value(&found, "place"));
    let widened = found[1].upper.unwrap() - 0.5;
    assert!((widened - (pin_mm - 12.0)).abs() < 1e-6, "{widened}");
}

/// Ⓜ decides as a gauge does: a pin of the virtual size at the true place enters, whatever offset and size add up to it.
#[test]
fn maximum_material_decides_as_a_gauge_does() {
    let features = [
        "[[feature]]\nkind = \"size\"\nname = \"d\"\nelement = \"journal\"\ntolerance_mm = [0.0, 0.1]\n"
            .to_owned(),
        limit("position", "place", "journal", "datums = \"seat\"\nmaximum_material = \"d\"")
            .replace("limit_mm = 0.5", "limit_mm = 0.04"),
    ];
    let plan = Plan::from_toml(&format!("{}\n{}", elements(true), features.concat())).unwrap();
    let mut noise = Noise(3);
    let (mut entered, mut stuck) = (0, 0);
    for _ in 0..40 {
        let part = Turned {
            hole: true,
            journal_off: [0.1 * noise.uniform() - 0.05, 0.1 * noise.uniform() - 0.05],
            journal_oversize: 0.1 * noise.uniform(),
            ..Turned::default()
        };
        let hole = part.journal();
        let gauge_mm = 12.0 - 0.04;
        let play = 2.0 * hole.iter().map(|p| place(p).xy().norm()).fold(f64::INFINITY, f64::min) - gauge_mm;
        // Points every 5° do not show the last micrometres of a pin.
        if play.abs() < 1e-3 {
            continue;
        }
        let found = evaluate(&plan, &[Turned::seat(), hole].concat()).features;
        let expected = if play > 0.0 { Verdict::Pass } else { Verdict::Fail };
        assert_eq!(found[1].verdict, Some(expected), "{part:?}: play {play}");
        *(if play > 0.0 { &mut entered } else { &mut stuck }) += 1;
    }
    assert!(entered > 8 && stuck > 8, "{entered} entered, {stuck} stuck");
}

/// A datum of one ring has no axis, a section of few points no range: both say so, and nothing passes.
#[test]
fn what_cannot_be_determined_has_a_reason() {
    let part = Turned::default();
    let features = [
        limit("total-runout", "total", "journal", "datums = \"seat\""),
        limit("coaxiality", "axis", "journal", "datums = \"seat\""),
        limit("circular-runout", "thin", "journal", "datums = \"seat\"\nsection_mm = 1e-6\nfilter_mm = 4.0"),
    ];
    let plan = Plan::from_toml(&format!("{}\n{}", elements(false), features.concat())).unwrap();
    let one_ring: Vec<Point> = rings(20..=20, |out, height| out * 10.0 + Vector3::z() * height, 1.0)
        .iter()
        .flat_map(|p| [*p, *p])
        .collect();
    let result = evaluate(&plan, &[one_ring, part.journal(), part.face()].concat());
    for feature in &result.features {
        let told = feature.reason.clone().unwrap_or_default();
        let wide = feature.u.is_some_and(|u| u > 1.0);
        assert!(told.contains("seat") || wide, "{feature:?}");
        assert_ne!(feature.verdict, Some(Verdict::Pass), "{feature:?}");
    }
    let found = results(&features, &part);
    assert!(value(&found, "total").abs() < 1e-9 && value(&found, "axis").abs() < 1e-9);
    assert!(found[2].reason.as_ref().unwrap().contains("no section with 12 values"), "{:?}", found[2]);
}

/// What a plan must not say of these characteristics.
#[test]
fn characteristics_of_the_wrong_element_are_refused() {
    let table: [(String, &str); 9] = [
        (limit("coaxiality", "f", "ball1", "datums = \"seat\""), "a sphere; name an axis"),
        (limit("concentricity", "f", "journal", "datums = \"seat\""), "a cylinder; name a centre"),
        (limit("symmetry", "f", "seat", "datums = \"body\""), "a cylinder; name a plane"),
        (limit("symmetry", "f", "groove", "datums = \"groove\""), "which is toleranced"),
        (limit("coaxiality", "f", "journal", ""), "datums"),
        (limit("total-runout", "f", "journal", "datums = \"face\""), "run-out needs one axis first"),
        (
            limit("total-runout", "f", "pitch", "datums = \"seat\""),
            "a circle; name a cylinder, cone or plane",
        ),
        (limit("line-profile", "f", "seat", ""), "a cylinder; name a line"),
        (
            size("size", "d", "element = \"seat\"", "")
                + &limit("position", "p", "journal", "datums = \"seat\"\nmaximum_material = \"d\""),
            "of element \"journal\" has this name",
        ),
    ];
    for (text, words) in table {
        let error = Plan::from_toml(&format!("{}\n{text}", elements(false))).expect_err(&text).to_string();
        assert!(error.contains(words) && !error.trim_end().contains("\n\n"), "{text}\n{error}");
    }
}

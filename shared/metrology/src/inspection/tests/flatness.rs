//! The filtered flatness: its value, what noise adds to it, and what is said of both.

use proptest::prelude::*;

use crate::fit::tests::Noise;
use crate::inspection::{FeatureResult, FlatnessFilter, Plan, evaluate};
use crate::verdict::Verdict;
use fringe::cloud::Point;

const HALF_MM: f64 = 50.0;
/// Where the grid of points begins: outside of the plate, and off the borders of the cells.
const START_MM: f64 = -51.01;
const SIGMA_MM: f64 = 0.027;

/// A plate of 100 mm: 40 × 40 whole cells of 2.5 mm.
fn plan(filter: &str) -> Plan {
    let text = format!(
        r#"
format = "fringecell-plan/1"
name = "plate"
[[element]]
kind = "plane"
name = "plate"
point_mm = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]
direction = [1.0, 0.0, 0.0]
size_mm = [100.0, 100.0]
margin_mm = 0.8
min_points = 100
max_reject_fraction = 0.003
[[feature]]
kind = "plane-flatness"
name = "flatness"
element = "plate"
limit_mm = 0.1
{filter}
"#
    );
    Plan::from_toml(&text).unwrap()
}

/// Two views of a surface z = form(x, y) on a grid of `pitch_mm`, neighbours along a row correlated by 0.45; the
/// second view ends at x = 20 mm, so a third of the plate has half of the points.
fn cloud(seed: u64, pitch_mm: f64, sigma_mm: f64, form: impl Fn(f64, f64) -> f64) -> Vec<Point> {
    let mut noise = Noise(seed.wrapping_mul(0x1234_5678_9ABC_DEF1));
    let steps = (-2.0 * START_MM / pitch_mm) as usize;
    let mut points = Vec::new();
    for (pair, shift_mm) in [0.0, 0.4 * pitch_mm].into_iter().enumerate() {
        for row in 0..steps {
            let mut previous = noise.normal();
            for column in 0..steps {
                let fresh = noise.normal();
                let error = (fresh + 0.63 * previous) / (1.0f64 + 0.63 * 0.63).sqrt() * sigma_mm;
                previous = fresh;
                let [x, y] = [column, row].map(|i| i as f64 * pitch_mm + START_MM + shift_mm);
                if pair == 1 && x > 20.0 {
                    continue;
                }
                points.push(Point {
                    position_mm: [x, y, form(x, y) + error],
                    normal: [0.0, 0.0, 1.0],
                    sigma_mm: sigma_mm as f32,
                    modulation: 80.0,
                    pair: pair as u32,
                    pixel: 0,
                    shared_mm: 0.0,
                });
            }
        }
    }
    points
}

fn measured(filter: &str, cloud: &[Point]) -> (FeatureResult, f64, f64) {
    let feature = evaluate(&plan(filter), cloud).features.remove(0);
    let (value, u) = (feature.value.unwrap(), feature.u_noise.unwrap());
    (feature, value, u)
}

fn filter(feature: &FeatureResult) -> &FlatnessFilter {
    feature.filter.as_ref().unwrap()
}

/// Proves: each feature has the plane and the filter that it names, and says why where there is none.
#[test]
fn every_flatness_has_its_own_plane_and_filter() {
    let step = |x: f64, _: f64| if x > 0.0 { 2.0 } else { 0.0 };
    let dish = |x: f64, y: f64| step(x, y) + if x > 0.0 { 4e-5 * y * y } else { 1e-5 * y * y };
    let points = cloud(5, 0.35, 0.005, dish);
    let element = |name: &str, x: f64, z: f64| {
        format!(
            "[[element]]\nkind = \"plane\"\nname = \"{name}\"\npoint_mm = [{x:?}, 0.0, {z:?}]\nnormal = [0.0, 0.0, 1.0]\n\
             direction = [1.0, 0.0, 0.0]\nsize_mm = [40.0, 90.0]\nmargin_mm = 0.8\nmin_points = 100\n\
             max_reject_fraction = 0.003\n"
        )
    };
    let feature = |name: &str, element: &str, filter: &str| {
        format!(
            "[[feature]]\nkind = \"plane-flatness\"\nname = \"{name}\"\nelement = \"{element}\"\nlimit_mm = 0.1\n{filter}\n"
        )
    };
    let elements = [element("low", -25.0, 0.0), element("high", 25.0, 2.0), element("none", 25.0, 9.0)];
    let features = [
        ("low", "filter_mm = 2.5"),
        ("high", "filter_mm = 2.5"),
        ("low", "filter_mm = 5.0"),
        ("low", ""),
        ("high", "filter_mm = 2.5"),
        ("high", "filter_mm = 60.0"),
        ("none", "filter_mm = 2.5"),
    ];
    let together = |chosen: &[usize]| {
        let wanted = chosen.iter().map(|i| feature(&format!("f{i}"), features[*i].0, features[*i].1));
        let text: String = elements.iter().cloned().chain(wanted).collect();
        let text = format!("format = \"fringecell-plan/1\"\nname = \"plates\"\n{text}");
        evaluate(&Plan::from_toml(&text).unwrap(), &points).features
    };
    let all = together(&[0, 1, 2, 3, 4, 5, 6]);
    for (number, found) in all.iter().enumerate() {
        assert_eq!(*found, together(&[number])[0], "{:?}", features[number]);
    }
    let value = |number: usize| all[number].value.expect("a flatness");
    assert!((value(0) - 0.02).abs() < 0.006 && (value(1) - 0.08).abs() < 0.01, "{} {}", value(0), value(1));
    assert!(value(3) > value(0) && value(0) != value(2) && value(1) == value(4));
    let reason = |number: usize| all[number].reason.clone().expect("a reason");
    assert!(reason(5).contains("60"), "{}", reason(5));
    assert!(reason(6).contains("none"), "{}", reason(6));
}

/// A perfect plane: the value is the noise of the means, which is stated. Over 60 planes the mean of a range that
/// scatters by a twelfth is known to 1 %; the noise taken from each plane and the correlation of a row over the border of
/// its cells leave 5 %.
#[test]
fn the_range_of_a_perfect_plane_is_the_stated_noise() {
    let (mut ratio, mut squares, mut raw) = (0.0, 0.0, 0.0);
    for seed in 0..60 {
        let (feature, value, u) = measured("filter_mm = 2.5", &cloud(seed, 0.35, SIGMA_MM, |_, _| 0.0));
        ratio += value / filter(&feature).noise_range_mm / 60.0;
        squares += (value / u).powi(2) / 60.0;
        raw += feature.form_range_mm.unwrap() / 60.0;
        assert_eq!(feature.verdict, Some(Verdict::Pass), "seed {seed}: {value} ± {u}");
        assert!((feature.form_sigma_mm.unwrap() / SIGMA_MM - 1.0).abs() < 0.03);
    }
    assert!((0.95..1.05).contains(&ratio), "value over expected noise: {ratio}");
    // The error of the value is the value itself; u has to cover it without being far larger.
    assert!((0.85..1.05).contains(&squares.sqrt()), "error over u: {}", squares.sqrt());
    // What the single points say of the same perfect planes: 6 sigma, more than the limit of 0.1 mm.
    assert!(raw > 5.5 * SIGMA_MM, "{raw}");
}

/// The expected range beside that of simulated independent means with the same numbers of points.
#[test]
fn the_expected_noise_range_is_that_of_simulated_means() {
    let (mut stated, mut found, mut u_cell) = (0.0, 0.0, 0.0);
    for seed in 0..40 {
        let mut noise = Noise(seed);
        let mut points = cloud(seed, 0.5, 0.0, |_, _| 0.0);
        for point in &mut points {
            point.position_mm[2] = SIGMA_MM * noise.normal();
        }
        let (feature, value, _) = measured("filter_mm = 2.0", &points);
        stated += filter(&feature).noise_range_mm / 40.0;
        u_cell += filter(&feature).u_cell_mm / 40.0;
        found += value / 40.0;
    }
    // 32 points a cell on 70 % of the plate, 16 on the rest.
    let expected = SIGMA_MM * (0.7f64 / 32.0 + 0.3 / 16.0).sqrt();
    assert!((u_cell / expected - 1.0).abs() < 0.02, "u of a cell {u_cell}, expected {expected}");
    assert!((found / stated - 1.0).abs() < 0.03, "{found} of {stated}");
}

/// A perfect plane of which one view is three times as noisy, as light and slope make it: the noise stated is the value where points
/// state their uncertainties, and too little where they do not. A wild uncertainty of a single point changes little.
#[test]
fn noisy_parts_of_a_plane_make_its_range() {
    let (mut with, mut without, mut wild) = (0.0, 0.0, 0.0);
    for seed in 0..30 {
        let mut points = cloud(seed, 0.35, SIGMA_MM, |_, _| 0.0);
        for point in points.iter_mut().filter(|p| p.position_mm[0] > 30.0) {
            point.position_mm[2] *= 3.0;
            point.sigma_mm *= 3.0;
        }
        let ratio = |points: &[Point]| {
            let (feature, value, _) = measured("filter_mm = 2.5", points);
            value / filter(&feature).noise_range_mm / 30.0
        };
        with += ratio(&points);
        points[40].sigma_mm = 1e3;
        wild += ratio(&points);
        for p in &mut points {
            p.sigma_mm = 0.0;
        }
        without += ratio(&points);
    }
    assert!((0.95..1.05).contains(&with), "{with}");
    assert!((wild / with - 1.0).abs() < 0.01, "{wild}");
    assert!(without > 1.2, "{without}");
}

/// Bows of known height: recovered within u each time, and never too small by more than the filter flattens.
#[test]
fn a_bow_is_recovered_within_its_uncertainty() {
    // z = a x² + b y² + c x y in units of the half width: trough, bowl, saddle.
    let truth = 0.05;
    for (name, [a, b, c]) in
        [("trough", [0.05, 0.0, 0.0]), ("bowl", [0.025, 0.025, 0.0]), ("saddle", [0.0, 0.0, 0.025])]
    {
        let bow = |x: f64, y: f64| (a * x * x + b * y * y + c * x * y) / (HALF_MM * HALF_MM);
        for seed in 0..12 {
            let (_, value, u) = measured("filter_mm = 2.5", &cloud(seed, 0.35, SIGMA_MM, bow));
            assert!((value - truth).abs() < u, "{name}, seed {seed}: {value} ± {u}");
        }
        // Without noise: too small by the flattening alone, half a cell of the slope at each extreme, though a third
        // of the plate has half of the points.
        let (feature, value, u) = measured("filter_mm = 2.5", &cloud(0, 0.35, 0.0, bow));
        assert!(value > truth - 0.005 && value < truth + 1e-4, "{name}: {value}");
        assert!(u < 0.002, "{name}: {u}, {:?}", feature.filter);
    }
}

/// A plate bent beyond its limit fails, in spite of noise and guard band.
#[test]
fn a_bent_plate_fails() {
    let (feature, value, u) = measured("filter_mm = 2.5", &cloud(3, 0.35, SIGMA_MM, |x, _| 8e-5 * x * x));
    assert_eq!(feature.verdict, Some(Verdict::Fail), "{value} ± {u}");
}

/// A dent of one cell stays, though the fit rejects its points.
#[test]
fn a_dent_is_not_rejected_away() {
    let dent = |x: f64, y: f64| if (0.0..2.5).contains(&x) && (0.0..2.5).contains(&y) { -0.3 } else { 0.0 };
    let (feature, value, _) = measured("filter_mm = 2.5", &cloud(1, 0.35, 0.01, dent));
    assert!(feature.rejected > 50 && feature.form_range_mm.unwrap() < 0.1, "{feature:?}");
    assert!((value - 0.3).abs() < 0.02, "{value}");
    assert_eq!(feature.verdict, Some(Verdict::Fail));
}

/// Without a filter the value is the range of the single points, as the element's fit has it.
#[test]
fn without_a_filter_the_range_is_that_of_the_points() {
    let points = cloud(7, 0.5, SIGMA_MM, |_, _| 0.0);
    let (off, value, _) = measured("", &points);
    assert_eq!((off.form_range_mm, off.filter.clone()), (Some(value), None));
    let (on, ..) = measured("filter_mm = 2.5", &points);
    assert_eq!((on.form_range_mm, on.form_sigma_mm), (off.form_range_mm, off.form_sigma_mm));
    assert!(on.value < off.value);
    let [off_detail, on_detail] = [&off, &on].map(|f| f.detail.clone().unwrap());
    for words in [
        "over squares of edge filter_mm",
        "filter_mm 2.5",
        "single points: range",
        "1600 squares, left out 0 with 0",
    ] {
        assert!(on_detail.contains(words), "{on_detail}");
    }
    assert!(off_detail.contains("unfiltered"), "{off_detail}");
    assert_eq!(off.verdict, Some(Verdict::Fail));
}

/// Cells of few points are left out and counted.
#[test]
fn thin_cells_are_left_out() {
    let mut points = cloud(2, 0.5, SIGMA_MM, |_, _| 0.0);
    // One cell keeps three points, a millimetre off.
    let inside =
        |p: &Point| (10.0..12.5).contains(&p.position_mm[0]) && (10.0..12.5).contains(&p.position_mm[1]);
    let mut seen = 0;
    points.retain(|p| {
        seen += usize::from(inside(p));
        !inside(p) || seen <= 3
    });
    points.iter_mut().filter(|p| inside(p)).for_each(|p| p.position_mm[2] = 0.5);
    let (feature, value, _) = measured("filter_mm = 2.5", &points);
    assert!(value < 0.1, "{value}");
    assert_eq!((filter(&feature).cells_left_out, filter(&feature).points_left_out), (1, 3));
    assert_eq!(filter(&feature).cells + 1, 1600);
}

/// Too large or too small a filter: no value, the reason with the numbers, and never a pass.
#[test]
fn a_filter_that_leaves_too_few_cells_says_so() {
    let points = cloud(2, 0.5, SIGMA_MM, |_, _| 0.0);
    for edge in ["30.0", "1e7", "0.01", "1e-300"] {
        let result = evaluate(&plan(&format!("filter_mm = {edge}")), &points);
        let feature = &result.features[0];
        assert_eq!((feature.value, feature.verdict), (None, None), "{edge}");
        let reason = feature.reason.as_ref().unwrap();
        assert!(reason.contains("filter_mm = ") && reason.contains("needs at least 16 blocks"), "{reason}");
        assert_ne!(result.verdict, Verdict::Pass);
    }
}

proptest! {
    // Each case filters three clouds.
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Nothing but the surface counts: a shift along the normal changes next to nothing, and a surface turned over
    /// has the same range.
    #[test]
    fn the_range_does_not_depend_on_place_or_side(seed in 0u64..1000, shift_mm in -0.2..0.2f64) {
        let points = cloud(seed, 1.0, SIGMA_MM, |x, y| 1e-5 * x * y);
        let (_, value, u) = measured("filter_mm = 5.0", &points);
        let changed = |f: &dyn Fn(f64) -> f64| {
            let mut other = points.clone();
            for point in &mut other {
                point.position_mm[2] = f(point.position_mm[2]);
            }
            measured("filter_mm = 5.0", &other)
        };
        for (_, same, same_u) in [changed(&|z| z + shift_mm), changed(&|z| -z)] {
            prop_assert!((same - value).abs() < 1e-9 && (same_u - u).abs() < 1e-9);
        }
    }
}

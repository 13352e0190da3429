//! What must not pass: each test was passed by an instrument, or by a plan, that must be refused.

use super::super::*;
use super::synthetic::*;
use crate::verdict::Verdict;
use fringe::cloud::Point;
use fringe::math;
use nalgebra::{Point3, Vector3};

/// From the name of a position, the number of a view and its points to the points that are evaluated instead.
pub(super) type Change<'a> = &'a dyn Fn(&str, usize, Vec<Point>) -> Vec<Point>;

/// A test of spheres and bars with clouds that a closure may change.
pub(super) fn evaluate_changed(
    text: &str,
    rules: &str,
    change: Change,
) -> Result<TestReport, AcceptanceError> {
    let plan = TestPlan::from_toml(text)?;
    let rules = RuleSet::from_toml(rules)?;
    let mut evaluator = Evaluator::new(&plan, &rules)?;
    let (mut balls, mut bars) = (0, 0);
    for position in &plan.positions {
        let clouds = if position.artefact == "ball" {
            balls += 1;
            views(PLACES[(balls - 1) % 3], 20.0, FORMS[(balls - 1) % 3])
        } else {
            bars += 1;
            vec![bar_at(AXES[(bars - 1) % 7], 150.0)]
        };
        let changed: Vec<Vec<Point>> =
            clouds.into_iter().enumerate().map(|(view, cloud)| change(&position.name, view, cloud)).collect();
        evaluator.add(position, &changed[..position.views.len()])?;
    }
    evaluator.finish(Vec::new(), Vec::new())
}

/// Forms of the spheres; no view of one has the form of a view of another.
pub(super) const FORMS: [f64; 3] = [0.001, 0.002_37, 0.003_37];

pub(super) fn message(result: Result<TestReport, AcceptanceError>) -> String {
    let text =
        result.map(|report| format!("{:?} {:?}", report.verdict, report.reduced)).unwrap_err().to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

pub(super) fn unchanged(_: &str, _: usize, cloud: Vec<Point>) -> Vec<Point> {
    cloud
}

pub(super) const LIMITS: &str = "PF_range = 1.6\nPS = 0.5\nSD = 0.5";

/// Moves a point along its direction from a centre.
fn outwards(p: &Point, centre: [f64; 3], by: f64) -> Point {
    let (at, centre) = (p.position(), Point3::from(centre));
    point(at + (at - centre).normalize() * by)
}

#[test]
fn points_off_a_sphere_are_neither_lost_nor_taken_for_another_form() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    assert_eq!(evaluate_changed(&text, PART_3, &unchanged).unwrap().verdict, Verdict::Pass);
    // A third of the points of one view lies 3 mm off: they were left out without being counted, and the test passed.
    let ghost = |name: &str, view: usize, cloud: Vec<Point>| -> Vec<Point> {
        let off = |(i, p): (usize, &Point)| {
            if name == "s1" && view == 2 && i % 3 == 0 { outwards(p, PLACES[1], 3.0) } else { *p }
        };
        cloud.iter().enumerate().map(off).collect()
    };
    let error = message(evaluate_changed(&text, PART_3, &ghost));
    assert!(
        error.contains("\"s1\"") && error.contains("points that count") && error.contains("margin_mm"),
        "{error}"
    );
    // Inside the sphere there is nothing but the sphere.
    let inside = |name: &str, _: usize, cloud: Vec<Point>| -> Vec<Point> {
        let off = |(i, p): (usize, &Point)| {
            if name == "s0" && i % 5 == 0 { outwards(p, PLACES[0], -6.0) } else { *p }
        };
        cloud.iter().enumerate().map(off).collect()
    };
    assert!(message(evaluate_changed(&text, PART_3, &inside)).contains("points that count"));
}

#[test]
fn a_form_beyond_the_margin_is_an_error_and_with_a_wider_margin_its_whole_range() {
    // A form error of 2.48 mm was reported as 1.196 mm and passed a limit of 1.6 mm.
    let bent = |name: &str, view: usize, cloud: Vec<Point>| {
        if name == "s0" { ball_seen(PLACES[0], 20.0, 1.24 - 0.01 * view as f64, view) } else { cloud }
    };
    for rules in [PART_3, ALL[3]] {
        let text = plan_text("", 3, 150.0, "allow_reduced = true").replace("vdi2634-3", "any");
        let error = message(evaluate_changed(&text, rules, &bent));
        assert!(error.contains("margin_mm") && error.contains("1.24"), "{error}");
    }
    let wide = plan_text(LIMITS, 3, 150.0, "") + "[segmentation]\nmargin_mm = 2.0\n";
    let report = evaluate_changed(&wide, PART_3, &bent).unwrap();
    assert!((one(&report, "PF_range").value - 2.48).abs() < 1e-6);
    assert_eq!(report.verdict, Verdict::Fail);
}

#[test]
fn points_are_removed_only_as_the_rule_allows_and_counted() {
    let text = plan_text(LIMITS, 3, 150.0, "").replace("reject_fraction = 0.0\n", "");
    let few = |share: usize| {
        move |name: &str, _: usize, cloud: Vec<Point>| -> Vec<Point> {
            let off = |(i, p): (usize, &Point)| {
                if name == "s2" && i % 100 < share { outwards(p, PLACES[2], 2.0) } else { *p }
            };
            cloud.iter().enumerate().map(off).collect()
        }
    };
    // Two in a hundred lie off, three may be left out; four in a hundred are one too many.
    let report = evaluate_changed(&text, PART_3, &few(2)).unwrap();
    let row = &one(&report, "PF_range").positions[2];
    assert_eq!((row.rejected, row.points), (300, 9700));
    assert!(message(evaluate_changed(&text, PART_3, &few(4))).contains("points that count"));
}

#[test]
fn what_the_plan_excludes_is_counted_and_only_what_it_names() {
    let stem = |name: &str, view: usize, mut cloud: Vec<Point>| {
        if name == "s0" && view == 0 {
            let [x, y, z] = PLACES[0];
            cloud.extend((0..300).map(|i| {
                let (sin, cos) = math::sincos(0.7 * f64::from(i));
                point(Point3::new(x + 2.0 * cos, y + 2.0 * sin, z - 10.0 - 0.02 * f64::from(i)))
            }));
        }
        cloud
    };
    let text = plan_text(LIMITS, 3, 150.0, "");
    assert!(message(evaluate_changed(&text, PART_3, &stem)).contains("exclude_mm"));
    let named = text.replacen(
        "cloud = \"s0v0.ply\"",
        "cloud = \"s0v0.ply\"\nexclude_mm = [[1.0, 2.0, -10.0, 4.5]]",
        1,
    );
    let report = evaluate_changed(&named, PART_3, &stem).unwrap();
    let excluded = one(&report, "PS").positions[0].excluded;
    assert!((300..420).contains(&excluded), "{excluded}");
    assert!(
        report.conditions.iter().any(|(_, text)| text.contains(&format!("{excluded} excluded by the plan")))
    );
}

#[test]
fn an_uncertainty_is_written_and_zero_has_a_reason() {
    let good = plan_text("", 3, 150.0, "");
    for (from, to, words) in [
        ("u_diameter_mm = 0.001\n", "", ["\"ball\"", "u_diameter_mm is missing: write u_diameter_mm = "]),
        ("u_spacing_mm = 0.001\n", "", ["\"bar\"", "u_spacing_mm is missing: write u_spacing_mm = "]),
        (
            "certificate = \"C1\"\ncertificate_date = \"2026-01-01\"\ncertificate_valid_until = \"2026-12-31\"\nzero_reason = \"synthetic\"",
            "certificate = \"C1\"",
            ["\"ball\"", "u_form_mm = 0"],
        ),
        (
            "u_temperature_k = 0.0\nzero_reason = \"synthetic\"",
            "u_temperature_k = 0.0\nzero_reason = \" \"",
            ["conditions", "zero_reason"],
        ),
    ] {
        assert!(good.contains(from), "{from}");
        let error = TestPlan::from_toml(&good.replacen(from, to, 1)).map(|_| ()).unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    }
    let report = evaluate(&good, &SPHERES, &BARS).unwrap();
    assert!(report.artefacts[0].validity.contains("uncertainty 0: synthetic"), "{:?}", report.artefacts[0]);
}

#[test]
fn one_measurement_counts_once() {
    let text = plan_text(LIMITS, 3, 150.0, "allow_reduced = true");
    // The same points, in another order.
    let copied = |name: &str, _: usize, cloud: Vec<Point>| {
        if name.starts_with('b') { bar_at(AXES[0], 150.0).into_iter().rev().collect() } else { cloud }
    };
    let error = message(evaluate_changed(&text, PART_3, &copied));
    assert!(error.contains("\"b1\"") && error.contains("\"b0\"") && error.contains("twice"), "{error}");
    // The same measurement, carried to another place.
    let moved = |name: &str, view: usize, cloud: Vec<Point>| {
        if name == "s1" { ball_seen(PLACES[1], 20.0, 0.001 * (1.0 - 0.1 * view as f64), view) } else { cloud }
    };
    let error = message(evaluate_changed(&text, PART_3, &moved));
    assert!(error.contains("\"s1\"") && error.contains("residuals"), "{error}");
}

#[test]
fn artefacts_stand_apart_in_the_volume_and_in_every_direction_of_it() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let alike = |name: &str, _: usize, cloud: Vec<Point>| {
        let step = name[1..].parse::<f64>().unwrap_or(0.0);
        if name.starts_with('b') { bar_at([45.0 + 0.01 * step, 0.0], 150.0) } else { cloud }
    };
    let error = message(evaluate_changed(&text, PART_3, &alike));
    for words in
        ["distance of two ball bar positions", "directions of the ball bar", "extent of the ball bar"]
    {
        assert!(error.contains(words), "{words}: {error}");
    }
    let away = |name: &str, _: usize, cloud: Vec<Point>| -> Vec<Point> {
        let by = if name.starts_with('s') { 2000.0 } else { 0.0 };
        cloud.iter().map(|p| point(p.position() + Vector3::new(by, 0.0, 0.0))).collect()
    };
    let error = message(evaluate_changed(&text, PART_3, &away));
    assert!(
        error.contains("position s0 lies 2001.000 mm from center_mm along x, at most 70.000 mm"),
        "{error}"
    );
    // Two spheres that are not those of the bar.
    let other = |name: &str, _: usize, cloud: Vec<Point>| {
        if name == "b2" { bar_at(AXES[2], 2000.0) } else { cloud }
    };
    let error = message(evaluate_changed(&text, PART_3, &other));
    assert!(error.contains("not the spheres of this bar"), "{error}");
    let unknown = text.replace("center_mm = [0.0, 0.0, 0.0]\n", "");
    assert!(message(evaluate(&unknown, &SPHERES, &BARS)).contains("write center_mm = [x, y, z]"));
    let large = text.replace("sensor_mm = [140.0, 140.0, 90.0]", "sensor_mm = [140.0, 91.0, 141.0]");
    assert!(message(evaluate(&large, &SPHERES, &BARS)).contains("does not fit into total_mm"));
}

#[test]
fn a_narrow_cap_does_not_pass_part_2() {
    let mut text = plan_text("PF_range = 0.1\nPS = 5.0\nSD = 0.5", 0, 150.0, "allow_reduced = true");
    text = text.replace("vdi2634-3", "vdi2634-2");
    let plan = TestPlan::from_toml(&text).unwrap();
    let rules = RuleSet::from_toml(ALL[1]).unwrap();
    let cap = |degrees: f64| {
        let mut evaluator = Evaluator::new(&plan, &rules).unwrap();
        let low = math::cos(degrees.to_radians());
        let mut cloud = Vec::new();
        for i in 0..3000 {
            let z = low + (1.0 - low) * (f64::from(i) + 0.5) / 3000.0;
            let (sin, cos) = math::sincos(2.399_963 * f64::from(i));
            let ring = (1.0 - z * z).sqrt();
            let wave = 0.001 * math::sin(f64::from(i));
            for x in [-75.0, 75.0] {
                // The left one shows other points than the right one.
                let (sin, cos) = if x < 0.0 {
                    math::sincos(2.399_963 * f64::from(i) + 0.05 * math::sin(7.0 * f64::from(i)))
                } else {
                    (sin, cos)
                };
                let out = Vector3::new(ring * cos, ring * sin, z) * (10.0 + wave);
                cloud.push(point(Point3::new(x, 0.0, 0.0) + out));
            }
        }
        evaluator.add(&plan.positions[0], &[cloud]).unwrap();
        let report = evaluator.finish(Vec::new(), Vec::new()).unwrap();
        report.reduced.iter().filter(|v| v.rule.contains("points cover")).count()
    };
    assert_eq!((cap(15.0), cap(60.0)), (2, 0), "both spheres of the bar");
}

#[test]
fn a_verdict_without_reduced_names_who_what_when_and_how_with_valid_certificates() {
    let good = plan_text(LIMITS, 3, 150.0, "");
    for (from, to, words) in [
        ("instrument = \"maker, type, 1\"\n", "", "instrument is missing"),
        ("operator = \"test\"", "operator = \" \"", "operator is missing"),
        ("operating_mode = \"synthetic\"\n", "", "operating_mode is missing"),
        ("date = \"2026-11-20\"", "date = \"soon\"", "\"soon\" is no day"),
        (
            "date = \"2026-11-20\"",
            "date = \"2027-02-01\"",
            "\"ball\": the certificate C1 is valid from 2026-01-01 until",
        ),
        ("certificate_valid_until = \"2026-12-31\"\n", "", "certificate_valid_until is missing"),
    ] {
        assert!(good.contains(from), "{from}");
        let text = good.replacen(from, to, 1);
        let error = message(evaluate(&text, &SPHERES, &BARS));
        assert!(error.contains(words), "{words}: {error}");
        let reduced = text.replacen("reject_fraction", "allow_reduced = true\nreject_fraction", 1);
        assert!(!evaluate(&reduced, &SPHERES, &BARS).unwrap().reduced.is_empty(), "{words}");
    }
}

#[test]
fn an_artefact_is_better_than_the_limit_that_it_tests() {
    // Form 2 µm over 9 µm; U of a spacing 2 µm over 5 µm.
    let form = plan_text("PF_range = 0.009\nPS = 0.05\nSD = 0.05", 3, 150.0, "");
    assert!(
        message(evaluate(&form, &SPHERES, &BARS))
            .contains("form deviation of the sphere, by its certificate")
    );
    let spacing = plan_text("PF_range = 0.1\nPS = 0.05\nSD = 0.005", 3, 150.0, "");
    assert!(
        message(evaluate(&spacing, &SPHERES, &BARS))
            .contains("expanded uncertainty of a test value of the ball bar")
    );
}

#[test]
fn a_retest_takes_the_place_of_a_value_only_by_a_rule() {
    let again = "[[position]]\nname = \"b4\"\nartefact = \"bar\"\nrepeat = 2\nretest = true\n\
                 [[position.view]]\nname = \"v\"\ncloud = \"again.ply\"\n";
    let text = plan_text("PF_range = 0.1\nPS = 0.05\nSD = 0.03", 3, 150.0, "") + again;
    let bars = [BARS.to_vec(), vec![0.003]].concat();
    let evaluate = |rules: &str| -> Result<TestReport, AcceptanceError> {
        let (plan, rules) = (TestPlan::from_toml(&text)?, RuleSet::from_toml(rules)?);
        let mut evaluator = Evaluator::new(&plan, &rules)?;
        for (index, position) in plan.positions.iter().enumerate() {
            let clouds = match index {
                0..3 => views(PLACES[index], 20.0, FORMS[index]),
                _ => vec![bar_at(AXES[[0, 1, 2, 3, 4, 5, 6, 4][index - 3]], 150.0 + bars[index - 3])],
            };
            evaluator.add(position, &clouds)?;
        }
        evaluator.finish(Vec::new(), Vec::new())
    };
    assert!(message(evaluate(PART_3)).contains("has no [retest]"));
    let retest = |count: usize| {
        let rule = format!(
            "[retest]\nmost_positions = 1\nmeasurements = {count}\nstatus = \"assumed\"\nsource = \"agreed\"\n\n[[rule]]"
        );
        PART_3.replacen("[[rule]]", &rule, 1)
    };
    assert!(message(evaluate(&retest(3))).contains("the rule set asks for 3"));
    let report = evaluate(&retest(1)).unwrap();
    let sd = one(&report, "SD");
    assert_eq!((sd.verdict, report.verdict), (Some(Verdict::Pass), Verdict::Pass));
    let old = &sd.positions[4];
    assert!(old.replaced && old.verdict == Some(Verdict::Fail) && (old.value + 0.04).abs() < 1e-9, "{old:?}");
    assert!(report.rule_set.assumed.iter().any(|text| text.contains("retest")));
}

#[test]
fn each_row_has_its_own_uncertainty_and_verdict() {
    let limits = "PF_range = 0.1\nPS = 0.05\nSD = 0.0405";
    let report = evaluate(&plan_text(limits, 3, 150.0, ""), &SPHERES, &BARS).unwrap();
    let sd = one(&report, "SD");
    assert_eq!(report.guard_factor, 1.65);
    assert_eq!(sd.positions[4].verdict, Some(Verdict::Indeterminate));
    assert!(sd.positions.iter().enumerate().all(|(i, p)| i == 4 || p.verdict == Some(Verdict::Pass)));
    assert!(sd.positions.iter().all(|p| p.test_value_u == sd.test_value_u));
    assert_eq!(one(&report, "PF_sigma").positions[0].verdict, None);
}

/// Caps of 95° that look along −x: the pole of the pattern was +z, where they show nothing.
#[test]
fn the_pattern_of_25_points_follows_the_line_of_sight() {
    let text = plan_text("", 3, 150.0, "allow_reduced = true").replace("vdi2634-3", "iso10360-13");
    let plan = TestPlan::from_toml(&text).unwrap();
    let rules = RuleSet::from_toml(ALL[3]).unwrap();
    for axis in [Vector3::x(), Vector3::new(0.6, -0.8, 0.0), -Vector3::z(), Vector3::z()] {
        let mut evaluator = Evaluator::new(&plan, &rules).unwrap();
        let seen = |cloud: Vec<Point>| -> Vec<Point> {
            let facing = |p: &Point| p.position().coords.dot(&axis) > -0.9;
            cloud.into_iter().filter(facing).collect()
        };
        let clouds: Vec<Vec<Point>> = views([0.0; 3], 20.05, 0.0).into_iter().map(seen).collect();
        evaluator.add(&plan.positions[0], &clouds).unwrap();
        let report = evaluator.finish(Vec::new(), Vec::new()).unwrap();
        assert!((one(&report, "P_Size.Sph.1x25").value - 0.05).abs() < 1e-9);
    }
}

#[test]
fn part_13_decides_by_flat_form_and_by_lengths_in_the_concatenated_volume() {
    let rules = RuleSet::from_toml(ALL[3]).unwrap();
    let decides = |symbol: &str| rules.characteristics.iter().any(|c| c.symbol == symbol && c.decides);
    assert!(decides("E_Form.Pla.D95%") && decides("E_Vol") && rules.reject_fraction.most == 0.0);
    // Without a plate the test is no full one.
    let error = message(evaluate_changed(&plan_text("", 3, 150.0, ""), ALL[3], &unchanged));
    assert!(error.contains("plane positions"), "{error}");
    // Both spheres 10 µm too large, their centres 5 µm too far apart: 15 µm.
    let larger = |name: &str, _: usize, cloud: Vec<Point>| {
        if !name.starts_with('b') {
            return cloud;
        }
        let index = name[1..].parse::<usize>().unwrap();
        let mut cloud = bar_at(AXES[index], 150.005);
        let middle = |half: &[Point]| {
            let sum: Vector3<f64> = half.iter().map(|p| p.position().coords).sum();
            (sum / half.len() as f64).into()
        };
        let half = cloud.len() / 2;
        for part in [0..half, half..2 * half] {
            let centre = middle(&cloud[part.clone()]);
            cloud[part].iter_mut().for_each(|p| *p = outwards(p, centre, 0.005));
        }
        cloud
    };
    let report = evaluate_changed(&plan_text("", 3, 150.0, "allow_reduced = true"), ALL[3], &larger).unwrap();
    assert!((one(&report, "E_Vol").value - 0.015).abs() < 1e-9, "{}", one(&report, "E_Vol").value);
    assert!((one(&report, "E_Vol").positions[0].length_mm.unwrap() - 170.0).abs() < 1e-12);
}

/// Scatter that is rounding is not stated as 1e-8 mm.
#[test]
fn what_is_not_determined_is_absent() {
    let report =
        evaluate(&plan_text("", 3, 150.0, ""), &[(0.01, 0.004), (0.01, 0.02), (0.01, 0.001)], &[0.0; 7]);
    let report = report.unwrap();
    assert_eq!((one(&report, "SD").between_positions, one(&report, "PS").between_positions), (None, None));
    assert!(one(&report, "PF_range").between_positions.is_some());
}

//! Tests that somebody wants to pass: measurements copied, doubled or computed, points excluded, uncertainties and guard bands
//! made small.

use super::super::*;
use super::refused::{FORMS, LIMITS, evaluate_changed, message, unchanged};
use super::synthetic::*;
use crate::verdict::Verdict;
use fringe::cloud::Point;
use fringe::math::random::Key;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

/// A bar as it is measured: points at random, no two neighbourhoods alike.
fn seen_bar(axis: [f64; 2]) -> Vec<Point> {
    let key = Key::new(41);
    let jitter = |(i, p): (usize, Point)| {
        let by = Vector3::from_fn(|k, _| 0.002 * key.symmetric(3 * i as u64 + k as u64));
        point(p.position() + by)
    };
    bar_at(axis, 150.0).into_iter().enumerate().map(jitter).collect()
}

/// A measurement at another place, with new angles, another order, some points changed and some left out.
#[test]
fn a_copy_in_disguise_counts_once() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    let disguised = |mirror: bool| {
        move |name: &str, _: usize, cloud: Vec<Point>| -> Vec<Point> {
            if name == "b0" {
                return seen_bar(AXES[0]);
            } else if name != "b1" {
                return cloud;
            }
            let motion = Isometry3::from_parts(Vector3::new(0.1, 0.2, 0.3).into(), turn);
            let one = |(i, p): (usize, Point)| {
                let [x, y, z] = p.position_mm;
                let at = motion * Point3::new(if mirror { -x } else { x }, y, z);
                let away = if i % 40 == 0 { 0.002 } else { 0.0 };
                point(Point3::new(at.x, at.y, at.z + away))
            };
            let kept = seen_bar(AXES[0]).into_iter().enumerate().filter(|(i, _)| i % 11 != 5);
            kept.map(one).rev().collect()
        }
    };
    for mirror in [false, true] {
        let error = message(evaluate_changed(&text, PART_3, &disguised(mirror)));
        for words in ["\"b1\"", "\"b0\"", "in common with", "must not count twice"] {
            assert!(error.contains(words), "{words}: {error}");
        }
    }
}

/// Good points that are there twice make the share of bad ones small enough to be left out.
#[test]
fn points_count_once() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let doubled = |name: &str, view: usize, mut cloud: Vec<Point>| {
        if name == "s1" && view == 1 {
            cloud.extend_from_within(..cloud.len() / 2);
        }
        cloud
    };
    let error = message(evaluate_changed(&text, PART_3, &doubled));
    assert!(error.contains("\"s1\"") && error.contains("lie on another one to the last digit"), "{error}");
}

#[test]
fn computed_points_are_no_measurement() {
    let text = plan_text(LIMITS, 3, 150.0, "").replace("simulated = true\n", "");
    let error = message(evaluate_changed(&text, PART_3, &unchanged));
    assert!(error.contains("perfect element") && error.contains("write simulated = true"), "{error}");
    let simulated = evaluate_changed(&plan_text(LIMITS, 3, 150.0, ""), PART_3, &unchanged).unwrap();
    assert!(simulated.simulated);
}

/// A ball of excluded points where the errors are, or a rod as thick as the sphere.
#[test]
fn what_is_excluded_is_a_small_part_of_the_surface() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let ball = text.replacen(
        "cloud = \"s0v0.ply\"",
        "cloud = \"s0v0.ply\"\nexclude_mm = [[1.0, 2.0, 13.0, 12.0]]",
        1,
    );
    let rod = text.replacen("spacings_mm =", "rod_diameter_mm = 18.0\nspacings_mm =", 1);
    for changed in [ball, rod] {
        let error = message(evaluate_changed(&changed, PART_3, &unchanged));
        assert!(error.contains("points on its surface that the plan excludes"), "{error}");
        assert!(error.contains("at most 15.0 %"), "{error}");
    }
    // A rod of a third of the diameter is one.
    let rod = text.replacen("spacings_mm =", "rod_diameter_mm = 6.0\nspacings_mm =", 1);
    assert!(evaluate_changed(&rod, PART_3, &unchanged).unwrap().reduced.is_empty());
}

/// What is as good as 0 is 0, and an artefact without form deviation is none that a laboratory has seen.
#[test]
fn an_uncertainty_that_no_laboratory_reaches_needs_a_reason() {
    let good = plan_text("", 3, 150.0, "");
    let certificate = "certificate = \"C1\"\ncertificate_date = \"2026-01-01\"\n\
                       certificate_valid_until = \"2026-12-31\"\nzero_reason = \"synthetic\"\n";
    assert!(good.contains(certificate));
    let bare = good.replacen(certificate, "certificate = \"C1\"\n", 1);
    let bare = bare.replacen("u_form_mm = 0.0\n", "u_form_mm = 0.0003\n", 1);
    let bare = bare.replacen("u_expansion_per_k = 0.0\n", "u_expansion_per_k = 1e-7\n", 1);
    assert!(TestPlan::from_toml(&bare).is_ok());
    for (from, to, words) in [
        ("u_diameter_mm = 0.001", "u_diameter_mm = 1e-9", "u_diameter_mm = 0.000000001 is less than any"),
        ("form_mm = 0.002", "form_mm = 0.0", "form_mm = 0 states that there is none"),
        ("u_expansion_per_k = 1e-7", "u_expansion_per_k = 1e-20", "u_expansion_per_k"),
        ("u_form_mm = 0.0003", "u_form_mm = 1e-12", "u_form_mm"),
    ] {
        assert!(bare.contains(from), "{from}");
        let error = TestPlan::from_toml(&bare.replacen(from, to, 1)).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("zero_reason"), "{error}");
    }
    let cold =
        good.replacen("u_temperature_k = 0.0\nzero_reason = \"synthetic\"", "u_temperature_k = 1e-9", 1);
    let error = TestPlan::from_toml(&cold).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("u_temperature_k") && error.contains("zero_reason"), "{error}");
}

#[test]
fn a_guard_band_is_one_or_agreed_to_be_none() {
    let with = |text: &str| plan_text(&format!("{LIMITS}\n[decision]\n{text}"), 3, 150.0, "");
    let error = message(evaluate_changed(&with("guard_factor = 0.01"), PART_3, &unchanged));
    assert!(error.contains("guard factor: 0.01, at least 1.64") && error.contains("simple"), "{error}");
    for agreed in ["rule = \"simple\"", "guard_factor = 2.0"] {
        assert!(evaluate_changed(&with(agreed), PART_3, &unchanged).unwrap().reduced.is_empty());
    }
}

#[test]
fn what_was_left_out_of_a_cloud_before_is_stated() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let silent = text.replace("cloud_filters = \"none\"\n", "");
    let error = message(evaluate_changed(&silent, PART_3, &unchanged));
    assert!(error.contains("cloud_filters is missing"), "{error}");
    let report = evaluate_changed(&text, PART_3, &unchanged).unwrap();
    let stated = ("left out of the clouds before this test".to_owned(), "none".to_owned());
    assert!(report.conditions.contains(&stated), "{:?}", report.conditions);
}

/// A repeat, and so a retest, of a position that was hard, at a place that is easier.
#[test]
fn a_repeat_stands_where_its_position_stands() {
    let again = "[[position]]\nname = \"b4\"\nartefact = \"bar\"\nrepeat = 2\n\
                 [[position.view]]\nname = \"v\"\ncloud = \"again.ply\"\n";
    let text = plan_text(LIMITS, 3, 150.0, "") + again;
    let at = |axis: [f64; 2]| {
        let (plan, rules) = (TestPlan::from_toml(&text).unwrap(), RuleSet::from_toml(PART_3).unwrap());
        let mut evaluator = Evaluator::new(&plan, &rules).unwrap();
        for (index, position) in plan.positions.iter().enumerate() {
            let clouds = match index {
                0..3 => views(PLACES[index], 20.0, FORMS[index]),
                10 => vec![bar_at(axis, 150.001)],
                _ => vec![bar_at(AXES[index - 3], 150.0)],
            };
            evaluator.add(position, &clouds).unwrap();
        }
        evaluator.finish(Vec::new(), Vec::new())
    };
    assert!(at(AXES[4]).unwrap().reduced.is_empty());
    let error = message(at([10.0, 30.0]));
    assert!(error.contains("a repeat of position b4 lies"), "{error}");
}

/// A row without uncertainty was decided with a guard band of zero.
#[test]
fn a_value_without_uncertainty_proves_nothing() {
    let mut report = evaluate_changed(&plan_text(LIMITS, 3, 150.0, ""), PART_3, &unchanged).unwrap();
    let one = report.characteristics.iter_mut().find(|c| c.symbol == "SD").unwrap();
    assert_eq!(one.verdict_at(&one.positions[0], 1.65), Some(Verdict::Pass));
    one.test_value_u = None;
    one.positions[0].test_value_u = None;
    assert_eq!(one.verdict_at(&one.positions[0], 1.65), Some(Verdict::Indeterminate));
}

/// An instrument that is off by half a millimetre, and a bar that is said to be so warm that it is as much longer.
#[test]
fn a_warm_bar_does_not_explain_an_error() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let at = text.find("id = \"bar\"").unwrap();
    let (before, bar) = text.split_at(at);
    let warm = |alpha: &str| {
        let bar = bar.replacen("expansion_per_k = 0.0", &format!("expansion_per_k = {alpha}"), 1);
        format!("{before}{bar}").replacen("temperature_c = 20.0", "temperature_c = 40.0", 1)
    };
    let error = message(evaluate_changed(&warm("2e-4"), PART_3, &unchanged));
    assert!(
        error.contains("bar are corrected by up to 0.6000 mm from 20 °C to 40 °C, at most 0.5000"),
        "{error}"
    );
    // Steel by 20 K: 34 µm, far within a limit of half a millimetre.
    assert!(evaluate_changed(&warm("1.15e-5"), PART_3, &unchanged).unwrap().reduced.is_empty());
}

/// Each position with a bar of its own, whose certificate says what was measured.
#[test]
fn an_error_is_not_shared_out_among_bars() {
    let text = plan_text(LIMITS, 3, 150.0, "");
    let start = text.rfind("[[artefact]]").unwrap();
    let end = text.find("[[position]]").unwrap();
    let second = |length: &str| {
        let bar = text[start..end].replacen("id = \"bar\"", "id = \"bar2\"", 1).replacen(
            "spacings_mm = [150.0]",
            &format!("spacings_mm = [{length}]"),
            1,
        );
        let positions = text[end..].replacen(
            "name = \"b3\"\nartefact = \"bar\"",
            "name = \"b3\"\nartefact = \"bar2\"",
            1,
        );
        format!("{}{bar}{positions}", &text[..end])
    };
    let error = message(evaluate_changed(&second("150.4"), PART_3, &unchanged));
    assert!(error.contains("bar and bar2 have nearly one length, 150 mm and 150.4 mm"), "{error}");
}

/// A gap so small that points off the sphere count as other bodies.
#[test]
fn a_small_gap_loses_no_points() {
    let text = plan_text(LIMITS, 3, 150.0, "[segmentation]\ngap_mm = 0.05\n");
    let off = |name: &str, view: usize, mut cloud: Vec<Point>| {
        if name == "s1" && view == 1 {
            let middle = Point3::from(PLACES[1]);
            for p in cloud.iter_mut().step_by(10) {
                *p = point(middle + (p.position() - middle).normalize() * 13.0);
            }
        }
        cloud
    };
    let told = match evaluate_changed(&text, PART_3, &off) {
        Ok(report) => format!("{:?}", report.verdict),
        Err(error) => error.to_string(),
    };
    assert!(!told.contains("Pass"), "{told}");
}

/// A limit that is left out decides nothing, and a test without it proves nothing about what it limits.
#[test]
fn a_missing_limit_is_no_verdict() {
    let text = plan_text("PF_range = 1.6\nPS = 0.5", 3, 150.0, "");
    match evaluate_changed(&text, PART_3, &unchanged) {
        Ok(report) => assert_ne!(report.verdict, Verdict::Pass, "{:?}", report.reduced),
        Err(error) => assert!(error.to_string().contains("SD"), "{error}"),
    }
}

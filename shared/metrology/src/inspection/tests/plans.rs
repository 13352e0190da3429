//! Plans that are refused, with the words that the message must hold.

use crate::inspection::{Plan, Quantity};

const SMALL: &str = r#"
format = "fringecell-plan/1"
name = "small"
[alignment]
plane = "table"
line = ["a", "b"]
origin = "a"
search_mm = 5.0
search_deg = 4.0
[[element]]
kind = "plane"
name = "table"
point_mm = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 2.0]
size_mm = [100.0, 50.0]
exclude = [{ center_mm = [10.0, 0.0, 0.0], radius_mm = 5.0 }]
margin_mm = 1.0
min_points = 100
[[element]]
kind = "sphere"
name = "a"
center_mm = [0.0, 0.0, 20.0]
diameter_mm = 20.0
margin_mm = 1.0
min_points = 100
[[element]]
kind = "sphere"
name = "b"
center_mm = [60.0, 0.0, 20.0]
diameter_mm = 20.0
margin_mm = 1.0
min_points = 100
[[feature]]
kind = "centre-distance"
name = "spacing"
elements = ["a", "b"]
nominal_mm = 60.0
tolerance_mm = [-0.1, 0.2]
"#;

/// A flatness before the first feature.
fn flatness(filter_mm: f64) -> String {
    let edge = if filter_mm.is_nan() { "nan".into() } else { format!("{filter_mm:?}") };
    format!(
        "[[feature]]\nkind = \"plane-flatness\"\nname = \"flat\"\nelement = \"table\"\nlimit_mm = 0.1\n\
         filter_mm = {edge}\n[[feature]]"
    )
}

#[test]
fn a_plan_becomes_limits_and_indices() {
    let plan = Plan::from_toml(SMALL).unwrap();
    let feature = &plan.features[0];
    assert_eq!((feature.lower, feature.upper, feature.u_system), (59.9, 60.2, 0.0));
    assert_eq!(feature.quantity, Quantity::CentreDistance([1, 2]));
    assert_eq!(plan.settings.guard_factor, 1.65);
}

#[test]
fn a_value_between_an_element_and_itself_and_names_that_hide_something_are_refused() {
    for (from, to, words) in [
        ("elements = [\"a\", \"b\"]", "elements = [\"a\", \"a\"]", "names \"a\" twice"),
        ("name = \"small\"", "name = \"sm\\u001ball\"", "do not print"),
        ("name = \"spacing\"", "name = \"spa\\u202ecing\"", "do not print"),
    ] {
        let error = Plan::from_toml(&SMALL.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn wrong_plans_are_refused_with_place_key_and_limit() {
    let table: [(&str, &str, &[&str]); 24] = [
        (
            "format = \"fringecell-plan/1\"",
            "format = \"fringecell-plan/2\"",
            &["fringecell-plan/2", "fringecell-plan/1"],
        ),
        ("format = \"fringecell-plan/1\"", "", &["format"]),
        ("name = \"small\"", "name = \"small\"\ncolour = \"red\"", &["colour", "unknown field"]),
        ("diameter_mm = 20.0", "diameter_mm = 20.0\nradius_mm = 10.0", &["radius_mm"]),
        ("diameter_mm = 20.0", "diameter_mm = -20.0", &["element \"a\"", "diameter_mm = -20"]),
        ("diameter_mm = 20.0", "diameter_mm = nan", &["element \"a\"", "diameter_mm = NaN"]),
        (
            "center_mm = [60.0, 0.0, 20.0]",
            "center_mm = [inf, 0.0, 20.0]",
            &["element \"b\"", "center_mm = inf"],
        ),
        ("center_mm = [60.0, 0.0, 20.0]", "center_mm = [0.0, 0.0, 70.0]", &["alignment", "normal"]),
        ("normal = [0.0, 0.0, 2.0]", "normal = [0.0, 0.0, 0.0]", &["element \"table\"", "normal = 0"]),
        (
            "size_mm = [100.0, 50.0]",
            "size_mm = [100.0, 50.0]\ninset_mm = 25.0",
            &["element \"table\"", "inset_mm"],
        ),
        (
            "size_mm = [100.0, 50.0]",
            "size_mm = [100.0, 50.0]\ndirection = [0.0, 0.0, 1.0]",
            &["direction = 0"],
        ),
        (
            "radius_mm = 5.0",
            "radius_mm = 5.0, size_mm = [1.0, 1.0]",
            &["element \"table\"", "either radius_mm or size_mm"],
        ),
        ("kind = \"sphere\"", "kind = \"pyramid\"", &["pyramid"]),
        ("min_points = 100", "min_points = 3", &["min_points = 3", "10"]),
        ("min_points = 100", "min_points = -3", &["-3"]),
        ("name = \"b\"", "name = \"a\"", &["element name \"a\"", "twice"]),
        ("elements = [\"a\", \"b\"]", "elements = [\"a\", \"c\"]", &["feature \"spacing\"", "\"c\"", "a, b"]),
        (
            "elements = [\"a\", \"b\"]",
            "elements = [\"a\", \"table\"]",
            &["feature \"spacing\"", "sphere elements", "a, b"],
        ),
        ("plane = \"table\"", "plane = \"a\"", &["alignment", "plane elements are: table"]),
        ("tolerance_mm = [-0.1, 0.2]", "tolerance_mm = [0.2, -0.1]", &["feature \"spacing\"", "tolerance"]),
        ("search_deg = 4.0", "search_deg = 400.0", &["alignment", "search_deg = 400"]),
        ("[[feature]]", "[[element]]", &["centre-distance"]),
        ("[[feature]]", &flatness(0.0), &["feature \"flat\"", "filter_mm = 0"]),
        ("[[feature]]", &flatness(f64::NAN), &["feature \"flat\"", "filter_mm = NaN"]),
    ];
    for (good, bad, words) in table {
        assert!(SMALL.contains(good), "{good}");
        let message = Plan::from_toml(&SMALL.replacen(good, bad, 1)).expect_err(bad).to_string();
        for word in words {
            assert!(message.contains(word), "{bad}: {message}");
        }
    }
    let headless = SMALL.split("[[feature]]").next().unwrap();
    assert!(Plan::from_toml(headless).unwrap_err().to_string().contains("[[feature]]"));
}

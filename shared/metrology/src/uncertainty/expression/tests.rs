//! Formulas against the same formulas in Rust; derivatives against closed forms and central differences.

use super::*;
use crate::uncertainty::Dual;
use proptest::prelude::*;

fn value(text: &str) -> f64 {
    let names = ["x", "y"];
    Expression::parse(text, &names).unwrap().evaluate(&[2.0, 3.0], &mut Vec::new())
}

fn error(text: &str) -> String {
    Expression::parse(text, &["x", "y"]).unwrap_err().to_string()
}

#[test]
fn precedence_is_that_of_mathematics() {
    for (text, expected) in [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("-x^2", -4.0),
        ("2^-x", 0.25),
        ("x^y^2", 512.0),
        ("8 / 2 / 2", 2.0),
        ("8 - 2 - 2", 4.0),
        ("- - x", 2.0),
        ("2e1*x", 40.0),
        ("2.5E-1", 0.25),
        (".5 + 1.", 1.5),
        ("sqrt(x^2 + y^2) - atan2(0, 1)", 13.0_f64.sqrt()),
        ("deg(pi)", 180.0),
        ("rad(180) - pi", 0.0),
        ("distance(0, 0, 0, x, y, 6)", 7.0),
        ("abs(x - y)", 1.0),
        ("log10(100) + ln(exp(y))", 5.0),
    ] {
        assert!((value(text) - expected).abs() < 1e-14, "{text} = {}", value(text));
    }
}

#[test]
fn a_wrong_formula_is_reported_with_its_column() {
    assert_eq!(error("x + z"), "column 5: unknown variable \"z\"; known: x, y");
    assert_eq!(error(" "), "the formula is empty");
    assert_eq!(error("x +"), "column 4: a number, a name or \"(\" expected, the end found");
    assert_eq!(error("x y"), "column 3: an operator or the end expected, \"y\" found");
    assert_eq!(error("(x"), "column 3: \")\" expected, the end found");
    assert_eq!(error("x = 2"), "column 3: \"=\" is not understood here");
    assert_eq!(error("distance(x, y)"), "column 1: distance takes 6 arguments, 2 are given");
    assert!(error("system(x)").starts_with("column 1: unknown function \"system\"; known: sqrt, exp"));
    assert!(error("sqrt()").contains("expected"));
    assert!(error("1e999").contains("finite"));
    assert!(error("1.2.3").contains("operator"));
    assert!(error(&"(".repeat(3000)).contains("too deep: 65, limit 64"));
    assert!(error(&"-".repeat(3000)).contains("too deep"));
    assert!(error(&"x^".repeat(1000)).contains("too deep"));
    assert!(error(&"x+".repeat(3000)).contains("too long: 6000, limit 4096"));
    assert!(Expression::parse(&format!("x{}", "+x".repeat(2000)), &["x"]).is_ok());
}

#[test]
fn a_quantity_must_have_a_name_that_formulas_can_hold() {
    for name in ["2x", "a b", "", "a-b", "sin", "pi"] {
        assert!(Expression::parse("1", &[name]).is_err(), "{name}");
    }
    assert!(Expression::parse("α_s * ΔT", &["α_s", "ΔT"]).is_ok());
}

#[test]
fn what_is_not_defined_is_nan_and_not_a_panic() {
    for text in ["sqrt(-x)", "ln(-x)", "acos(x)", "0/0", "(-x)^0.5"] {
        assert!(value(text).is_nan(), "{text}");
    }
}

/// Formulas that are smooth for x in 0.1 … 0.9 and y in 0.5 … 2.
const SMOOTH: [&str; 12] = [
    "x * y - y / x",
    "x^y",
    "y^3 - 2^x",
    "sqrt(x) * exp(-y)",
    "ln(y) + log10(x)",
    "sin(x) * cos(y) + tan(x)",
    "asin(x) - acos(x) + atan(y)",
    "atan2(x, y)",
    "abs(-x) * deg(y) + rad(x)",
    "distance(x, y, 1, y, x, 3)",
    "direction_cosine(0, x, 1, y, 2, 3)",
    "deg(plane_angle(x, y, 0, 0, x, y)) + length_at_20(y, x / 100, 30)",
];

proptest! {
    #[test]
    fn derivatives_agree_with_central_differences(x in 0.1_f64..0.9, y in 0.5_f64..2.0) {
        for text in SMOOTH {
            let f = Expression::parse(text, &["x", "y"]).unwrap();
            for by in 0..2 {
                let at = |h: f64| {
                    let mut values = [x, y];
                    values[by] += h;
                    f.evaluate(&values, &mut Vec::new())
                };
                let h = 1e-5;
                let difference = (at(h) - at(-h)) / (2.0 * h);
                let mut duals = [Dual::constant(x), Dual::constant(y)];
                duals[by].derivative = 1.0;
                let exact = f.evaluate(&duals, &mut Vec::new()).derivative;
                // Third derivatives are below 1e4 here, rounding below 1e-14/h.
                prop_assert!((difference - exact).abs() < 1e-6 * (1.0 + exact.abs()), "{} {} {}", text, difference, exact);
            }
        }
    }

    #[test]
    fn no_text_makes_it_panic(text in ".{0,60}") {
        let _ = Expression::parse(&text, &["x", "y"]);
    }

    #[test]
    fn no_likely_text_makes_it_panic(text in "[xy0-9.e+*/^(), -]{0,40}") {
        if let Ok(f) = Expression::parse(&text, &["x", "y"]) {
            let plain = f.evaluate(&[0.3, 0.7], &mut Vec::new());
            let dual = f.evaluate(&[Dual::constant(0.3), Dual::constant(0.7)], &mut Vec::new());
            prop_assert!(plain.to_bits() == dual.value.to_bits() || plain.is_nan() && dual.value.is_nan());
        }
    }
}

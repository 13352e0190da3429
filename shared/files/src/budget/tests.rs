//! What the reader makes of a budget, and what it refuses.

use super::*;
use crate::document::Document;

const HEAD: &str =
    "format = \"fringecell-budget/1\"\nname = \"n\"\n[measurand]\nsymbol = \"y\"\nunit = \"mm\"\n";

fn read(text: &str) -> Result<BudgetFile, FileError> {
    check::check(&Document { path: "b.toml".into(), text: text.into() })
}

/// A budget of one quantity with these lines.
fn one(lines: &str) -> Result<BudgetFile, FileError> {
    read(&format!("{HEAD}[[quantity]]\nname = \"x\"\n{lines}"))
}

fn u_and_dof(lines: &str) -> (f64, f64) {
    let file = one(lines).unwrap();
    let quantity = &file.budget.quantities[0];
    (quantity.standard_uncertainty(), quantity.dof)
}

#[test]
fn every_statement_gives_its_standard_uncertainty() {
    let known = f64::INFINITY;
    for (lines, u, dof) in [
        ("readings = [1.0, 2.0, 3.0, 4.0]", (5.0_f64 / 12.0).sqrt(), 3.0),
        ("estimate = 1.0\nstandard_deviation = 0.4\nobservations = 16", 0.1, 15.0),
        ("estimate = 1.0\nstandard_uncertainty = 0.1\ndof = 4", 0.1, 4.0),
        ("estimate = 1.0\nstandard_uncertainty = 0.1\ndof = inf", 0.1, known),
        ("estimate = 1.0\nexpanded_uncertainty = 0.3\ncoverage_factor = 3", 0.1, known),
        ("estimate = 0\nhalf_width = 0.3\ndistribution = \"rectangular\"", 0.3 / 3.0_f64.sqrt(), known),
        ("estimate = 0\nhalf_width = 0.6\ndistribution = \"triangular\"", 0.6 / 6.0_f64.sqrt(), known),
        ("estimate = 0\nhalf_width = 0.2\ndistribution = \"u-shaped\"", 0.2 / 2.0_f64.sqrt(), known),
        (
            "estimate = 0\nhalf_width = 0.6\ndistribution = \"trapezoidal\"\ntop_ratio = 0.5",
            0.6 * (1.25_f64 / 6.0).sqrt(),
            known,
        ),
        (
            "estimate = 0\nhalf_width = 0.05\ndistribution = \"curvilinear-trapezoidal\"\nlimit_uncertainty = 0.025\n\
             relative_uncertainty_of_u = 0.5",
            (0.05_f64.powi(2) / 3.0 + 0.025_f64.powi(2) / 9.0).sqrt(),
            2.0,
        ),
    ] {
        let (found_u, found_dof) = u_and_dof(lines);
        assert!((found_u - u).abs() < 1e-15 && found_dof == dof, "{lines}: {found_u} {found_dof}");
    }
}

#[test]
fn what_cannot_be_meant_is_reported_with_line_and_key() {
    for (lines, words) in [
        (
            "estimate = 0\nstandard_uncertainty = -0.1",
            "b.toml:9: quantity[0].standard_uncertainty: value -0.1",
        ),
        ("estimate = 0\nstandard_uncertainty = nan", "quantity[0].standard_uncertainty: value NaN"),
        ("estimate = nan\nstandard_uncertainty = 0.1", "quantity[0].estimate: value NaN"),
        ("standard_uncertainty = 0.1", "estimate is missing; add it"),
        ("estimate = 0", "states no uncertainty; give exactly one of readings"),
        ("estimate = 0\nhalf_width = 1\nstandard_uncertainty = 1", "states its uncertainty 2 times"),
        ("estimate = 0\nhalf_width = 1", "distribution is missing; add one of rectangular"),
        ("estimate = 0\nhalf_width = 1\ndistribution = \"rectangle\"", "did you mean \"rectangular\"?"),
        ("estimate = 0\nhalf_width = 1\ndistribution = \"normal\"", "has no half-width"),
        ("estimate = 0\nhalf_width = 1\ndistribution = \"trapezoidal\"", "top_ratio is missing"),
        (
            "estimate = 0\nhalf_width = 1\ndistribution = \"trapezoidal\"\ntop_ratio = 2.0",
            "value 2 is not allowed: 0 … 1",
        ),
        (
            "estimate = 0\nhalf_width = 1\ndistribution = \"triangular\"\ntop_ratio = 0.5",
            "top_ratio: has no meaning here",
        ),
        ("estimate = 0\nstandard_uncertainty = 1\ndistribution = \"rectangular\"", "is taken as normal"),
        ("estimate = 0\nstandard_uncertainty = 1\ndof = 0", "quantity[0].dof: value 0"),
        ("estimate = 0\nstandard_uncertainty = 1\ndof = -3", "quantity[0].dof: value -3"),
        ("estimate = 0\nstandard_uncertainty = 1\ndof = nan", "quantity[0].dof: value NaN"),
        ("estimate = 0\nstandard_uncertainty = 1\ndof = 4\nrelative_uncertainty_of_u = 0.1", "without dof"),
        ("estimate = 0\nexpanded_uncertainty = 1", "coverage_factor is missing"),
        ("estimate = 0\nstandard_deviation = 1", "observations is missing"),
        ("estimate = 0\nstandard_deviation = 1\nobservations = 1", "observations: value 1"),
        ("readings = [1.0]", "1 readings, at least 2"),
        ("readings = []", "0 readings, at least 2"),
        ("readings = [1.0, nan]", "reading NaN"),
        ("readings = [1.0, 2.0]\nestimate = 1.5", "remove it"),
        ("readings = [1.0, 2.0]\ndof = 5", "dof: has no meaning here"),
        ("readings = [1.0, 2.0]\ntype = \"B\"", "type A"),
        ("readings = [1.0, 2.0]\ntype = \"C\"", "\"A\" or \"B\""),
        ("readings = [1.0, 2.0]\nsensitivity = inf", "sensitivity: value inf"),
        ("readings = [1.0, 2.0]\nsensitvity = 1.0", "did you mean \"sensitivity\"?"),
    ] {
        let error = one(lines).unwrap_err().to_string();
        assert!(error.starts_with("b.toml:") && error.contains(words), "{lines}\n{error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

const TWO: &str = "[[quantity]]\nname = \"a\"\nreadings = [1.0, 2.0, 4.0]\n\
                   [[quantity]]\nname = \"b\"\nestimate = 0\nstandard_uncertainty = 0.1\n";

#[test]
fn the_whole_must_fit_together() {
    let model = |text: &str| HEAD.to_owned() + &format!("model = \"{text}\"\n") + TWO;
    for (text, words) in [
        (HEAD.to_owned(), "quantity: value 0 quantities is not allowed: 1 … 500"),
        (model("a + c"), "b.toml:6: measurand.model: column 5: unknown variable \"c\"; known: a, b"),
        (model("a + "), "measurand.model: column 5"),
        (model("2 * a"), "does not mention quantity \"b\""),
        (model("a + b") + "sensitivity = 2.0", "follows from measurand.model"),
        (format!("{HEAD}{TWO}{TWO}"), "quantity \"a\" occurs twice"),
        (
            format!("{HEAD}{TWO}[[correlation]]\nbetween = [\"a\", \"c\"]\ncoefficient = 0.1"),
            "quantity \"c\" is unknown",
        ),
        (format!("{HEAD}{TWO}[[correlation]]\nbetween = [\"a\", \"b\"]\ncoefficient = 1.1"), "value 1.1"),
        (format!("{HEAD}{TWO}[[correlation]]\nbetween = [\"a\", \"b\"]"), "exactly one of coefficient"),
        (format!("{HEAD}{TWO}[[correlation]]\nbetween = [\"a\", \"b\"]\nfrom_readings = true"), "same time"),
        (
            format!("{HEAD}{TWO}[monte_carlo]\ntrials = 1000000000000"),
            "b.toml:14: monte_carlo.trials: value 1000000000000",
        ),
        (format!("{HEAD}{TWO}[monte_carlo]\ndigits = 3"), "1 or 2"),
        (format!("{HEAD}{TWO}[monte_carlo]\nseed = -1"), "seed"),
        (
            format!("{HEAD}{TWO}[reference]\nname = \"r\"\nvalue = 1\nexpanded_uncertainty = -1"),
            "reference.expanded_uncertainty",
        ),
        ("name = 3".into(), "add the line: format = \"fringecell-budget/1\""),
        (
            HEAD.replace("name = \"n\"", "name = \"n\"\ncoverage_probability = 95") + TWO,
            "coverage_probability: value 95",
        ),
        (HEAD.replace("name = \"n\"", "name = \"n\"\ncoverage_factor = 0") + TWO, "coverage_factor: value 0"),
    ] {
        let error = read(&text).unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{text}\n{error}");
    }
}

#[test]
fn defaults_are_those_that_the_format_says() {
    let file = read(&format!("{HEAD}{TWO}")).unwrap();
    assert_eq!(file.budget.coverage_probability, 0.9545);
    assert_eq!(file.budget.model, metrology::uncertainty::Model::Linear(vec![1.0, 1.0]));
    assert_eq!(file.monte_carlo, MonteCarloSettings::default());
    assert_eq!(file.budget.quantities[1].unit, "mm");
    assert!(file.budget.evaluate().is_ok());
}

/// 5 µm beside millimetres were added as 5 mm.
#[test]
fn a_sum_of_different_units_is_refused_unless_a_factor_converts_it() {
    let two = |unit: &str, more: &str| {
        read(&format!(
            "{HEAD}{TWO}[[quantity]]\nname = \"um\"\nunit = \"{unit}\"\nestimate = 5.0\nstandard_uncertainty = 1.0\n{more}"
        ))
    };
    for (unit, more) in [("µm", ""), ("um", "sensitivity = 1.0\n"), ("K", "")] {
        let error = two(unit, more).unwrap_err().to_string();
        assert!(error.contains("quantity[2].unit") && error.contains("the measurand in mm"), "{error}");
    }
    assert!(two("µm", "sensitivity = 0.001\n").is_ok() && two("mm", "").is_ok());
    let head = HEAD.replace("unit = \"mm\"", "unit = \"mm\"\nmodel = \"L + d\"");
    let model = |unit: &str| {
        read(&format!(
            "{head}[[quantity]]\nname = \"L\"\nestimate = 1.0\nstandard_uncertainty = 0.1\n[[quantity]]\nname = \"d\"\n\
             unit = \"{unit}\"\nestimate = 5.0\nstandard_uncertainty = 1.0\n"
        ))
    };
    let error = model("µm").unwrap_err().to_string();
    assert!(error.contains("measurand.model") && error.contains("mm") && error.contains("um"), "{error}");
    assert!(model("mm").is_ok());
}

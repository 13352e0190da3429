//! `fringetool uncertainty`: budgets in, table, JSON and report out; bad budgets refused on one line.

use crate::support::{Ran, fringetool, root};
use serde_json::Value;
use std::fs;
use tempfile::TempDir;

fn budget(name: &str) -> String {
    root().join("configs/budgets").join(name).to_str().unwrap().to_owned()
}

/// Runs a budget of the repository; exit code, result, what was printed.
fn evaluate(name: &str, more: &[&str]) -> (Option<i32>, Value, String) {
    let folder = TempDir::new().unwrap();
    let json = folder.path().join("u.json").to_str().unwrap().to_owned();
    let path = budget(name);
    let mut arguments = vec!["uncertainty", &path, "--json", &json];
    arguments.extend(more);
    let ran = fringetool(&arguments);
    let text = fs::read_to_string(&json).unwrap_or_else(|_| panic!("{}", ran.stderr));
    (ran.code, serde_json::from_str(&text).unwrap(), ran.stdout)
}

fn printed(value: &Value, expected: f64, decimals: i32) {
    let value = value.as_f64().unwrap();
    assert!(
        (value - expected).abs() <= 0.5 * 10.0_f64.powi(-decimals) + 1e-12,
        "{value}, printed {expected}"
    );
}

#[test]
fn budgets_of_the_thesis_have_its_combined_uncertainty_and_a_k_that_covers() {
    // u_c as printed (tables 4.1, 4.4); E_n from the U that covers 95.45 %, not from k = 2; exit code 1 where |E_n| > 1.
    for (name, combined, decimals, k, code) in [
        ("sphere-spacing.toml", 0.021, 3, 2.002, 0),
        ("hemisphere-diameter.toml", 0.023, 3, 2.000, 0),
        ("feature-angle.toml", 0.395, 3, 2.869, 0),
        ("wedge-inclination.toml", 0.004, 3, 4.526, 1),
    ] {
        let (found_code, json, _) = evaluate(name, &[]);
        let evaluation = &json["evaluation"];
        printed(&evaluation["combined_standard_uncertainty"], combined, decimals);
        // t at 95.45 % and ν_eff, see the reference values in metrology::uncertainty.
        printed(&evaluation["coverage_factor"], k, 3);
        printed(&evaluation["covered_probability"], 0.9545, 6);
        assert_eq!(found_code, Some(code), "{name}");
        assert_eq!(json["comparison"]["agrees"], code == 0, "{name}");
    }
}

#[test]
fn the_end_gauge_of_the_gum_comes_out_as_printed() {
    let (code, json, text) = evaluate("end-gauge.toml", &[]);
    assert_eq!(code, Some(0));
    printed(&json["evaluation"]["estimate"], 50.000_838, 6);
    // H.1 rounds u_c to 32 nm before it is expanded to 93 nm; unrounded it is 31.7 and 92.5.
    printed(&json["evaluation"]["combined_standard_uncertainty"], 31.7e-6, 7);
    printed(&json["evaluation"]["coverage_factor"], 2.92, 2);
    printed(&json["evaluation"]["expanded_uncertainty"], 92.5e-6, 7);
    assert!(text.contains("the sensitivity of alpha_s is 0"), "{text}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_a_report_stands_alone() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let input = path("b.toml");
    let text = fs::read_to_string(budget("length-at-20.toml")).unwrap();
    fs::write(&input, text + "[monte_carlo]\ndigits = 1\n").unwrap();
    let run = |json: &str, report: &str, seed: &str| {
        let arguments =
            ["uncertainty", &input, "--monte-carlo", "--seed", seed, "--json", json, "--report", report];
        fringetool(&arguments).expect_success();
        (fs::read(json).unwrap(), fs::read(report).unwrap())
    };
    let first = run(&path("1.json"), &path("1.html"), "7");
    assert!(first == run(&path("2.json"), &path("2.html"), "7"));
    assert!(first != run(&path("3.json"), &path("3.html"), "8"));
    let json: Value = serde_json::from_slice(&first.0).unwrap();
    assert_eq!(
        (&json["monte_carlo"]["converged"], &json["validation"]["valid"]),
        (&true.into(), &true.into())
    );
    // The correction of α L ΔT = 5.6 µm is applied.
    printed(&json["evaluation"]["estimate"], 112.4726, 4);
    let html = String::from_utf8(first.1).unwrap();
    for words in ["<svg", "length_at_20(", "Monte Carlo", "ν_eff", "JCGM 100:2008"] {
        assert!(html.contains(words), "{words}");
    }
    assert!(!html.contains("http:") && !html.contains("https:"), "nothing is fetched");
}

const GOOD: &str = "format = \"fringecell-budget/1\"\nname = \"n\"\n[measurand]\nsymbol = \"y\"\nunit = \"mm\"\nmodel = \"a + b\"\n\
                    [[quantity]]\nname = \"a\"\nestimate = 1.0\nstandard_uncertainty = 0.1\ndof = 4\n\
                    [[quantity]]\nname = \"b\"\nestimate = 2.0\nhalf_width = 0.1\ndistribution = \"rectangular\"\n";

/// Runs a budget of this text with Monte Carlo; asserts that it is refused on one line and leaves nothing.
fn refused(text: &str) -> String {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("b.toml"), text).unwrap();
    let (input, json, report) = (path("b.toml"), path("u.json"), path("u.html"));
    let Ran { code, stdout, stderr } =
        fringetool(&["uncertainty", &input, "--monte-carlo", "--json", &json, "--report", &report]);
    assert_eq!(code, Some(2), "{stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
    assert!(stderr.contains("b.toml") && stdout.is_empty(), "{stderr}\n{stdout}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is written");
    stderr
}

#[test]
fn what_is_wrong_with_a_budget_is_said_on_one_line() {
    let correlated =
        |r: &str| format!("{GOOD}[[correlation]]\nbetween = [\"a\", \"b\"]\ncoefficient = {r}\n");
    let three = GOOD.replace("a + b", "a + b + c")
        + "[[quantity]]\nname = \"c\"\nestimate = 0.0\nstandard_uncertainty = 0.1\n";
    let contradicting = ["\"a\", \"b\"", "\"b\", \"c\"", "\"a\", \"c\""]
        .iter()
        .zip(["0.9", "0.9", "-0.9"])
        .fold(three, |text, (pair, r)| {
            format!("{text}[[correlation]]\nbetween = [{pair}]\ncoefficient = {r}\n")
        });
    let model = |text: &str| GOOD.replace("a + b", text);
    for (text, words) in [
        (String::new(), "format"),
        ("not = [toml".into(), "b.toml:1"),
        (GOOD.replace("standard_uncertainty = 0.1", "standard_uncertainty = -0.1"), "-0.1"),
        (GOOD.replace("half_width = 0.1", "half_width = nan"), "NaN"),
        (GOOD.replace("dof = 4", "dof = 0"), "dof"),
        (GOOD.replace("dof = 4", "dof = 2"), "4 readings"),
        (GOOD.replace("\"rectangular\"", "\"square\""), "distribution \"square\" is unknown"),
        (model("a + z"), "unknown variable \"z\""),
        (model("a + b + shell(1)"), "unknown function \"shell\""),
        (model("a + sqrt(b - 2)"), "no derivative by \"b\""),
        (model("a + ln(b - 2.0)"), "gives -inf at the estimates"),
        (model("a + sqrt(b - 1.95)"), "no finite value at"),
        (correlated("1.5"), "1.5"),
        (correlated("0.5"), "is rectangular and correlated"),
        (contradicting, "not positive semidefinite"),
        (format!("{GOOD}[monte_carlo]\ntrials = 1000000000000000\n"), "10000 … 50000000"),
        (format!("{GOOD}[monte_carlo]\nmax_trials = 99999999999999999999999\n"), "b.toml:18: max_trials"),
        (GOOD.split("[[quantity]]").next().unwrap().to_owned(), "0 quantities"),
        (format!("{GOOD}half_wdith = 0.1\n"), "did you mean \"half_width\"?"),
        (
            format!("{GOOD}[reference]\nname = \"r\"\nvalue = nan\nexpanded_uncertainty = 1\n"),
            "reference.value",
        ),
    ] {
        let error = refused(&text);
        assert!(error.contains(words), "{words}\n{error}");
    }
}

#[test]
fn an_absent_budget_and_a_result_over_the_budget_are_refused() {
    let absent = fringetool(&["uncertainty", "no-such.toml"]);
    assert_eq!(absent.code, Some(2));
    assert!(
        absent.stderr.contains("no-such.toml") && absent.stderr.lines().count() == 1,
        "{}",
        absent.stderr
    );
    let path = budget("end-gauge.toml");
    let over = fringetool(&["uncertainty", &path, "--json", &path]);
    assert_eq!(over.code, Some(2));
    assert!(over.stderr.contains("would overwrite an input"), "{}", over.stderr);
}

//! Statistics over parts, through the real programs: from a run of a cell and from tables.

use crate::running::Cell;
use crate::support::{fringetool, root};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;

fn json(path: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// A table of the study in the manual of the AIAG, as the tests of the crate have it.
fn msa() -> String {
    let mut table = "part,operator,value,lower,upper\n".to_owned();
    let text = fs::read_to_string(root().join("shared/metrology/src/spc/tests.rs")).unwrap();
    let data =
        text.split_once("const AIAG").unwrap().1.split_once("= [").unwrap().1.split_once("];\n").unwrap().0;
    let rows = data.lines().filter(|line| line.trim().starts_with('[') && line.contains(','));
    for (row, line) in rows.enumerate() {
        for (part, value) in line.trim().trim_matches(|c| "[],".contains(c)).split(',').enumerate() {
            let operator = ["A", "B", "C"][row / 3];
            let _ = writeln!(table, "{},{operator},{},-2,2", part + 1, value.trim());
        }
    }
    table
}

#[test]
fn two_runs_of_a_cell_become_one_series_and_a_changed_value_is_refused() {
    let cell = Cell::played("statistics", 0.0, "");
    fs::write(cell.small.path("wide.plan.toml"), crate::control::plan(-50.0, 50.0)).unwrap();
    cell.small.edit("played.toml", "[limits]", "plan = \"wide.plan.toml\"\n[limits]");
    for _ in 0..2 {
        let run = cell.run("played.toml", &["--cycles", "5"]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    }
    let (out, file) = (cell.out().display().to_string(), cell.small.path("spc.json"));
    let (html, dfq) = (cell.small.path("spc.html"), cell.small.path("spc.dfq"));
    let told = fringetool(&["spc", &out, "--json", &file, "--report", &html, "--dfq", &dfq]);
    let told = told.expect_success();
    let result = json(&file);
    assert_eq!(
        (&result["parts"], &result["parts_not_ok"]),
        (&Value::from(10), &Value::from(0)),
        "{}",
        told.stdout
    );
    let features = result["features"].as_array().unwrap();
    assert!(!features.is_empty() && features.iter().all(|f| f["values"].as_array().unwrap().len() == 10));
    let last: Value = json(&format!("{out}/result.json"));
    assert_eq!(features[0]["values"][9], last["features"][0]["value"], "the last part is the last value");
    assert!(fs::read_to_string(&html).unwrap().contains("Statistics of parts"));
    let values = fs::read_to_string(&dfq).unwrap().matches("K0001/1 ").count();
    assert_eq!(values, 10);
    let store = format!("{out}/parts.jsonl");
    let text = fs::read_to_string(&store).unwrap();
    let digit = text.find("\"value\":").unwrap() + 9;
    let mut bytes = text.into_bytes();
    bytes[digit] = if bytes[digit] == b'1' { b'2' } else { b'1' };
    fs::write(&store, bytes).unwrap();
    let refused = fringetool(&["spc", &out]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("parts.jsonl:1: the seal does not fit"), "{}", refused.stderr);
    let again = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(again.status.code(), Some(2), "a cell does not append to a store that was changed");
}

#[test]
fn a_gauge_is_rated_and_a_study_that_is_not_balanced_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(path("msa.csv"), msa()).unwrap();
    let rated = fringetool(&["spc", &path("msa.csv"), "--gauge", "--json", &path("msa.json")]);
    assert_eq!(rated.code, Some(1), "45 % of the tolerance: {}{}", rated.stdout, rated.stderr);
    let study = &json(&path("msa.json"))["gauge"][0];
    assert_eq!((study["rating"].as_str(), study["type_two"]["ndc"].as_u64()), (Some("not-capable"), Some(4)));
    let percent = study["type_two"]["grr_of_variation_percent"].as_f64().unwrap();
    assert!((percent - 27.86).abs() < 0.01, "{percent}");
    let short = msa().lines().take(90).collect::<Vec<_>>().join("\n");
    fs::write(path("short.csv"), short).unwrap();
    let refused = fringetool(&["spc", &path("short.csv"), "--gauge"]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("each operator measures each part equally often"), "{}", refused.stderr);
}

#[test]
fn an_index_is_proven_or_the_exit_code_is_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let rows = |count: usize| -> String {
        let row = |i: usize| format!("{:.3},9.9,10.1\n", 10.0 + 0.001 * ((i * 29) % 31) as f64 - 0.015);
        "value,lower,upper\n".to_owned() + &(0..count).map(row).collect::<String>()
    };
    fs::write(path("few.csv"), rows(5)).unwrap();
    fs::write(path("many.csv"), rows(200)).unwrap();
    let code = |file: &str, least: &str| fringetool(&["spc", &path(file), "--least-ppk", least]).code;
    // The same process: five parts prove less than two hundred.
    assert_eq!((code("many.csv", "3"), code("few.csv", "3")), (Some(0), Some(1)));
    for (arguments, expected) in [
        (vec!["--confidence", "1"], "within 0.5 … 0.999999"),
        (vec!["--confidence", "0.9999999999999999"], "within 0.5 … 0.999999"),
        (vec!["--reference", "nan"], "--reference NaN: give a finite number"),
        (vec!["--least-ppk", "nan"], "a number greater than 0"),
        (vec!["--feature", "width"], "no part has it (known: value)"),
        (vec!["--tolerance", "1"], "belongs to --reference or --gauge"),
        (vec!["--gauge"], "a table with the column \"operator\""),
    ] {
        let file = path("few.csv");
        let refused = fringetool(&[&["spc", &file][..], &arguments].concat());
        assert_eq!(refused.code, Some(2), "{arguments:?}");
        assert!(refused.stderr.contains(expected), "{arguments:?}: {}", refused.stderr);
    }
    for (text, expected) in [
        ("", "bad.csv: has no header row; begin with"),
        ("value\n", "the table has no rows"),
        (
            "value,price\n1,2\n",
            "bad.csv: the column \"price\" is not known here; rename it or leave it out (known: feature, part",
        ),
        ("part\n1\n", "the column \"value\" is missing"),
        ("value,u\n1\n", "bad.csv:2: "),
        ("value\n1\nmany\n", "bad.csv:3: value: value \"many\" is not allowed: a finite number"),
        ("value\nnan\n", "bad.csv:2: value: value \"nan\" is not allowed"),
        ("value,value\n1,2\n", "bad.csv: the column \"value\" occurs twice; rename one or leave it out"),
    ] {
        fs::write(path("bad.csv"), text).unwrap();
        let refused = fringetool(&["spc", &path("bad.csv")]);
        assert_eq!(refused.code, Some(2), "{text:?}");
        assert!(refused.stderr.contains(expected), "{text:?}: {}", refused.stderr);
    }
    let twice = fringetool(&["spc", &path("few.csv"), &path("few.csv")]);
    assert!(twice.stderr.contains("is given twice"), "{}", twice.stderr);
}

#[test]
fn limits_the_wrong_way_round_are_refused() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("values.csv").display().to_string();
    for (lower, upper) in [("2", "0"), ("1", "1")] {
        fs::write(&path, format!("value,lower,upper\n1.1,0,2\n0.9,{lower},{upper}\n1.0,0,2\n")).unwrap();
        let refused = fringetool(&["spc", &path]);
        assert_eq!(refused.code, Some(2), "{}", refused.stdout);
        assert!(
            refused.stderr.contains("lower") && refused.stderr.contains("below \"upper\""),
            "{}",
            refused.stderr
        );
    }
}

//! The report of an acceptance test through the real binary: what must be refused leaves no file.

use crate::support::fringetool;
use serde_json::{Value, json};
use std::path::Path;

pub fn master() -> Value {
    let position = |name: &str, value: f64| {
        json!({
            "position": name, "repeat": 1, "value": value, "test_value_u": 0.001, "verdict": "pass",
            "points": 900, "rejected": 2, "views": ["v1"]
        })
    };
    json!({
        "format": "fringecell-acceptance/1",
        "rule_set": {
            "id": "own-2", "standard": "VDI/VDE 2634 part 2", "edition": "2012-08",
            "wording": "evaluated following VDI/VDE 2634 part 2, edition 2012-08", "assumed": []
        },
        "guard_factor": 1.65,
        "reduced": [],
        "conditions": [["Operator", "M. M."]],
        "sensor_volume": { "size_mm": [100.0, 80.0, 60.0], "body_diagonal_mm": 141.4 },
        "total_volume": { "size_mm": [100.0, 80.0, 60.0], "body_diagonal_mm": 141.4 },
        "artefacts": [{ "id": "s", "kind": "sphere", "certificate": "K-1", "values": [["diameter", 20.0, 0.0005]] }],
        "characteristics": [{
            "symbol": "PS", "name": "probing size error", "definition": "fitted less calibrated diameter", "unit": "mm",
            "value": -0.012, "decides": true, "limit": 0.03, "test_value_u": 0.001, "verdict": "pass",
            "positions": [position("a", 0.004), position("b", -0.012)],
            "repeatability": null, "between_positions": 0.011
        }],
        "verdict": "pass"
    })
}

fn report(folder: &Path, master: &str, more: &[&str]) -> crate::support::Ran {
    let path = folder.join("result.json");
    std::fs::write(&path, master).unwrap();
    let mut arguments = vec!["report".to_owned(), path.display().to_string()];
    arguments.extend(more.iter().map(|a| a.replace("DIR", &folder.display().to_string())));
    fringetool(&arguments)
}

const ALL: [&str; 10] = [
    "--html",
    "DIR/r.html",
    "--pdf",
    "DIR/r.pdf",
    "--csv",
    "DIR/r.csv",
    "--qif",
    "DIR/r.qif",
    "--dfq",
    "DIR/r.dfq",
];

#[test]
fn one_master_gives_all_formats() {
    let folder = tempfile::tempdir().unwrap();
    report(folder.path(), &master().to_string(), &ALL).expect_success();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(String::from_utf8(read("r.html")).unwrap().contains("edition 2012-08"));
    assert!(read("r.pdf").starts_with(b"%PDF"));
    for name in ["r.csv", "r.qif", "r.dfq"] {
        assert!(String::from_utf8(read(name)).unwrap().contains("-0.012"), "{name}");
    }
}

#[test]
fn a_bad_master_is_told_on_one_line_and_leaves_nothing() {
    let with = |change: &dyn Fn(&mut Value)| {
        let mut value = master();
        change(&mut value);
        value.to_string()
    };
    for (master, words) in [
        (with(&|m| m["rule_set"]["edition"] = "".into()), "edition"),
        (with(&|m| m["characteristics"] = json!([])), "there is none"),
        (with(&|m| m["characteristics"][0]["value"] = Value::Null), "null"),
        (with(&|m| m["format"] = "fringecell-result/1".into()), "expected \"fringecell-acceptance/1\""),
        (with(&|m| m["characteristics"][0]["verdict"] = "fail".into()), "its positions give pass"),
        (
            with(&|m| {
                m.as_object_mut().unwrap().remove("guard_factor");
            }),
            "missing field `guard_factor`",
        ),
        // A forged master: 29.5 µm of 30 µm with U = 1 µm proves nothing, whatever the verdicts say.
        (
            with(&|m| {
                m["characteristics"][0]["value"] = (-0.0295).into();
                m["characteristics"][0]["positions"][1]["value"] = (-0.0295).into();
            }),
            "give indeterminate",
        ),
        ("{\"cycle\": 3}".to_owned(), "fringecell-acceptance/1"),
        ("\u{1}".to_owned(), "result.json"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let ran = report(folder.path(), &master, &ALL);
        assert_eq!(ran.code, Some(2), "{words}");
        assert!(ran.stderr.contains(words) && ran.stderr.trim_end().lines().count() == 1, "{}", ran.stderr);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{words}");
    }
}

#[test]
fn no_output_takes_the_place_of_the_input_or_of_another() {
    let folder = tempfile::tempdir().unwrap();
    for (more, words) in [
        (&["--html", "DIR/result.json"][..], "would overwrite an input"),
        (&["--html", "DIR/a", "--pdf", "DIR/a"], "is also the file of --html"),
        (&[], "nothing to write"),
    ] {
        let text = master().to_string();
        let ran = report(folder.path(), &text, more);
        assert_eq!(ran.code, Some(2));
        assert!(ran.stderr.contains(words), "{}", ran.stderr);
        assert_eq!(std::fs::read_to_string(folder.path().join("result.json")).unwrap(), text);
    }
}

//! Exports of a part: numbers survive, foreign words stay in their field, QIF follows its schema.

use super::*;
use crate::acceptance::{html, pdf};
use metrology::inspection::{FeatureResult, Unit};
use metrology::verdict::Verdict;
use std::path::Path;

fn result() -> InspectionResult {
    let feature = |name: &str, value: Option<f64>, unit: Unit, verdict: Option<Verdict>| FeatureResult {
        name: name.into(),
        value,
        unit,
        u: value.map(|_| 0.0021),
        nominal: 12.0,
        lower: Some(11.9),
        upper: Some(12.1),
        deviation: value.map(|v| v - 12.0),
        verdict,
        reason: value.is_none().then(|| "element bore: 0 points\nin its region".into()),
        detail: Some("⌖ position, \"A\"".into()),
        ..FeatureResult::default()
    };
    InspectionResult {
        plan: "block <1> & co".into(),
        verdict: Verdict::Indeterminate,
        alignment: None,
        alignment_failure: None,
        elements: Vec::new(),
        constructed: Vec::new(),
        features: vec![
            feature("=bore, d", Some(12.012_345_678_9), Unit::Mm, Some(Verdict::Pass)),
            feature("angle", Some(12.2), Unit::Deg, Some(Verdict::Fail)),
            feature("gone", None, Unit::Mm, None),
        ],
    }
}

fn input(result: &InspectionResult) -> PartInput<'_> {
    PartInput {
        part: Some("4711"),
        result,
        guard_factor: 1.65,
        date: "2026-01-31T08:00:00Z",
        made_with: &[],
        sha256: "abcdef0123456789abcdef0123456789",
    }
}

#[test]
fn tables_hold_every_digit_and_one_line_a_feature() {
    let result = result();
    let text = tables::csv(&input(&result));
    assert_eq!(text.lines().count(), 4, "{text}");
    assert!(text.contains("12.0123456789,mm,0.0021,12,") && text.contains("\"'=bore, d\""), "{text}");
    assert!(
        text.contains(",not-measured,") && text.contains("element bore: 0 points in its region"),
        "{text}"
    );
    let text = tables::dfq(&input(&result));
    for line in [
        "K0100 3",
        "K0001/1 12.0123456789",
        "K2110/1 11.9",
        "K2121/2 1",
        "K0002/3 255",
        "K0004/1 31.01.2026/08:00:00",
    ] {
        assert!(text.contains(&format!("{line}\r\n")), "{line} in {text}");
    }
    assert!(text.is_ascii());
}

#[test]
fn pages_say_the_verdict_and_the_reason() {
    let result = result();
    let document = document::document(&input(&result));
    let page = html::render(&document);
    assert!(page.contains("INDETERMINATE") && page.contains("block &lt;1&gt; &amp; co"));
    assert!(page.contains("element bore: 0 points") && page.contains("12.012"), "{page}");
    assert!(pdf::render(&document).starts_with(b"%PDF"));
}

#[test]
#[cfg_attr(
    not(all(shared_data, xmllint)),
    ignore = "../shared/data or xmllint (libxml2-utils) is absent; with it: cargo test -p fringe-report part::"
)]
fn qif_is_valid_by_the_schema_of_the_standard() {
    let result = result();
    let none = InspectionResult { features: result.features[2..].to_vec(), ..result.clone() };
    let schema =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/qif/schema/QIFDocument.xsd");
    let dir = tempfile::tempdir().unwrap();
    for (name, result) in [("part", &result), ("nothing", &none)] {
        let file = dir.path().join(name);
        std::fs::write(&file, qif::render(&input(result))).unwrap();
        let check = ["--noout", "--nonet", "--schema"];
        let run = std::process::Command::new("xmllint").args(check).arg(&schema).arg(&file).output().unwrap();
        assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
    }
}

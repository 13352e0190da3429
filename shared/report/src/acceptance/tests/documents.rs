//! QIF and DCC: valid by their published schemas, and complete.

use super::*;
use files::rig_file::{Covariance, RigFile};
use std::process::Command;

/// Holds documents against a schema in `../shared/data`.
fn assert_valid(schema: &str, documents: &[(&str, Vec<u8>)]) {
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(schema);
    let dir = tempfile::tempdir().unwrap();
    for (name, document) in documents {
        let file = dir.path().join(name);
        std::fs::write(&file, document).unwrap();
        let check = ["--noout", "--nonet", "--schema"];
        let run = Command::new("xmllint").args(check).arg(&schema).arg(&file).output().unwrap();
        assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
    }
}

#[test]
#[cfg_attr(
    not(all(shared_data, xmllint)),
    ignore = "../shared/data or xmllint (libxml2-utils) is absent; with it: cargo test -p fringe-report documents::"
)]
fn qif_is_valid_by_the_schema_of_the_standard() {
    let render = |report: TestReport| {
        let sha256 = sha256_hex(master_text(&report).unwrap().as_bytes());
        qif::render(&report, &sha256)
    };
    let documents =
        [("full", render(report())), ("hostile", render(hostile())), ("lengths", render(two_lengths()))];
    assert_valid("qif/schema/QIFDocument.xsd", &documents);
}

#[test]
#[cfg_attr(
    not(all(shared_data, xmllint)),
    ignore = "../shared/data or xmllint (libxml2-utils) is absent; with it: cargo test -p fringe-report documents::"
)]
fn a_dcc_is_valid_by_the_published_schema() {
    let named = Parties { laboratory: Some("<lab> & co"), customer: Some("customer"), country: Some("DE") };
    let render =
        |report: TestReport, parties: Parties| dcc::render(&report, &parties, &"ab".repeat(32)).unwrap();
    let documents = [
        ("full", render(report(), Parties::default())),
        ("hostile", render(hostile(), named)),
        ("lengths", render(two_lengths(), named)),
    ];
    assert_valid("dcc/dcc.xsd", &documents);
}

/// The rig of the demo, and the same with a covariance.
fn rigs() -> [(RigFile, Option<Covariance>); 2] {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/demo-rig.toml");
    let rig = files::rig_file::read_rig(&path).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let covariance = serde_json::json!({
        "format": "fringecell-covariance/1",
        "devices": ["cam1"],
        "parameters": ["fx_px", "tx_mm"],
        "matrix": [[0.25, 0.0], [0.0, 0.0004]],
        "sensors": { "cam1": { "u_footprint_px": [0.01, 0.015], "u_noise_dn": [0.05, 0.002] } },
    });
    let text = covariance.to_string();
    std::fs::write(dir.path().join("rig.covariance.json"), &text).unwrap();
    let named = format!(
        "{}\n[covariance]\nfile = \"rig.covariance.json\"\nsha256 = \"{}\"\n",
        std::fs::read_to_string(&path).unwrap().replacen(
            "name = \"cam1\"",
            "name = \"cam1\"\nfootprint_px = [0.57, 0.58]\nnoise = { read_dn = 1.2, gain_dn = 0.03 }",
            1
        ),
        sha256_hex(text.as_bytes())
    );
    std::fs::write(dir.path().join("rig.toml"), named).unwrap();
    let calibrated = files::rig_file::read_rig(&dir.path().join("rig.toml")).unwrap();
    let covariance = calibrated.read_covariance().unwrap();
    [(rig, None), (calibrated, covariance)]
}

#[test]
#[cfg_attr(
    not(all(shared_data, xmllint)),
    ignore = "../shared/data or xmllint (libxml2-utils) is absent; with it: cargo test -p fringe-report documents::"
)]
fn the_dcc_of_a_rig_is_valid_by_the_published_schema() {
    let named = Parties { laboratory: Some("<lab> & co"), customer: Some("customer"), country: Some("DE") };
    let render = |(rig, covariance): (RigFile, Option<Covariance>), parties: Parties| {
        render_rig(&rig, covariance.as_ref(), "2026-01-31", &parties).unwrap()
    };
    let [plain, calibrated] = rigs();
    let documents = [("plain", render(plain, Parties::default())), ("calibrated", render(calibrated, named))];
    assert_valid("dcc/dcc.xsd", &documents);
}

#[test]
fn the_dcc_of_a_rig_carries_parameters_with_their_uncertainties() {
    let [(plain, _), (rig, covariance)] = rigs();
    let text = |rig: &RigFile, covariance: Option<&Covariance>| {
        String::from_utf8(render_rig(rig, covariance, "2026-01-31", &Parties::default()).unwrap()).unwrap()
    };
    let told = text(&rig, covariance.as_ref());
    // Twice the root of the variance of fx_px and of tx_mm, and nothing for the others.
    for expected in [
        "<si:value>2330</si:value>",
        "<si:uncertainty>1</si:uncertainty>",
        "<si:uncertainty>0.04</si:uncertainty>",
        ">footprint_px along y</dcc:content>",
        "<si:value>0.58</si:value>",
        "<si:uncertainty>0.03</si:uncertainty>",
        "<si:value>1.2</si:value>",
        "<si:uncertainty>0.004</si:uncertainty>",
    ] {
        assert!(told.contains(expected), "{expected}");
    }
    assert_eq!(told.matches("<si:uncertainty>").count(), 6);
    assert!(told.contains("not a calibration certificate"));
    let silent = text(&plain, None);
    assert!(!silent.contains("si:uncertainty") && silent.contains("no uncertainty is stated"));
}

#[test]
fn a_dcc_carries_value_uncertainty_conformity_and_no_claim() {
    let parties = Parties { laboratory: Some("lab"), ..Parties::default() };
    let text = String::from_utf8(dcc::render(&report(), &parties, &"ab".repeat(32)).unwrap()).unwrap();
    for words in [
        "schemaVersion=\"3.1.2\"",
        "<si:value>0.0412</si:value>",
        "<si:unit>\\milli\\metre</si:unit>",
        "<si:coverageFactor>2</si:coverageFactor>",
        "<dcc:conformity>noPass</dcc:conformity>",
        "<dcc:conformity>fail</dcc:conformity>",
        "not a calibration certificate of an accredited laboratory",
        "<dcc:uniqueIdentifier>abababab-abab-8bab-abab-abababababab</dcc:uniqueIdentifier>",
    ] {
        assert!(text.contains(words), "{words}\n{text}");
    }
    let mut undated = report();
    undated.conditions.retain(|(label, _)| label != "date");
    let error = dcc::render(&undated, &parties, &"ab".repeat(32)).unwrap_err().to_string();
    assert!(error.contains("date of the test"), "{error}");
    let abroad = Parties { country: Some("Germany"), ..parties };
    let error = dcc::render(&report(), &abroad, &"ab".repeat(32)).unwrap_err().to_string();
    assert!(error.contains("two capital letters"), "{error}");
}

#[test]
fn qif_carries_value_limit_uncertainty_and_verdict() {
    let text = String::from_utf8(qif::render(&report(), &"ab".repeat(32))).unwrap();
    for words in [
        "<SphericityCharacteristicDefinition id=\"3\">",
        "<ToleranceValue>0.04</ToleranceValue>",
        "<MinValue>-0.03</MinValue>",
        "<CharacteristicStatusEnum>INDETERMINATE</CharacteristicStatusEnum>",
        "<Value combinedUncertainty=\"0.00105\" meanError=\"0\">0.0412</Value>",
        "<InspectionStatusEnum>FAIL</InspectionStatusEnum>",
        "<QPId>abababab-abab-8bab-abab-abababababab</QPId>",
        "<Designator>VDI/VDE 2634 part 3</Designator>",
    ] {
        assert!(text.contains(words), "{words}\n{text}");
    }
}

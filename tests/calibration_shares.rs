//! What a calibration adds to the uncertainty of features: found on one part, joined to the verdicts of a cell.

use crate::running::{Cell, json, results, text};
use crate::support::fringetool;
use files::hash::sha256_hex;
use serde_json::Value;
use std::fs;

const PLAN: &str = "format = \"fringecell-plan/1\"\nname = \"dome\"\n[[element]]\nkind = \"sphere\"\nname = \"s\"\n\
    center_mm = [0.0, 0.0, 0.0]\ndiameter_mm = 60.194\nmax_polar_deg = 75.0\nmargin_mm = 3.0\nmin_points = 100\n[[feature]]\n\
    kind = \"sphere-diameter\"\nname = \"d\"\nelement = \"s\"\nnominal_mm = 60.194\ntolerance_mm = [-9.0, 9.0]\n";

/// The rig file again, with the focal lengths of its cameras known to 0.5 px.
fn with_covariance(cell: &Cell) {
    let path = cell.small.path("rig.toml");
    let rig = files::rig_file::read_rig(path.as_ref()).unwrap();
    let names: Vec<&str> = rig.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let size = 2 * names.len();
    let row = |i: usize| (0..size).map(|j| if i == j { 0.25 } else { 0.0 }).collect::<Vec<f64>>();
    let matrix: Vec<Vec<f64>> = (0..size).map(row).collect();
    let parameters = &characterise::calibration::PARAMETERS[..2];
    let covariance = serde_json::json!({
        "format": "fringecell-covariance/1", "devices": names, "parameters": parameters, "matrix": matrix,
    });
    let covariance = covariance.to_string();
    fs::write(cell.small.path("c.json"), &covariance).unwrap();
    let named = format!(
        "covariance = {{ file = \"c.json\", sha256 = \"{}\" }}\n[[camera]]",
        sha256_hex(covariance.as_bytes())
    );
    cell.small.edit("rig.toml", "[[camera]]", &named);
}

/// The only feature of the last cycle.
fn feature(cell: &Cell) -> Value {
    let all = results(&cell.out());
    let last = all.last().unwrap();
    assert_eq!(last["outcome"], "ok", "{last}");
    last["features"][0].clone()
}

/// Proves: the shares that were found on a part join the uncertainties of a cell in squares, in result and report; without them, a cell has none.
/// Shares of another rig or plan, or a result without shares, are refused with file, key and remedy.
#[test]
fn a_cell_takes_the_shares_of_a_measured_part() {
    let cell = Cell::played("shares", 0.0, "");
    let path = |name: &str| cell.small.path(name);
    with_covariance(&cell);
    fs::write(path("plan.toml"), PLAN).unwrap();
    cell.small.edit("played.toml", "pairs = ", "plan = \"plan.toml\"\npairs = ");
    let run = || cell.run("played.toml", &["--cycles", "1"]);
    let ends_well = || {
        let output = run();
        assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
    };
    ends_well();
    let bare = feature(&cell);
    assert!(bare.get("u_calibration").is_none(), "{bare}");
    let note = |words: &str| fs::read_to_string(cell.out().join("report.html")).unwrap().contains(words);
    assert!(note("What the calibration of the rig adds is not part of them"));

    cell.small.reconstruct(&[]).expect_success();
    let measure = |more: &[&str]| {
        let (plan, cloud, part) = (path("plan.toml"), path("cloud.ply"), path("part.json"));
        fringetool(&[&["measure", &plan, &cloud, "--json", &part][..], more].concat()).expect_success().stderr
    };
    measure(&[]);
    cell.small.edit("played.toml", "pairs = ", "calibration_shares = \"part.json\"\npairs = ");
    let refused = |words: &[&str]| {
        let output = run();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        for words in [&["part.json", "fringetool measure PLAN CLOUD --rig RIG --json FILE"], words].concat() {
            assert!(said.contains(words), "{said}\nlacks\n{words}");
        }
    };
    refused(&["provenance.rig_sha256", "was measured without one"]);
    // The other two cameras of the rig saw nothing of this part.
    let warned = measure(&["--rig", &path("rig.toml")]);
    assert!(warned.contains("footprint_px of cam1, cam2:") && !warned.contains("is known at"), "{warned}");
    ends_well();
    let with = feature(&cell);
    let of = |value: &Value, key: &str| value[key].as_f64().unwrap();
    let share = of(&json(path("part.json").as_ref())["features"][0], "u_calibration");
    assert!(share > 0.01 && of(&with, "u_calibration") == share, "{share}, {with}");
    assert_eq!((of(&with, "value"), of(&with, "u_noise")), (of(&bare, "value"), of(&bare, "u_noise")));
    assert!((of(&with, "u") / of(&bare, "u").hypot(share) - 1.0).abs() < 1e-12, "{with}");
    assert!(note("the calibration of the rig, as it was found on one part"));

    cell.small.edit("part.json", "\"u_calibration\"", "\"u_of_calibration\"");
    refused(&["features[0].u_calibration", "the share of feature \"d\" is missing"]);
    cell.small.edit("part.json", "\"u_of_calibration\": ", "\"u_calibration\": -");
    refused(&["features[0].u_calibration", "0 and more"]);
    fs::write(path("part.json"), "{}").unwrap();
    refused(&["is no result of a measurement"]);
    fs::remove_file(path("part.json")).unwrap();
    measure(&["--rig", &path("rig.toml")]);
    cell.small.edit("plan.toml", "margin_mm = 3.0", "margin_mm = 2.9");
    refused(&["provenance.plan_sha256", "the plan \"dome\" has "]);
    cell.small.edit("plan.toml", "margin_mm = 2.9", "margin_mm = 3.0");
    cell.small.edit("rig.toml", "focal_px = [", "focal_px = [1");
    refused(&["provenance.rig_sha256", "rig.toml has "]);
}

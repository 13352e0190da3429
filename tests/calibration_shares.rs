//! What a calibration adds to the uncertainty of features: found on one part, joined to the verdicts of a cell.

use crate::running::{Cell, json, results, text};
use crate::support::fringetool;
use files::hash::sha256_hex;
use serde_json::Value;
use std::fs;

const PLAN: &str = "format = \"fringecell-plan/1\"\nname = \"dome\"\n[[element]]\nkind = \"sphere\"\nname = \"s\"\n\
    center_mm = [0.0, 0.0, 0.0]\ndiameter_mm = 60.194\nmax_polar_deg = 75.0\nmargin_mm = 3.0\nmin_points = 100\n[[feature]]\n\
    kind = \"sphere-diameter\"\nname = \"d\"\nelement = \"s\"\nnominal_mm = 60.194\ntolerance_mm = [-9.0, 9.0]\n";

/// The rig file again, with the focal lengths of some of its cameras known to 4 px and those of the others exactly.
fn with_variances(cell: &Cell, cameras: &[usize]) {
    let path = cell.small.path("rig.toml");
    let rig = files::rig_file::read_rig(path.as_ref()).unwrap();
    let names: Vec<&str> = rig.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let size = 2 * names.len();
    let row = |i: usize| {
        (0..size).map(|j| if i == j && cameras.contains(&(i / 2)) { 16.0 } else { 0.0 }).collect::<Vec<f64>>()
    };
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

/// A cell that plays a recording and inspects it, and a rig file whose calibration is not exact.
fn planned(name: &str) -> Cell {
    let cell = Cell::played(name, 0.0, "");
    with_variances(&cell, &[0, 1, 2, 3]);
    fs::write(cell.small.path("plan.toml"), PLAN).unwrap();
    cell.small.edit("played.toml", "pairs = ", "plan = \"plan.toml\"\npairs = ");
    cell.small.reconstruct(&[]).expect_success();
    cell
}

/// Measures the part of the cell into `part.json`; what the program says.
fn measure(cell: &Cell, with_rig: bool) -> String {
    let [plan, cloud, rig, part] =
        ["plan.toml", "cloud.ply", "rig.toml", "part.json"].map(|name| cell.small.path(name));
    let mut arguments = vec!["measure", &plan, &cloud, "--json", &part, "--force"];
    if with_rig {
        arguments.extend(["--rig", rig.as_str()]);
    }
    fringetool(&arguments).expect_success().stderr
}

/// Proves: the shares that were found on a part join the uncertainties of a cell in squares, in result and report; without them, a cell has none
/// and says so.
#[test]
fn a_cell_takes_the_shares_of_a_measured_part() {
    let cell = planned("shares");
    let ends_well = |warned: bool| {
        let output = cell.run("played.toml", &["--cycles", "1"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{}{said}", text(&output.stdout));
        let warning = "counts for nothing in the features of recipe \"default\"";
        assert_eq!(said.contains(warning), warned, "{said}");
    };
    ends_well(true);
    let bare = feature(&cell);
    assert!(bare.get("u_calibration").is_none(), "{bare}");
    let note = |words: &str| fs::read_to_string(cell.out().join("report.html")).unwrap().contains(words);
    assert!(note("calibration of the rig adds is not part of them"));
    // The other two cameras of the rig saw nothing of this part.
    let warned = measure(&cell, true);
    assert!(warned.contains("footprint_px of cam1, cam2:") && !warned.contains("is known at"), "{warned}");
    cell.small.edit("played.toml", "pairs = ", "calibration_shares = \"part.json\"\npairs = ");
    ends_well(false);
    let with = feature(&cell);
    let of = |value: &Value, key: &str| value[key].as_f64().unwrap();
    let share = of(&json(cell.small.path("part.json").as_ref())["features"][0], "u_calibration");
    assert!(share > 0.01 && of(&with, "u_calibration") == share, "{share}, {with}");
    assert_eq!((of(&with, "value"), of(&with, "u_noise")), (of(&bare, "value"), of(&bare, "u_noise")));
    assert!((of(&with, "u") / of(&bare, "u").hypot(share) - 1.0).abs() < 1e-12, "{with}");
    assert!(note("the calibration of the rig, as it was found on one part"));
    let record = cell.small.path("with.record");
    let recorded = cell.run("played.toml", &["--cycles", "1", "--cycle-record", &record]);
    assert_eq!(recorded.status.code(), Some(0), "{}", text(&recorded.stderr));
    let file = fs::read(cell.small.path("part.json")).unwrap();
    assert_eq!(results(&cell.out()).last().unwrap()["calibration_shares_sha256"], sha256_hex(&file));
    fringetool(&["replay", &record]).expect_success();
    cell.small.edit("part.json", "\"points\"", "\"of_points\"");
    let replayed = fringetool(&["replay", &record]);
    let changed = replayed.stderr.contains("the calibration_shares of recipe \"default\" changed");
    assert!(replayed.code == Some(2) && changed, "{}", replayed.stderr);
}

/// Proves: shares of another rig, plan, pair, feature or unit, impossible ones, and a result without shares are refused with file, key and remedy,
/// by a recipe as well.
#[test]
fn shares_of_something_else_are_refused() {
    let cell = planned("others");
    cell.small.edit("played.toml", "plan = \"plan.toml\"\n", "");
    let played = fs::read_to_string(cell.small.path("played.toml")).unwrap();
    let recipe = "[[recipe]]\nname = \"r\"\nplan = \"plan.toml\"\ncalibration_shares = \"part.json\"\n";
    fs::write(cell.small.path("played.toml"), format!("{played}{recipe}")).unwrap();
    let refused = |words: &[&str]| {
        let output = cell.run("played.toml", &["--cycles", "1"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        for words in [&["part.json", "fringetool measure PLAN CLOUD --rig RIG --json FILE"], words].concat() {
            assert!(said.contains(words), "{said}\nlacks\n{words}");
        }
    };
    measure(&cell, false);
    refused(&["provenance.rig_sha256", "was measured with an unknown one"]);
    measure(&cell, true);
    let change = |from: &str, to: &str| cell.small.edit("part.json", from, to);
    change("\"u_calibration\"", "\"u_of_calibration\"");
    refused(&["features[0].u_calibration", "the share of feature \"d\" is missing"]);
    change("\"u_of_calibration\": ", "\"u_calibration\": -");
    refused(&["features[0].u_calibration", "0 … 1000"]);
    change("\"u_calibration\": -", "\"u_calibration\": 1e300, \"u_was\": ");
    refused(&["features[0].u_calibration", "0 … 1000"]);
    change("\"unit\": \"mm\"", "\"unit\": \"deg\"");
    refused(&["features[0].unit", "the plan has mm"]);
    change(
        "\"features\": [",
        "\"features\": [{ \"name\": \"d\", \"unit\": \"mm\", \"u_calibration\": 0.0 },",
    );
    refused(&["features[0].name", "feature \"d\" occurs twice"]);
    change("\"cloud_rig_sha256\": \"", "\"cloud_rig_sha256\": null, \"was\": \"");
    refused(&["cloud_rig_sha256", "was measured with an unknown one"]);
    change("\"cloud_rig_sha256\": null, \"was\": \"", "\"cloud_rig_sha256\": \"");
    change("\"pair1\"", "\"pair1\", \"pair2\"");
    refused(&["pairs", "seen by pair1, pair2", "the cell measures with pair1"]);
    fs::write(cell.small.path("part.json"), "{}").unwrap();
    refused(&["part.json:1", "is no result of a measurement"]);
    measure(&cell, true);
    cell.small.edit("plan.toml", "margin_mm = 3.0", "margin_mm = 2.9");
    refused(&["provenance.plan_sha256", "the plan \"dome\" has SHA-256 "]);
    cell.small.edit("plan.toml", "margin_mm = 2.9", "margin_mm = 3.0");
    cell.small.edit("rig.toml", "focal_px = [", "focal_px = [1");
    refused(&["provenance.rig_sha256", "rig.toml has SHA-256 "]);
}

/// Proves: the points of the second pair alone are those of its cameras: what only the first pair's cameras may err by adds nothing to them.
#[test]
fn shares_belong_to_the_cameras_that_saw_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let cell = Cell::new("pairs");
    let text = fs::read_to_string(cell.small.path("cell.toml")).unwrap();
    let second = text.replace("pair1", "pair2").replace("proj1", "proj2");
    fs::write(
        cell.small.path("cell.toml"),
        second.replace("\"cam2\"", "\"cam4\"").replace("\"cam1\"", "\"cam3\""),
    )
    .unwrap();
    fringetool(&["simulate", &cell.small.path("cell.toml"), "--out", &path("rec")]).expect_success();
    fs::write(path("plan.toml"), PLAN).unwrap();
    let rig = cell.small.path("rig.toml");
    let bare = fs::read_to_string(&rig).unwrap();
    let share = |cameras: [usize; 2]| {
        fs::write(&rig, &bare).unwrap();
        with_variances(&cell, &cameras);
        let (plan, cloud, part) = (path("plan.toml"), path("cloud.ply"), path("part.json"));
        fringetool(&["reconstruct", "--rig", &rig, "--out", &cloud, "--force", &path("rec")])
            .expect_success();
        fringetool(&["measure", &plan, &cloud, "--rig", &rig, "--json", &part, "--force"]).expect_success();
        let part = json(part.as_ref());
        assert_eq!(part["pairs"], serde_json::json!(["pair2"]));
        part["features"][0]["u_calibration"].as_f64().unwrap()
    };
    let [others, own] = [[0, 1], [2, 3]].map(share);
    // What the footprints may be wrong by is in both.
    assert!(own > 3.0 * others, "{own} mm by the cameras that saw it, {others} mm by the others");
}

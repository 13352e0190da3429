//! Phase methods on a recording without known truth: compared with all of its steps, or with another recording.

use crate::support::{Small, fringetool};
use serde_json::Value;

fn cell<'a>(result: &'a Value, method: &str) -> &'a Value {
    let cells = result["cells"].as_array().unwrap();
    cells.iter().find(|cell| cell["method"] == method).unwrap()
}

/// The even and the odd steps are different frames, and the phase of all is their mean: so the six even ones differ from it by just
/// what the two halves say, three steps by more, and a method that the recording does not allow states why.
#[test]
fn methods_are_held_against_all_steps_of_a_recording() {
    let small = Small::new();
    small.edit("cell.toml", "steps = 10", "steps = 12");
    let (config, recording, json) = (small.path("cell.toml"), small.path("twelve"), small.path("r.json"));
    fringetool(&["simulate", &config, "--out", &recording]).expect_success();
    fringetool(&["bench", "phase-methods", "--recording", &recording, "--json", &json]).expect_success();
    let result: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let reference = &result["references"][0];
    let halves_rad = reference["halves_rad"].as_f64().unwrap();
    let ratio = halves_rad / reference["stated_rad"].as_f64().unwrap();
    assert!((0.5..3.0).contains(&ratio), "{reference}");
    let rms = |method: &str| cell(&result, method)["rms_rad"].as_f64().unwrap();
    assert!((rms("6 steps") / halves_rad - 1.0).abs() < 0.1, "{} {halves_rad}", rms("6 steps"));
    assert!(rms("3 steps") > 1.2 * rms("6 steps"), "{} {}", rms("3 steps"), rms("6 steps"));
    let same = cell(&result, "all steps, Gray");
    assert_eq!((same["rms_rad"].as_f64(), same["wrong_orders"].as_f64()), (Some(0.0), Some(0.0)));
    let refused = cell(&result, "Hariharan")["refused"].as_str().unwrap();
    assert!(refused.contains("90 degrees"), "{refused}");

    let two = ["bench", "phase-methods", "--recording", &recording, "--recording", &recording];
    let ran = fringetool(&[&two[..], &["--reference", &recording]].concat());
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    assert!(ran.stderr.contains("--reference") && ran.stderr.lines().count() == 1, "{}", ran.stderr);
}

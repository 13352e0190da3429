//! Files that change under a running cell: it keeps what it started with, or refuses; never half of each.

use crate::running::{Cell, json, pid_of, results, signal, text, wait};
use crate::support::root;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A played cell with a plan.
fn planned(name: &str, limits: &str, rate_hz: f64) -> Cell {
    let cell = Cell::played(name, rate_hz, limits);
    fs::copy(root().join("configs/complex-artefact.plan.toml"), cell.small.path("plan.toml")).unwrap();
    cell.small.edit("played.toml", "pairs = ", "plan = \"plan.toml\"\npairs = ");
    cell
}

/// One pixel of a frame becomes another; the file stays a frame.
fn alter(frame: &str) {
    let mut image = image::open(frame).unwrap().to_luma8();
    image.get_pixel_mut(80, 60).0[0] ^= 0x3f;
    image.save(frame).unwrap();
}

/// What a cell reads, each with a change that would give other results or none.
fn change(cell: &Cell, file: &str) {
    match file {
        "played.toml" => {
            cell.small.edit(file, "[limits]", "[decode]\nmin_modulation_fraction = 0.05\n[limits]");
        }
        "rig.toml" => cell.small.edit(file, "focal_px = [", "focal_px = [1"),
        "plan.toml" => cell.small.edit(file, "diameter_mm = 22.462", "diameter_mm = 22.4"),
        "rec/recording.toml" => cell.small.edit(file, "stripe_px = 8.0", "stripe_px = 16.0"),
        frame => alter(&cell.small.path(frame)),
    }
}

const FILES: [(&str, &str); 5] = [
    ("played.toml", "decode/cam1"),
    ("rig.toml", "matching/pair1"),
    ("plan.toml", "inspection"),
    ("rec/recording.toml", "decode/cam2"),
    ("rec/frames/proj1/cam2/004.png", "capture/cam2"),
];

fn clouds(folder: &Path) -> Vec<Value> {
    let ok = results(folder).into_iter().filter(|result| result["outcome"] == "ok");
    ok.map(|result| result["hashes"]["cloud/fused"].clone()).collect()
}

/// Proves: a stage that is started again after one of the files changed is refused with the name of the file, and no cycle
/// gives another cloud than those before.
#[test]
fn a_stage_that_starts_again_refuses_files_that_changed() {
    for (number, (file, stage)) in FILES.into_iter().enumerate() {
        let cell = planned(&format!("restart{number}"), "restarts_max = 1", 20.0);
        let run = cell.program("played.toml", &["--cycles", "60"]).spawn().unwrap();
        cell.until("one cycle done", |status| status["cycles_done"].as_u64() >= Some(1));
        let status = cell.until_a_cycle_begins();
        change(&cell, file);
        signal("KILL", pid_of(&status, stage));
        let output = wait(run);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{file}: {said}");
        let what = if file.starts_with("rec/frames/") {
            "the frames of camera \"cam2\" in the recording have changed since the start of the cell"
                .to_owned()
        } else {
            format!("{} has changed since the start of the cell", file.rsplit('/').next().unwrap())
        };
        let changed_frame = "was changed while the recording is played";
        assert!(said.contains(&what) || said.contains(changed_frame), "{file}: {said}");
        let clouds = clouds(&cell.out());
        assert!(!clouds.is_empty() && clouds.iter().all(|cloud| *cloud == clouds[0]), "{file}: {clouds:?}");
    }
}

/// Proves: a serving cell measures on with what it started with when a file changes between two jobs, and states by its
/// hashes what that was; frames cannot be kept, so a changed one is refused by name.
#[test]
fn a_serving_cell_keeps_what_it_started_with() {
    let cell = planned("jobs", "", 0.0);
    let run = cell.serving("played.toml");
    let (first, _) = cell.part("first");
    assert_eq!(first["outcome"], "ok", "{first}");
    for (file, _) in FILES.into_iter().take(4) {
        change(&cell, file);
        let (next, _) = cell.part(file);
        for key in ["outcome", "hashes", "config_sha256", "rig_sha256", "plan_sha256", "verdict"] {
            assert_eq!(next[key], first[key], "{file}: {key}");
        }
    }
    let frame = FILES[4].0;
    let whole = fs::read(cell.small.path(frame)).unwrap();
    change(&cell, frame);
    let (refused, code) = cell.part("changed frame");
    let outcome = refused["outcome"].as_str().unwrap();
    assert_eq!(code, Some(1));
    assert!(outcome.contains("frame 004 of camera \"cam2\"") && outcome.contains("004.png"), "{outcome}");
    assert!(outcome.contains("was changed while the recording is played"), "{outcome}");
    // A frame that is there again is believed: it is the one that was hashed.
    fs::write(cell.small.path(frame), whole).unwrap();
    assert_eq!(cell.part("restored").0["hashes"], first["hashes"]);
    cell.stop(run);
    assert_eq!(json(&cell.out().join("result.json"))["outcome"], "ok");
}

/// Proves: frames that change while they are played end their cycles by name; no cycle is ok with another cloud.
#[test]
fn a_played_recording_that_changes_is_noticed() {
    let cell = Cell::played("swap", 40.0, "");
    let run = cell.program("played.toml", &["--cycles", "6"]).spawn().unwrap();
    cell.until("two cycles done", |status| status["cycles_done"].as_u64() >= Some(2));
    alter(&cell.small.path("rec/frames/proj1/cam1/007.png"));
    let output = wait(run);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let clouds = clouds(&cell.out());
    assert!((2..6).contains(&clouds.len()) && clouds.iter().all(|cloud| *cloud == clouds[0]), "{clouds:?}");
    let all = results(&cell.out());
    let failed: Vec<&str> =
        all.iter().filter_map(|r| r["outcome"].as_str()).filter(|outcome| *outcome != "ok").collect();
    assert_eq!(failed.len() + clouds.len(), 6);
    assert!(failed.iter().all(|outcome| outcome.contains("007.png")), "{failed:?}");
}

/// Proves: a mesh that changes under a cell of the twin changes no cloud, and the stage that would read it again is refused with
/// its name.
#[test]
fn a_mesh_that_changes_is_never_half_of_a_measurement() {
    let cell = Cell::new("mesh");
    for name in ["bracket.scene.toml", "bracket.stl"] {
        fs::copy(root().join("configs/bracket").join(name), cell.small.path(name)).unwrap();
    }
    let config = fs::read_to_string(cell.small.path("cell.toml")).unwrap();
    let (before, _) = config.split_once("scene = ").unwrap();
    let config = format!("{before}scene = \"bracket.scene.toml\"\n[limits]\nrestarts_max = 1\n");
    fs::write(cell.small.path("bracket.toml"), config).unwrap();
    let run = cell.serving("bracket.toml");
    assert_eq!(cell.part("1").0["outcome"], "ok");
    let mut mesh = fs::read(cell.small.path("bracket.stl")).unwrap();
    let middle = mesh.len() / 2;
    mesh[middle] ^= 1;
    fs::write(cell.small.path("bracket.stl"), mesh).unwrap();
    assert_eq!(cell.part("2").0["outcome"], "ok", "what was read is kept");
    signal("KILL", pid_of(&cell.status().unwrap(), "capture/cam1"));
    let status = cell.until("in error", |status| status["state"] == "Error");
    let reason = status["reason"].as_str().unwrap();
    assert!(reason.contains("bracket.stl has changed since the start of the cell"), "{reason}");
    cell.stop(run);
}

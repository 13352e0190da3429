//! A small cell through the real binary: what it measures, how it ends, and what it leaves when parts of it die.
//!
//! Durations are not asserted; every wait has a limit so that a dead lock fails instead of hanging.

use crate::running::{Cell, PATIENCE, is_alive, json, not_run, pid_of, results, signal, text, wait};
use serde_json::Value;
use std::process::Command;
use std::time::{Duration, Instant};

#[test]
fn a_cell_measures_writes_its_files_and_leaves_nothing_in_shared_memory() {
    let cell = Cell::new("ok");
    let output = cell.run("cell.toml", &["--cycles", "2"]);
    assert_eq!(output.status.code(), Some(0), "{}\n{}", text(&output.stdout), text(&output.stderr));
    let result = json(&cell.out().join("result.json"));
    assert_eq!((&result["outcome"], &result["cycle"]), (&"ok".into(), &1.into()));
    assert!(result["points"].as_u64().unwrap() > 1000, "{result}");
    assert!(result["latency_ns"].as_u64().unwrap() > 0);
    for stage in result["stages"].as_array().unwrap() {
        assert!(stage["compute_ns"].as_u64().unwrap() > 0, "{stage}");
    }
    let trace = json(&cell.out().join("trace.json"));
    assert!(trace["traceEvents"].as_array().unwrap().len() > 100);
    let cloud = files::ply::read_cloud(&cell.out().join("cloud.ply")).unwrap();
    assert_eq!(cloud.points.len() as u64, result["points"].as_u64().unwrap());
    assert!(std::fs::read_to_string(cell.out().join("report.html")).unwrap().contains("cam1"));
    assert_eq!(results(&cell.out()).len(), 2);
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: nothing behind the driver depends on which driver it was, on timing, or on an earlier cycle.
#[test]
fn played_frames_give_the_same_bytes_as_live_ones_cycle_after_cycle() {
    let cell = Cell::played("same", 0.0, "");
    let recorded = cell.small.path("live");
    cell.run("cell.toml", &["--cycles", "1", "--record", &recorded]);
    let live = json(&cell.out().join("result.json"));
    cell.small.edit("played.toml", "path = \"rec\"", "path = \"live\"");
    let output = cell.run("played.toml", &["--cycles", "3"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let played = results(&cell.out());
    assert_eq!(played.len(), 3);
    for result in &played {
        assert_eq!(result["hashes"], live["hashes"], "cycle {}", result["cycle"]);
    }
    assert_eq!(live["hashes"].as_object().unwrap().len(), 7, "{}", live["hashes"]);
}

#[test]
fn a_killed_stage_ends_its_cycle_with_the_reason_and_is_replaced() {
    let cell = Cell::played("kill", 20.0, "");
    let run = cell.program("played.toml", &["--cycles", "4"]).spawn().unwrap();
    let before = pid_of(&cell.until_a_cycle_begins(), "decode/cam2");
    signal("KILL", before);
    let after = cell.until("restarted", |s| {
        s["stages"].as_array().unwrap().iter().any(|s| s["restarts"] == 1 && s["state"] == "up")
    });
    assert_ne!(pid_of(&after, "decode/cam2"), before);
    let output = wait(run);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let outcomes: Vec<String> =
        results(&cell.out()).iter().map(|r| r["outcome"].as_str().unwrap().to_owned()).collect();
    let bad: Vec<&String> = outcomes.iter().filter(|outcome| *outcome != "ok").collect();
    assert_eq!(
        (outcomes.len(), bad),
        (4, vec![&"stage decode/cam2 died (signal 9)".to_owned()]),
        "{outcomes:?}"
    );
    assert_eq!(cell.left(), Vec::<String>::new());
}

#[test]
fn a_hung_stage_is_found_by_its_missing_progress_and_replaced() {
    let cell = Cell::played("hang", 20.0, "stage_budget_ms = 1500");
    let run = cell.program("played.toml", &["--cycles", "3"]).spawn().unwrap();
    signal("STOP", pid_of(&cell.until_a_cycle_begins(), "decode/cam1"));
    let output = wait(run);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let results = results(&cell.out());
    let bad: Vec<&Value> = results.iter().filter(|r| r["outcome"] != "ok").collect();
    let outcome = bad[0]["outcome"].as_str().unwrap();
    assert_eq!((results.len(), bad.len()), (3, 1), "{outcome}");
    assert!(outcome.starts_with("stage decode/cam1 hung: no progress for"), "{outcome}");
    assert!(outcome.contains("the limit is 1500 ms"), "{outcome}");
}

#[test]
fn a_stage_that_dies_again_and_again_makes_the_cell_give_up_and_say_so() {
    let cell = Cell::played("held", 20.0, "restarts_max = 1");
    let run = cell.program("played.toml", &["--cycles", "9"]).spawn().unwrap();
    signal("KILL", pid_of(&cell.until_a_cycle_begins(), "fusion"));
    let again = cell.until("restarted", |s| {
        let fusion = s["stages"].as_array().unwrap().iter().find(|s| s["name"] == "fusion").unwrap();
        fusion["restarts"] == 1 && fusion["state"] == "up"
    });
    signal("KILL", pid_of(&again, "fusion"));
    let output = wait(run);
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stderr);
    assert!(said.contains("the cell gave up: stage fusion failed 2 times within 60 s"), "{said}");
    assert_eq!(results(&cell.out()).len() + not_run(&output), 9, "every requested cycle is accounted for");
}

#[test]
fn the_interrupt_key_a_second_supervisor_and_stop() {
    let cell = Cell::played("stop", 20.0, "");
    for how in ["INT", "TERM", "QUIT", "HUP", "stop"] {
        let run = cell.program("played.toml", &[]).spawn().unwrap();
        let status = cell.until("running", |status| status["cycle"].is_u64());
        let pid = status["pid"].as_u64().unwrap();

        // The same cell once more, without a folder of its own and with the same folder.
        let config = cell.small.path("played.toml");
        let again = ["run", &config, "--cell", &cell.name, "--cycles", "1"];
        let second = Command::new(env!("CARGO_BIN_EXE_fringecell")).args(again).output().unwrap();
        let third = cell.run("played.toml", &["--cycles", "1"]);
        for (ran, expected) in [(second, "is already running, pid"), (third, "is already running, pid")] {
            assert_eq!(ran.status.code(), Some(2));
            let said = text(&ran.stderr);
            assert!(said.contains(expected) && said.contains(&pid.to_string()), "{said}");
        }

        if how == "stop" {
            let program = env!("CARGO_BIN_EXE_fringecell");
            let stop = Command::new(program).args(["stop", "--cell", &cell.name]).output().unwrap();
            assert!(stop.status.success(), "{}", text(&stop.stderr));
            assert_eq!(cell.left(), Vec::<String>::new(), "gone when stop returns");
        } else {
            signal(how, pid);
        }
        let output = wait(run);
        assert_eq!(output.status.code(), Some(0), "{how}: {}", text(&output.stderr));
        assert_eq!(cell.left(), Vec::<String>::new(), "{how}");
        let stage = pid_of(&status, "projection");
        assert!(!is_alive(stage), "{how} left a stage");
    }
}

/// Proves: restarts that an operator requests are no failures, and a stop counts the cycles that are not run in one line.
#[test]
fn restarts_by_an_operator_are_no_failures_and_a_stop_counts_what_is_not_run() {
    let cell = Cell::played("operator", 20.0, "restarts_max = 1");
    let run = cell.program("played.toml", &["--cycles", "300"]).spawn().unwrap();
    let program = env!("CARGO_BIN_EXE_fringecell");
    let fusion = |status: &Value| {
        status["stages"].as_array().unwrap().iter().find(|s| s["name"] == "fusion").unwrap().clone()
    };
    for restarts in 0..6 {
        cell.until("up", |s| fusion(s)["state"] == "up" && fusion(s)["restarts"] == restarts);
        let asked = Command::new(program).args(["restart", "fusion", "--cell", &cell.name]).output().unwrap();
        assert!(asked.status.success(), "{}", text(&asked.stderr));
    }
    cell.until("up again", |s| fusion(s)["restarts"] == 6 && s["state"] == "ContinuousExecution");
    let stop = Command::new(program).args(["stop", "--cell", &cell.name]).output().unwrap();
    assert!(stop.status.success(), "{}", text(&stop.stderr));
    let output = wait(run);
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stdout);
    assert_eq!(said.matches(" not run: stopped by the operator").count(), 1, "{said}");
    assert_eq!(results(&cell.out()).len() + not_run(&output), 300);
}

#[test]
fn a_killed_supervisor_takes_its_stages_with_it_and_the_next_one_cleans_up() {
    let cell = Cell::played("orphan", 20.0, "");
    let run = cell.program("played.toml", &[]).spawn().unwrap();
    let status = cell.until("running", |status| status["cycle"].is_u64());
    let stage = pid_of(&status, "decode/cam1");
    // One that hangs cannot end itself.
    signal("STOP", stage);
    signal("KILL", status["pid"].as_u64().unwrap());
    wait(run);
    let begin = Instant::now();
    while is_alive(stage) {
        assert!(begin.elapsed() < PATIENCE, "stage {stage} outlived its supervisor");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(!cell.left().is_empty(), "this test would prove nothing if the kernel cleaned up");
    let output = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(cell.left(), Vec::<String>::new());
}

#[test]
fn a_truncated_frame_ends_each_cycle_with_the_name_of_the_file() {
    let cell = Cell::played("cut", 0.0, "");
    let frame = cell.small.folder.path().join("rec/frames/proj1/cam2/004.png");
    let bytes = std::fs::read(&frame).unwrap();
    std::fs::write(&frame, &bytes[..bytes.len() / 2]).unwrap();
    let output = cell.run("played.toml", &["--cycles", "2"]);
    assert_eq!(output.status.code(), Some(1));
    let results = results(&cell.out());
    assert_eq!(results.len(), 2);
    for result in results {
        let outcome = result["outcome"].as_str().unwrap();
        assert!(outcome.starts_with("stage capture/cam2: ") && outcome.contains("cam2/004.png"), "{outcome}");
    }
    assert!(!cell.out().join("cloud.ply").exists(), "there is no cloud without a good cycle");
}

#[test]
fn frames_without_light_end_each_cycle_with_the_reason() {
    let cell = Cell::played("dark", 0.0, "");
    for camera in ["cam1", "cam2"] {
        for number in 0..19 {
            let frame = cell.small.path(&format!("rec/frames/proj1/{camera}/{number:03}.png"));
            let (width, height) = crate::support::SMALL_PX;
            image::GrayImage::from_pixel(width, height, image::Luma([2])).save(frame).unwrap();
        }
    }
    let output = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let outcome = results(&cell.out())[0]["outcome"].as_str().unwrap().to_owned();
    assert!(outcome.starts_with("stage fusion: no point at all"), "{outcome}");
    assert!(!cell.out().join("cloud.ply").exists());
}

/// Proves: no cycle runs then whose budget would find it, and the cell goes on all the same.
#[test]
fn a_stage_that_stands_still_while_another_is_started_again_is_ended() {
    let cell = Cell::played("connect", 50.0, "");
    let run = cell.program("played.toml", &["--cycles", "6"]).spawn().unwrap();
    let status = cell.until_a_cycle_begins();
    signal("KILL", pid_of(&status, "fusion"));
    signal("STOP", pid_of(&status, "decode/cam1"));
    let output = wait(run);
    assert!(text(&output.stderr).contains("did not connect within"), "{}", text(&output.stderr));
    let results = results(&cell.out());
    assert_eq!((results.len(), &results[5]["outcome"]), (6, &"ok".into()), "{}", text(&output.stdout));
}

#[test]
fn no_output_of_a_run_overwrites_what_it_reads_or_another_output() {
    let cell = Cell::played("inputs", 0.0, "");
    let (config, rig, file) =
        (cell.small.path("played.toml"), cell.small.path("rig.toml"), cell.small.path("one.file"));
    let refused = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_fringecell")).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output.stderr));
        text(&output.stderr)
    };
    for input in [&config, &rig] {
        assert!(refused(&["run", &config, "--trace", input]).contains("would overwrite an input"));
        assert!(refused(&["schedule", &config, "--picture", input]).contains("would overwrite an input"));
    }
    let both = refused(&["run", &config, "--trace", &file, "--cycle-record", &file]);
    assert!(both.contains("is also the file of --cycle-record"), "{both}");
}

#[test]
fn measured_times_are_held_against_the_limits_of_the_schedule() {
    let cell = Cell::played("limits", 0.0, "");
    cell.run("played.toml", &["--cycles", "1"]);
    cell.small.edit("played.toml", "[limits]\n", "[limits]\ncycle_deadline_ms = 60000\n");
    let tight = std::fs::read_to_string(cell.small.path("played.toml")).unwrap();
    std::fs::write(cell.small.path("tight.toml"), tight.replace("= 60000", "= 1\nstage_budget_ms = 1"))
        .unwrap();
    let result = cell.out().join("result.json");
    for (file, code, words) in
        [("played.toml", 0, "deadline 60000 ms kept"), ("tight.toml", 1, "deadline 1 ms EXCEEDED")]
    {
        let mut program = Command::new(env!("CARGO_BIN_EXE_fringecell"));
        program.args(["schedule", &cell.small.path(file)]).arg("--result").arg(&result);
        let output = program.output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{}", text(&output.stderr));
        assert!(text(&output.stdout).contains(words), "{}", text(&output.stdout));
    }
}

#[test]
fn the_schedule_is_printed_the_same_every_time() {
    let cell = Cell::new("plan");
    let print = || {
        let program = env!("CARGO_BIN_EXE_fringecell");
        Command::new(program).args(["schedule", &cell.small.path("cell.toml")]).output().unwrap()
    };
    let (first, second) = (print(), print());
    assert!(first.status.success(), "{}", text(&first.stderr));
    assert_eq!(first.stdout, second.stdout);
    let table = text(&first.stdout);
    for words in ["core 0", "core 1", "expose proj1 018", "match pair1", "inspect", "cloud/fused"] {
        assert!(table.contains(words), "{words}");
    }
}

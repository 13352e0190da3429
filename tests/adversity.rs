//! Faults of the machine: no memory, a full disk, a closed output, another cell on the same machine.

use crate::running::{Cell, PATIENCE, children, json, not_run, pid_of, poke, results, signal, text, wait};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::FileExt;
use std::process::{Command, Output, Stdio};
use std::time::Instant;

/// Runs a script as root of file systems of its own. `None`, said in one line, where the machine does not permit that.
pub fn in_own_namespace(script: &str) -> Option<Output> {
    let inside = |command: &str| Command::new("unshare").args(["-rm", "sh", "-c", command]).output();
    if !inside("true").is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: this machine permits no file systems of one's own (unshare -rm)");
        return None;
    }
    Some(inside(script).unwrap())
}

pub fn programs() -> (&'static str, &'static str) {
    (env!("CARGO_BIN_EXE_fringecell"), env!("CARGO_BIN_EXE_fringetool"))
}

/// Proves: two cells that see different parts at the same time each measure their own, and the death of one is nothing to
/// the other.
#[test]
fn two_cells_do_not_hear_each_other() {
    let cells = ["left", "right"].map(|name| Cell::played(name, 100.0, ""));
    // The other sees one pixel otherwise: enough for another hash of every output.
    let frame = cells[1].small.path("rec/frames/proj1/cam1/018.png");
    let mut image = image::open(&frame).unwrap().to_luma8();
    image.get_pixel_mut(80, 60).0[0] ^= 1;
    image.save(&frame).unwrap();
    let alone = cells.each_ref().map(|cell| {
        assert_eq!(cell.run("played.toml", &["--cycles", "1"]).status.code(), Some(0));
        results(&cell.out())[0]["hashes"].clone()
    });
    assert_ne!(alone[0]["frame/cam1"], alone[1]["frame/cam1"]);
    let runs = cells.each_ref().map(|cell| cell.program("played.toml", &["--cycles", "4"]).spawn().unwrap());
    signal("KILL", pid_of(&cells[0].until_a_cycle_begins(), "decode/cam1"));
    let outputs = runs.map(wait);
    assert_eq!(outputs.map(|output| output.status.code()), [Some(1), Some(0)]);
    for (cell, alone) in cells.iter().zip(&alone) {
        let results = results(&cell.out());
        assert_eq!(results.len(), 4);
        for result in results.iter().filter(|r| r["outcome"] == "ok") {
            assert_eq!(result["hashes"], *alone, "{}", cell.name);
        }
        assert_eq!(cell.left(), Vec::<String>::new());
    }
}

/// A run whose stage gets no memory after it was killed; `None` where the new stage had mapped shared memory before it could be limited, as on a
/// busy machine, so that nothing was tried.
fn starved() -> Option<(Cell, Output)> {
    let cell = Cell::played("memory", 50.0, "restarts_max = 1");
    let run = cell.program("played.toml", &["--cycles", "9"]).spawn().unwrap();
    let status = cell.until_a_cycle_begins();
    let before = children(run.id());
    poke("KILL", pid_of(&status, "decode/cam1"));
    let begin = Instant::now();
    let newcomer = loop {
        if let Some(pid) = children(run.id()).into_iter().find(|pid| !before.contains(pid)) {
            break pid;
        }
        assert!(begin.elapsed() < PATIENCE, "decode/cam1 was not started again");
    };
    poke("STOP", newcomer);
    let limited = Command::new("prlimit").args(["--as=1", "--pid", &newcomer.to_string()]).status();
    assert!(limited.is_ok_and(|status| status.success()));
    let maps = std::fs::read_to_string(format!("/proc/{newcomer}/maps")).unwrap();
    poke("CONT", newcomer);
    let output = wait(run);
    (!maps.contains("/dev/shm/")).then_some((cell, output))
}

/// Proves: a stage for which there is no memory fails with its own words, again after its restart, and then the cell holds
/// and states them.
#[test]
fn a_stage_that_finds_no_memory_makes_the_cell_give_up_with_its_last_words() {
    let (cell, output) =
        (0..5).find_map(|_| starved()).expect("a stage is limited in time once in five runs");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("the cell gave up: stage decode/cam1 failed 2 times within 60 s"), "{said}");
    println!("{said}");
    assert_eq!(results(&cell.out()).len() + not_run(&output), 9, "every requested cycle is accounted for");
    assert_eq!(cell.left(), Vec::<String>::new());
}

#[test]
fn a_reader_that_goes_away_does_not_stop_a_run_of_so_many_cycles() {
    let cell = Cell::played("head", 0.0, "");
    let mut run = cell.program("played.toml", &["--cycles", "3"]).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(run.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.contains("cycle   1/3  ok"), "{line}");
    let output = wait(run);
    let lost = "error: standard output: Broken pipe (os error 32)\n";
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(2), lost));
    assert_eq!(results(&cell.out()).len(), 3);
}

/// Proves: a frame whose bytes another process changes in shared memory ends its cycle and never becomes a cloud.
#[test]
fn a_changed_byte_of_a_frame_in_shared_memory_ends_the_cycle() {
    let cell = Cell::played("flipped", 0.0, "cycle_deadline_ms = 100000\nstage_budget_ms = 90000");
    let run = cell.program("played.toml", &["--serve"]).spawn().unwrap();
    let decode = pid_of(&cell.until("ready", |status| status["state"] == "Ready"), "decode/cam1");
    signal("STOP", decode);
    let file = cell.small.path("one.json");
    let trigger = ["trigger", &cell.name, "--part", "1", "--json", &file];
    let asked = Command::new(programs().0).args(trigger).stdout(Stdio::null()).spawn().unwrap();
    let frame = image::open(cell.small.path("rec/frames/proj1/cam1/000.png")).unwrap().to_luma8().into_raw();
    let begin = Instant::now();
    while !flip_a_byte(&cell, &frame) {
        assert!(begin.elapsed() < PATIENCE, "the frame is not in shared memory");
    }
    signal("CONT", decode);
    assert_eq!(wait(asked).status.code(), Some(1));
    let outcome = json(file.as_ref())["outcome"].as_str().unwrap().to_owned();
    assert_eq!(outcome, "stage decode/cam1: frame 000 of cam1: its pixels were changed in shared memory");
    let stop = Command::new(programs().0).args(["stop", "--cell", &cell.name]).output().unwrap();
    assert!(stop.status.success(), "{}", text(&stop.stderr));
    wait(run);
}

/// Changes a byte of a frame in the shared memory of a cell, if it is there.
fn flip_a_byte(cell: &Cell, frame: &[u8]) -> bool {
    let paths = cell.left().into_iter().map(|name| std::path::Path::new("/dev/shm").join(name));
    for path in paths.filter(|path| path.is_file()) {
        let Ok(bytes) = std::fs::read(&path) else { continue };
        if let Some(at) = bytes.windows(frame.len()).position(|window| window == frame) {
            let file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
            let middle = frame.len() / 2;
            file.write_all_at(&[frame[middle] ^ 1], (at + middle) as u64).unwrap();
            return true;
        }
    }
    false
}

/// Proves: output that is lost on a full device is an error with its reason, and neither stops a cell nor panics.
#[test]
fn a_full_device_behind_an_output_is_exit_code_2_with_the_reason() {
    let cell = Cell::played("full", 0.0, "");
    let full = || Stdio::from(std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    let (fringecell, fringetool) = programs();
    let config = cell.small.path("played.toml");
    for arguments in [&["schedule", &config][..], &["--version"]] {
        let output = Command::new(fringecell).args(arguments).stdout(full()).output().unwrap();
        let said = text(&output.stderr);
        if arguments[0] == "schedule" {
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(said.contains("standard output: No space left on device"), "{said}");
        }
        assert_ne!(output.status.code(), Some(101), "{arguments:?}: {said}");
    }
    let rig = cell.small.path("rig.toml");
    let plan = ["plan-patterns", "--rig", &rig, "--want-u-um", "50"];
    let output = Command::new(fringetool).args(plan).stdout(full()).output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("error: standard output: No space left on device"), "{said}");
    // An error that cannot be determined anywhere still has its exit code.
    let output = Command::new(fringetool)
        .args(["uncertainty", "no-such-file.toml"])
        .stdout(full())
        .stderr(full())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let run = cell.program("played.toml", &["--cycles", "2"]).stdout(full()).stderr(full()).spawn().unwrap();
    assert_eq!(wait(run).status.code(), Some(2));
    assert_eq!(results(&cell.out()).len(), 2, "the cell measures all the same");
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: a recording that a full disk cuts short is lost output, told with the file and what to do, and no recording is left.
#[test]
fn a_recording_that_a_full_disk_cuts_short_is_exit_code_2() {
    let cell = Cell::played("fullrec", 0.0, "");
    let folder = cell.small.path("disk");
    std::fs::create_dir(&folder).unwrap();
    let script = format!(
        "mount -t tmpfs -o size=64k none {folder} && {} run {} --cell {} --cycles 2 --record {folder}/frames; code=$?; \
         find {folder} -name recording.toml; exit $code",
        programs().0,
        cell.small.path("played.toml"),
        cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let said = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("error: cycle 1 is not recorded: ") && said.contains("free space on the disk"),
        "{said}"
    );
    assert!(said.contains("No space left on device") && !said.contains("recording.toml\n"), "{said}");
}

/// Proves: output of a program that was started without standard output is lost, and that is an error, too; what prints nothing is none.
#[test]
fn output_without_a_standard_output_is_exit_code_2() {
    let cell = Cell::played("closed", 0.0, "");
    let (fringecell, fringetool) = programs();
    let config = cell.small.path("played.toml");
    for (command, code) in [
        (format!("{fringecell} schedule {config}"), 2),
        (format!("{fringecell} schedule {config} --json -"), 2),
        (format!("{fringecell} --help"), 2),
        (format!("{fringetool} --version"), 2),
        (format!("{fringecell} schedule --quiet {config}"), 0),
        (format!("{fringecell} schedule {config} > /dev/null"), 0),
    ] {
        let script = if command.contains("null") { command.clone() } else { format!("{command} >&-") };
        let output = Command::new("sh").args(["-c", &script]).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{command}: {said}");
        assert_eq!(said.contains("error: standard output: it is closed"), code == 2, "{command}: {said}");
    }
}

#[test]
fn a_run_without_end_that_nobody_reads_any_more_ends() {
    let cell = Cell::played("unread", 0.0, "");
    let mut run = Command::new(programs().0)
        .args(["run", &cell.small.path("played.toml"), "--cell", &cell.name])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    BufReader::new(run.stdout.take().unwrap()).read_line(&mut String::new()).unwrap();
    let output = wait(run);
    let lost = "error: standard output: Broken pipe (os error 32)\n";
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(2), lost));
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: what a system does not permit is told in one line, and the cell measures without it.
#[test]
fn real_time_and_locked_memory_are_asked_for_and_not_needed() {
    let cell = Cell::played("steady", 0.0, "");
    let config = std::fs::read_to_string(cell.small.path("played.toml")).unwrap();
    let steady = "[schedule]\npin = true\nrealtime_priority = 10\nlock_memory = true\n";
    std::fs::write(cell.small.path("played.toml"), format!("{config}{steady}")).unwrap();
    let permitted = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(permitted.status.code(), Some(0), "{}", text(&permitted.stderr));
    let script = format!(
        "ulimit -l 64; exec setpriv --bounding-set=-all --inh-caps=-all {} run {} --cell {} --cycles 1",
        programs().0,
        cell.small.path("played.toml"),
        cell.name
    );
    let Some(refused) = in_own_namespace(&script) else { return };
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(0), "{said}");
    for key in
        ["schedule.realtime_priority: the system refuses", "schedule.lock_memory: the system does not allow"]
    {
        assert!(said.contains(key), "{said}");
    }
    assert_eq!(said.lines().count(), 2, "{said}");
}

#[test]
fn an_output_folder_that_cannot_be_written_is_refused_before_anything_starts() {
    let cell = Cell::played("sealed", 0.0, "");
    let output = Command::new(programs().0)
        .args(["run", &cell.small.path("played.toml"), "--cell", &cell.name, "--out", "/proc/fringecell"])
        .output()
        .unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("/proc/fringecell: cannot create the folder") && said.lines().count() == 1,
        "{said}"
    );
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: on a disk that fills up the cell measures on, the cycles that fitted are whole, and the exit code tells.
#[test]
fn a_disk_that_fills_up_costs_cycles_of_the_record_and_nothing_else() {
    let cell = Cell::played("disk", 0.0, "");
    let (fringecell, fringetool) = programs();
    let script = format!(
        "mkdir -p {disk} && mount -t tmpfs -o size=2m disk {disk} || exit 9
         {fringecell} run {config} --cell {name} --cycles 6 --cycle-record {disk}/r --keep frames; echo run $?
         {fringetool} replay {disk}/r; echo replay $?",
        disk = cell.small.path("disk"),
        config = cell.small.path("played.toml"),
        name = cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(said.matches("  ok  ").count(), 6, "{said}{cried}");
    assert!(
        said.contains("run 2") && said.contains("replay 0") && said.contains("all equal"),
        "{said}{cried}"
    );
    assert!(cried.contains("cycles are missing in the cycle record"), "{cried}");
    assert!(
        cried.contains("cannot write the cycle record; free space on the disk: No space left"),
        "{cried}"
    );
    let replayed: u64 = said.split("disk/r: ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((1..6).contains(&replayed), "{said}");
}

#[test]
fn too_little_shared_memory_is_refused_with_both_numbers() {
    let cell = Cell::played("shm", 0.0, "");
    let script = format!(
        "mount -t tmpfs -o size=2m shm /dev/shm || exit 9
         {} run {} --cell {} --cycles 1; echo run $?; ls /dev/shm | wc -l",
        programs().0,
        cell.small.path("played.toml"),
        cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(said.trim(), "run 2\n0", "{cried}");
    assert!(cried.contains("/dev/shm has 2 MB free") && cried.contains("need up to"), "{cried}");
}

/// Proves: shared memory of just the size that the schedule states is enough for a cell whose stages are killed one after the
/// other, with and without an output folder.
#[test]
fn shared_memory_as_the_schedule_states_is_enough_after_any_restart() {
    let cell = Cell::played("sized", 100.0, "restarts_max = 100");
    let config = cell.small.path("played.toml");
    let schedule = Command::new(programs().0).args(["schedule", &config, "--json", "-"]).output().unwrap();
    let schedule: serde_json::Value = serde_json::from_slice(&schedule.stdout).unwrap();
    for (key, out) in
        [("run_bytes", String::new()), ("run_out_bytes", format!("--out {}", cell.small.path("out")))]
    {
        let bytes = schedule["memory"][key].as_u64().unwrap();
        let script = format!(
            "mount -t tmpfs -o size={bytes} shm /dev/shm || exit 9
             {program} run {config} --cell {name} --cycles 60 {out} & run=$!
             until {program} status {name} --once 2>/dev/null | grep -q ' up '; do
               kill -0 $run 2>/dev/null || break; sleep 0.05
             done
             for round in 1 2 3; do
               for stage in projection capture/cam1 decode/cam1 decode/cam2 matching/pair1 fusion inspection; do
                 {program} restart $stage --cell {name} >/dev/null
                 for look in 1 2 3 4 5 6 7 8; do sleep 0.05; df --output=used -B1 /dev/shm | tail -1 >> {used}; done
               done
             done
             {program} stop {name}; wait $run; echo run $?; ls /dev/shm | wc -l",
            program = programs().0,
            name = cell.name,
            used = cell.small.path("used"),
        );
        let Some(output) = in_own_namespace(&script) else { return };
        let (said, cried) = (text(&output.stdout), text(&output.stderr));
        assert!(said.contains("  ok  "), "{key} {bytes}: {said}{cried}");
        let used = std::fs::read_to_string(cell.small.path("used")).unwrap();
        let most = used.lines().filter_map(|line| line.trim().parse::<u64>().ok()).max().unwrap();
        std::fs::remove_file(cell.small.path("used")).unwrap();
        println!("{key}: {bytes} bytes stated, {most} used");
        assert!(most <= bytes && !cried.contains("/dev/shm"), "{key} {bytes}, {most} used: {said}{cried}");
        assert!(said.matches("  ok  ").count() >= 10, "{said}{cried}");
        assert!(said.trim().ends_with("\n0"), "something is left in shared memory: {said}{cried}");
    }
}

/// Proves: a process that takes the last shared memory while the cell runs costs the cycles of the stage that needs some,
/// with the reason, and when there is room again the cell goes on.
#[test]
fn shared_memory_that_fills_up_is_named_and_the_cell_goes_on_when_there_is_room() {
    let cell = Cell::played("filled", 50.0, "");
    let script = format!(
        "mount -t tmpfs -o size=60m shm /dev/shm || exit 9
         {program} run {config} --cell {name} --cycles 8 --out {out} &
         sleep 1; dd if=/dev/zero of=/dev/shm/fill bs=1M 2>/dev/null
         {program} restart decode/cam1 --cell {name}
         sleep 1; rm /dev/shm/fill; wait $!; ls /dev/shm | wc -l",
        program = programs().0,
        config = cell.small.path("played.toml"),
        out = cell.small.path("out"),
        name = cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    let results = results(&cell.out());
    assert_eq!((results.len(), &results[7]["outcome"]), (8, &"ok".into()), "{said}{cried}");
    assert!(cried.contains("/dev/shm"), "the stage that found no room did not say so: {said}{cried}");
    assert!(said.trim().ends_with("\n0"), "something is left in shared memory: {said}");
}

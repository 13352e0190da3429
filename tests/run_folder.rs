//! The output folder of a run: no run is mixed with another, none is lost, and one cell at a time writes to it.

use crate::running::{Cell, json, pid_of, signal, text, wait};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

impl Cell {
    /// The folders of earlier runs.
    fn earlier(&self) -> Vec<PathBuf> {
        let mut runs: Vec<PathBuf> = fs::read_dir(self.out().join("runs"))
            .map(|entries| entries.map(|entry| entry.unwrap().path()).collect())
            .unwrap_or_default();
        runs.sort();
        runs
    }

    pub fn serving(&self, config: &str) -> Child {
        let run = self.program(config, &["--serve"]).spawn().unwrap();
        self.until("ready", |status| status["state"] == "Ready");
        run
    }

    /// The result of one part, and the exit code of its request.
    pub fn part(&self, part: &str) -> (Value, Option<i32>) {
        let file = self.small.path("part.json");
        let _ = fs::remove_file(&file);
        let mut trigger = Command::new(env!("CARGO_BIN_EXE_fringecell"));
        let output = trigger.args(["trigger", &self.name, "--part", part, "--json", &file]).output().unwrap();
        let result = if Path::new(&file).exists() { json(Path::new(&file)) } else { Value::Null };
        (result, output.status.code())
    }

    pub fn stop(&self, run: Child) -> std::process::Output {
        let stop = ["stop", "--cell", &self.name];
        let output = Command::new(env!("CARGO_BIN_EXE_fringecell")).args(stop).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        wait(run)
    }
}

/// What a run writes to its folder, without the folder of earlier ones and the store over all runs.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.filter(|name| name != "runs" && name != "parts.jsonl").collect();
    names.sort();
    names
}

const ALL: [&str; 6] = ["cloud.ply", "report.html", "result.json", "results", "run.json", "trace.json"];

/// Proves: a second run into the same folder loses nothing of the first and mixes nothing with it; a run whose only cycle
/// failed leaves no cloud beside its result.
#[test]
fn a_run_moves_the_one_before_aside_and_shows_its_own_files_only() {
    let cell = Cell::played("again", 0.0, "");
    assert_eq!(cell.run("played.toml", &["--cycles", "2"]).status.code(), Some(0));
    assert_eq!(names(&cell.out()), ALL);
    fs::write(cell.out().join("notes.txt"), "mine").unwrap();
    let first: Vec<Vec<u8>> = ["cloud.ply", "result.json", "run.json"]
        .map(|name| fs::read(cell.out().join(name)).unwrap())
        .to_vec();

    // The second run: its cycle dies.
    cell.small.edit("played.toml", "rate_hz = 0.0", "rate_hz = 20.0");
    let run = cell.program("played.toml", &["--cycles", "1"]).spawn().unwrap();
    let status = cell.until("in its cycle", |status| status["cycle"].is_u64());
    signal("KILL", pid_of(&status, "matching/pair1"));
    assert_eq!(wait(run).status.code(), Some(1));
    assert!(json(&cell.out().join("result.json"))["outcome"].as_str().unwrap().contains("died"));
    assert_eq!(
        names(&cell.out()).iter().filter(|name| *name == "cloud.ply").count(),
        0,
        "{:?}",
        names(&cell.out())
    );
    assert_eq!(fs::read_dir(cell.out().join("results")).unwrap().count(), 1);
    assert_eq!(fs::read(cell.out().join("notes.txt")).unwrap(), b"mine");

    let runs = cell.earlier();
    assert_eq!((runs.len(), names(&runs[0])), (1, ALL.map(str::to_owned).to_vec()));
    let kept = ["cloud.ply", "result.json", "run.json"].map(|name| fs::read(runs[0].join(name)).unwrap());
    assert_eq!(kept.to_vec(), first);
    let stamp = runs[0].file_name().unwrap().to_str().unwrap().to_owned();
    assert!(stamp.ends_with("Z-1") && stamp.len() == "20260131T080000Z-1".len(), "{stamp}");
    assert_eq!(cell.run("played.toml", &["--cycles", "1"]).status.code(), Some(0));
    assert_eq!(cell.earlier().len(), 2);
    let store = fs::read_to_string(cell.out().join("parts.jsonl")).unwrap();
    assert_eq!(store.lines().count(), 4, "a line for each cycle of the three runs");
}

/// Proves: no run takes a folder that another one would move aside, and a run that is refused moves nothing.
#[test]
fn a_folder_within_a_run_and_a_cell_that_runs_leave_the_results_where_they_are() {
    let cell = Cell::played("within", 0.0, "");
    assert_eq!(cell.run("played.toml", &["--cycles", "1"]).status.code(), Some(0));
    let before = names(&cell.out());
    let within = |option: &str, folder: &str| {
        let folder = cell.out().join(folder).display().to_string();
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_fringecell"));
        program.args([
            "run",
            &cell.small.path("played.toml"),
            "--cell",
            &cell.name,
            "--cycles",
            "1",
            option,
            &folder,
        ]);
        let output = program.output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{option} {folder}");
        assert!(
            text(&output.stderr).contains("lies within the results of a run"),
            "{}",
            text(&output.stderr)
        );
    };
    for folder in ["results", "parts/new", "runs/a/b", "results/../results/x"] {
        within("--out", folder);
        within("--record", folder);
    }
    std::os::unix::fs::symlink(cell.out(), cell.small.path("link")).unwrap();
    within("--out", "../link/results");
    let run = cell.serving("played.toml");
    let moved = names(&cell.out());
    let second = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(second.status.code(), Some(2));
    assert!(text(&second.stderr).contains("is already running, pid"), "{}", text(&second.stderr));
    let elsewhere = cell.small.path("elsewhere");
    fs::create_dir(&elsewhere).unwrap();
    let third = cell.run("played.toml", &["--cycles", "1", "--record", &elsewhere]);
    assert_eq!(third.status.code(), Some(2));
    assert_eq!(names(&cell.out()), moved);
    signal("TERM", u64::from(run.id()));
    wait(run);
    assert!(before.contains(&"cloud.ply".to_owned()) && cell.earlier().len() == 1);
}

/// Proves: a move that was broken off is continued, and files that no run wrote are neither moved nor replaced.
#[test]
fn a_broken_move_is_continued_and_foreign_files_are_refused() {
    let cell = Cell::played("move", 0.0, "");
    assert_eq!(cell.run("played.toml", &["--cycles", "1"]).status.code(), Some(0));
    let moving = cell.out().join("runs/.moving");
    fs::create_dir_all(&moving).unwrap();
    for name in ["run.json", "result.json", "cloud.ply"] {
        fs::rename(cell.out().join(name), moving.join(name)).unwrap();
    }
    assert_eq!(cell.run("played.toml", &["--cycles", "1"]).status.code(), Some(0));
    let runs = cell.earlier();
    assert_eq!((runs.len(), names(&runs[0])), (1, ALL.map(str::to_owned).to_vec()));

    fs::remove_dir_all(cell.out()).unwrap();
    fs::create_dir(cell.out()).unwrap();
    fs::write(cell.out().join("report.html"), "<html>mine</html>").unwrap();
    let output = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("holds report.html, which no run wrote"),
        "{}",
        text(&output.stderr)
    );
    assert_eq!(names(&cell.out()), ["report.html"]);
}

/// Proves: of two cells on one folder the second is refused with the name of the first, by whatever path it comes, and the
/// first is told; both in one line. Nothing of the first is touched.
#[test]
fn two_cells_on_one_folder_are_both_told() {
    let cell = Cell::played("first", 0.0, "");
    let run = cell.serving("played.toml");
    assert_eq!(cell.part("a").1, Some(0));
    let before = fs::read(cell.out().join("result.json")).unwrap();
    std::os::unix::fs::symlink("out", cell.small.path("other")).unwrap();
    for path in ["out", "other", "rec/../out"] {
        let other = format!("{}-b", cell.name);
        let mut second = Command::new(env!("CARGO_BIN_EXE_fringecell"));
        second.args(["run", &cell.small.path("played.toml"), "--cell", &other, "--cycles", "1"]);
        let output = second.args(["--out", &cell.small.path(path)]).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        let expected = format!("cell '{}' (process {} on ", cell.name, run.id());
        assert!(said.contains(&expected) && said.contains("writes there; name another folder"), "{said}");
    }
    assert_eq!(fs::read(cell.out().join("result.json")).unwrap(), before);
    assert_eq!(cell.part("b").1, Some(0));
    let said = text(&cell.stop(run).stderr);
    assert_eq!(said.matches("wanted this folder and was refused").count(), 3, "{said}");
    assert!(said.contains(&format!("cell '{}-b'", cell.name)), "{said}");
    assert!(!cell.out().join(".fringecell.lock").exists());
}

/// Proves: the lock of a run that was killed stops nobody; its files are kept as those of an earlier run. Of a run whose
/// lock was taken away nothing more is written.
#[test]
fn the_lock_of_a_killed_run_is_stale_and_a_lost_lock_ends_writing() {
    let cell = Cell::played("stale", 0.0, "");
    let mut run = cell.serving("played.toml");
    assert_eq!(cell.part("a").1, Some(0));
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(cell.out().join(".fringecell.lock").exists());
    let run = cell.serving("played.toml");
    assert_eq!(cell.part("b").1, Some(0));
    assert_eq!(json(&cell.earlier()[0].join("result.json"))["part"], "a");

    fs::remove_file(cell.out().join(".fringecell.lock")).unwrap();
    let (result, code) = cell.part("c");
    assert_eq!(
        (result["outcome"].as_str(), result["kept"].as_str(), code),
        (Some("ok"), Some("no, disk"), Some(1))
    );
    assert_eq!(json(&cell.out().join("result.json"))["part"], "b");
    let said = text(&cell.stop(run).stderr);
    assert!(said.contains("ended without removing its lock"), "{said}");
    assert!(said.contains("the lock of this run was removed or replaced"), "{said}");
}

/// Proves: a serving cell keeps result, cloud and report of every part, as many as its configuration states.
#[test]
fn a_serving_cell_keeps_the_files_of_its_last_parts() {
    let cell = Cell::played("parts", 0.0, "");
    let config = fs::read_to_string(cell.small.path("played.toml")).unwrap();
    fs::write(cell.small.path("few.toml"), format!("{config}[results]\nkeep_parts = 2\n")).unwrap();
    let run = cell.serving("few.toml");
    let parts = cell.out().join("parts");
    for (part, expected) in
        [("a", vec!["0001-a"]), ("b/1", vec!["0001-a", "0002-b_1"]), ("c", vec!["0002-b_1", "0003-c"])]
    {
        assert_eq!(cell.part(part).1, Some(0));
        assert_eq!(numbered(&parts), expected);
        let latest = fs::read_link(parts.join("latest")).unwrap();
        assert_eq!(latest.to_str(), expected.last().copied(), "a link to the newest");
    }
    for (folder, part) in [("0002-b_1", "b/1"), ("0003-c", "c")] {
        let folder = parts.join(folder);
        assert_eq!(names(&folder), ["cloud.ply", "report.html", "result.json"]);
        let result = json(&folder.join("result.json"));
        assert_eq!(result["part"], part);
        let cloud = files::ply::read_cloud(&folder.join("cloud.ply")).unwrap();
        assert_eq!(Some(cloud.points.len() as u64), result["points"].as_u64());
        assert!(fs::read_to_string(folder.join("report.html")).unwrap().contains(part));
    }
    cell.stop(run);
    assert_eq!(fs::read_dir(cell.out().join("results")).unwrap().count(), 3);
    let size: u64 = 1; // MB: one cloud of this cell is smaller, three are not
    fs::write(cell.small.path("few.toml"), format!("{config}[results]\nkeep_mb = {size}\n")).unwrap();
    let run = cell.serving("few.toml");
    for part in ["d", "e", "f", "g"] {
        assert_eq!(cell.part(part).1, Some(0));
    }
    let bytes = |folder: &Path| -> u64 {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
    };
    let kept = numbered(&parts);
    let all: u64 = kept.iter().map(|name| bytes(&parts.join(name))).sum();
    assert!(all <= size * 1_000_000 || kept.len() == 1, "{all}");
    assert!(kept.last().unwrap().ends_with("-g") && kept.len() < 4, "{kept:?}");
    cell.stop(run);
}

/// The folders of parts, without the link to the newest.
fn numbered(parts: &Path) -> Vec<String> {
    names(parts).into_iter().filter(|name| name != "latest").collect()
}

/// Proves: results, parts and earlier runs of a cell that serves are bounded, the oldest go first; a run of so many cycles
/// removes nothing, and neither removes what no run wrote.
#[test]
fn a_serving_cell_bounds_results_parts_and_earlier_runs() {
    let cell = Cell::played("bounded", 0.0, "");
    let config = fs::read_to_string(cell.small.path("played.toml")).unwrap();
    fs::write(cell.small.path("few.toml"), format!("{config}[results]\nkeep_results = 3\nkeep_parts = 2\n"))
        .unwrap();
    assert_eq!(cell.run("few.toml", &["--cycles", "5"]).status.code(), Some(0));
    assert_eq!(fs::read_dir(cell.out().join("results")).unwrap().count(), 5, "a run of so many cycles");
    let notes = cell.out().join("runs/20000101T000000Z-1");
    fs::create_dir_all(&notes).unwrap();
    fs::write(notes.join("notes.txt"), "mine").unwrap();

    let run = cell.serving("few.toml");
    let first = cell.earlier().into_iter().next_back().unwrap();
    let left = |folder: &Path| fs::read_dir(folder.join("results")).map_or(0, Iterator::count);
    assert_eq!(left(&first), 5, "nothing is removed before there is something new");
    assert_eq!(cell.part("a").1, Some(0));
    // One new result, the earlier run itself, and one of its results.
    assert_eq!((left(&first), left(&cell.out())), (1, 1));
    assert!(first.join("results/0005.json").exists() && first.join("cloud.ply").exists());
    assert_eq!(cell.part("b").1, Some(0));
    assert!(!first.join("cloud.ply").exists() && first.join("run.json").exists(), "two parts are kept");
    assert_eq!(cell.part("c").1, Some(0));
    assert!(!first.exists(), "an earlier run goes with its last result");
    assert_eq!(numbered(&cell.out().join("parts")), ["0002-b", "0003-c"]);
    assert_eq!(cell.part("d").1, Some(0));
    assert_eq!(names(&cell.out().join("results")), ["0002.json", "0003.json", "0004.json"]);
    cell.stop(run);

    let run = cell.serving("few.toml");
    assert_eq!(cell.part("e").1, Some(0));
    cell.stop(run);
    let second = cell.earlier().into_iter().next_back().unwrap();
    // Three results: the new one, the earlier run itself, and its last one; parts: the new one and the files of that run.
    assert_eq!((left(&second), left(&cell.out())), (1, 1));
    assert!(second.join("results/0004.json").exists() && second.join("report.html").exists());
    assert_eq!(numbered(&second.join("parts")), Vec::<String>::new());
    assert_eq!(fs::read(notes.join("notes.txt")).unwrap(), b"mine");
}

/// Proves: each result with features is also in the formats that the configuration asks for, with the name of its part, and they go
/// with it; a cycle without features has none of them; a format that nobody knows is refused.
#[test]
fn results_are_in_the_formats_asked_for_and_go_together() {
    let cell = Cell::played("formats", 0.0, "");
    let config = fs::read_to_string(cell.small.path("played.toml")).unwrap();
    fs::write(cell.small.path("all.plan.toml"), crate::control::plan(-50.0, 50.0)).unwrap();
    let results =
        "[results]\nkeep_results = 2\nformats = [\"dfq\", \"pdf\", \"csv\", \"html\", \"qif\", \"csv\"]\n";
    let recipe = "[[recipe]]\nname = \"all\"\nplan = \"all.plan.toml\"\n";
    fs::write(cell.small.path("formats.toml"), format!("{config}{recipe}{results}")).unwrap();
    let run = cell.serving("formats.toml");
    for part in ["a", "b\"<b>", "c"] {
        assert_eq!(cell.part(part).1, Some(0), "{part}");
    }
    cell.stop(run);
    let kept: Vec<String> = [2, 3]
        .iter()
        .flat_map(|number| {
            ["csv", "dfq", "html", "json", "pdf", "qif"].map(|kind| format!("{number:04}.{kind}"))
        })
        .collect();
    assert_eq!(names(&cell.out().join("results")), kept);
    let read = |name: &str| fs::read(cell.out().join("results").join(name)).unwrap();
    assert!(read("0002.pdf").starts_with(b"%PDF"));
    let html = String::from_utf8(read("0002.html")).unwrap();
    assert!(html.contains("&lt;b&gt;") && !html.contains("b\"<b>"), "names stay text");
    assert!(String::from_utf8(read("0003.dfq")).unwrap().contains("K0014/1 c\r\n"));
    let lines = String::from_utf8(read("0003.csv")).unwrap().lines().count();
    let features = json(&cell.out().join("results/0003.json"))["features"].as_array().unwrap().len();
    assert_eq!(lines, 1 + features);
    assert!(String::from_utf8(read("0003.qif")).unwrap().contains("part c"));

    let plain = Cell::played("noformats", 0.0, "");
    fs::write(plain.small.path("formats.toml"), format!("{config}{results}")).unwrap();
    assert_eq!(plain.run("formats.toml", &["--cycles", "1"]).status.code(), Some(0));
    assert_eq!(names(&plain.out().join("results")), ["0001.json"], "no plan, no features");
    fs::write(plain.small.path("wrong.toml"), format!("{config}[results]\nformats = [\"xls\"]\n")).unwrap();
    let refused = plain.run("wrong.toml", &["--cycles", "1"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(
        ["results.formats", "xls", "html, pdf, csv, qif, dfq"].iter().all(|word| said.contains(word)),
        "{said}"
    );
}

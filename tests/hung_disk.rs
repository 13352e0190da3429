//! A disk under `--out` that does not answer: control, monitoring and the clients go on.

use crate::running::{Cell, json, results, text, wait};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// `fsync` of a disk that hangs for as long as a file exists. Every file of a result is flushed before it is renamed.
const SHIM: &str = r#"
#include <stdlib.h>
#include <sys/syscall.h>
#include <unistd.h>
int fsync(int file) {
    const char *hangs = getenv("HUNG_DISK");
    while (hangs && access(hangs, F_OK) == 0) usleep(10000);
    return syscall(SYS_fsync, file);
}
"#;

/// A serving cell whose disk hangs on demand.
struct Served {
    cell: Cell,
    run: Child,
}

impl Served {
    fn new(name: &str) -> Self {
        let cell = Cell::played(name, 0.0, "");
        let run = on_a_disk_that_hangs(&cell, &["--serve"]).spawn().unwrap();
        cell.until("ready", |status| status["state"] == "Ready");
        Self { cell, run }
    }

    fn trigger(&self, part: &str, file: &str) -> Child {
        let mut trigger = Command::new(env!("CARGO_BIN_EXE_fringecell"));
        trigger.args(["trigger", &self.cell.name, "--part", part, "--json", file]);
        trigger.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    fn hang(&self) {
        std::fs::write(self.cell.small.path("hangs"), "").unwrap();
    }

    fn part_on_disk(&self) -> serde_json::Value {
        json(&self.cell.out().join("result.json"))["part"].clone()
    }

    fn stop(&self) {
        let stop = ["stop", "--cell", &self.cell.name];
        let output = Command::new(env!("CARGO_BIN_EXE_fringecell")).args(stop).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
}

/// A run whose disk hangs on demand.
fn on_a_disk_that_hangs(cell: &Cell, more: &[&str]) -> Command {
    let (source, shim) = (cell.small.path("shim.c"), cell.small.path("shim.so"));
    std::fs::write(&source, SHIM).unwrap();
    let built = Command::new("cc").args(["-shared", "-fPIC", "-o", &shim, &source]).status().unwrap();
    assert!(built.success(), "the C compiler builds the disk that hangs");
    let mut run = cell.program("played.toml", more);
    run.env("LD_PRELOAD", shim).env("HUNG_DISK", cell.small.path("hangs"));
    run
}

/// Proves: an answer without reservation means that the files are there; a disk that hangs delays one answer, which states it,
/// and nothing else; a disk that comes back loses nothing.
#[test]
fn a_hung_disk_stops_neither_control_nor_answers() {
    let served = Served::new("hung");
    let file = served.cell.small.path("one.json");
    let first = wait(served.trigger("first", &file));
    assert_eq!(first.status.code(), Some(0), "{}", text(&first.stderr));
    assert_eq!(served.part_on_disk(), "first");

    served.hang();
    let mut second = served.trigger("second", &file);
    served.cell.until("past the second part", |status| status["cycles_done"] == 2);
    // The cycle is over and the cell answers others, but nobody is told "ok" before the file is there.
    for _ in 0..20 {
        assert!(served.cell.status().is_some());
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(second.try_wait().unwrap().is_none(), "answered before its files were written");
    assert_eq!(served.part_on_disk(), "first");
    let second = wait(second);
    assert_eq!(second.status.code(), Some(1), "{}", text(&second.stdout));
    assert!(text(&second.stderr).contains("not kept: no, disk"), "{}", text(&second.stderr));
    let result = json(file.as_ref());
    assert_eq!((&result["outcome"], &result["kept"]), (&"ok".into(), &"no, disk".into()));
    crate::schema::assert_valid("result", Path::new(&file));
    assert_eq!(served.cell.status().unwrap()["state"], "Ready");

    std::fs::remove_file(served.cell.small.path("hangs")).unwrap();
    assert_eq!(wait(served.trigger("third", &file)).status.code(), Some(0));
    assert!(json(file.as_ref()).get("kept").is_none());
    assert_eq!(served.part_on_disk(), "third");
    served.stop();
    let Served { cell, run } = served;
    let output = wait(run);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("cycle 2: --out: the disk did not answer within 10 s"), "{said}");
    assert_eq!(results(&cell.out()).len(), 3);
}

/// Proves: a cell whose disk never comes back stops, and states what is missing.
#[test]
fn a_cell_on_a_hung_disk_stops_with_what_is_missing() {
    let served = Served::new("dead");
    served.hang();
    let file = served.cell.small.path("one.json");
    let waiting = served.trigger("only", &file);
    served.cell.until("past the part", |status| status["cycles_done"] == 1);
    served.stop();
    let Served { cell, run } = served;
    let output = wait(run);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("error: 1 result is not written: --out: the disk did not answer within 10 s"),
        "{said}"
    );
    assert_eq!(wait(waiting).status.code(), Some(1), "who waited has an answer");
    assert_eq!(json(file.as_ref())["kept"], "no, disk");
    assert!(!cell.out().join("result.json").exists());
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: a supervisor that panics waits for the disk as well; the last result is not lost.
#[test]
fn a_supervisor_that_panics_waits_for_the_disk() {
    let cell = Cell::played("both", 20.0, "");
    let mut run = on_a_disk_that_hangs(&cell, &["--cycles", "50"]);
    std::fs::create_dir(cell.small.path("requests")).unwrap();
    let mut run = run.env("FRINGECELL_PANIC_DRILL", cell.small.path("requests")).spawn().unwrap();
    cell.until("in its first cycle", |status| status["cycle"].is_u64());
    std::fs::write(cell.small.path("hangs"), "").unwrap();
    let request = cell.small.folder.path().join("requests/supervisor");
    std::fs::write(&request, "").unwrap();
    while request.exists() {
        std::thread::sleep(Duration::from_millis(10));
    }
    // Long enough for the stages to end, and shorter than a disk is waited for.
    std::thread::sleep(Duration::from_secs(4));
    assert!(run.try_wait().unwrap().is_none(), "ended before the disk answered");
    std::fs::remove_file(cell.small.path("hangs")).unwrap();
    let output = wait(run);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("panic: a panic was requested"), "{said}");
    let results = results(&cell.out());
    let failed = "the supervisor failed: panic: a panic was requested";
    assert_eq!(results.iter().map(|result| &result["outcome"]).collect::<Vec<_>>(), [failed]);
    assert_eq!(cell.left(), Vec::<String>::new());
}

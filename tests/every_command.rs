//! Every command of both programs: what stands on standard output, and what becomes of output that nobody takes.

use crate::acceptance::spheres;
use crate::acceptance_report::master;
use crate::running::{Cell, text, wait};
use crate::support::{fringetool, fringetool_in, root};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::os::fd::AsFd as _;
use std::process::{Child, Command, Output, Stdio};

/// Commands of `fringetool` that take seconds, in an order in which inputs come first. `DIR` has the inputs, `NEW` is a folder
/// of its own for each pass, `CONFIGS` that of the repository. All of them take `--json`.
const QUICK: &[&str] = &[
    "simulate DIR/cell.toml --out NEW/rec",
    "decode DIR/rec",
    "explore DIR/rec",
    "unwrap DIR/rec",
    "reconstruct --rig DIR/rig.toml --out NEW/cloud.ply DIR/rec",
    "reference-plane calibrate --plane 0=DIR/z0 --plane 10=DIR/z10 --plane 20=DIR/z20 --out NEW/planes",
    "reference-plane measure DIR/z10 --calibration NEW/planes --out NEW/heights.npy",
    "rotation-stage calibrate --diameter 20 --out NEW/stage.toml --view 0=DIR/ball0.ply --view 40=DIR/ball40.ply \
     --view 80=DIR/ball80.ply",
    "rotation-stage merge --stage NEW/stage.toml --view 0=DIR/ball0.ply --view 40=DIR/ball40.ply --out NEW/whole.ply",
    "fit sphere DIR/ball0.ply",
    "flatness --box=-25,-25,-5,25,25,5 DIR/plane.ply",
    "compare DIR/cloud.ply DIR/cloud.ply",
    "register DIR/cloud.ply --to DIR/cloud.ply --out NEW/aligned.ply",
    "measure DIR/plan.toml DIR/cloud.ply",
    "place DIR/plan.toml DIR/cloud.ply --out NEW/placed.toml",
    "vdi2634 DIR/thesis.test.toml",
    "cmm-plan part DIR/plan.toml --points 25 --out NEW/probing.csv",
    "cmm-compare DIR/measured.json CONFIGS/complex-artefact.cmm.csv",
    "import DIR/layout.toml --from DIR/rec/frames/proj1 --out NEW/imported",
    "export --rig DIR/rig.toml --pair pair1 --out NEW/stereo.yml",
    "import-rig NEW/stereo.yml --views cam1,cam2 --out NEW/imported.toml",
    "calibrate --target DIR/target.toml --images left=DIR/left*.png --out NEW/calibrated.toml",
    "check-rig DIR/lit --rig DIR/lit-rig.toml",
    "gamma DIR/grey",
    "focus --images DIR/focus*.png --positions 460:560:10",
    "uncertainty CONFIGS/budgets/sphere-spacing.toml",
    "plan-patterns --rig DIR/rig.toml --want-u-um 50",
    "report DIR/master.json --csv NEW/values.csv",
    "replay DIR/record",
    "cameras",
];

/// Commands that take a minute or more.
const SLOW: &[&str] = &[
    "simulate-test --reduced --out NEW/test",
    "bench accuracy",
    "bench calibration --trials 2 --images 0",
    "bench error-sources",
    "bench exposures",
    "bench order-errors",
    "bench peers-case --case stream",
    "bench phase-methods",
    "bench plan-patterns",
    "bench speed --repeats 1",
    "bench stage-axis",
    "bench unwrap",
    "bench transport",
];

/// Commands that end only when they are stopped; see the tests of network cameras.
const ENDLESS: &[&str] = &["serve-camera DIR/cell.toml"];

/// Commands whose output is no result.
const WITHOUT_JSON: &[&str] = &["completions bash", "man --out NEW/man"];

/// What the commands of the table need.
struct Inputs {
    cell: Cell,
}

impl Inputs {
    fn new() -> Self {
        let inputs = Self { cell: Cell::played("table", 0.0, "") };
        let small = &inputs.cell.small;
        small.reconstruct(&[]).expect_success();
        // Limits and numbers of points for so few points.
        let plan = small.path("plan.toml");
        std::fs::write(&plan, crate::control::plan(-50.0, 50.0)).unwrap();
        let run = |line: &str| fringetool(&inputs.words(line, "")).expect_success();
        fringetool(&["measure", &plan, &small.path("cloud.ply"), "--json", &small.path("measured.json")])
            .expect_success();
        run("simulate DIR/cell.toml --scene CONFIGS/plane.scene.toml --grey-levels 32 --out DIR/grey");
        std::fs::write(small.path("master.json"), master().to_string()).unwrap();
        let layout = "format = \"fringecell-layout/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\n\
            sequence = [\n{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 },\n\
            { set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 },\n{ set = \"white\" }, { set = \"black\" },\n]\n\
            [[projector.camera]]\nname = \"cam1\"\nfiles = \"cam1/{nnn}.png\"\n\
            [[projector.camera]]\nname = \"cam2\"\nfiles = \"cam2/{nnn}.png\"\n";
        std::fs::write(small.path("layout.toml"), layout).unwrap();
        inputs.clouds();
        crate::focus::stack(small.folder.path());
        crate::calibrate_bad::boards(small.folder.path());
        crate::rig_state::lit(small.folder.path());
        crate::single_view::planes(small.folder.path(), &[0.0, 10.0, 20.0]);
        crate::acceptance::thesis_test(small.folder.path());
        let recorded =
            inputs.cell.run("played.toml", &["--cycles", "1", "--cycle-record", &small.path("record")]);
        assert_eq!(recorded.status.code(), Some(0), "{}", text(&recorded.stderr));
        inputs
    }

    /// A ball on a rotation stage, and a plane.
    fn clouds(&self) {
        for degrees in [0, 40, 80] {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let ball = spheres(&[([30.0 * cos, 30.0 * sin, 5.0], 20.0)]);
            std::fs::write(self.cell.small.path(&format!("ball{degrees}.ply")), ball).unwrap();
        }
        let mut plane = "ply\nformat ascii 1.0\nelement vertex 62500\nproperty double x\nproperty double y\nproperty double \
            z\nend_header\n"
            .to_owned();
        for i in 0..62_500 {
            let at = |step: i32| 0.2 * f64::from(step) - 25.0;
            let _ = writeln!(plane, "{} {} {}", at(i % 250), at(i / 250), 0.001 * f64::from(i * 7 % 11));
        }
        std::fs::write(self.cell.small.path("plane.ply"), plane).unwrap();
    }

    fn words(&self, line: &str, pass: &str) -> Vec<String> {
        let (folder, configs) = (self.cell.small.path(""), root().join("configs").display().to_string());
        let folder = folder.trim_end_matches('/');
        let line = line.replace("CONFIGS", &configs).replace("NEW", &format!("DIR/{pass}"));
        line.replace("DIR", folder).split_whitespace().map(str::to_owned).collect()
    }

    /// Runs a line of the table.
    fn run(&self, line: &str, pass: &str, more: &[&str], stdout: Stdio) -> Output {
        std::fs::create_dir_all(self.cell.small.path(pass)).unwrap();
        let mut program = Command::new(env!("CARGO_BIN_EXE_fringetool"));
        program.args(self.words(line, pass)).args(more).stdout(stdout).stderr(Stdio::piped());
        // Outside the repository: what is not named is part of the program.
        output(program.current_dir(self.cell.small.folder.path()))
    }
}

/// Runs a program; reads while it writes, because what it writes may be more than a pipe holds.
fn output(program: &mut Command) -> Output {
    program.spawn().unwrap().wait_with_output().unwrap()
}

/// A device without space.
fn full() -> Stdio {
    Stdio::from(std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap())
}

/// A pipe whose reader has gone.
pub fn unread() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    let writer = writer.as_fd().try_clone_to_owned().unwrap();
    drop(reader);
    Stdio::from(writer)
}

/// Fails unless standard output is one JSON document and nothing else.
fn expect_json(line: &str, output: &Output) -> Value {
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert!(matches!(output.status.code(), Some(0 | 1)), "{line}: {:?}\n{said}\n{cried}", output.status);
    let value: Value =
        serde_json::from_str(&said).unwrap_or_else(|error| panic!("{line}: {error}\n{said}\n{cried}"));
    assert!(value.is_object() || value.is_array(), "{line}: {said}");
    value
}

/// Fails unless a document follows its schema.
fn follows(schema: &str, value: &Value) {
    let schema = crate::schema::schema(schema).unwrap();
    assert_eq!(crate::schema::faults(&schema, value), Vec::<String>::new());
}

/// Fails unless lost output is exit code 2 with its reason.
fn expect_lost(line: &str, output: &Output, reason: &str) {
    let cried = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{line}: {cried}");
    let told = format!("error: standard output: {reason}");
    assert!(cried.lines().any(|line| line.starts_with(&told)), "{line}: {cried}");
    assert!(!cried.contains("panicked"), "{line}: {cried}");
}

/// A file that no command wrote.
const FOREIGN: &str = "{\"mine\": true}\n";

/// Fails unless an output that would replace a file of another kind is refused, and the file is what it was.
fn expect_kept(line: &str, file: &str, run: impl FnOnce(&str) -> Output) {
    std::fs::write(file, FOREIGN).unwrap();
    let output = run(file);
    let cried = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{line}: {cried}");
    assert!(cried.contains("add --force"), "{line}: {cried}");
    assert_eq!(std::fs::read_to_string(file).unwrap(), FOREIGN, "{line}");
}

/// Prints a row of the table of commands.
fn print_row(command: &str) {
    println!("| `{command}` | JSON alone | exit code 2, reason | exit code 2, reason | refused, unchanged |");
}

fn check(inputs: &Inputs, lines: &[&str]) {
    println!("| command | `--json -` | full device | reader gone | existing file of another kind |");
    for line in lines {
        let foreign = inputs.cell.small.path("foreign.json");
        expect_kept(line, &foreign, |file| inputs.run(line, "kept", &["--json", file], Stdio::piped()));
        expect_json(line, &inputs.run(line, "json", &["--json", "-"], Stdio::piped()));
        expect_lost(line, &inputs.run(line, "full", &["--json", "-"], full()), "No space left on device");
        expect_lost(line, &inputs.run(line, "unread", &[], unread()), "Broken pipe");
        assert!(!inputs.cell.small.folder.path().join("-").exists(), "{line} wrote a file named -");
        print_row(&command_of(line));
    }
}

/// Subcommands that the help of a program lists, groups such as `bench` with their members.
fn listed(program: &str) -> BTreeSet<String> {
    let of = |words: &[&str]| -> Vec<String> {
        let help = text(&Command::new(program).args(words).arg("--help").output().unwrap().stdout);
        let Some((_, list)) = help.split_once("Commands:\n") else { return Vec::new() };
        let lines = list.lines().take_while(|line| !line.is_empty()).filter(|line| !line.starts_with("   "));
        let names = lines.filter_map(|line| line.split_whitespace().next());
        names.filter(|name| *name != "help").map(str::to_owned).collect()
    };
    let mut all = BTreeSet::new();
    for name in of(&[]) {
        let inner = of(&[&name]);
        if inner.is_empty() {
            all.insert(name);
        } else {
            all.extend(inner.iter().map(|inner| format!("{name} {inner}")));
        }
    }
    all
}

/// A command that is added must come into the table.
#[test]
fn the_table_has_every_command() {
    let known: BTreeSet<String> =
        [QUICK, SLOW, WITHOUT_JSON, ENDLESS].concat().iter().map(|line| command_of(line)).collect();
    let mut listed_commands = listed(env!("CARGO_BIN_EXE_fringetool"));
    // What a CMM probes is an argument here, as the element of a fit.
    for group in ["fit", "cmm-plan"] {
        let of_group = |name: &String| name.starts_with(&format!("{group} "));
        if listed_commands.iter().any(of_group) {
            listed_commands.retain(|name| !of_group(name));
            listed_commands.insert(group.to_owned());
        }
    }
    assert_eq!(known, listed_commands);
    let operated: BTreeSet<String> = CELL.iter().map(|command| (*command).to_owned()).collect();
    assert_eq!(operated, listed(env!("CARGO_BIN_EXE_fringecell")));
}

fn command_of(line: &str) -> String {
    let mut words = line.split_whitespace();
    let name = words.next().unwrap().to_owned();
    match name.as_str() {
        "bench" | "reference-plane" | "rotation-stage" => format!("{name} {}", words.next().unwrap()),
        _ => name,
    }
}

#[test]
fn every_tool_gives_pure_json_and_tells_lost_output() {
    check(&Inputs::new(), QUICK);
}

#[test]
#[ignore = "half an hour, every benchmark three times: cargo test --test main every_slow_tool -- --ignored"]
fn every_slow_tool_gives_pure_json_and_tells_lost_output() {
    check(&Inputs::new(), SLOW);
}

/// Proves: a command whose configuration is that of the demo needs no repository.
#[test]
fn a_bare_simulation_works_outside_the_repository() {
    let folder = tempfile::tempdir().unwrap();
    let ran = fringetool_in(folder.path(), &["simulate", "--out", "rec"]).expect_success();
    assert!(folder.path().join("rec/recording.toml").exists(), "{}", ran.stdout);
    let named = fringetool_in(folder.path(), &["simulate", "configs/other.toml", "--out", "other"]);
    assert_eq!(named.code, Some(2));
    assert!(named.stderr.contains("configs/other.toml: cannot open it"), "{}", named.stderr);
}

/// Commands of `fringecell`; those from `status` on speak with a running cell.
const CELL: &[&str] = &[
    "demo",
    "run",
    "schedule",
    "completions",
    "man",
    "status",
    "trigger",
    "start",
    "finish",
    "abort",
    "halt",
    "reset",
    "prepare",
    "unprepare",
    "restart",
    "stop",
];

fn fringecell(arguments: &[&str], stdout: Stdio) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_fringecell"));
    output(program.args(arguments).stdout(stdout).stderr(Stdio::piped()))
}

fn serve(cell: &Cell) -> Child {
    let run = cell.program("played.toml", &["--serve", "--json", "-"]).spawn().unwrap();
    cell.until("ready", |status| status["state"] == "Ready");
    run
}

/// Every command to a running cell, in an order that its states allow.
fn operate(cell: &Cell, mut each: impl FnMut(&str, &[&str])) {
    let ready = || cell.until("ready", |status| status["state"] == "Ready");
    let name = cell.name.as_str();
    each("status", &["status", name]);
    each("trigger", &["trigger", name, "--part", "1"]);
    each("unprepare", &["unprepare", name, "--recipe", "default"]);
    each("prepare", &["prepare", name, "--recipe", "default"]);
    each("start", &["start", name]);
    each("finish", &["finish", name]);
    ready();
    each("start", &["start", name]);
    each("abort", &["abort", name]);
    each("halt", &["halt", name]);
    each("reset", &["reset", name]);
    each("restart", &["restart", "fusion", "--cell", name]);
    ready();
    each("stop", &["stop", name]);
}

#[test]
fn every_command_to_a_cell_gives_pure_json_and_tells_lost_output() {
    let cell = Cell::played("operated", 0.0, "");
    let run = serve(&cell);
    let mut seen = BTreeSet::new();
    operate(&cell, |command, arguments| {
        seen.insert(command.to_owned());
        let value =
            expect_json(command, &fringecell(&[arguments, &["--json", "-"]].concat(), Stdio::piped()));
        assert_eq!(value["cell"], cell.name.as_str(), "{command}: {value}");
        match command {
            "status" => follows("status", &value),
            "trigger" => follows("result", &value),
            _ => follows("operate", &value),
        }
    });
    let report = expect_json("run", &run.wait_with_output().unwrap());
    follows("run", &report);
    assert!(report["cycles_done"].as_u64() >= Some(2), "{report}");
    assert_eq!(
        report["results"].as_array().map(Vec::len),
        report["cycles_done"].as_u64().map(|n| n as usize)
    );
    let run = serve(&cell);
    let foreign = cell.small.path("foreign.json");
    operate(&cell, |command, arguments| {
        // Refused before anything is asked of the cell: the command itself follows.
        expect_kept(command, &foreign, |file| {
            fringecell(&[arguments, &["--json", file]].concat(), Stdio::piped())
        });
        expect_lost(command, &fringecell(arguments, full()), "No space left on device");
        print_row(command);
    });
    wait(run);
    let run = serve(&cell);
    operate(&cell, |command, arguments| {
        expect_lost(command, &fringecell(arguments, unread()), "Broken pipe");
    });
    wait(run);
    let operated = CELL.iter().skip_while(|command| **command != "status").map(|c| (*c).to_owned()).collect();
    assert_eq!(seen, operated);
}

/// Proves: `run`, `demo` and `schedule` measure whoever reads, and say what was lost.
#[test]
fn cells_and_schedules_give_pure_json_and_tell_lost_output() {
    let cell = Cell::played("piped", 0.0, "");
    let folder = cell.small.path("demo");
    let config = cell.small.path("played.toml");
    let lines: [(&str, Vec<&str>); 4] = [
        ("run", vec!["run", &config, "--cell", &cell.name, "--cycles", "2"]),
        ("schedule", vec!["schedule", &config]),
        // The configuration of the demo is part of the program.
        ("bare schedule", vec!["schedule"]),
        ("demo", vec!["demo", "--cycles", "1", "--cell", &cell.name, "--out", &folder]),
    ];
    for (what, arguments) in lines {
        expect_kept(what, &cell.small.path("foreign.json"), |file| {
            fringecell(&[&arguments[..], &["--json", file]].concat(), Stdio::piped())
        });
        std::fs::remove_dir_all(&folder).ok();
        print_row(what);
        let value =
            expect_json(what, &fringecell(&[&arguments[..], &["--json", "-"]].concat(), Stdio::piped()));
        if matches!(what, "run" | "demo") {
            follows("run", &value);
            let cycles = if what == "run" { 2 } else { 1 };
            assert_eq!(value["cycles_ok"], cycles, "{what}: {value}");
        } else {
            follows("schedule", &value);
            assert!(value["memory"]["run_bytes"].as_u64() > Some(1_000_000), "{what}: {value}");
        }
        std::fs::remove_dir_all(&folder).ok();
        let output = fringecell(&[&arguments[..], &["--json", "-"]].concat(), full());
        expect_lost(what, &output, "No space left on device");
        std::fs::remove_dir_all(&folder).ok();
        expect_lost(what, &fringecell(&arguments, unread()), "Broken pipe");
        assert_eq!(cell.left(), Vec::<String>::new());
        // Silent: only the exit code.
        std::fs::remove_dir_all(&folder).ok();
        let quiet = fringecell(&[&arguments[..], &["--quiet"]].concat(), Stdio::piped());
        let silent = (quiet.status.code(), text(&quiet.stdout), text(&quiet.stderr));
        assert_eq!(silent, (Some(0), String::new(), String::new()), "{what}");
    }
}

/// Completions and man pages name every command and option; both programs make them.
#[test]
fn completions_and_man_pages_come_from_the_command_line_itself() {
    let folder = tempfile::tempdir().unwrap();
    for program in [env!("CARGO_BIN_EXE_fringecell"), env!("CARGO_BIN_EXE_fringetool")] {
        let run = |words: &[&str], stdout: Stdio| {
            output(Command::new(program).args(words).stdout(stdout).stderr(Stdio::piped()))
        };
        for shell in ["bash", "zsh", "fish"] {
            let script = text(&run(&["completions", shell], Stdio::piped()).stdout);
            assert!(script.contains("json") && script.contains("color"), "{shell}: {script}");
            expect_lost(shell, &run(&["completions", shell], full()), "No space left on device");
        }
        let script = folder.path().join("script");
        std::fs::write(&script, run(&["completions", "bash"], Stdio::piped()).stdout).unwrap();
        assert!(Command::new("bash").arg("-n").arg(&script).status().unwrap().success());
        let pages = folder.path().join("man");
        let made = run(&["man", "--out", pages.to_str().unwrap()], Stdio::piped());
        assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
        let name = program.rsplit('/').next().unwrap();
        for command in listed(program) {
            let page = pages.join(format!("{name}-{}.1", command.replace(' ', "-")));
            let page = std::fs::read_to_string(&page).unwrap_or_else(|e| panic!("{}: {e}", page.display()));
            assert!(page.contains(".TH") && page.contains("\\-\\-verbose"), "{command}: {page}");
        }
        let version = text(&run(&["--version"], Stdio::piped()).stdout);
        assert!(version.contains(" (") && version.contains("features: "), "{version}");
        expect_lost("--version", &run(&["--version"], full()), "No space left on device");
    }
}

/// The global options mean the same in both programs.
#[test]
fn colours_and_prefix_of_an_error_are_the_same_in_both_programs() {
    for (program, arguments) in [
        (env!("CARGO_BIN_EXE_fringecell"), ["schedule", "no-such-file.toml"]),
        (env!("CARGO_BIN_EXE_fringetool"), ["uncertainty", "no-such-file.toml"]),
    ] {
        let error = |color: &str| {
            let output = Command::new(program).args(arguments).args(["--color", color]).output().unwrap();
            assert_eq!(output.status.code(), Some(2));
            text(&output.stderr)
        };
        assert!(error("never").starts_with("error: no-such-file.toml: "), "{}", error("never"));
        assert!(error("always").starts_with("\x1b[1;31merror:\x1b[0m no-such"), "{:?}", error("always"));
        assert_eq!(error("auto"), error("never"), "no colours on a pipe");
        let both = Command::new(program).args(["-q", "-v", "--help"]).output().unwrap();
        assert_eq!(both.status.code(), Some(0), "help comes first");
        let verbose = Command::new(program).args(arguments).arg("--verbose").output().unwrap();
        assert!(text(&verbose.stderr).contains(" s, at most "), "{}", text(&verbose.stderr));
    }
}

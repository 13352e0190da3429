//! Every command of both programs: what stands on standard output, and what becomes of output that nobody takes.

mod cell;
mod table;

use crate::running::text;
use crate::support::fringetool_in;
use cell::CELL;
use serde_json::Value;
use std::collections::BTreeSet;
use std::os::fd::AsFd as _;
use std::process::{Command, Output, Stdio};
use table::{ENDLESS, Inputs, ON_NETWORK, QUICK, SLOW, WITHOUT_JSON};

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
    let known: BTreeSet<String> = [QUICK, SLOW, WITHOUT_JSON, ENDLESS, ON_NETWORK]
        .concat()
        .iter()
        .map(|line| command_of(line))
        .collect();
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

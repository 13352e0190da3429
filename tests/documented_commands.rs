//! Every command of README, CONTRIBUTING and `docs/` is run, page by page, each page from a clean folder.
//!
//! A page's ```` ```console ```` blocks are run in order. Lines that begin with `$ ` are commands, `> ` continues one; other
//! lines are output. A comment `# exits with 1` states another exit code than 0. A comment `# takes …` marks what takes
//! seconds or minutes: the usual test only parses the arguments of its block, the long one (`--ignored`) runs it. A block with
//! `file=PATH` after its language is written to that file.

use crate::documentation::pages;
use crate::support::root;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// Commands that no test can run, each with its reason. As few as possible.
const NOT_RUN: [(&str, &str); 8] = [
    ("cargo install --path .", "installs the programs that the test already has"),
    ("cargo test", "this test is part of it"),
    ("DOCUMENTED_PAGE=", "this test"),
    ("cargo clippy", "part of .ci/run"),
    ("cargo fmt", "part of .ci/run"),
    (".ci/run", "this test is part of it"),
    ("fringetool focus --images", "pictures of a projected checkerboard, which the twin does not show"),
    ("python3 -c", "needs scikit-image"),
];

/// A command as it stands on a page.
#[derive(Debug)]
struct Documented {
    line: usize,
    text: String,
}

impl Documented {
    fn exit_code(&self) -> u32 {
        let stated = self.text.split_once("# exits with ");
        stated.map_or(0, |(_, rest)| rest[..1].parse().expect("an exit code"))
    }

    fn is_long(&self) -> bool {
        self.text.contains("# takes ")
    }

    fn reason_not_to_run(&self) -> Option<&'static str> {
        NOT_RUN.iter().find(|(start, _)| self.text.starts_with(start)).map(|(_, reason)| *reason)
    }
}

/// What a page asks for, in order.
#[derive(Debug)]
enum Step {
    File { path: String, text: String },
    Block(Vec<Documented>),
}

/// The steps of a page.
fn steps(page: &str) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut lines = page.lines().enumerate();
    while let Some((_, line)) = lines.next() {
        let Some(language) = line.trim_start().strip_prefix("```") else { continue };
        let block: Vec<(usize, &str)> = lines.by_ref().take_while(|(_, l)| l.trim_start() != "```").collect();
        if language == "console" {
            steps.push(Step::Block(commands(&block)));
        } else if let Some((_, path)) = language.split_once("file=") {
            let text = block.iter().flat_map(|(_, line)| [*line, "\n"]).collect();
            steps.push(Step::File { path: path.to_owned(), text });
        }
    }
    steps
}

fn commands(block: &[(usize, &str)]) -> Vec<Documented> {
    let mut all: Vec<Documented> = Vec::new();
    let mut goes_on = false;
    for (number, line) in block {
        if let Some(text) = line.strip_prefix("$ ") {
            all.push(Documented { line: number + 1, text: text.to_owned() });
        } else if let (Some(last), true) = (all.last_mut(), goes_on || line.starts_with("> ")) {
            let _ = write!(last.text, "\n{}", line.strip_prefix("> ").unwrap_or(line));
        }
        goes_on = line.ends_with('\\');
    }
    all
}

/// The script of a page: each command, its exit code compared; stops at the first one that ends otherwise.
fn script(steps: &[Step], run_long: bool) -> String {
    let mut script = String::from(PROLOGUE);
    for step in steps {
        match step {
            Step::File { path, text } => {
                let _ = writeln!(
                    script,
                    "mkdir -p \"$(dirname '{path}')\"\ncat > '{path}' <<'END OF FILE'\n{text}END OF FILE"
                );
            }
            Step::Block(commands) => {
                let only_parse = !run_long && commands.iter().any(Documented::is_long);
                let _ = writeln!(script, "parse_only={}", if only_parse { "--parse-only" } else { "" });
                for command in commands.iter().filter(|command| command.reason_not_to_run().is_none()) {
                    let (line, text) = (command.line, &command.text);
                    let expected = if only_parse { 0 } else { command.exit_code() };
                    let _ = writeln!(script, "begin {line}\n{text}\nended $? {expected}");
                }
            }
        }
    }
    script
}

const PROLOGUE: &str = r#"
# A page that fails leaves no cell behind, which would keep the output open.
trap 'command fringecell stop >/dev/null 2>&1; kill $(jobs -p) 2>/dev/null; wait 2>/dev/null' EXIT
fringecell() { command fringecell $parse_only "$@"; }
fringetool() { command fringetool $parse_only "$@"; }
for move in cp mv; do eval "$move() { [ -n \"\$parse_only\" ] || command $move \"\$@\"; }"; done
cargo() {
  case "$*" in
    "run -- "*) shift 2; fringecell "$@";;
    "run --bin fringetool -- "*) shift 4; fringetool "$@";;
    *) echo "no test runs: cargo $*" >&2; return 97;;
  esac
}
begin() { line=$1; start=$SECONDS; }
ended() {
  echo "@@ line $line: exit code $1, $((SECONDS - start)) s" >&2
  [ "$1" -eq "$2" ] || { echo "@@ line $line: exit code $1, expected $2" >&2; exit 1; }
}
"#;

/// Runs a page in a folder that holds what a clone holds, without anything built or measured.
fn run_page(page: &Path, run_long: bool) -> Result<String, String> {
    let folder = TempDir::new().unwrap();
    for name in ["configs", "tests/layouts", "tests/charuco"] {
        copy(&root().join(name), &folder.path().join(name));
    }
    // `../shared` lies beside the clone.
    let clone = folder.path();
    let bin = folder.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    for (name, program) in
        [("fringecell", env!("CARGO_BIN_EXE_fringecell")), ("fringetool", env!("CARGO_BIN_EXE_fringetool"))]
    {
        std::os::unix::fs::symlink(program, bin.join(name)).unwrap();
    }
    let text = std::fs::read_to_string(page).unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let mut bash = if own_shared_memory() {
        let mut unshare = Command::new("unshare");
        unshare.args(["-rm", "bash", "-c", "mount -t tmpfs none /dev/shm && exec bash -c \"$1\"", "bash"]);
        unshare
    } else {
        let mut bash = Command::new("bash");
        bash.arg("-c");
        bash
    };
    let output = bash
        .arg(script(&steps(&text), run_long))
        .current_dir(clone)
        .env("PATH", path)
        .stdin(Stdio::null())
        .output()
        .expect("bash starts");
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() {
        return Ok(told
            .lines()
            .filter(|line| line.starts_with("@@"))
            .flat_map(|line| [line, "\n"])
            .collect());
    }
    let last = |text: &str| {
        text.lines().rev().take(25).collect::<Vec<_>>().into_iter().rev().collect::<Vec<_>>().join("\n")
    };
    Err(format!("{}:\n{}\n{}", page.display(), last(&String::from_utf8_lossy(&output.stdout)), last(&told)))
}

/// Whether pages can have a `/dev/shm` of their own: then another cell "demo" on this machine is no hindrance.
fn own_shared_memory() -> bool {
    let mount = ["-rm", "sh", "-c", "mount -t tmpfs none /dev/shm"];
    Command::new("unshare").args(mount).output().is_ok_and(|output| output.status.success())
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let (from, to) = (entry.as_ref().unwrap().path(), to.join(entry.unwrap().file_name()));
        if from.is_dir() {
            copy(&from, &to);
        } else {
            std::fs::copy(&from, &to).unwrap();
        }
    }
}

fn run_pages(run_long: bool) {
    let only = std::env::var("DOCUMENTED_PAGE").unwrap_or_default();
    let mut faults = Vec::new();
    for page in pages().iter().filter(|page| page.to_str().unwrap().ends_with(&only)) {
        match run_page(page, run_long) {
            Ok(times) => print!("{}\n{times}", page.display()),
            Err(fault) => faults.push(fault),
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
}

#[test]
fn every_documented_command_runs_from_a_clean_folder() {
    run_pages(false);
}

#[test]
#[ignore = "twenty minutes: cargo test --test main documented_commands -- --ignored --nocapture"]
fn every_documented_command_runs_however_long_it_takes() {
    run_pages(true);
}

/// Every command that is not run has a reason, and every reason has a command.
#[test]
fn what_is_not_run_is_on_a_page() {
    let all: Vec<Documented> = pages()
        .iter()
        .flat_map(|page| steps(&std::fs::read_to_string(page).unwrap()))
        .filter_map(|step| if let Step::Block(commands) = step { Some(commands) } else { None })
        .flatten()
        .collect();
    assert!(all.len() > 50, "{all:#?}");
    for (start, reason) in NOT_RUN {
        assert!(all.iter().any(|command| command.text.starts_with(start)), "no page has {start} ({reason})");
    }
}

#[test]
fn a_wrong_option_and_a_wrong_exit_code_are_found() {
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("page.md");
    let ran = |text: &str| {
        std::fs::write(&page, format!("```console\n$ {text}\n```\n")).unwrap();
        run_page(&page, false)
    };
    assert!(ran("fringetool fit sphere none.ply  # exits with 2").is_ok());
    for wrong in [
        "fringetool fit sphere none.ply",
        "fringetool uncertainty configs/budgets/sphere-spacing.toml  # exits with 1",
        "fringetool bench accuracy --no-such-option  # takes a minute",
        "no-such-program",
        "cargo run --bin other -- demo",
    ] {
        assert!(ran(wrong).is_err(), "{wrong}");
    }
}

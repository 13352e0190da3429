//! How the tests run programs and make small recordings.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// The date of all outputs of [`fringetool`]: 2026-01-01T00:00:00Z.
const EPOCH: &str = "1767225600";

/// What a program did.
pub struct Ran {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Ran {
    pub fn new(output: &Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// Fails the test unless the program ended well.
    pub fn expect_success(self) -> Self {
        assert_eq!(self.code, Some(0), "stdout:\n{}\nstderr:\n{}", self.stdout, self.stderr);
        self
    }
}

/// Runs `fringetool` in the repository's root. What it writes with `--json` must follow its schema.
pub fn fringetool<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Ran {
    fringetool_in(root(), arguments)
}

/// Runs `fringetool` in a folder. What it writes with `--json` must follow its schema.
pub fn fringetool_in<S: AsRef<std::ffi::OsStr>>(folder: &Path, arguments: &[S]) -> Ran {
    let ran = run_in(folder, env!("CARGO_BIN_EXE_fringetool"), arguments);
    let words: Vec<&str> = arguments.iter().filter_map(|word| word.as_ref().to_str()).collect();
    let json = words.iter().position(|word| *word == "--json").and_then(|at| words.get(at + 1));
    if let (Some(file), Some(command), Some(0 | 1)) = (json, crate::schema::command_of(&words), ran.code) {
        let file = folder.join(file);
        if file.is_file() {
            crate::schema::assert_valid(&command, &file);
        }
    }
    ran
}

/// Runs `fringecell` in a folder.
pub fn fringecell_in<S: AsRef<std::ffi::OsStr>>(folder: &Path, arguments: &[S]) -> Ran {
    run_in(folder, env!("CARGO_BIN_EXE_fringecell"), arguments)
}

fn run_in<S: AsRef<std::ffi::OsStr>>(folder: &Path, program: &str, arguments: &[S]) -> Ran {
    let mut command = Command::new(program);
    // Results carry their date; these must not differ between two runs of the same.
    command.args(arguments).current_dir(folder).env("SOURCE_DATE_EPOCH", EPOCH);
    Ran::new(&command.output().expect("the program starts"))
}

/// The folder of the repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder of the real recordings; `None`, said in one line, where they are absent.
pub fn real_data(set: &str) -> Option<PathBuf> {
    shared_data(&format!("real/{set}"))
}

/// A folder of data that lie beside the repository; `None`, said in one line, where it is absent. The tests that need them
/// are ignored there (`cfg(shared_data)`, tests/build.rs); where `CI` is set, absence is a failure.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let folder = root().join("../shared/data").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("CI").is_none(), "{} is absent", folder.display());
    eprintln!("skipped: {} is absent; these data are not part of the repository", folder.display());
    None
}

/// A small two-camera recording of the twin with its rig file, for tests that break things.
pub struct Small {
    // Before the folder: fields are dropped in this order.
    _programs: EndedWithTheTest,
    pub folder: TempDir,
}

/// Programs that work on files of a folder. A test that fails leaves its cell at work, which takes a core from all tests after
/// it: the cell is asked to end, and killed if it does not.
struct EndedWithTheTest(String);

impl EndedWithTheTest {
    /// Those that still work; a zombie has no command line.
    fn left(&self) -> Vec<String> {
        let processes = std::fs::read_dir("/proc").into_iter().flatten().filter_map(Result::ok);
        let names = processes.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let works_here = |pid: &String| {
            let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            String::from_utf8_lossy(&line).contains(&self.0)
        };
        names.filter(|name| name.bytes().all(|byte| byte.is_ascii_digit())).filter(works_here).collect()
    }
}

impl Drop for EndedWithTheTest {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            return;
        }
        for signal in ["-TERM", "-KILL"] {
            for _ in 0..50 {
                let left = self.left();
                if left.is_empty() {
                    return;
                }
                let _ = Command::new("kill").arg(signal).args(left).output();
                std::thread::sleep(std::time::Duration::from_millis(100));
            }
        }
    }
}

/// Columns and rows of the small cameras.
pub const SMALL_PX: (u32, u32) = (168, 112);

impl Small {
    /// Simulates it: one projector, two cameras, a sphere-studded part, noise.
    pub fn new() -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        let rig = twin::thesis::rig(SMALL_PX.0, SMALL_PX.1);
        let path = folder.path().join("rig.toml");
        files::rig_file::write_rig(&path, &rig, &toml::Table::new(), None).expect("rig.toml");
        std::fs::write(folder.path().join("cell.toml"), small_cell()).expect("cell.toml");
        let small = Self::within(folder);
        let (cell, out) = (small.path("cell.toml"), small.path("rec"));
        fringetool(&["simulate", &cell, "--out", &out]).expect_success();
        small
    }

    /// The same in a folder that has its files already, or will have them.
    pub fn within(folder: TempDir) -> Self {
        let path = folder.path().to_str().expect("a path in UTF-8").to_owned();
        Self { _programs: EndedWithTheTest(path), folder }
    }

    /// A path inside, as text.
    pub fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().expect("a path in UTF-8").to_owned()
    }

    /// Reconstructs the recording into `cloud.ply`.
    pub fn reconstruct(&self, more: &[&str]) -> Ran {
        let (rig, out, recording) = (self.path("rig.toml"), self.path("cloud.ply"), self.path("rec"));
        let mut arguments = vec!["reconstruct", "--rig", &rig, "--out", &out, &recording];
        arguments.extend(more);
        fringetool(&arguments)
    }

    /// Replaces text in a file; the text must occur.
    pub fn edit(&self, name: &str, from: &str, to: &str) {
        let path = self.path(name);
        let text = std::fs::read_to_string(&path).expect(name);
        assert!(text.contains(from), "{name} does not hold {from:?}:\n{text}");
        std::fs::write(&path, text.replacen(from, to, 1)).expect(name);
    }
}

fn small_cell() -> String {
    let scene = root().join("configs/complex-artefact.scene.toml");
    format!(
        r#"format = "fringecell-config/1"
name = "small"
rig = "rig.toml"
pairs = ["pair1"]
[[projector]]
name = "proj1"
driver = "twin"
width_px = 608
height_px = 684
cameras = ["cam1", "cam2"]
sequence = [
  {{ set = "sine", axis = "x", period_px = 16.0, steps = 10 }},
  {{ set = "gray", axis = "x", bits = 7, stripe_px = 8.0 }},
  {{ set = "white" }}, {{ set = "black" }},
]
[[camera]]
name = "cam1"
driver = "twin"
[[camera]]
name = "cam2"
driver = "twin"
[twin]
scene = {:?}
"#,
        scene.display().to_string()
    )
}

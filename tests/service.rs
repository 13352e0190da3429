//! A production machine: what the service manager is told, the unit, the Debian package.

use crate::running::{Cell, PATIENCE, signal, text, wait};
use crate::support::root;
use std::os::unix::net::UnixDatagram;
use std::process::Command;
use std::time::{Duration, Instant};

/// The socket of a service manager.
struct Manager {
    socket: UnixDatagram,
}

impl Manager {
    fn new(path: &str) -> Self {
        Self { socket: UnixDatagram::bind(path).unwrap() }
    }

    /// The next message; `None` if there is none for some time.
    fn message(&self, timeout: Duration) -> Option<String> {
        self.socket.set_read_timeout(Some(timeout)).unwrap();
        let mut bytes = [0; 4096];
        self.socket.recv(&mut bytes).ok().map(|length| text(&bytes[..length]).trim().to_owned())
    }

    /// Waits for a message; returns those before it.
    fn until(&self, wanted: &str) -> Vec<String> {
        let begin = Instant::now();
        let mut before = Vec::new();
        while begin.elapsed() < PATIENCE {
            match self.message(PATIENCE) {
                Some(message) if message == wanted => return before,
                Some(message) => before.push(message),
                None => break,
            }
        }
        panic!("{wanted} did not come; there came {before:?}");
    }
}

/// Proves: ready is said when the stages are ready and not before, signs of life come from the event loop itself, and the end is
/// announced.
#[test]
fn a_service_manager_hears_ready_alive_and_stopping() {
    let cell = Cell::played("service", 0.0, "");
    let path = cell.small.path("notify");
    let manager = Manager::new(&path);
    let mut program = cell.program("played.toml", &["--serve"]);
    program.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "200000");
    let run = program.spawn().unwrap();
    let before = manager.until("READY=1");
    assert!(before.iter().any(|m| m == "STATUS=Preoperational, 0 cycles"), "{before:?}");
    assert!(before.iter().any(|m| m == "WATCHDOG=1"), "alive while it starts: {before:?}");
    manager.until("STATUS=Ready, 0 cycles");
    for _ in 0..3 {
        manager.until("WATCHDOG=1");
    }
    // A supervisor that does not run sends nothing.
    signal("STOP", run.id().into());
    while manager.message(Duration::from_millis(400)).is_some() {}
    assert_eq!(manager.message(Duration::from_millis(600)), None);
    signal("CONT", run.id().into());
    manager.until("WATCHDOG=1");
    signal("TERM", run.id().into());
    let rest = manager.until("STOPPING=1");
    assert!(!rest.contains(&"READY=1".to_owned()), "ready is said once: {rest:?}");
    let output = wait(run);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// The unit starts a command that exists, with its options.
#[test]
fn the_unit_starts_what_the_program_understands() {
    let unit = std::fs::read_to_string(root().join("packaging/fringecell@.service")).unwrap();
    let value = |key: &str| {
        let line = unit.lines().find_map(|line| line.strip_prefix(&format!("{key}=")));
        line.unwrap_or_else(|| panic!("{key} is missing")).to_owned()
    };
    assert_eq!(value("Type"), "notify");
    assert!(value("WatchdogSec").parse::<u32>().unwrap() > 10);
    let start =
        value("ExecStart").replace("%i", "line1").replace("$FRINGECELL_OPTIONS", "--metrics 127.0.0.1:9464");
    let words: Vec<&str> = start.split_whitespace().collect();
    assert_eq!(words[0], "/usr/bin/fringecell");
    let program = env!("CARGO_BIN_EXE_fringecell");
    let output = Command::new(program).arg("--parse-only").args(&words[1..]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

/// The package is built twice with the same bytes, has what a user relies on, and its programs run.
#[test]
fn the_debian_package_has_programs_pages_and_units() {
    if Command::new("dpkg-deb").arg("--version").output().is_err() {
        eprintln!("skipped: this machine has no dpkg-deb");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let programs = std::path::Path::new(env!("CARGO_BIN_EXE_fringecell")).parent().unwrap();
    let build = |out: &str| {
        let mut build = Command::new(root().join("packaging/build-deb"));
        build.arg(programs).arg(folder.path().join(out)).env("COMPRESSION", "none");
        let output = build.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
        root().join(text(&output.stdout).trim())
    };
    let (first, second) = (build("first"), build("second"));
    assert!(std::fs::read(&first).unwrap() == std::fs::read(&second).unwrap(), "the packages differ");
    let unpacked = folder.path().join("unpacked");
    assert!(Command::new("dpkg-deb").arg("-x").arg(&first).arg(&unpacked).status().unwrap().success());
    let run = |name: &str, words: &[&str]| {
        let program = unpacked.join("usr/bin").join(name);
        Command::new(program).args(words).current_dir(folder.path()).output().unwrap()
    };
    let demo = unpacked.join("usr/share/fringecell/configs/demo.toml");
    let planned = run("fringecell", &["schedule", "--quiet", demo.to_str().unwrap()]);
    assert_eq!(planned.status.code(), Some(0), "{}", text(&planned.stderr));
    assert!(run("fringetool", &["--version"]).status.success());
}

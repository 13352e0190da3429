//! Another user of the machine, and a user whom the machine gives little. The tests need to be root to be two users.

use crate::every_command::unread;
use crate::running::{Cell, PATIENCE, pid_of, results, signal, text, wait};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// A user that no machine has.
const USER: u32 = 54_321;

/// A command of the other user; `None`, said in one line, for a test that is not root.
fn as_other(program: &str) -> Option<Command> {
    let user = USER.to_string();
    let mut command = Command::new("setpriv");
    command.args(["--reuid", &user, "--regid", &user, "--clear-groups", program]);
    let may = Command::new("setpriv").args(["--reuid", &user, "--clear-groups", "true"]).output();
    if may.is_ok_and(|output| output.status.success()) {
        return Some(command);
    }
    eprintln!("skipped: only root can be two users");
    None
}

fn shell(script: &str) -> Option<Output> {
    Some(as_other("sh")?.args(["-c", script]).output().unwrap())
}

fn folder_of(cell: &Cell) -> PathBuf {
    ipc::cell::CellName::new(&cell.name).unwrap().socket().parent().unwrap().to_owned()
}

/// Proves: what another user has put in the place of the runtime folder is neither used, nor followed, nor removed.
#[test]
fn a_folder_or_link_that_another_user_made_beforehand_is_refused_and_harms_nothing() {
    let cell = Cell::played("squatted", 0.0, "");
    let victim = cell.small.folder.path().join("victim");
    std::fs::create_dir(&victim).unwrap();
    std::fs::write(victim.join("precious"), "precious").unwrap();
    let place = folder_of(&cell);
    let (there, to) = (place.display(), victim.display());
    for (trap, says) in [
        (format!("ln -s {to} {there}"), "is not a folder"),
        (
            format!("mkdir {there} && touch {there}/command {there}/pid && chmod 777 {there}"),
            "belongs to user 54321",
        ),
        (format!("touch {there}"), "is not a folder"),
    ] {
        let Some(made) = shell(&trap) else { return };
        assert!(made.status.success(), "{trap}: {}", text(&made.stderr));
        let before = listed(&place);
        let run = cell.run("played.toml", &["--cycles", "1"]);
        let said = text(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{trap}: {said}");
        assert!(said.contains(says) && said.lines().count() == 1, "{trap}: {said}");
        assert_eq!(listed(&place), before, "{trap}");
        assert_eq!(std::fs::read(victim.join("precious")).unwrap(), b"precious");
        assert_eq!(listed(&victim), ["precious"]);
        shell(&format!("rm -rf {there}"));
    }
}

/// Names in a folder; the name itself of anything else.
fn listed(place: &Path) -> Vec<String> {
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    if place.is_symlink() || !place.is_dir() {
        return vec![name(place)];
    }
    let mut names: Vec<String> =
        std::fs::read_dir(place).unwrap().map(|entry| name(&entry.unwrap().path())).collect();
    names.sort();
    names
}

/// Proves: shared memory, files and socket of a running cell are of its user alone; what another user tries fails, and the cell
/// goes on.
#[test]
fn another_user_can_neither_read_nor_change_nor_command_a_running_cell() {
    let cell = Cell::played("private", 100.0, "");
    if as_other("true").is_none() {
        return;
    }
    let run = cell.program("played.toml", &["--cycles", "30"]).spawn().unwrap();
    cell.until("at work", |status| status["cycles_done"].as_u64() > Some(1));
    let mut attacked = 0;
    for name in cell.left() {
        let path = Path::new("/dev/shm").join(&name);
        let Ok(metadata) = std::fs::symlink_metadata(&path) else { continue };
        let mode = metadata.permissions().mode() & 0o077;
        assert_eq!((mode, metadata.uid()), (0, 0), "{name} is open to others");
        let path = path.display();
        let script = format!(
            "cat {path} >/dev/null 2>&1 && echo read; : 2>/dev/null > {path} && echo truncated; \
             rm -rf {path} 2>/dev/null && echo removed; mv {path} {path}.x 2>/dev/null && echo moved; true"
        );
        assert_eq!(text(&shell(&script).unwrap().stdout), "", "{name}");
        attacked += 1;
    }
    assert!(attacked > 10, "the cell has only {attacked} names");
    let program = cell.small.folder.path().join("fringecell");
    std::fs::copy(env!("CARGO_BIN_EXE_fringecell"), &program).unwrap();
    open_to_all(cell.small.folder.path());
    for arguments in [["stop", "--cell"], ["halt", "--cell"], ["status", "--cell"]] {
        let mut other = as_other(program.to_str().unwrap()).unwrap();
        let output = other.args(arguments).arg(&cell.name).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output.stdout));
    }
    let output = wait(run);
    assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
    assert_eq!(results(&cell.out()).len(), 30);
    assert_eq!(cell.left(), Vec::<String>::new());
}

fn open_to_all(folder: &Path) {
    assert!(Command::new("chmod").args(["-R", "a+rwX"]).arg(folder).status().unwrap().success());
}

/// A cell of the other user, whose processes and files the tests count from zero.
fn of_other(cell: &Cell, more: &[&str]) -> Option<std::process::Child> {
    let program = cell.small.folder.path().join("fringecell");
    std::fs::copy(env!("CARGO_BIN_EXE_fringecell"), &program).unwrap();
    open_to_all(cell.small.folder.path());
    let mut command = as_other("env")?;
    command.args(["--default-signal", program.to_str().unwrap(), "run", &cell.small.path("played.toml")]);
    command.args(["--cell", &cell.name, "--serve"]).args(more);
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    Some(command.spawn().unwrap())
}

/// Proves: a cell of a user who has nothing, as a service manager starts it, measures and leaves nothing: with a runtime folder
/// of its own and without one.
#[test]
fn a_cell_of_a_user_without_home_and_terminal_measures() {
    let cell = Cell::played("nobody", 0.0, "");
    let program = cell.small.folder.path().join("fringecell");
    std::fs::copy(env!("CARGO_BIN_EXE_fringecell"), &program).unwrap();
    let runtime = cell.small.folder.path().join("runtime");
    std::fs::create_dir(&runtime).unwrap();
    open_to_all(cell.small.folder.path());
    for (number, environment) in
        [format!("XDG_RUNTIME_DIR={}", runtime.display()), "TERM=dumb".to_owned()].into_iter().enumerate()
    {
        let Some(mut run) = as_other("env") else { return };
        let out = cell.small.path(&format!("out{number}"));
        run.args(["-i", &environment, program.to_str().unwrap(), "run", &cell.small.path("played.toml")]);
        let output = run.args(["--cycles", "3", "--cell", &cell.name, "--out", &out]).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{environment}: {}", text(&output.stderr));
        let results = results(Path::new(&out));
        assert!(results.len() == 3 && results.iter().all(|result| result["outcome"] == "ok"), "{results:?}");
        assert_eq!(std::fs::metadata(&out).unwrap().uid(), USER);
        assert_eq!(cell.left(), Vec::<String>::new());
    }
}

/// Sets a soft limit of a process; its user may do that.
fn limit(prlimit: &mut Command, pid: u32, what: &str) {
    let set = prlimit.args(["--pid", &pid.to_string(), what]).output().unwrap();
    assert!(set.status.success(), "{}", text(&set.stderr));
}

/// One request over the socket, and its answer.
fn ask(cell: &Cell, request: &str) -> Option<Value> {
    let mut stream = UnixStream::connect(folder_of(cell).join("command")).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    // A cell that refuses a client closes without reading.
    let _ = stream.write_all(request.as_bytes());
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).ok()?;
    serde_json::from_str(&line).ok()
}

/// The soft limit of the number of processes.
fn soft_processes(pid: u32) -> String {
    let limits = std::fs::read_to_string(format!("/proc/{pid}/limits")).unwrap();
    let line = limits.lines().find(|line| line.starts_with("Max processes")).unwrap();
    line.split_whitespace().nth(2).unwrap().to_owned()
}

/// Proves: where the system has no process for a moment (EAGAIN), the start of a stage is tried again, clients are told, and
/// then everything goes on.
#[test]
fn a_start_that_fails_for_a_moment_is_tried_again() {
    let cell = Cell::played("eagain", 0.0, "restarts_max = 1000");
    let Some(run) = of_other(&cell, &[]) else { return };
    let ready = cell.until("ready", |status| status["state"] == "Ready");
    let processes = |soft: &str| {
        limit(&mut as_other("prlimit").unwrap(), run.id(), &format!("--nproc={soft}:"));
    };
    let before = soft_processes(run.id());
    processes("1");
    signal("KILL", pid_of(&ready, "fusion"));
    let begin = Instant::now();
    loop {
        let answer = ask(&cell, "{\"command\":\"status\"}\n").expect("an answer without a thread");
        if answer["refused"].as_str().is_some_and(|why| why.contains("no thread for this client")) {
            break;
        }
        assert!(begin.elapsed() < PATIENCE, "{answer}");
    }
    // Some starts fail meanwhile.
    std::thread::sleep(Duration::from_secs(2));
    processes(&before);
    cell.until("ready again", |status| status["state"] == "Ready");
    let inspected = ask(&cell, "{\"command\":\"inspect\",\"part\":\"1\"}\n").unwrap();
    assert_eq!(inspected["inspected"]["outcome"], "ok", "{inspected}");
    ask(&cell, "{\"command\":\"stop\"}\n");
    let output = wait(run);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("starting stage fusion: Resource temporarily unavailable"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Processor time of a process, s: all its threads.
fn cpu_s(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    let ticks: u64 = [11, 12].iter().map(|at| fields[*at].parse::<u64>().unwrap()).sum();
    ticks as f64 / 100.0
}

/// Proves: without file descriptors the command socket waits instead of spinning, the metrics endpoint too, and serves again.
#[test]
fn without_file_descriptors_clients_wait_and_nothing_spins() {
    let cell = Cell::played("emfile", 0.0, "");
    let mut run = cell.program("played.toml", &["--serve", "--metrics", "127.0.0.1:0"]).spawn().unwrap();
    cell.until("ready", |status| status["state"] == "Ready");
    let mut line = String::new();
    BufReader::new(run.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("metrics at http://").unwrap().strip_suffix("/metrics").unwrap();
    // Fewer than are open already: every accept fails.
    limit(&mut Command::new("prlimit"), run.id(), "--nofile=4:");
    let waiting: Vec<UnixStream> =
        (0..4).map(|_| UnixStream::connect(folder_of(&cell).join("command")).unwrap()).collect();
    let scraper = std::net::TcpStream::connect(address).unwrap();
    let (before, begin) = (cpu_s(run.id()), Instant::now());
    std::thread::sleep(Duration::from_secs(3));
    let share = (cpu_s(run.id()) - before) / begin.elapsed().as_secs_f64();
    println!("{:.1} % of a core", 100.0 * share);
    // Two loops that spin take two cores.
    assert!(share < 0.5, "the supervisor spins: {:.0} % of a core", 100.0 * share);
    limit(&mut Command::new("prlimit"), run.id(), "--nofile=1024:");
    for mut client in &waiting {
        client.set_read_timeout(Some(PATIENCE)).unwrap();
        client.write_all(b"{\"command\":\"state\"}\n").unwrap();
        let mut line = String::new();
        BufReader::new(client).read_line(&mut line).unwrap();
        assert!(line.contains("\"Ready\""), "{line}");
    }
    drop((waiting, scraper));
    ask(&cell, "{\"command\":\"stop\"}\n");
    assert_eq!(wait(run).status.code(), Some(0));
}

/// Proves: metrics leave the machine only when that is asked for.
#[test]
fn an_address_that_others_can_reach_needs_a_word() {
    let cell = Cell::played("remote", 0.0, "");
    for address in ["0.0.0.0:0", "[::]:0"] {
        let refused = cell.run("played.toml", &["--cycles", "1", "--metrics", address]);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains("other machines can reach this address; add --allow-remote"), "{said}");
        assert!(!cell.out().exists(), "refused before anything is written");
    }
    let allowed = cell.run("played.toml", &["--cycles", "1", "--metrics", "0.0.0.0:0", "--allow-remote"]);
    assert_eq!(allowed.status.code(), Some(0), "{}", text(&allowed.stderr));
    assert!(text(&allowed.stdout).contains("metrics at http://0.0.0.0:"));
    let alone = cell.run("played.toml", &["--cycles", "1", "--allow-remote"]);
    assert_eq!(alone.status.code(), Some(2), "a word about nothing");
}

/// Proves: nobody who reads the messages of a cell can end it by going away.
#[test]
fn a_reader_of_messages_that_goes_away_ends_nothing() {
    let cell = Cell::played("unheard", 50.0, "");
    let mut program = cell.program("played.toml", &["--cycles", "6"]);
    program.env("FRINGECELL_LOG", "debug").stdout(std::process::Stdio::null()).stderr(unread());
    let mut run = program.spawn().unwrap();
    signal("KILL", pid_of(&cell.until_a_cycle_begins(), "decode/cam1"));
    let status = loop {
        if let Some(status) = run.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert_eq!(status.code(), Some(1), "one cycle is lost with its stage");
    assert_eq!(results(&cell.out()).len(), 6);
    assert_eq!(cell.left(), Vec::<String>::new());
}

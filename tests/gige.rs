//! Cameras on the network: the twin as GigE Vision cameras gives the same bytes as the twin itself, and what goes wrong on
//! the network is repaired or told, never believed.

use crate::support::{SMALL_PX, fringetool, root};
use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;
use tempfile::TempDir;

pub const SEQUENCE: &str = r#"{ set = "sine", axis = "x", period_px = 16.0, steps = 5 },
  { set = "gray", axis = "x", bits = 7, stripe_px = 8.0 },
  { set = "white" }, { set = "black" },"#;

/// With white and black first, and the check by which the order of the frames is proven.
const CHECKED: &str = r#"{ set = "white" }, { set = "black" },
  { set = "sine", axis = "x", period_px = 16.0, steps = 5 },
  { set = "gray", axis = "x", bits = 7, stripe_px = 8.0 },
  { set = "check", axis = "x", stripe_px = 8.0 },"#;

/// Loopback addresses of this test alone: the control port of a camera is the same for all.
pub fn network(test: u8) -> [u8; 3] {
    let pid = std::process::id();
    [127, 16 + (pid % 200) as u8, (pid / 200 % 8) as u8 * 16 + test]
}

/// A configuration of the first cameras of the rig in the folder.
fn configuration(folder: &Path, test: u8, live: bool, cameras: u8) -> String {
    let [a, b, c] = network(test);
    let all = |camera: &dyn Fn(u8) -> String| (1..=cameras).map(camera).collect::<String>();
    let names: Vec<String> = (1..=cameras).map(|n| format!("\"cam{n}\"")).collect();
    let (projector, cameras) = if live {
        let camera = |n: u8| {
            format!(
                "[[camera]]\nname = \"cam{n}\"\ndriver = \"genicam\"\naddress = \"{a}.{b}.{c}.{}\"\n",
                10 + n
            )
        };
        (format!("driver = \"network\"\naddress = \"{a}.{b}.{c}.1:3957\""), all(&camera))
    } else {
        let camera = |n: u8| format!("[[camera]]\nname = \"cam{n}\"\ndriver = \"twin\"\n");
        ("driver = \"twin\"".to_owned(), all(&camera))
    };
    let scene = root().join("configs/complex-artefact.scene.toml").display().to_string();
    let twin = if live { String::new() } else { format!("[twin]\nscene = {scene:?}\n") };
    let text = format!(
        "format = \"fringecell-config/1\"\nname = \"gige\"\nrig = \"rig.toml\"\n\
         [limits]\nstage_budget_ms = 20000\ncycle_deadline_ms = 60000\n\
         [[projector]]\nname = \"proj1\"\n{projector}\nwidth_px = 608\nheight_px = 684\n\
         cameras = [{}]\nsequence = [\n  {SEQUENCE}\n]\n{cameras}{twin}",
        names.join(", ")
    );
    let path = folder.join(if live { "live.toml" } else { "twin.toml" });
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The served cameras, stopped when dropped.
pub struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub fn serve(config: &str, test: u8, faults: &[&str]) -> Served {
    let [a, b, c] = network(test);
    let mut command = Command::new(env!("CARGO_BIN_EXE_fringetool"));
    command.args(["serve-camera", config, "--address", &format!("{a}.{b}.{c}.11")]);
    command.args(["--light", &format!("{a}.{b}.{c}.1:3957")]);
    for fault in faults {
        command.args(["--fault", fault]);
    }
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let served = Served(child);
    assert!(lines.any(|line| line.unwrap().contains("serving")), "serve-camera ended");
    served
}

/// A folder with a rig of two cameras and both configurations.
fn cell(test: u8) -> (TempDir, String, String) {
    cell_of(test, SMALL_PX, 2)
}

/// The same of cameras of a size, up to four; all of them look at the first projector.
pub fn cell_of(test: u8, (width_px, height_px): (u32, u32), cameras: usize) -> (TempDir, String, String) {
    let folder = TempDir::new().unwrap();
    let mut rig = twin::thesis::rig(width_px, height_px);
    rig.cameras.truncate(cameras);
    rig.projectors.truncate(1);
    rig.pairs.truncate(1);
    if let [pair] = &mut rig.pairs[..]
        && cameras == 1
    {
        "proj1".clone_into(&mut pair.right);
    }
    if cameras > 2 {
        let pair = fringe::geometry::rig::Pair {
            name: "pair2".into(),
            left: "cam3".into(),
            right: "cam4".into(),
            projector: "proj1".into(),
        };
        rig.pairs.push(pair);
    }
    files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
    let written = |live| configuration(folder.path(), test, live, cameras as u8);
    let (simulated, live) = (written(false), written(true));
    (folder, simulated, live)
}

pub fn run(folder: &Path, config: &str, out: &str, cycles: &str) -> Output {
    // Several tests run at once: the folder's name is unique.
    let unique = folder.file_name().unwrap().to_str().unwrap().trim_start_matches(".tmp").to_lowercase();
    let name = format!("t-gige-{out}-{unique}");
    Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args([
            "run",
            config,
            "--cell",
            &name,
            "--cycles",
            cycles,
            "--out",
            folder.join(out).to_str().unwrap(),
        ])
        .args(["--cycle-record", folder.join(format!("{out}.record")).to_str().unwrap()])
        .output()
        .unwrap()
}

/// Runs so many cycles; the file with their results.
pub fn run_json(folder: &Path, config: &str, out: &str, cycles: u64) -> std::path::PathBuf {
    let unique = folder.file_name().unwrap().to_str().unwrap().trim_start_matches(".tmp").to_lowercase();
    let json = folder.join(format!("{out}.json"));
    let ran = Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args(["run", config, "--cell", &format!("t-storm-{out}-{unique}"), "--cycles", &cycles.to_string()])
        .args(["--json", json.to_str().unwrap()])
        .output()
        .unwrap();
    assert!(matches!(ran.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&ran.stderr));
    json
}

/// Hashes of all outputs of the stages of the last cycle.
pub fn hashes(folder: &Path, out: &str) -> serde_json::Value {
    let result = std::fs::read_to_string(folder.join(out).join("result.json")).unwrap();
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    assert!(result["hashes"].as_object().unwrap().len() > 5, "{result}");
    result["hashes"].clone()
}

#[test]
fn a_cell_of_cameras_on_the_network_gives_the_bytes_of_the_twin() {
    let (folder, simulated, live) = cell(1);
    let twin = run(folder.path(), &simulated, "twin", "2");
    assert!(twin.status.success(), "{}", String::from_utf8_lossy(&twin.stderr));
    let served = serve(&simulated, 1, &["drop=11", "duplicate=13", "swap=7"]);
    let ran = run(folder.path(), &live, "net", "2");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    drop(served);
    let cloud = |out: &str| std::fs::read(folder.path().join(out).join("cloud.ply")).unwrap();
    // The headers hold dates and configurations: the points are behind them.
    let points = |bytes: Vec<u8>| {
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        bytes[end..].to_vec()
    };
    let (a, b) = (points(cloud("twin")), points(cloud("net")));
    assert!(a.len() > 1000 && a == b, "{} and {} bytes", a.len(), b.len());
    assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "net"));
}

#[test]
fn packets_and_triggers_that_are_lost_for_good_end_the_cycle_with_their_reason() {
    for (test, faults, reason) in [
        (2, vec!["drop=11", "no-resend"], "is not complete"),
        (3, vec!["ignore-trigger=9"], "no frame within"),
    ] {
        let (folder, simulated, live) = cell(test);
        let served = serve(&simulated, test, &faults);
        let ran = run(folder.path(), &live, "net", "1");
        drop(served);
        let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(1), "{faults:?}: {text}");
        assert!(text.contains(reason), "{faults:?}: {text}");
    }
}

/// The configurations of a cell whose projector carries a check; with `period_ms` it fires the cameras in its own time.
pub fn checked_cell(test: u8, period_ms: Option<f64>) -> (TempDir, String, String) {
    let (folder, simulated, live) = cell(test);
    for path in [&simulated, &live] {
        let text = std::fs::read_to_string(path).unwrap().replace(SEQUENCE, CHECKED);
        let trigger = period_ms.filter(|_| path == &live).map_or(String::new(), |period_ms| {
            format!("trigger = \"sequenced\"\nperiod_ms = {period_ms:?}\n")
        });
        std::fs::write(path, text.replace("width_px = 608", &format!("{trigger}width_px = 608"))).unwrap();
    }
    (folder, simulated, live)
}

#[test]
fn a_projector_that_fires_the_cameras_gives_the_bytes_of_the_twin() {
    let (folder, simulated, live) = checked_cell(7, Some(8.0));
    let twin = run(folder.path(), &simulated, "twin", "2");
    assert!(twin.status.success(), "{}", String::from_utf8_lossy(&twin.stderr));
    let served = serve(&simulated, 7, &["drop=11", "duplicate=13", "swap=7"]);
    let ran = run(folder.path(), &live, "net", "3");
    let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{text}");
    drop(served);
    let shorter = run(folder.path(), &simulated, "third", "3");
    assert!(shorter.status.success());
    assert_eq!(hashes(folder.path(), "third"), hashes(folder.path(), "net"));
}

#[test]
fn frames_out_of_order_are_named_in_the_outcome_of_every_cycle() {
    for (test, period_ms, fault, reason) in [
        (8, None, "exchange=4", "frames 4 and 5 are exchanged"),
        (9, None, "lost=9", "frame 9 was lost"),
        (10, Some(8.0), "twice=10", "pattern 9 was taken twice"),
        (11, Some(8.0), "repeat=6", "frame 6 shows pattern 5 once more"),
    ] {
        let (folder, simulated, live) = checked_cell(test, period_ms);
        let served = serve(&simulated, test, &[fault]);
        let ran = run(folder.path(), &live, "net", "2");
        drop(served);
        let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(1), "{fault}: {text}");
        assert!(text.matches(reason).count() >= 2, "{fault}: {text}");
        assert!(!folder.path().join("net/cloud.ply").exists(), "{fault}: a cloud of wrong frames");
    }
}

#[test]
fn a_trigger_that_a_camera_missed_ends_the_cycle_with_its_reason() {
    let (folder, simulated, live) = checked_cell(12, Some(8.0));
    let served = serve(&simulated, 12, &["ignore-trigger=9"]);
    let ran = run(folder.path(), &live, "net", "1");
    drop(served);
    let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(1), "{text}");
    assert!(text.contains("that the projector fires was lost"), "{text}");
}

#[test]
fn a_camera_that_is_not_there_is_named() {
    let (folder, _, live) = cell(4);
    let ran = run(folder.path(), &live, "net", "1");
    let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
    assert!(!ran.status.success(), "{text}");
    let [a, b, c] = network(4);
    assert!(text.contains(&format!("{a}.{b}.{c}.1")), "{text}");
}

/// A client that only knows the standard: discovery, the description, and the refusal to serve two masters.
#[test]
fn a_device_answers_a_plain_client_as_the_standard_says() {
    let (_folder, simulated, _) = cell(5);
    let _served = serve(&simulated, 5, &[]);
    let [a, b, c] = network(5);
    let device = (Ipv4Addr::new(a, b, c, 11), 3956);
    let client = || {
        let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        socket.connect(device).unwrap();
        socket
    };
    let ask = |socket: &UdpSocket, request: &[u8]| {
        socket.send(request).unwrap();
        let mut answer = [0; 600];
        let length = socket.recv(&mut answer).unwrap();
        answer[..length].to_vec()
    };
    let first = client();
    let discovery = ask(&first, &[0x42, 0x11, 0, 2, 0, 0, 0xff, 0xff]);
    assert_eq!((discovery.len(), &discovery[..4]), (8 + 248, &[0, 0, 0, 3][..]));
    assert!(discovery[8 + 0xd8..].starts_with(b"TWIN-0001"));
    assert!(discovery[8 + 0xe8..].starts_with(b"cam1"));

    let url = ask(&first, &[0x42, 1, 0, 0x84, 0, 8, 0, 1, 0, 0, 2, 0, 0, 0, 0, 64]);
    let url = String::from_utf8_lossy(&url[12..]).trim_end_matches('\0').to_owned();
    assert!(url.starts_with("Local:twin.xml;10000;"), "{url}");

    let take = [0x42, 1, 0, 0x82, 0, 8, 0, 2, 0, 0, 0x0a, 0, 0, 0, 0, 2];
    assert_eq!(ask(&first, &take)[..4], [0, 0, 0, 0x83]);
    let second = client();
    assert_eq!(ask(&second, &take)[..4], [0x80, 6, 0, 0x83], "access denied");
    let width = [0x42, 1, 0, 0x82, 0, 8, 0, 3, 0, 0, 0xa0, 0, 0, 0, 0, 5];
    assert_eq!(ask(&first, &width)[..4], [0x80, 4, 0, 0x83], "write protected");
    let odd = [0x42, 1, 0, 0x80, 0, 4, 0, 4, 0, 0, 0, 1];
    assert_eq!(ask(&first, &odd)[..2], [0x80, 5], "alignment");
    let beyond = [0x42, 1, 0, 0x80, 0, 4, 0, 5, 0xff, 0xff, 0xff, 0xfc];
    assert_eq!(ask(&first, &beyond)[..2], [0x80, 3], "address");
    let unknown = [0x42, 1, 1, 0, 0, 0, 0, 6];
    assert_eq!(ask(&first, &unknown)[..2], [0x80, 1], "not implemented");
}

#[test]
fn impossible_devices_are_refused_with_their_key() {
    let (folder, _, live) = cell(6);
    let text = std::fs::read_to_string(&live).unwrap();
    let cases = [
        ("driver = \"network\"\n", "driver = \"twin\"\n", "[twin]"),
        ("driver = \"genicam\"", "driver = \"recording\"", "address"),
        ("[[camera]]", "[[camera]]\nserial = \"1\"", "either address or serial"),
        ("[[camera]]", "[[camera]]\npixel_format = \"Mono9\"", "pixel_format"),
        ("[[camera]]", "[[camera]]\nexposure_us = -1.0", "exposure_us"),
        ("[[camera]]", "[[camera]]\ngain_db = 1e9", "gain_db"),
        (":3957\"", "\"", "address"),
        ("width_px = 608", "width_px = 608\ntrigger = \"sequenced\"", "period_ms"),
        ("width_px = 608", "width_px = 608\nperiod_ms = 20.0", "sequenced"),
        ("width_px = 608", "width_px = 608\ntrigger = \"sequenced\"\nperiod_ms = 1e9", "period_ms"),
        ("width_px = 608", "width_px = 608\ntrigger = \"sequenced\"\nperiod_ms = 59999.0", "last"),
        ("width_px = 608", "width_px = 608\nrefresh_hz = 0.0", "refresh_hz"),
        ("width_px = 608", "width_px = 608\ntrigger = \"free\"", "trigger"),
        (
            "{ set = \"black\" },",
            "{ set = \"black\" }, { set = \"check\", axis = \"y\", stripe_px = 8.0 },",
            "prove the order",
        ),
    ];
    for (from, to, named) in cases {
        assert!(text.contains(from));
        let path = folder.path().join("bad.toml");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let refused =
            Command::new(env!("CARGO_BIN_EXE_fringecell")).arg("schedule").arg(&path).output().unwrap();
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{to}: {message}");
        assert!(message.contains(named) && message.contains("bad.toml"), "{to}: {message}");
    }
    let wrong = fringetool(&["serve-camera", &live, "--fault", "drop=0"]);
    assert_eq!(wrong.code, Some(2), "{}", wrong.stderr);
}

/// A new cell of served cameras is accepted, ready, and measured as the twin is; each command works on it.
#[test]
fn a_cell_is_set_up_from_cameras_that_answer() {
    let (folder, simulated, _) = cell(13);
    let _served = serve(&simulated, 13, &[]);
    let [a, b, c] = network(13);
    let (cameras, light) = (format!("{a}.{b}.{c}.11,{a}.{b}.{c}.12"), format!("{a}.{b}.{c}.1:3957"));
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let new = fringetool(&[
        "new-cell",
        "--out",
        &path("new.toml"),
        "--name",
        "new",
        "--cameras",
        &cameras,
        "--projector",
        &light,
        "--projector-size",
        "608x684",
        "--json",
        &path("new.json"),
    ]);
    assert_eq!(new.code, Some(0), "{}{}", new.stdout, new.stderr);
    let schedule = Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args(["schedule", &path("new.toml")])
        .output()
        .unwrap();
    assert_eq!(schedule.status.code(), Some(0), "{}", String::from_utf8_lossy(&schedule.stderr));
    let doctor = fringetool(&["doctor", &path("new.toml"), "--json", &path("doctor.json")]);
    assert!(
        doctor.stdout.contains("camera \"cam1\"") && doctor.stdout.contains("TWIN-0001"),
        "{}",
        doctor.stdout
    );
    // The calibrated rig of the test: its cameras have the names and sizes.
    let taken = fringetool(&[
        "new-cell",
        "--out",
        &path("taken.toml"),
        "--rig",
        &path("rig.toml"),
        "--cameras",
        &cameras,
    ]);
    assert_eq!(taken.code, Some(0), "{}{}", taken.stdout, taken.stderr);
}

#[test]
fn cameras_are_exposed_and_looked_through() {
    let (folder, simulated, live) = cell(0);
    let _served = serve(&simulated, 0, &[]);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let dark = fringetool(&[
        "expose",
        &live,
        "--start-us",
        "1000",
        "--write",
        &path("exposed.toml"),
        "--json",
        &path("exposed.json"),
    ]);
    assert_eq!(dark.code, Some(0), "{}{}", dark.stdout, dark.stderr);
    let exposed: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path("exposed.json")).unwrap()).unwrap();
    let us = exposed["cameras"][0]["exposure_us"].as_f64().unwrap();
    assert!((5_000.0..30_000.0).contains(&us), "{exposed}");
    assert!(std::fs::read_to_string(path("exposed.toml")).unwrap().contains("exposure_us = "));
    let preview = fringetool(&[
        "preview",
        &live,
        "--camera",
        "cam2",
        "--modulation",
        "--png",
        &path("a.png"),
        "--json",
        &path("preview.json"),
    ]);
    assert_eq!(preview.code, Some(0), "{}{}", preview.stdout, preview.stderr);
    assert!(
        std::fs::read(path("a.png")).unwrap().starts_with(b"\x89PNG") && preview.stdout.contains("sharpness")
    );
}

#[test]
fn set_up_commands_refuse_what_they_cannot_do_with_one_message() {
    let (folder, simulated, live) = cell(14);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [a, b, c] = network(14);
    let absent = format!("{a}.{b}.{c}.99");
    std::fs::write(path("foreign.toml"), "answer = 42\n").unwrap();
    let cases: [(&[&str], &str); 15] = [
        (&["new-cell", "--out", &path("n.toml"), "--cameras", &absent], &absent),
        (&["new-cell", "--out", &path("n.toml"), "--cameras", "1.2.3"], "--cameras"),
        (&["new-cell", "--out", &path("n.toml"), "--name", "Ä b"], "--name"),
        (&["new-cell", "--out", &path("n.toml"), "--projector-size", "99999999x1"], "--projector-size"),
        (&["new-cell", "--out", &path("n.toml"), "--distance-mm", "1e300"], "--distance-mm"),
        (&["new-cell", "--out", &path("n.toml"), "--period-ms", "nan"], "--period-ms"),
        (&["new-cell", "--out", &path("n.toml"), "--rig", &path("none.toml")], "none.toml"),
        (&["new-cell", "--out", &simulated, "--cameras", &absent], "--force"),
        (&["doctor", &path("foreign.toml")], "foreign.toml"),
        (&["expose", &simulated, "--write", &path("w.toml")], "[twin]"),
        (&["expose", &simulated, "--start-us", "1e99"], "--start-us"),
        (&["expose", &simulated, "--camera", "cam9"], "cam9"),
        (&["preview", &simulated, "--frame", "99999999999"], "--frame"),
        (&["preview", &simulated, "--serve", "0.0.0.0:0"], "--allow-remote"),
        (&["preview", &live], &format!("{a}.{b}.{c}.")),
    ];
    for (arguments, named) in cases {
        let ran = fringetool(arguments);
        assert_eq!(ran.code, Some(2), "{arguments:?}: {}{}", ran.stdout, ran.stderr);
        assert!(
            ran.stderr.contains(named) && !ran.stderr.contains("panicked"),
            "{arguments:?}: {}",
            ran.stderr
        );
        assert!(!folder.path().join("n.toml").exists(), "{arguments:?}");
    }
    let doctor = fringetool(&["doctor", &live]);
    assert_eq!(doctor.code, Some(1), "{}{}", doctor.stdout, doctor.stderr);
    assert!(
        doctor.stdout.contains("BAD") && doctor.stdout.contains(&format!("{a}.{b}.{c}.11")),
        "{}",
        doctor.stdout
    );
}

#[test]
fn no_part_has_a_verdict_before_the_cameras_have_settled() {
    let (folder, simulated, live) = cell(15);
    let _served = serve(&simulated, 15, &["warm-up=2"]);
    let gate = |change: f64, window: f64| {
        let text = std::fs::read_to_string(&live).unwrap();
        let path = folder.path().join("gate.toml");
        std::fs::write(
            &path,
            format!("{text}\n[warm_up]\nmax_change_k = {change:?}\nwindow_s = {window:?}\n"),
        )
        .unwrap();
        run(folder.path(), path.to_str().unwrap(), "gate", "2")
    };
    let cold = gate(0.5, 3600.0);
    let text = String::from_utf8_lossy(&cold.stdout).into_owned() + &String::from_utf8_lossy(&cold.stderr);
    assert_eq!(cold.status.code(), Some(1), "{text}");
    assert!(text.contains("has not settled"), "{text}");
    let result = std::fs::read_to_string(folder.path().join("gate/result.json")).unwrap();
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    let state = &result["reports"]["frame/cam1"];
    assert!(
        state["temperature_c"].as_f64().is_some_and(|celsius| (20.0..40.0).contains(&celsius)),
        "{result}"
    );
    assert!(state["link"]["packets"].as_u64().is_some_and(|packets| packets > 100), "{result}");
}

//! Cameras on the network: the twin as GigE Vision cameras gives the same bytes as the twin itself, and what goes wrong on
//! the network is repaired or told, never believed.

use crate::support::{SMALL_PX, fringetool, root};
use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;
use tempfile::TempDir;

const SEQUENCE: &str = r#"{ set = "sine", axis = "x", period_px = 16.0, steps = 5 },
  { set = "gray", axis = "x", bits = 7, stripe_px = 8.0 },
  { set = "white" }, { set = "black" },"#;

/// Loopback addresses of this test alone: the control port of a camera is the same for all.
fn network(test: u8) -> [u8; 3] {
    let pid = std::process::id();
    [127, 16 + (pid % 200) as u8, (pid / 200 % 8) as u8 * 16 + test]
}

fn configuration(folder: &Path, test: u8, live: bool) -> String {
    let [a, b, c] = network(test);
    let (projector, cameras) = if live {
        let camera = |n: u8| {
            format!(
                "[[camera]]\nname = \"cam{n}\"\ndriver = \"genicam\"\naddress = \"{a}.{b}.{c}.{}\"\n",
                10 + n
            )
        };
        (format!("driver = \"network\"\naddress = \"{a}.{b}.{c}.1:3957\""), camera(1) + &camera(2))
    } else {
        let camera = |n: u8| format!("[[camera]]\nname = \"cam{n}\"\ndriver = \"twin\"\n");
        ("driver = \"twin\"".to_owned(), camera(1) + &camera(2))
    };
    let scene = root().join("configs/complex-artefact.scene.toml").display().to_string();
    let twin = if live { String::new() } else { format!("[twin]\nscene = {scene:?}\n") };
    let text = format!(
        "format = \"fringecell-config/1\"\nname = \"gige\"\nrig = \"rig.toml\"\n\
         [limits]\nstage_budget_ms = 20000\ncycle_deadline_ms = 60000\n\
         [[projector]]\nname = \"proj1\"\n{projector}\nwidth_px = 608\nheight_px = 684\n\
         cameras = [\"cam1\", \"cam2\"]\nsequence = [\n  {SEQUENCE}\n]\n{cameras}{twin}"
    );
    let path = folder.join(if live { "live.toml" } else { "twin.toml" });
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The served cameras, stopped when dropped.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn serve(config: &str, test: u8, faults: &[&str]) -> Served {
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
    let folder = TempDir::new().unwrap();
    let mut rig = twin::thesis::rig(SMALL_PX.0, SMALL_PX.1);
    rig.cameras.truncate(2);
    rig.projectors.truncate(1);
    rig.pairs.truncate(1);
    files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
    let (simulated, live) =
        (configuration(folder.path(), test, false), configuration(folder.path(), test, true));
    (folder, simulated, live)
}

fn run(folder: &Path, config: &str, out: &str, cycles: &str) -> Output {
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

/// Hashes of all outputs of the stages of the last cycle.
fn hashes(folder: &Path, out: &str) -> serde_json::Value {
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

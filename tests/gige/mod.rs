//! Cameras on the network: the twin as GigE Vision cameras gives the same bytes as the twin itself, and what goes wrong on
//! the network is repaired or told, never believed.

#[cfg(feature = "aravis")]
mod aravis;
mod figures;
mod order;
mod set_up;
mod stream;

use crate::support::{SMALL_PX, root};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
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

/// A part of a cell's name that no other test has: several run at once, and the folder's name is unique.
fn unique(folder: &Path) -> String {
    folder.file_name().unwrap().to_str().unwrap().trim_start_matches(".tmp").to_lowercase()
}

pub fn run(folder: &Path, config: &str, out: &str, cycles: &str) -> Output {
    let name = format!("t-gige-{out}-{}", unique(folder));
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
    let json = folder.join(format!("{out}.json"));
    let ran = Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args([
            "run",
            config,
            "--cell",
            &format!("t-storm-{out}-{}", unique(folder)),
            "--cycles",
            &cycles.to_string(),
        ])
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

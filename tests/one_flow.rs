//! One flow: a recording that a cell made gives the same cloud offline, byte for byte, whatever the cell matches.

use crate::support::{SMALL_PX, fringetool, root};
use fringe::geometry::rig::{Pair, Rig};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

const X: &str = r#"{ set = "sine", axis = "x", period_px = 16.0, steps = 5 },
  { set = "gray", axis = "x", bits = 7, stripe_px = 8.0 },"#;

const Y: &str = r#"{ set = "sine", axis = "y", period_px = 16.0, steps = 5 },
  { set = "gray", axis = "y", bits = 7, stripe_px = 8.0 },"#;

/// Where the cameras stand, seen from the projector.
#[derive(Clone, Copy, PartialEq)]
enum Baseline {
    Horizontal,
    Vertical,
}

/// The first pair of the demo; turned about the projector's axis, its baseline is vertical while all images stay upright.
fn rig(baseline: Baseline, with_projector: bool) -> Rig {
    let mut rig = twin::thesis::rig(SMALL_PX.0, SMALL_PX.1);
    rig.cameras.truncate(2);
    rig.projectors.truncate(1);
    rig.pairs.truncate(1);
    if baseline == Baseline::Vertical {
        let roll = |angle: f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            Isometry3::from_parts(Translation3::identity(), turn)
        };
        let projector = rig.projectors[0].camera.camera_from_world;
        for view in &mut rig.cameras {
            let camera_from_projector = view.camera.camera_from_world * projector.inverse();
            view.camera.camera_from_world =
                roll(FRAC_PI_2) * camera_from_projector * roll(-FRAC_PI_2) * projector;
        }
    }
    if with_projector {
        rig.cameras.truncate(1);
        let (left, right) = ("cam1".to_owned(), "proj1".to_owned());
        rig.pairs = vec![Pair { name: "pair1".into(), left, right: right.clone(), projector: right }];
    }
    rig
}

fn configuration(rig: &Rig, sequence: &[&str]) -> String {
    let names: Vec<String> = rig.cameras.iter().map(|camera| format!("{:?}", camera.name)).collect();
    let camera = |name: &String| format!("[[camera]]\nname = {name}\ndriver = \"twin\"\n");
    let cameras = names.iter().map(camera).collect::<Vec<_>>().concat();
    // Settings that are not the usual ones, in each table: offline they must hold as well.
    format!(
        "format = \"fringecell-config/1\"\nname = \"flow\"\nrig = \"rig.toml\"\n\
         [decode]\nmin_modulation_fraction = 0.03\n\
         [matching]\ndepth_mm = [100.0, 5000.0]\n[matching.surface]\nsmoothing_px = 3\n\
         [fusion]\nmin_neighbours = 5\n\
         [[projector]]\nname = \"proj1\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\n\
         cameras = [{}]\nsequence = [\n  {}\n  {{ set = \"white\" }}, {{ set = \"black\" }},\n]\n\
         {cameras}[twin]\nscene = {:?}\n",
        names.join(", "),
        sequence.join("\n  "),
        root().join("configs/complex-artefact.scene.toml").display().to_string()
    )
}

/// Runs the cell, reconstructs its recording, and compares; gives the number of points.
fn same_cloud(name: &str, rig: &Rig, sequence: &[&str], method: &str) -> usize {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    files::rig_file::write_rig(&folder.path().join("rig.toml"), rig, &toml::Table::new(), None).unwrap();
    std::fs::write(folder.path().join("cell.toml"), configuration(rig, sequence)).unwrap();
    let (config, cell) = (path("cell.toml"), format!("t-{name}-{}", std::process::id()));
    let ran = Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args(["run", &config, "--cell", &cell, "--cycles", "1"])
        .args(["--record", &path("rec"), "--out", &path("out")])
        .output()
        .unwrap();
    let said = [ran.stdout, ran.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(ran.status.success(), "{name}: {said}");
    fringetool(&["reconstruct", "--config", &config, &path("rec"), "--out", &path("offline.ply")])
        .expect_success();
    let live = ply(&folder.path().join("out/cloud.ply"));
    let offline = ply(&folder.path().join("offline.ply"));
    assert_eq!(live.method, method, "{name}");
    assert_eq!(offline.method, method, "{name}");
    assert_eq!(live.header, offline.header, "{name}");
    assert!(live.points == offline.points, "{name}: the points differ");
    live.points.len() / live.bytes_per_point
}

/// A recording of two exposures that a cell plays: all of both reach its cloud, and what it records of them again.
#[test]
fn a_recording_of_several_exposures_gives_the_same_cloud_live_and_offline() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (rig, sequence) = (rig(Baseline::Horizontal, false), [X, Y]);
    files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
    let shown = configuration(&rig, &sequence);
    std::fs::write(folder.path().join("shown.toml"), &shown).unwrap();
    let exposures = ["--exposures", "0.3,3"];
    fringetool(&[&["simulate", &path("shown.toml"), "--out", &path("rec")][..], &exposures].concat())
        .expect_success();
    let (cell, _) = shown.split_once("[twin]").unwrap();
    let played = cell.replace("\"twin\"", "\"recording\"") + "[recording]\npath = \"rec\"\n";
    let config = path("played.toml");
    std::fs::write(&config, played).unwrap();
    let ran = Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args([
            "run",
            &config,
            "--cell",
            &format!("t-flow-exposures-{}", std::process::id()),
            "--cycles",
            "1",
        ])
        .args(["--record", &path("again"), "--out", &path("out")])
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let live = ply(&folder.path().join("out/cloud.ply"));
    let offline = |recording: &str| {
        let (recording, out) = (path(recording), path(&format!("{recording}.ply")));
        fringetool(&["reconstruct", "--config", &config, &recording, "--out", &out]).expect_success();
        ply(Path::new(&out))
    };
    for recording in ["rec", "again"] {
        let offline = offline(recording);
        assert_eq!(live.header, offline.header, "{recording}");
        assert!(live.points == offline.points, "{recording}: the points differ");
    }
    // The first exposure alone sees less: the second one counts.
    let file = path("again/recording.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    let single: Vec<&str> = text.lines().filter(|line| !line.starts_with("exposures_ms")).collect();
    assert!(single.len() < text.lines().count(), "{text}");
    std::fs::write(&file, single.join("\n")).unwrap();
    for camera in ["cam1", "cam2"] {
        let frames = std::fs::read_dir(path(&format!("again/frames/proj1/{camera}"))).unwrap();
        let longer =
            frames.map(|entry| entry.unwrap().path()).filter(|p| p.to_str().unwrap().contains("_1."));
        assert!(longer.map(|path| std::fs::remove_file(path).unwrap()).count() > 0);
    }
    let first = offline("again");
    assert!(first.points.len() < live.points.len(), "{} {}", first.points.len(), live.points.len());
}

/// A recording for a calibration shows every projector to every camera; the cell gives the same cloud meanwhile.
#[test]
fn a_camera_may_look_at_the_projector_of_another_pair() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let rig = twin::thesis::rig(SMALL_PX.0, SMALL_PX.1);
    files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
    let text = configuration(&rig, &[X]);
    let (head, rest) = text.split_once("[[projector]]").unwrap();
    let (projector, cameras) = rest.split_once("[[camera]]").unwrap();
    let second = projector.replace("proj1", "proj2");
    let crossed = format!("{head}[[projector]]{projector}[[projector]]{second}[[camera]]{cameras}");
    let all = r#""cam1", "cam2", "cam3", "cam4""#;
    let apart = crossed.replacen(all, r#""cam1", "cam2""#, 1).replacen(all, r#""cam3", "cam4""#, 1);
    let run = |name: &str, text: &str| {
        std::fs::write(path(&format!("{name}.toml")), text).unwrap();
        let cell = format!("t-flow-{name}-{}", std::process::id());
        let ran = Command::new(env!("CARGO_BIN_EXE_fringecell"))
            .args(["run", &path(&format!("{name}.toml")), "--cell", &cell, "--cycles", "1"])
            .args(["--record", &path(&format!("{name}-rec")), "--out", &path(name)])
            .output()
            .unwrap();
        assert!(ran.status.success(), "{name}: {}", String::from_utf8_lossy(&ran.stderr));
        ply(&folder.path().join(name).join("cloud.ply"))
    };
    let (one, other) = (run("crossed", &crossed), run("apart", &apart));
    assert!(!one.points.is_empty() && one.points == other.points);
    let frame = |name: &str| Path::new(&path(&format!("{name}-rec/frames/proj1/cam4/000.png"))).exists();
    assert!(frame("crossed") && !frame("apart"));
}

/// A point cloud, with its provenance apart.
struct Ply {
    method: String,
    header: Vec<String>,
    points: Vec<u8>,
    bytes_per_point: usize,
}

fn ply(path: &Path) -> Ply {
    const END: &[u8] = b"end_header\n";
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(END.len()).position(|part| part == END).unwrap() + END.len();
    let (header, points) = bytes.split_at(end);
    let header = String::from_utf8(header.to_vec()).unwrap();
    let (comments, header): (Vec<&str>, Vec<&str>) =
        header.lines().partition(|line| line.starts_with("comment"));
    let method = comments.iter().find_map(|line| line.strip_prefix("comment method: "));
    let count = header.iter().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
    let count: usize = count.parse().unwrap();
    Ply {
        method: method.unwrap_or_else(|| panic!("no method in {comments:?}")).to_owned(),
        header: header.into_iter().map(str::to_owned).collect(),
        points: points.to_vec(),
        bytes_per_point: points.len() / count,
    }
}

#[test]
fn two_cameras_beside_each_other_give_the_same_cloud_live_and_offline() {
    let rig = rig(Baseline::Horizontal, false);
    let x = same_cloud("flow-x", &rig, &[X], "phase");
    let both = same_cloud("flow-xy", &rig, &[X, Y], "phase");
    // The phase along y does not change along their epipolar lines: with both, that along x is matched.
    assert!(x > 1000 && both > x * 9 / 10, "{x} points by x, {both} of both");
}

#[test]
fn two_cameras_above_each_other_give_the_same_cloud_live_and_offline() {
    let rig = rig(Baseline::Vertical, false);
    let y = same_cloud("flow-v-y", &rig, &[Y], "phase");
    let both = same_cloud("flow-v-xy", &rig, &[X, Y], "phase");
    assert!(y > 1000 && both > y * 9 / 10, "{y} points by y, {both} of both");
}

#[test]
fn a_camera_and_its_projector_give_the_same_cloud_live_and_offline() {
    for (name, baseline, sequence) in [
        ("flow-p-x", Baseline::Horizontal, &[X][..]),
        ("flow-p-y", Baseline::Vertical, &[Y]),
        ("flow-p-xy", Baseline::Horizontal, &[X, Y]),
        ("flow-p-v-xy", Baseline::Vertical, &[X, Y]),
    ] {
        let points = same_cloud(name, &rig(baseline, true), sequence, "projector");
        assert!(points > 1000, "{name}: {points} points");
    }
}

/// Codes without fringes, lines, micro and modulated phase shifting: a cell takes what the offline tools take.
#[test]
fn every_codec_gives_the_same_cloud_live_and_offline() {
    let gray = r#"{ set = "gray", axis = "x", bits = 7, stripe_px = 8.0 },"#;
    let lines = r#"{ set = "lines", axis = "x", period_px = 32.0, steps = 8, width_px = 4.0 },"#;
    let micro = r#"{ set = "micro", axis = "x", periods_px = [24.0, 25.1, 26.7, 29.3, 33.0, 39.1] },"#;
    let modulated = r#"{ set = "modulated", axis = "x", period_px = 32.0, steps = 4, carrier_px = 24.0, carrier_steps = 4 },"#;
    let one = r#"{ set = "sine", axis = "x", period_px = 24.0, steps = 1 },"#;
    for (name, sequence, least) in [
        ("gray", vec![gray], 1000),
        ("lines", vec![lines, gray], 1000),
        ("micro", vec![micro], 1000),
        ("modulated", vec![modulated, gray], 1000),
        ("one", vec![one, gray], 300),
    ] {
        for (views, with_projector, method) in [("c", false, "phase"), ("p", true, "projector")] {
            let rig = rig(Baseline::Horizontal, with_projector);
            let points = same_cloud(&format!("flow-{name}-{views}"), &rig, &sequence, method);
            assert!(points > least, "{name} {views}: {points} points");
        }
    }
}

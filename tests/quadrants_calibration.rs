//! One calibration of a rig around a part, from poses of which each is seen by two sides of it only.

use crate::support::{Ran, fringetool, root};
use std::fmt::Write as _;
use tempfile::TempDir;

/// Cameras of the test, px.
const SIZE_PX: (u32, u32) = (562, 375);

const NAMES: [&str; 4] = ["east", "north", "west", "south"];

/// Squares of the boards, mm: so large that small cameras read the markers.
const BOARD: &str = "columns = 5, rows = 4, pitch_mm = 10.0";

/// The target of the configuration with fewer and larger squares.
fn large_squares(text: &str) -> String {
    text.replace("columns = 7, rows = 6, pitch_mm = 7.5", BOARD)
        .replace("columns = 7\nrows = 6\npitch_mm = 7.5", &BOARD.replace(", ", "\n"))
        .replace("marker_mm = 4.8", "marker_mm = 6.5")
}

/// The cell of some sides of the rig.
fn cell(sides: &[usize]) -> String {
    let mut text = "format = \"fringecell-config/1\"\nname = \"sides\"\nrig = \"true-rig.toml\"\n".to_owned();
    let pairs: Vec<String> = sides.iter().map(|side| format!("\"pair{}\"", side + 1)).collect();
    writeln!(text, "pairs = [{}]", pairs.join(", ")).unwrap();
    for side in sides {
        let [left, right] = [2 * side + 1, 2 * side + 2];
        writeln!(
            text,
            "[[projector]]\nname = \"proj{}\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\ncameras = [\"cam{left}\", \"cam{right}\"]\n\
             sequence = [{{ set = \"white\" }}, {{ set = \"sine\", axis = \"x\", period_px = 40.0, steps = 3 }}, \
             {{ set = \"sine\", axis = \"x\", period_px = 608.0, steps = 3 }}, {{ set = \"sine\", axis = \"y\", period_px = 45.0, steps = 3 }}, \
             {{ set = \"sine\", axis = \"y\", period_px = 684.0, steps = 3 }}]\n\
             [[camera]]\nname = \"cam{left}\"\ndriver = \"twin\"\n[[camera]]\nname = \"cam{right}\"\ndriver = \"twin\"",
            side + 1
        )
        .unwrap();
    }
    text + "[twin]\nscene = \"boards.scene.toml\"\nseed = 3\n\
            settings = { position_scatter_mm = 12.0, angle_scatter_deg = 20.0, subsamples = 2 }\n"
}

/// The cell on disk, and the recordings of its target.
struct Poses {
    folder: TempDir,
    recordings: Vec<String>,
}

impl Poses {
    /// One pose for each set of sides.
    fn new(sides: &[&[usize]]) -> Self {
        let folder = TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let rig = twin::thesis::rig_of_sides(4, SIZE_PX.0, SIZE_PX.1);
        files::rig_file::write_rig(path("true-rig.toml").as_ref(), &rig, &toml::Table::new(), None).unwrap();
        for (from, to) in
            [("frustum.scene.toml", "boards.scene.toml"), ("frustum.target.toml", "target.toml")]
        {
            let text = std::fs::read_to_string(root().join("configs").join(from)).unwrap();
            std::fs::write(path(to), large_squares(&text)).unwrap();
        }
        let mut recordings = Vec::new();
        for (pose, sides) in sides.iter().enumerate() {
            std::fs::write(path("cell.toml"), cell(sides)).unwrap();
            let (cell, out, cycle) = (path("cell.toml"), path(&format!("pose{pose}")), pose.to_string());
            fringetool(&["simulate", &cell, "--cycle", &cycle, "--out", &out]).expect_success();
            recordings.push(out);
        }
        Self { folder, recordings }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn calibrate(&self, recordings: &[&String]) -> Ran {
        let (target, out, json) = (self.path("target.toml"), self.path("rig.toml"), self.path("rig.json"));
        let mut arguments =
            vec!["calibrate", "--target", &target, "--out", &out, "--json", &json, "--hold-out", "0"];
        arguments.extend(recordings.iter().map(|r| r.as_str()));
        fringetool(&arguments)
    }
}

/// Proves: eight cameras and four projectors come out of one adjustment, each from poses that only two sides see; lengths across the rig
/// are true, one covariance holds all devices, and a rig of which two parts share no pose is refused with both parts and their poses.
#[test]
#[ignore = "half a minute of processor time: cargo test --test main a_rig_around_a_part -- --ignored"]
fn a_rig_around_a_part_is_calibrated_at_once_from_poses_of_two_sides() {
    let poses = Poses::new(&[&[0, 1], &[1, 2], &[2, 3], &[0, 1], &[1, 2], &[2, 3], &[3, 0]]);
    let all: Vec<&String> = poses.recordings.iter().collect();
    println!("{}", poses.calibrate(&all).expect_success().stdout);
    let rig = files::rig_file::read_rig(poses.path("rig.toml").as_ref()).unwrap();
    let truth = twin::thesis::rig_of_sides(4, SIZE_PX.0, SIZE_PX.1);
    assert_eq!((rig.rig.cameras.len(), rig.rig.projectors.len(), rig.rig.pairs.len()), (8, 4, 4));
    let centre = |rig: &fringe::geometry::rig::Rig, name: &str| rig.device(name).unwrap().centre_mm();
    let names: Vec<String> =
        (1..=8).map(|i| format!("cam{i}")).chain((1..=4).map(|i| format!("proj{i}"))).collect();
    for (a, b) in names.iter().flat_map(|a| names.iter().map(move |b| (a, b))) {
        let [found, true_mm] = [&rig.rig, &truth].map(|rig| (centre(rig, a) - centre(rig, b)).norm());
        // Three poses leave focal lengths of cameras open by 0.1 %, of projectors by 0.3 %: 0.5 and 1.5 mm of their stand-off.
        let limit_mm = if a.starts_with("proj") || b.starts_with("proj") { 4.5 } else { 1.5 };
        assert!((found - true_mm).abs() < limit_mm, "{a} to {b}: {found} mm, truth {true_mm} mm");
    }
    let covariance = std::fs::read_to_string(poses.path("rig.covariance.json")).unwrap();
    let covariance: serde_json::Value = serde_json::from_str(&covariance).unwrap();
    assert_eq!(covariance["devices"].as_array().unwrap().len(), 12);
    // Sides 1 and 2 on the one hand, 3 and 4 on the other.
    let split: Vec<&String> = [0, 2, 3, 5].iter().map(|i| &poses.recordings[*i]).collect();
    let ran = poses.calibrate(&split);
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    for words in [
        "[cam1, cam2, cam3, cam4, proj1, proj2] [cam5, cam6, cam7, cam8, proj3, proj4]",
        "alone sees",
        "pose2",
    ] {
        assert!(ran.stderr.contains(words), "{words}: {}", ran.stderr);
    }
}

/// Proves: faces that cannot be told apart, that look the same after half a turn, or that have no place are refused with key and line.
#[test]
fn targets_whose_faces_cannot_be_told_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let good = std::fs::read_to_string(root().join("configs/frustum.target.toml")).unwrap();
    let plain = "kind = \"charuco\"\ncolumns = 7\nrows = 6\npitch_mm = 7.5\ndictionary = \"DICT_4X4_250\"\nmarker_mm = 4.8\nfirst_marker = 40\n";
    assert!(good.contains(plain) && NAMES.iter().all(|name| good.contains(name)));
    let cases = [
        (good.replace("first_marker = 40", "first_marker = 20"), "\"east\" and \"north\" look alike"),
        (good.replace("name = \"north\"", "name = \"east\""), "a name of its own"),
        (
            good.replace(plain, "kind = \"checkerboard\"\ncolumns = 8\nrows = 6\npitch_mm = 7.5\n"),
            "same after half a turn",
        ),
        (
            good.replace(plain, "kind = \"checkerboard\"\ncolumns = 7\nrows = 6\npitch_mm = 7.5\n"),
            "look alike",
        ),
        (good.replace("first_marker = 120", "first_marker = 240"), "250 markers"),
        (good.replace("position_mm = [0.0, 48.0, 15.0]\n", ""), "position_mm"),
        (good.replace("225.0, 0.0, 180.0", "nan, 0.0, 180.0"), "rotation_deg"),
        (good.split("\n[[face]]").take(2).collect::<Vec<_>>().join("\n[[face]]"), "2 … 24 faces"),
    ];
    for (text, words) in cases {
        std::fs::write(path("target.toml"), &text).unwrap();
        let (target, out) = (path("target.toml"), path("rig.toml"));
        let ran =
            fringetool(&["calibrate", "--target", &target, "--out", &out, "--images", "cam1=none*.png"]);
        assert_eq!(ran.code, Some(2), "{}", ran.stderr);
        assert!(ran.stderr.contains(words) && ran.stderr.contains("target.toml"), "{words}: {}", ran.stderr);
    }
}

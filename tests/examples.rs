//! The programs in `examples/`, run on small inputs from the twin.

use crate::support::{Ran, Small, fringetool, root};
use std::path::Path;
use std::process::Command;

/// Runs an example; `cargo test` has built it beside the programs.
fn example(name: &str, arguments: &[&str]) -> Ran {
    let program = Path::new(env!("CARGO_BIN_EXE_fringetool")).with_file_name("examples").join(name);
    assert!(program.exists(), "{} is not built: run all of `cargo test`", program.display());
    Ran::new(&Command::new(program).args(arguments).current_dir(root()).output().expect("the example starts"))
}

#[test]
fn a_recording_becomes_the_cloud_of_the_tool() {
    let small = Small::new();
    let (recording, rig, out) = (small.path("rec"), small.path("rig.toml"), small.path("example.ply"));
    example("recording_to_cloud", &[&recording, &rig, &out]).expect_success();
    small.reconstruct(&["--pair", "pair1"]).expect_success();
    let read = |name: &str| files::ply::read_cloud(small.path(name).as_ref()).unwrap().points;
    let (ours, theirs) = (read("example.ply"), read("cloud.ply"));
    // The tool also drops isolated points.
    let together = ours.len() - theirs.len();
    assert!(theirs.len() > 2000 && together * 100 < ours.len(), "{} and {} points", ours.len(), theirs.len());
}

#[test]
fn a_cloud_becomes_features_and_a_sphere() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fringetool(&["simulate", "--out", &path("rec")]).expect_success();
    let rig = "configs/demo-rig.toml";
    fringetool(&["reconstruct", "--rig", rig, "--out", &path("cloud.ply"), &path("rec")]).expect_success();
    let plan = "configs/complex-artefact.plan.toml";
    let ran = example("cloud_to_features", &[plan, &path("cloud.ply")]).expect_success();
    let number = |start: &str| -> f64 {
        let line = ran
            .stdout
            .lines()
            .find(|line| line.starts_with(start))
            .unwrap_or_else(|| panic!("{}", ran.stdout));
        line[start.len()..].split_whitespace().next().unwrap().parse().unwrap()
    };
    assert_eq!(ran.stdout.matches("not measured").count(), 0, "{}", ran.stdout);
    assert!((number("sphere1_diameter") - 22.462).abs() < 0.01, "{}", ran.stdout);
    assert!((number("by hand: diameter") - 22.462).abs() < 0.03, "{}", ran.stdout);
}

#[test]
fn pictures_become_a_rig() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    // Boards by two of the twin's cameras, white light only, one ray a pixel more than the default.
    let cell = std::fs::read_to_string(root().join("configs/calibration.toml")).unwrap();
    let start = cell.find("sequence = [").unwrap();
    let head = cell[..start].replace("\"cam1\", \"cam2\", \"cam3\", \"cam4\"", "\"cam1\", \"cam2\"");
    let sequence =
        "sequence = [{ set = \"sine\", axis = \"x\", period_px = 1000.0, steps = 3 }, { set = \"white\" }]\n";
    let cameras =
        "[[camera]]\nname = \"cam1\"\ndriver = \"twin\"\n[[camera]]\nname = \"cam2\"\ndriver = \"twin\"\n";
    let twin = "[twin]\nscene = \"board.scene.toml\"\n\
                settings = { position_scatter_mm = 20.0, angle_scatter_deg = 22.0, subsamples = 2 }\n";
    let head = head.replace("rig = \"demo-rig.toml\"", "rig = \"demo-rig.toml\"\npairs = [\"pair1\"]");
    std::fs::write(path("cell.toml"), format!("{head}{sequence}{cameras}{twin}")).unwrap();
    for name in ["demo-rig.toml", "board.scene.toml"] {
        std::fs::copy(root().join("configs").join(name), path(name)).unwrap();
    }
    let mut arguments = vec!["configs/board.target.toml".to_owned(), path("rig.toml")];
    for pose in 0..6 {
        let rec = path(&format!("p{pose}"));
        fringetool(&["simulate", &path("cell.toml"), "--cycle", &pose.to_string(), "--out", &rec])
            .expect_success();
        arguments.extend(["cam1", "cam2"].map(|camera| format!("{rec}/frames/proj1/{camera}/003.png")));
    }
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    println!("{}", example("images_to_rig", &arguments).expect_success().stdout);
    let rig = files::rig_file::read_rig(path("rig.toml").as_ref()).unwrap().rig;
    let truth = files::rig_file::read_rig(&root().join("configs/demo-rig.toml")).unwrap().rig;
    let baseline_mm = |rig: &fringe::geometry::rig::Rig, left: &str, right: &str| {
        (rig.camera(left).unwrap().centre_mm() - rig.camera(right).unwrap().centre_mm()).norm()
    };
    let off_mm = baseline_mm(&rig, "left", "right") - baseline_mm(&truth, "cam1", "cam2");
    assert!(off_mm.abs() < 0.2, "{off_mm} mm");
}

#[test]
fn a_driver_of_ones_own_passes_the_checks_of_all_drivers() {
    let ran = example("projector_driver", &[]).expect_success();
    assert!(ran.stdout.contains("the driver does what a cell asks of a projector"), "{}", ran.stdout);
}

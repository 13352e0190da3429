//! The twin's frames become a cloud whose features are true.

use crate::support::{fringetool, root};
use tempfile::TempDir;

fn json(path: &std::path::Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn sphere(cloud: &std::path::Path, near: &str) -> serde_json::Value {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("fit.json");
    let arguments =
        ["fit", "sphere", cloud.to_str().unwrap(), "--near", near, "--json", out.to_str().unwrap()];
    fringetool(&arguments).expect_success();
    json(&out)
}

/// Nominal pose, so that the spheres stand where the scene file states.
const STILL: &str = "position_scatter_mm = 0.0, angle_scatter_deg = 0.0";

#[test]
fn the_ideal_twin_gives_true_spheres() {
    let folder = TempDir::new().unwrap();
    let cell = cell_without_scatter(&folder);
    simulate_cell(&folder, &cell, &["--ideal"]);
    for method in ["phase", "projector"] {
        let (cloud, report) = reconstruct_recording(&folder, method);
        assert!(report["points"].as_u64().unwrap() > 300_000, "{method}: {}", report["points"]);
        // The upper part only: below the equator the post joins.
        let one = sphere(&cloud, "-39.7560,-39.7560,32,10");
        let two = sphere(&cloud, "39.7560,39.7560,32,10");
        let error_um =
            |fit: &serde_json::Value, truth: f64| (fit["diameter_mm"].as_f64().unwrap() - truth) * 1e3;
        assert!(error_um(&one, 22.462).abs() < 1.0, "{method}: {} µm", error_um(&one, 22.462));
        assert!(error_um(&two, 22.367).abs() < 1.0, "{method}: {} µm", error_um(&two, 22.367));
        let centre = |fit: &serde_json::Value| -> Vec<f64> {
            fit["center_mm"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
        };
        let spacing_mm: f64 =
            centre(&one).iter().zip(centre(&two)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!((spacing_mm - 112.447).abs() < 1e-3, "{method}: spacing {spacing_mm} mm");
    }
    a_footprint_that_frames_contradict_goes_with_the_cloud(&folder);
}

/// Of the same recording, whose pictures no lens has blurred: the cloud says which camera of its rig file has another footprint, and who
/// measures on it without the rig is warned.
fn a_footprint_that_frames_contradict_goes_with_the_cloud(folder: &TempDir) {
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let rig = std::fs::read_to_string(root().join("configs/demo-rig.toml")).unwrap();
    let blurred = rig.replacen("name = \"cam2\"\n", "name = \"cam2\"\nfootprint_px = [1.2, 1.2]\n", 1);
    std::fs::write(path("blurred.toml"), blurred).unwrap();
    let told = |rig: &str| {
        let cloud = path("told.ply");
        let reconstruct = ["reconstruct", "--rig", rig, "--out", &cloud, "--force", &path("rec")];
        fringetool(&reconstruct).expect_success();
        let header = String::from_utf8_lossy(&std::fs::read(&cloud).unwrap()[..1000]).into_owned();
        let measured = fringetool(&["measure", "configs/complex-artefact.plan.toml", &cloud]);
        (header.contains("comment footprint_off_px2: {\"cam2\":-1."), measured.stderr)
    };
    let (named, warning) = told(&path("blurred.toml"));
    assert!(
        named && warning.contains("another footprint was taken off the frames of cam2 than"),
        "{warning}"
    );
    let (named, warning) = told("configs/demo-rig.toml");
    assert!(!named && warning.is_empty(), "{warning}");
    a_footprint_that_was_not_taken_off_goes_with_the_cloud(folder);
}

/// Of the same recording, by a cell whose settings take nothing off: the cloud says what is left, also when it is converted, and who measures
/// on it is told.
fn a_footprint_that_was_not_taken_off_goes_with_the_cloud(folder: &TempDir) {
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let cell = std::fs::read_to_string(path("cell.toml")).unwrap();
    std::fs::write(path("nothing.toml"), format!("{cell}\n[decode]\nfootprint_px = 0.0\n")).unwrap();
    let (cloud, converted) = (path("nothing.ply"), path("converted.ply"));
    let reconstruct = ["reconstruct", "--config", &path("nothing.toml"), "--out", &cloud, &path("rec")];
    fringetool(&reconstruct).expect_success();
    fringetool(&["convert", &cloud, "--out", &converted]).expect_success();
    let header = |cloud: &str| String::from_utf8_lossy(&std::fs::read(cloud).unwrap()[..1000]).into_owned();
    for name in [
        "footprint_off_px2: {\"cam1\":0.2,",
        "rig_sha256: ",
        "pairs: ",
        "viewpoints: {\"pair1\":{\"o",
        "edge_px: ",
    ] {
        assert!(header(&cloud).contains(name) && header(&converted).contains(name), "{}", header(&converted));
    }
    assert_eq!(header(&converted).matches("unit: ").count(), 1);
    let warning = fringetool(&["measure", "configs/complex-artefact.plan.toml", &converted]).stderr;
    assert!(warning.contains("the frames of cam1, cam2, cam3, cam4 than"), "{warning}");
}

fn cell_without_scatter(folder: &TempDir) -> String {
    let text = std::fs::read_to_string(root().join("configs/demo.toml")).unwrap();
    let configs = root().join("configs");
    let text = text
        .replace("\"demo-rig.toml\"", &format!("{:?}", configs.join("demo-rig.toml").to_str().unwrap()))
        .replace(
            "\"complex-artefact.plan.toml\"",
            &format!("{:?}", configs.join("complex-artefact.plan.toml").to_str().unwrap()),
        )
        .replace(
            "\"complex-artefact.scene.toml\"",
            &format!("{:?}", configs.join("complex-artefact.scene.toml").to_str().unwrap()),
        );
    let path = folder.path().join("cell.toml");
    std::fs::write(&path, format!("{text}settings = {{ {STILL} }}\n")).unwrap();
    path.to_str().unwrap().to_owned()
}

fn simulate_cell(folder: &TempDir, cell: &str, options: &[&str]) {
    let recording = folder.path().join("rec");
    let mut simulate = vec!["simulate", cell, "--out", recording.to_str().unwrap()];
    simulate.extend(options);
    fringetool(&simulate).expect_success();
}

fn reconstruct_recording(folder: &TempDir, method: &str) -> (std::path::PathBuf, serde_json::Value) {
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (recording, cloud, report) = (path("rec"), path("cloud.ply"), path("report.json"));
    let arguments = [
        "reconstruct",
        "--rig",
        "configs/demo-rig.toml",
        "--method",
        method,
        "--out",
        &cloud,
        "--json",
        &report,
        &recording,
    ];
    fringetool(&arguments).expect_success();
    (cloud.into(), json(report.as_ref()))
}

#[test]
fn the_same_recording_gives_the_same_bytes_on_any_number_of_threads() {
    let small = crate::support::Small::new();
    let clouds: Vec<Vec<u8>> = ["1", "2", "3"]
        .iter()
        .map(|threads| {
            let ran = std::process::Command::new(env!("CARGO_BIN_EXE_fringetool"))
                .args([
                    "reconstruct",
                    "--rig",
                    &small.path("rig.toml"),
                    "--out",
                    &small.path("cloud.ply"),
                    &small.path("rec"),
                ])
                .env("RAYON_NUM_THREADS", threads)
                .status()
                .unwrap();
            assert!(ran.success());
            std::fs::read(small.path("cloud.ply")).unwrap()
        })
        .collect();
    assert!(clouds[0].len() > 10_000);
    assert!(clouds.iter().all(|cloud| *cloud == clouds[0]), "the clouds differ");
}

/// What goes wrong when folders are copied by hand: a frame twice, and the cameras exchanged.
#[test]
fn a_frame_that_is_a_copy_is_refused_and_exchanged_cameras_are_warned_of() {
    let small = crate::support::Small::new();
    let frame = |number: u32| small.path(&format!("rec/frames/proj1/cam1/{number:03}.png"));
    let kept = std::fs::read(frame(5)).unwrap();
    std::fs::copy(frame(4), frame(5)).unwrap();
    let refused = small.reconstruct(&[]);
    assert_eq!(refused.code, Some(2), "{}", refused.stdout);
    assert!(refused.stderr.contains("steps 5 and 6 are the same, bit by bit"), "{}", refused.stderr);
    std::fs::write(frame(5), kept).unwrap();
    // A fifth of so small a picture is nearer than two pixels to a rim, and half of it becomes points with none to spare.
    small.edit("cell.toml", "[twin]", "[matching.surface]\nedge_px = 1\n[twin]");
    let (cell, out, recording) = (small.path("cell.toml"), small.path("cloud.ply"), small.path("rec"));
    let narrow = ["reconstruct", "--config", &cell, "--out", &out, &recording, "--force"];
    assert!(!fringetool(&narrow).expect_success().stdout.contains("fewer than half"));
    for (from, to) in [("cam1", "kept"), ("cam2", "cam1"), ("kept", "cam2")] {
        let [from, to] = [from, to].map(|name| small.path(&format!("rec/frames/proj1/{name}")));
        std::fs::rename(from, to).unwrap();
    }
    // Either nothing matches at all, or much less than should.
    for told in [fringetool(&narrow), small.reconstruct(&["--force"])] {
        let said = [&told.stdout, &told.stderr]
            .map(|text| text.contains("fewer than half") || text.contains("no point at all"));
        assert!(said.contains(&true), "{}{}", told.stdout, told.stderr);
    }
}

#[test]
fn truth_lies_apart_from_the_recording() {
    let small = crate::support::Small::new();
    assert!(std::fs::read_to_string(small.path("rec.truth.toml")).unwrap().contains("sphere1_diameter"));
    let recording = std::fs::read_to_string(small.path("rec/recording.toml")).unwrap();
    assert!(!recording.contains("truth") && !recording.contains("pose"), "{recording}");
}

#[test]
fn a_reader_that_left_ends_the_tool_without_panic() {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let ran = std::process::Command::new(env!("CARGO_BIN_EXE_fringetool"))
        .args(["uncertainty", "configs/budgets/end-gauge.toml"])
        .current_dir(root())
        .stdout(writer)
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(2), "{message}");
    assert!(message.starts_with("error: standard output: Broken pipe"), "{message}");
}

//! Calibration through the real binary, on real pictures and on pictures that cannot be used.

use crate::support::{fringetool, real_data};
use std::path::Path;
use tempfile::TempDir;

const BOARD: &str = "kind = \"checkerboard\"\ncolumns = 9\nrows = 6\npitch_mm = 25.0\n";

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Thirteen pairs of real pictures, 640 × 480. Its README: OpenCV's f 536.1 px and rms 0.41 px with one camera,
/// baseline 83.45 mm.
#[test]
fn a_real_stereo_pair_is_characterised_like_others_did_and_closer() {
    let Some(source) = real_data("calib_boards/stereo_case1") else { return };
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("target.toml"), BOARD).unwrap();
    let images =
        ["left", "right"].map(|side| format!("{side}={}", source.join(format!("{side}*.png")).display()));
    let (target, out, report) = (path("target.toml"), path("rig.toml"), path("report.json"));
    let arguments = [
        "calibrate",
        "--target",
        &target,
        "--out",
        &out,
        "--json",
        &report,
        "--images",
        &images[0],
        "--images",
        &images[1],
        "--pair",
        "pair1=left,right",
    ];
    println!("{}", fringetool(&arguments).expect_success().stdout);
    let report = json(report.as_ref());
    for camera in report["cameras"].as_array().unwrap() {
        assert!(camera["views"].as_u64().unwrap() >= 11, "{camera}");
        assert!(camera["rms_reprojection_px"].as_f64().unwrap() < 0.25, "{camera}");
        let focal_px = camera["focal_px"][0].as_f64().unwrap();
        assert!((focal_px - 536.1).abs() < 5.0, "{camera}");
    }
    let rig = rig::rig_file::read_rig(out.as_ref()).unwrap();
    let [left, right] = ["left", "right"].map(|name| rig.rig.camera(name).unwrap().centre_mm());
    let baseline_mm = (left - right).norm();
    assert!((baseline_mm - 83.45).abs() < 0.5, "{baseline_mm} mm");
    let covariance = rig.covariance.unwrap();
    let bytes = std::fs::read(folder.path().join(&covariance.file)).unwrap();
    assert_eq!(rig::hash::sha256_hex(&bytes), covariance.sha256);
}

#[test]
fn pictures_without_board_and_arguments_without_sense_write_nothing() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("target.toml"), BOARD).unwrap();
    std::fs::write(path("wrong.toml"), BOARD.replace("columns = 9", "columns = -9")).unwrap();
    for number in 0..4 {
        image::GrayImage::from_pixel(160, 120, image::Luma([90]))
            .save(path(&format!("flat{number}.png")))
            .unwrap();
    }
    let (target, wrong, out) = (path("target.toml"), path("wrong.toml"), path("rig.toml"));
    let flat = format!("cam1={}", path("flat*.png"));
    let nothing = format!("cam1={}", path("none*.png"));
    let cases: [(&[&str], &[&str]); 5] = [
        (&["--target", &target, "--images", &flat], &["flat0.png"]),
        (&["--target", &target, "--images", &nothing], &["none*.png", "no file"]),
        (&["--target", &wrong, "--images", &flat], &["wrong.toml", "columns"]),
        (&["--target", &target], &["recordings"]),
        (&["--target", &target, "--images", "cam1"], &["camera=pattern"]),
    ];
    for (arguments, words) in cases {
        let mut all = vec!["calibrate", "--out", &out];
        all.extend(arguments);
        let ran = fringetool(&all);
        assert_eq!(ran.code, Some(2), "{arguments:?}: {}", ran.stderr);
        assert!(words.iter().all(|word| ran.stderr.contains(word)), "{arguments:?}: {}", ran.stderr);
        assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
        assert!(!Path::new(&out).exists(), "{arguments:?}");
    }
}

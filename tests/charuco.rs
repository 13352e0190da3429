//! ChArUco boards through the real binary. The images `charuco/five*.png` show OpenCV's board of 8 × 6 squares of 10 mm with
//! markers of 7 mm (`DICT_5X5_100`) before a pinhole camera of 400 px and centre (159.5, 119.5), blurred by 0.7 px; in the last two
//! the board leaves the image.

use crate::support::{fringetool, root};
use tempfile::TempDir;

const TARGET: &str = "kind = \"charuco\"\ncolumns = 7\nrows = 5\npitch_mm = 10.0\ndictionary = \"DICT_5X5_100\"\nmarker_mm = 7.0\n";

/// Calibrates from the images with this target; exit code, standard error and the result.
fn calibrate(target: &str) -> (Option<i32>, String, Option<serde_json::Value>) {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("target.toml"), target).unwrap();
    let images = format!("cam1={}", root().join("tests/charuco/five*.png").display());
    let (declared, out, report) = (path("target.toml"), path("rig.toml"), path("report.json"));
    let arguments =
        ["calibrate", "--target", &declared, "--out", &out, "--json", &report, "--images", &images];
    let ran = fringetool(&arguments);
    let result = std::fs::read_to_string(&report).ok().map(|text| serde_json::from_str(&text).unwrap());
    (ran.code, ran.stderr, result)
}

#[test]
fn the_markers_number_whole_boards_and_parts_of_them() {
    let (code, message, result) = calibrate(TARGET);
    assert_eq!((code, message.as_str()), (Some(0), ""));
    let camera = &result.unwrap()["cameras"][0];
    assert_eq!(camera["views"], 6, "{camera}");
    // By the true camera 199 inner corners lie four pixels or more inside the six images.
    assert!(camera["corners"].as_u64().unwrap() >= 194, "{camera}");
    assert!(camera["rms_reprojection_px"].as_f64().unwrap() < 0.02, "{camera}");
    for (key, truth) in [("focal_px", [400.0, 400.0]), ("principal_point_px", [159.5, 119.5])] {
        for (i, truth) in truth.into_iter().enumerate() {
            let error_px = camera[key][i].as_f64().unwrap() - truth;
            assert!(error_px.abs() < 0.5, "{key} is off by {error_px} px: {camera}");
        }
    }
}

#[test]
fn other_markers_than_declared_and_more_squares_than_markers_are_refused() {
    for (from, to, words) in [
        ("DICT_5X5_100", "DICT_6X6_250", &["no two markers agree", "five0.png"][..]),
        ("DICT_5X5_100", "DICT_9X9_50", &["DICT_9X9_50", "DICT_5X5_100"]),
        ("columns = 7", "columns = 5", &["no two markers agree"]),
        ("rows = 5", "rows = 4", &["found 7 x 5 inner corners, target.toml declares 7 x 4"]),
        ("columns = 7\nrows = 5", "columns = 30\nrows = 20", &["has 100 markers", "need 325"]),
        ("marker_mm = 7.0", "marker_mm = 11.0", &["marker_mm = 11", "9"]),
        ("marker_mm = 7.0", "", &["marker_mm"]),
    ] {
        let (code, message, result) = calibrate(&TARGET.replace(from, to));
        assert_eq!((code, message.lines().count(), result), (Some(2), 1, None), "{to}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{to}: {message}");
    }
}

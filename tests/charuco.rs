//! ChArUco boards through the real binary. The images `charuco/five*.png` show OpenCV's board of 8 × 6 squares of 10 mm with
//! markers of 7 mm (`DICT_5X5_100`) before a pinhole camera of 400 px and centre (159.5, 119.5), blurred by 0.7 px; in the last two
//! the board leaves the image. `four`, `seven`, `april` and `original` show the same board with markers of other dictionaries, before a
//! camera of 600 px and centre (239.5, 179.5); `kalibr` and `single` an AprilGrid of 5 × 4 tags of 10 mm, as Kalibr prints it and with
//! tags of one cell's rim that are counted from the top, before a camera of 480 px and centre (199.5, 159.5). OpenCV 5 drew the markers.

use crate::support::{fringetool, root};
use tempfile::TempDir;

const TARGET: &str = "kind = \"charuco\"\ncolumns = 7\nrows = 5\npitch_mm = 10.0\ndictionary = \"DICT_5X5_100\"\nmarker_mm = 7.0\n";

/// As [`calibrate_from`], of the images `five*.png`.
fn calibrate(target: &str) -> (Option<i32>, String, Option<serde_json::Value>) {
    calibrate_from("five*.png", target)
}

/// Calibrates from images with this target; exit code, standard error and the result.
fn calibrate_from(images: &str, target: &str) -> (Option<i32>, String, Option<serde_json::Value>) {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("target.toml"), target).unwrap();
    let images = format!("cam1={}", root().join("tests/charuco").join(images).display());
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

/// Fails unless the camera comes out as it is; compressed pictures are worth some hundredths of a pixel.
fn finds(images: &str, target: &str, corners: u64, focal_px: f64) {
    let (code, message, result) = calibrate_from(images, target);
    assert_eq!(code, Some(0), "{images}: {message}");
    let camera = &result.unwrap()["cameras"][0];
    assert_eq!(camera["views"], 4, "{images}: {camera}");
    assert!(camera["corners"].as_u64().unwrap() >= corners, "{images}: {camera}");
    assert!(camera["rms_reprojection_px"].as_f64().unwrap() < 0.05, "{images}: {camera}");
    let error_px = camera["focal_px"][0].as_f64().unwrap() - focal_px;
    assert!(error_px.abs() < 0.01 * focal_px, "{images}: focal length off by {error_px} px");
}

#[test]
fn boards_of_every_size_of_marker_are_read() {
    for (images, dictionary) in [
        ("four*.jpg", "DICT_4X4_1000"),
        ("four*.jpg", "DICT_4X4_50"),
        ("seven*.jpg", "DICT_7X7_250"),
        ("april*.jpg", "DICT_APRILTAG_36h11"),
        ("original*.jpg", "DICT_ARUCO_ORIGINAL"),
    ] {
        finds(images, &TARGET.replace("DICT_5X5_100", dictionary), 130, 600.0);
    }
}

const GRID: &str = "kind = \"aprilgrid\"\ncolumns = 10\nrows = 8\npitch_mm = 13.0\nmarker_mm = 10.0\ndictionary = \"DICT_APRILTAG_36h11\"\n";

#[test]
fn an_aprilgrid_is_numbered_by_its_tags_however_they_are_printed() {
    finds("kalibr*.jpg", GRID, 250, 480.0);
    finds("single*.jpg", GRID, 250, 480.0);
}

#[test]
fn an_aprilgrid_of_another_size_or_other_tags_is_refused() {
    for (from, to, words) in [
        ("columns = 10", "columns = 8", "no two markers agree"),
        ("columns = 10", "columns = 9", "both are even"),
        ("rows = 8", "rows = 6", "declares 10 x 6"),
        ("36h11", "25h9", "no two markers agree"),
    ] {
        let (code, message, result) = calibrate_from("kalibr*.jpg", &GRID.replace(from, to));
        assert_eq!((code, result), (Some(2), None), "{to}: {message}");
        assert!(message.contains(words), "{to}: {message}");
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

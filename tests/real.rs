//! Recordings by other people's cameras, with other people's calibration: imported, reconstructed, and compared with
//! what their README states. Skipped with a line where `../shared/data/real` is absent.

use crate::support::{fringetool, real_data};
use fringe::cloud::Point;
use metrology::fit::{FitSettings, PlaneFit, plane};
use nalgebra::Point3;
use tempfile::TempDir;

/// Imports a set by its layout and reconstructs it.
fn cloud(set: &str, layout: &str, method: &str) -> Option<Vec<Point>> {
    let source = real_data(set)?;
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (recording, rig, ply) = (path("rec"), path("rec/rig.toml"), path("cloud.ply"));
    let layout = format!("tests/layouts/{layout}.toml");
    fringetool(&["import", &layout, "--from", source.to_str().unwrap(), "--out", &recording])
        .expect_success();
    let ran = fringetool(&["reconstruct", "--rig", &rig, "--method", method, "--out", &ply, &recording]);
    println!("{set}:\n{}", ran.expect_success().stdout);
    Some(files::ply::read_cloud(ply.as_ref()).unwrap().points)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn depths_mm(points: &[Point]) -> Vec<f64> {
    points.iter().map(|p| p.position_mm[2]).collect()
}

fn plane_within(points: &[Point], center_mm: Point3<f64>, half_mm: [f64; 2]) -> PlaneFit {
    let inside: Vec<Point3<f64>> = points
        .iter()
        .map(Point::position)
        .filter(|p| (p.x - center_mm.x).abs() < half_mm[0] && (p.y - center_mm.y).abs() < half_mm[1])
        .collect();
    plane(&inside, &FitSettings::default()).unwrap()
}

/// Two real cameras, approach 2. Its README: 604 472 points between Z = 295 and 304 mm, plane sigma 0.0439 mm over
/// 79 × 103 mm, in the part that their rectification kept; 0.0591 mm over the whole view.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn a_real_flat_plate_seen_by_two_cameras_is_flat() {
    let Some(points) = cloud("stereo_plane", "stereo_plane", "phase") else { return };
    assert!(points.len() > 1_000_000, "{} points", points.len());
    let center = Point3::from([0, 1, 2].map(|i| median(points.iter().map(|p| p.position_mm[i]).collect())));
    let middle = plane_within(&points, center, [39.5, 51.5]);
    println!("middle: {} points, sigma {:.4} mm", middle.form.points, middle.form.form_sigma_mm);
    assert!(middle.form.form_sigma_mm < 0.05, "{} mm", middle.form.form_sigma_mm);
    let depth_mm = median(depths_mm(&points));
    assert!((295.0..304.0).contains(&depth_mm), "{depth_mm} mm");
    // No fringe-order jump: one period is 14 mm of depth here.
    let whole = plane_within(&points, center, [500.0, 500.0]);
    assert!(whole.form.form_range_mm < 2.0, "{} mm", whole.form.form_range_mm);
}

/// A real camera and projector, approach 1. Its README: Z median 386 mm.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn a_real_skull_seen_by_camera_and_projector_stands_where_it_stood() {
    let Some(points) = cloud("procam_skull", "procam_skull_2x3", "projector") else { return };
    assert!(points.len() > 250_000, "{} points", points.len());
    let depth_mm = median(depths_mm(&points));
    println!("median depth {depth_mm:.2} mm");
    assert!((depth_mm - 386.0).abs() < 2.0, "{depth_mm} mm");
    // The same skull by an entirely different code: ten Gray bits and no sine.
    let Some(coded) = cloud("procam_skull", "procam_skull_gray", "projector") else { return };
    let coded_mm = median(depths_mm(&coded));
    assert!((depth_mm - coded_mm).abs() < 3.0, "{depth_mm} mm by sines, {coded_mm} mm by code");
}

/// A real camera and projector with a code of half periods. Its README: 214 654 points, no order jump, Z median
/// 727.4 mm with the phase origin that its pattern generator has.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn a_real_relief_seen_by_camera_and_projector_stands_where_it_stood() {
    let Some(points) = cloud("procam_mono", "procam_mono", "projector") else { return };
    assert!(points.len() > 190_000, "{} points", points.len());
    let depth_mm = median(depths_mm(&points));
    assert!((depth_mm - 727.4).abs() < 1.0, "{depth_mm} mm");
}

/// The same camera and projector characterised by us from four of the six published poses of the board (13 × 9 inner
/// corners), then the skull with our own rig. Published, with fewer lens parameters: f 2195.1 and 2601.5 px, rms 0.282 and
/// 0.463 px, |T| 164.5 mm.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn a_real_camera_and_projector_are_characterised_and_the_skull_stands_where_it_stood() {
    let Some(source) = real_data("procam_skull") else { return };
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let mut poses = Vec::new();
    for pose in ["calseq2", "calseq3", "calseq5", "calseq6"] {
        let from = source.join("calibration").join(pose);
        let layout = "tests/layouts/procam_calibration.toml";
        fringetool(&["import", layout, "--from", from.to_str().unwrap(), "--out", &path(pose)])
            .expect_success();
        poses.push(path(pose));
    }
    let target = path("target.toml");
    std::fs::write(&target, "kind = \"checkerboard\"\ncolumns = 13\nrows = 9\npitch_mm = 10.0\n").unwrap();
    let (rig, report) = (path("rig.toml"), path("report.json"));
    let mut arguments = vec![
        "calibrate",
        "--target",
        &target,
        "--out",
        &rig,
        "--json",
        &report,
        "--pair",
        "pair1=cam1,proj1",
    ];
    arguments.extend(poses.iter().map(String::as_str));
    println!("{}", fringetool(&arguments).expect_success().stdout);
    let file = files::rig_file::read_rig(rig.as_ref()).unwrap();
    assert!(file.read_covariance().unwrap().is_some());
    let (camera, projector) = (file.rig.camera("cam1").unwrap(), file.rig.projector("proj1").unwrap());
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    // Four poses of a print leave the focal length of the camera open to tens of pixels (OpenCV without the projector: 2169 ± 16
    // from three of them), so the published values are held against the scatter between poses, which has to be told.
    let between = &report["held_out"]["between_poses"];
    for (number, (device, published_px)) in [(camera, 2195.1), (projector, 2601.5)].into_iter().enumerate() {
        let u_px = between[number]["standard_uncertainty"][0].as_f64().unwrap();
        let off_px = device.focal_px[0] - published_px;
        println!("focal length {off_px:+.1} px from the published one, u between poses {u_px:.1} px");
        assert!(off_px.abs() < 2.0 * u_px && u_px < 0.03 * published_px, "{off_px} px, u {u_px} px");
    }
    assert!(between[0]["over_stated"].as_f64().unwrap() > 2.5, "{between}");
    let baseline_mm = (camera.centre_mm() - projector.centre_mm()).norm();
    assert!((baseline_mm - 164.5).abs() < 3.0, "{baseline_mm} mm");
    for (devices, published_px) in [("cameras", 0.282), ("projectors", 0.463)] {
        let device = &report[devices][0];
        assert_eq!(device["views"], 4, "{device}");
        assert!(device["rms_reprojection_px"].as_f64().unwrap() < published_px, "{device}");
    }
    let (skull, ply) = (path("skull"), path("skull.ply"));
    let layout = "tests/layouts/procam_skull_2x3.toml";
    fringetool(&["import", layout, "--from", source.to_str().unwrap(), "--out", &skull]).expect_success();
    fringetool(&["reconstruct", "--rig", &rig, "--method", "projector", "--out", &ply, &skull])
        .expect_success();
    let points = files::ply::read_cloud(ply.as_ref()).unwrap().points;
    assert!(points.len() > 290_000, "{} points", points.len());
    let depths = points.iter().map(|p| (camera.camera_from_world * p.position()).z).collect();
    let depth_mm = median(depths);
    println!("median depth {depth_mm:.2} mm");
    assert!((depth_mm - 386.0).abs() < 6.0, "{depth_mm} mm");
}

/// Recordings as they lie there, with their rig: points and gross causes. A plain pipeline gives 240 380 and 448 164 points.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn ordinary_recordings_keep_their_points_and_say_what_is_left_out() {
    for (set, method, least) in
        [("gray_stereo", "phase", 230_000), ("procam_skull_3step", "projector", 420_000)]
    {
        let Some(source) = real_data(set) else { return };
        let folder = TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (ply, map, json) = (path("cloud.ply"), path("why.png"), path("result.json"));
        let (recording, rig) = (source.to_str().unwrap(), source.join("rig.toml"));
        let ran = fringetool(&[
            "reconstruct",
            "--rig",
            rig.to_str().unwrap(),
            "--method",
            method,
            "--out",
            &ply,
            "--map",
            &map,
            "--json",
            &json,
            recording,
        ])
        .expect_success();
        let points = files::ply::read_cloud(ply.as_ref()).unwrap().points.len();
        assert!(points > least, "{set}: {points}\n{}", ran.stdout);
        assert!(ran.stdout.contains("lit pixels without a point"), "{}", ran.stdout);
        let result: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        let pair = &result["pairs"][0];
        let left_out: u64 =
            pair["left_out"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum();
        // Every pixel of the picture is a point, left out, or not lit.
        let picture = image::open(&map).unwrap().to_rgb8();
        let not_lit = picture.pixels().filter(|p| p.0 == [20, 20, 24]).count() as u64;
        let view = &result["views"][0];
        let pixels = view["width_px"].as_u64().unwrap() * view["height_px"].as_u64().unwrap();
        let counted = pair["points"].as_u64().unwrap() + left_out;
        // The legend has one square of the dark colour.
        assert!(counted <= pixels && pixels - counted <= not_lit && not_lit - (pixels - counted) < 5_000);
    }
}

/// Gray codes of both axes alone: OpenCV gives the projector 0.24 px rms.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn a_projector_is_characterised_by_gray_codes_alone() {
    let Some(source) = real_data("procam_board_gray") else { return };
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (rig, json) = (path("rig.toml"), path("result.json"));
    let target = source.join("target.toml").to_str().unwrap().to_owned();
    let poses: Vec<String> =
        (0..4).map(|n| source.join(format!("pose_{n}")).to_str().unwrap().to_owned()).collect();
    let mut arguments = vec!["calibrate", "--target", &target, "--out", &rig, "--json", &json];
    arguments.extend(poses.iter().map(String::as_str));
    fringetool(&arguments).expect_success();
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let rms_px = result["projectors"][0]["rms_reprojection_px"].as_f64().unwrap();
    assert!(rms_px < 0.24, "{rms_px}");
    assert_eq!(result["not_characterised"].as_array().unwrap().len(), 0);
}

/// Complete outer squares on overexposed paper: their outer corners are none of the board.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main real::")]
fn a_board_with_complete_outer_squares_is_found_and_another_size_is_refused() {
    let Some(source) = real_data("calib_phantom") else { return };
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let images = format!("cam1={}", source.join("left*.png").display());
    let calibrate = |columns: u32| {
        let text = format!("kind = \"checkerboard\"\ncolumns = {columns}\nrows = 6\npitch_mm = 20.0\n");
        std::fs::write(path("target.toml"), text).unwrap();
        let (target, rig, json) = (path("target.toml"), path("rig.toml"), path("result.json"));
        fringetool(&["calibrate", "--target", &target, "--out", &rig, "--json", &json, "--images", &images])
    };
    calibrate(7).expect_success();
    let result = std::fs::read_to_string(path("result.json")).unwrap();
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    assert_eq!(result["cameras"][0]["views"], 16);
    let refused = calibrate(8);
    assert!(refused.stderr.contains("found 7 x 6 inner corners"), "{}", refused.stderr);
}

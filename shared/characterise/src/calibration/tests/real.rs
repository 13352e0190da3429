//! Real point lists, with what other software found on them.

use super::super::*;
use super::synthetic::image_point;
use nalgebra::Point3;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/real/");

/// The numbers of a file; `None` when the data are absent, which the test states.
#[expect(
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "a test reads its reference and says so"
)]
fn numbers(name: &str) -> Option<Vec<f64>> {
    let path = format!("{DATA}{name}");
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("skipped: {path} is absent");
        return None;
    };
    // The lists end where prose begins.
    Some(text.split_whitespace().map_while(|word| word.parse().ok()).collect())
}

/// 13 poses of 289 points, of which −1 marks those not seen.
fn thirteen_poses(cameras: &[&str]) -> Option<Observations> {
    let target = numbers("calib_points_13pose/X3D_Test_2.txt")?;
    let target_mm: Vec<Point3<f64>> = target.chunks_exact(3).map(Point3::from_slice).collect();
    let mut views = Vec::new();
    for (device, file) in cameras.iter().enumerate() {
        let pixels = numbers(&format!("calib_points_13pose/{file}"))?;
        for (pose, block) in pixels.chunks_exact(2 * target_mm.len()).enumerate() {
            let seen = block.chunks_exact(2).enumerate().filter(|(_, p)| p[0] >= 0.0);
            let image_points = seen.map(|(index, p)| image_point(index, p[0], p[1])).collect();
            views.push(View { device, pose, image_points, may_be_turned: false });
        }
    }
    let device = |file: &&str| Device {
        name: file[..4].to_owned(),
        kind: DeviceKind::Camera,
        width_px: 1440,
        height_px: 1080,
    };
    let devices = cameras.iter().map(device).collect();
    Some(Observations {
        devices,
        target_mm,
        faces: Vec::new(),
        poses: (1..=13).map(|i| format!("pose{i}")).collect(),
        views,
    })
}

/// All points count, and the board is flat: what OpenCV's `calibrateCamera` assumes.
fn plain() -> CalibrationSettings {
    CalibrationSettings { target: TargetShape::Flat, outlier_limit: 1e6, ..Default::default() }
}

/// Each camera by itself: the parameters, root mean square and uncertainties that OpenCV 5 reports (README of the set).
#[test]
#[cfg_attr(
    not(shared_data),
    ignore = "../shared/data is absent; with it: cargo test -p fringe-characterise real::"
)]
fn thirteen_real_poses_give_what_opencv_gives() {
    let expected = [
        ("Left_Test_2.txt", [4743.06, 4743.17, 736.61, 556.17], 0.1082),
        ("Righ_Test_2.txt", [4736.56, 4737.07, 711.12, 551.45], 0.1140),
    ];
    for (file, parameters, rms_px) in expected {
        let Some(observations) = thirteen_poses(&[file]) else { return };
        let found = calibrate(&observations, &plain()).unwrap();
        let device = &found.devices[0];
        let camera = &device.camera;
        let ours = [
            camera.focal_px[0],
            camera.focal_px[1],
            camera.principal_point_px[0],
            camera.principal_point_px[1],
        ];
        for (a, b) in ours.iter().zip(parameters) {
            // The reference has two decimals.
            assert!((a - b).abs() < 0.006, "{file}: {ours:?} beside {parameters:?}");
        }
        assert!((device.rms_reprojection_px - rms_px).abs() < 6e-5, "{}", device.rms_reprojection_px);
        assert!((0.6..1.0).contains(&device.standard_uncertainty[0]), "{}", device.standard_uncertainty[0]);
    }
}

/// Both cameras together: the relative pose of a stereo calibration, within what the joint adjustment may differ by.
#[test]
#[cfg_attr(
    not(shared_data),
    ignore = "../shared/data is absent; with it: cargo test -p fringe-characterise real::"
)]
fn thirteen_real_poses_give_the_baseline() {
    let Some(observations) = thirteen_poses(&["Left_Test_2.txt", "Righ_Test_2.txt"]) else { return };
    let found = calibrate(&observations, &plain()).unwrap();
    let [left, right] = [0, 1].map(|i| found.devices[i].camera.camera_from_world);
    let t = (right * left.inverse()).translation.vector;
    let u = found.devices[1].standard_uncertainty;
    for (axis, expected) in [-61.854, 0.954, 5.718].into_iter().enumerate() {
        // OpenCV held the intrinsics; ours move with the pose, by their uncertainty.
        assert!((t[axis] - expected).abs() < 3.0 * u[13 + axis], "{t} ± {:?}", &u[13..]);
    }
    let with_warp = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    assert!(with_warp.devices[0].rms_reprojection_px < found.devices[0].rms_reprojection_px);
}

/// Seven views with a published solution of all parameters and poses (OpenCV's own test data, 4 decimals).
#[test]
#[cfg_attr(
    not(shared_data),
    ignore = "../shared/data is absent; with it: cargo test -p fringe-characterise real::"
)]
fn the_published_solution_of_seven_views_is_met() {
    let Some(values) = numbers("calib_boards/cameracalibration/calib1.dat") else { return };
    let (size, rest) = values.split_at(5);
    let count = (size[2] * size[3]) as usize;
    let views = size[4] as usize;
    let (boards, rest) = rest.split_at(3 * count * views);
    let (pixels, rest) = rest.split_at(2 * count * views);
    // Some views number the same board 7 × 5, others 5 × 7: the target is the union of both.
    let mut target_mm: Vec<Point3<f64>> = Vec::new();
    for point in boards.chunks_exact(3).map(Point3::from_slice) {
        if !target_mm.contains(&point) {
            target_mm.push(point);
        }
    }
    let view = |pose: usize| {
        let own = boards[3 * count * pose..3 * count * (pose + 1)].chunks_exact(3);
        let seen = own.zip(pixels[2 * count * pose..].chunks_exact(2)).map(|(p, q)| {
            let index = target_mm.iter().position(|t| (t - Point3::from_slice(p)).norm() < 1e-9);
            (index, q)
        });
        let image_points = seen.filter_map(|(index, q)| Some(image_point(index?, q[0], q[1]))).collect();
        View { device: 0, pose, image_points, may_be_turned: false }
    };
    let views: Vec<View> = (0..views).map(view).collect();
    let device = Device {
        name: "camera".into(),
        kind: DeviceKind::Camera,
        width_px: size[0] as u32,
        height_px: size[1] as u32,
    };
    let poses = (1..=views.len()).map(|i| format!("view{i}")).collect();
    let observations = Observations { devices: vec![device], target_mm, faces: Vec::new(), poses, views };
    let settings = CalibrationSettings { world: WorldFrame::FirstDevice, ..plain() };
    let found = calibrate(&observations, &settings).unwrap();
    let camera = &found.devices[0].camera;
    let [k1, k2, _] = camera.distortion.k;
    let [p1, p2] = camera.distortion.p;
    let ours = [camera.focal_px, camera.principal_point_px, [k1, k2], [p1, p2]].concat();
    let tolerance = [1e-2, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-4, 1e-4];
    for ((a, b), tolerance) in ours.iter().zip(rest).zip(tolerance) {
        assert!((a - b).abs() < tolerance, "{ours:?} beside {:?}", &rest[..8]);
    }
}

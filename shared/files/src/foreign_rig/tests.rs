//! Files as the programs write them, and rigs that come back from what is written for them.

use super::*;
use fringe::geometry::camera::LensKind;
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use std::path::PathBuf;
use tempfile::TempDir;

/// Writes a file into a folder of its own.
fn file(folder: &TempDir, name: &str, text: &str) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn read_one(name: &str, text: &str) -> Result<Rig, FileError> {
    let folder = TempDir::new().unwrap();
    let path = file(&folder, name, text);
    let program = Program::of_file(&path)?.expect("a known program");
    read(program, &[&path], &[], program.unit_mm())
}

/// Two cameras, 120 mm apart, turned towards each other.
fn pair(k3: f64) -> [Camera; 2] {
    let left = Camera {
        width_px: 1280,
        height_px: 1024,
        focal_px: [2310.5, 2312.25],
        principal_point_px: [655.1, 498.7],
        skew: 0.0,
        distortion: Lens::brown_conrady([-0.11, 0.21, k3], [0.0004, -0.0003]),
        camera_from_world: Isometry3::identity(),
    };
    let mut right = left.clone();
    right.principal_point_px = [640.0, 511.5];
    right.camera_from_world = Isometry3::from_parts(
        Translation3::new(-118.0, 1.5, 21.0),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.01, 0.24, -0.02)),
    );
    [left, right]
}

fn same(found: &Camera, expected: &Camera) {
    assert_eq!((found.width_px, found.height_px), (expected.width_px, expected.height_px));
    assert_eq!(found.matrix(), expected.matrix());
    assert_eq!(found.distortion, expected.distortion);
    let off = found.camera_from_world * expected.camera_from_world.inverse();
    assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-12, "{off}");
}

#[test]
fn what_is_written_for_ros_comes_back() {
    let [left, right] = pair(0.05);
    let folder = TempDir::new().unwrap();
    let texts = camera_info_texts(("left", &left), ("right", &right)).unwrap();
    let paths = [file(&folder, "left.yaml", &texts[0]), file(&folder, "right.yaml", &texts[1])];
    assert_eq!(Program::of_file(&paths[0]).unwrap(), Some(Program::Ros));
    let rig = read(Program::Ros, &[&paths[0], &paths[1]], &[], 1000.0).unwrap();
    assert_eq!([&rig.cameras[0].name, &rig.cameras[1].name], ["left", "right"]);
    same(&rig.cameras[0].camera, &left);
    same(&rig.cameras[1].camera, &right);
    assert_eq!((rig.pairs[0].left.as_str(), rig.pairs[0].right.as_str()), ("left", "right"));
}

#[test]
fn what_is_written_for_kalibr_comes_back() {
    let [left, mut right] = pair(0.0);
    let mut third = right.clone();
    third.camera_from_world.translation.vector.y += 75.0;
    right.width_px = 1300;
    let text = camchain_text(&[("a", &left), ("b", &right), ("c", &third)]).unwrap();
    let rig = read_one("camchain.yaml", &text).unwrap();
    for (found, expected) in rig.cameras.iter().zip([&left, &right, &third]) {
        same(&found.camera, expected);
    }
    assert_eq!(rig.pairs.len(), 2);
    let [left, _] = pair(0.05);
    assert_eq!(camchain_text(&[("a", &left)]), Err(("a".to_owned(), "k3")), "radtan has no k3");
}

/// As Kalibr's own documentation shows it (wiki, "YAML formats").
#[test]
fn a_chain_of_kalibr_is_read() {
    let text = "cam0:\n  camera_model: pinhole\n  intrinsics: [461.629, 460.152, 362.680, 246.049]\n  distortion_model: radtan\n  \
        distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]\n  T_cam_imu:\n  - [0.01779318, 0.99967549, -0.01822936, 0.07008565]\n  \
        - [-0.9998017, 0.01795239, 0.00860714, -0.01771023]\n  - [0.00893160, 0.01807260, 0.99979678, 0.00399246]\n  - [0.0, 0.0, 0.0, 1.0]\n  \
        timeshift_cam_imu: -8.1e-05\n  rostopic: /cam0/image_raw\n  resolution: [752, 480]\ncam1:\n  camera_model: pinhole\n  \
        intrinsics: [460.0, 461.0, 360.0, 250.0]\n  distortion_model: radtan\n  distortion_coeffs: [-0.28, 0.07, 0.0, 0.0]\n  \
        T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0.0004]\n  - [0.0, 0.0, 1.0, -0.0003]\n  - [0.0, 0.0, 0.0, 1.0]\n  \
        resolution: [752, 480]\n";
    let rig = read_one("camchain.yaml", text).unwrap();
    assert_eq!(rig.cameras[0].camera.focal_px, [461.629, 460.152]);
    let t = rig.cameras[1].camera.camera_from_world.translation.vector;
    assert!((t - Vector3::new(-110.0, 0.4, -0.3)).norm() < 1e-9, "{t}");
    let fisheye = read_one("camchain.yaml", &text.replace("radtan", "equidistant")).unwrap().cameras[1]
        .camera
        .distortion;
    assert_eq!((fisheye.kind, fisheye.k, fisheye.p), (LensKind::Fisheye, [-0.28, 0.07, 0.0], [0.0; 2]));
    let error = read_one("camchain.yaml", &text.replace("radtan", "fov")).unwrap_err().to_string();
    assert!(error.contains("cam0.distortion_model") && error.contains("equidistant"), "{error}");
}

/// As `mrcal-calibrate-cameras` writes it.
#[test]
fn a_camera_of_mrcal_is_read() {
    let text = "# generated on 2020-11-14\n{\n    'lensmodel':  'LENSMODEL_OPENCV5',\n\n    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n    \
        'intrinsics': [ 1761.181055, 1761.250444, 1965.706996, 1087.518797, -0.1, 0.02, 0.0003, -0.0004, 0.005,],\n\n    \
        'valid_intrinsics_region': [\n    [ 0.0, 0.0 ],\n    [ 1.0, 5.0 ],\n],\n    # extrinsics are rt_fromref\n    \
        'extrinsics': [ 0.0, 0.2, 0.0, 0.1, 0.0, -0.02,],\n\n    'imagersize': [ 4000, 2200,],\n    'icam_intrinsics': 0,\n}\n";
    let rig = read_one("left.cameramodel", text).unwrap();
    let camera = &rig.cameras[0].camera;
    assert_eq!(camera.focal_px, [1_761.181_055, 1_761.250_444]);
    assert_eq!(camera.distortion, Lens::brown_conrady([-0.1, 0.02, 0.005], [0.0003, -0.0004]));
    assert_eq!(camera.camera_from_world.translation.vector, Vector3::new(100.0, 0.0, -20.0));
    assert!((camera.camera_from_world.rotation.angle() - 0.2).abs() < 1e-12);
    let spline = text.replace("LENSMODEL_OPENCV5", "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3");
    assert!(read_one("a.cameramodel", &spline).unwrap_err().to_string().contains("SPLINED"));
}

#[test]
fn parameters_of_matlab_are_read_old_and_new() {
    let camera = |k: &str| {
        format!(
            "{{\"RadialDistortion\":[-0.1,0.2,0.3],\"TangentialDistortion\":[0.001,-0.002],\"ImageSize\":[1024,1280],{k}}}"
        )
    };
    let old = camera("\"IntrinsicMatrix\":[[2300,0,0],[0.5,2301,0],[641,513,1]]");
    let turned =
        "\"RotationOfCamera2\":[[0.8,0,-0.6],[0,1,0],[0.6,0,0.8]],\"TranslationOfCamera2\":[-120,1,30]";
    let rig = read_one(
        "old.json",
        &format!("{{\"CameraParameters1\":{old},\"CameraParameters2\":{old},{turned}}}"),
    )
    .unwrap();
    let new = camera("\"K\":[[2300,0.5,641],[0,2301,513],[0,0,1]]");
    let pose = "\"PoseCamera2\":{\"A\":[[0.8,0,0.6,-120],[0,1,0,1],[-0.6,0,0.8,30],[0,0,0,1]]}";
    let same_rig =
        read_one("new.json", &format!("{{\"CameraParameters1\":{new},\"CameraParameters2\":{new},{pose}}}"))
            .unwrap();
    assert_eq!(rig.cameras[0].camera.principal_point_px, [640.0, 512.0], "pixels count from 0 here");
    assert_eq!(rig.cameras[0].camera.skew, 0.5);
    for (a, b) in rig.cameras.iter().zip(&same_rig.cameras) {
        same(&a.camera, &b.camera);
    }
}

#[test]
fn what_no_calibration_holds_is_refused() {
    let nested = |levels: usize| format!("cam0:\n  {}1{}\n", "[".repeat(levels), "]".repeat(levels));
    assert!(read_one("a.yaml", &nested(40)).unwrap_err().to_string().contains("nested"));
    assert!(read_one("a.yaml", &nested(200_000)).is_err());
    let bomb = "a: &a [1, 1]\nb: &b [*a, *a]\ncam0: [*b, *b]\n";
    assert!(read_one("a.yaml", bomb).unwrap_err().to_string().contains("refers to itself"));
    let short = "cam0:\n  camera_model: pinhole\n  intrinsics: [1, 2, 3]\n  distortion_model: none\n  resolution: [752, 480]\n";
    assert!(read_one("a.yaml", short).unwrap_err().to_string().contains("3 numbers"));
    let nan = short.replace("[1, 2, 3]", "[.nan, 2, 3, 4]");
    assert!(read_one("a.yaml", &nan).unwrap_err().to_string().contains("cam0.intrinsics"));
    let lone = "cam0:\n  camera_model: pinhole\n  distortion_model: none\n  resolution: [752, 480]\n";
    assert!(read_one("a.yaml", lone).unwrap_err().to_string().contains("cam0.intrinsics is missing"));
    let folder = TempDir::new().unwrap();
    assert_eq!(Program::of_file(&file(&folder, "other.yaml", "a: 1\n")).unwrap(), None);
}

//! Calibrations from points that another program found, with each lens model, and rigs of such lenses in other programs' files.

use crate::support::{fringetool, real_data, root};
use std::fmt::Write as _;
use tempfile::TempDir;

/// Lists of what a camera with a strong rational lens shows of a board of 12 × 9 points in 12 poses, without noise beyond rounding.
fn lists(folder: &TempDir) -> String {
    let path = |name: &str| folder.path().join(name);
    let board: Vec<[f64; 2]> = (0..108).map(|i| [f64::from(i % 12) * 8.0, f64::from(i / 12) * 8.0]).collect();
    let mut points = String::new();
    for pose in 0..12 {
        let p = f64::from(pose);
        let (a, b, c) = (0.35 * (1.7 * p).sin(), 0.35 * (2.3 * p + 1.0).cos(), 0.3 * (p * 0.9).sin());
        let turn = nalgebra::Rotation3::from_euler_angles(a, b, c);
        let shift =
            nalgebra::Vector3::new(-44.0 + 18.0 * (p * 1.3).cos(), -32.0 + 14.0 * p.sin(), 85.0 + 2.0 * p);
        for [x, y] in &board {
            let at = turn * nalgebra::Vector3::new(*x - 44.0, *y - 32.0, 0.0)
                + shift
                + nalgebra::Vector3::new(44.0, 32.0, 0.0);
            let (x, y) = (at.x / at.z, at.y / at.z);
            let r2 = x * x + y * y;
            let radial = (1.0 + 0.9 * r2 + 0.05 * r2 * r2) / (1.0 + 1.2 * r2 + 0.25 * r2 * r2);
            // Decentred too, which no fisheye is.
            let u = x * radial + 4e-3 * x * y - 2e-3 * (r2 + 2.0 * x * x);
            let v = y * radial + 2e-3 * (r2 + 2.0 * y * y) - 4e-3 * x * y;
            let _ = writeln!(points, "{:.3} {:.3}", 700.0 * u + 640.0, 700.0 * v + 512.0);
        }
    }
    std::fs::write(path("cam1.txt"), points).unwrap();
    let board: String = board.iter().map(|[x, y]| format!("{x} {y}")).collect::<Vec<_>>().join("\n");
    std::fs::write(path("board.txt"), board).unwrap();
    let text = "format = \"fringecell-points/1\"\ntarget = \"board.txt\"\n[[device]]\nname = \"cam1\"\nwidth_px = 1280\n\
        height_px = 1024\npoints = \"cam1.txt\"\nsigma_px = 0.01\n";
    std::fs::write(path("points.toml"), text).unwrap();
    path("points.toml").to_str().unwrap().to_owned()
}

#[test]
fn the_lens_model_that_predicts_best_is_taken_and_goes_through_other_programs_files() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let points = lists(&folder);
    let (rig, json) = (path("rig.toml"), path("result.json"));
    let arguments = [
        "calibrate",
        "--points",
        &points,
        "--out",
        &rig,
        "--json",
        &json,
        "--board",
        "flat",
        "--model",
        "auto",
    ];
    fringetool(&arguments).expect_success();
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(result["lens_models"]["chosen"], "rational", "{}", result["lens_models"]);
    assert_eq!(result["cameras"][0]["lens"], "rational");
    assert!(result["cameras"][0]["rms_reprojection_px"].as_f64().unwrap() < 0.01);
    let text = std::fs::read_to_string(&rig).unwrap();
    assert!(text.contains("model = \"rational\""), "{text}");
    // The same camera twice, beside itself, through OpenCV's file and back.
    let camera = &text[text.find("[[camera]]").unwrap()..text.find("[provenance]").unwrap()];
    let second = camera.replace("\"cam1\"", "\"cam2\"");
    let at = second.find("translation_mm = [").unwrap() + "translation_mm = [".len();
    let end = at + second[at..].find(',').unwrap();
    let x_mm: f64 = second[at..end].parse().unwrap();
    let second = format!("{}{:?}{}", &second[..at], x_mm + 50.0, &second[end..]);
    let pair = "[[pair]]\nname = \"pair1\"\nleft = \"cam1\"\nright = \"cam2\"\n";
    std::fs::write(path("two.toml"), format!("format = \"fringecell-rig/1\"\n{camera}{second}{pair}"))
        .unwrap();
    fringetool(&["export", "--rig", &path("two.toml"), "--out", &path("pair.yml")]).expect_success();
    fringetool(&["import-rig", &path("pair.yml"), "--views", "cam1,cam2", "--out", &path("back.toml")])
        .expect_success();
    let lens = |text: &str| text.lines().find(|line| line.starts_with("distortion")).map(str::to_owned);
    assert_eq!(lens(&std::fs::read_to_string(path("back.toml")).unwrap()), lens(&text));
}

#[test]
fn lists_take_the_place_of_a_target_and_its_images() {
    let folder = TempDir::new().unwrap();
    let points = lists(&folder);
    let rig = folder.path().join("rig.toml").to_str().unwrap().to_owned();
    let target = root().join("configs/board.target.toml").to_str().unwrap().to_owned();
    for (more, words) in [
        (vec!["--target", target.as_str()], "cannot be used with"),
        (vec!["--images", "cam1=left*.png"], "leave recordings and --images out"),
        (vec!["--model", "polynomial"], "fisheye"),
    ] {
        let mut arguments = vec!["calibrate", "--points", points.as_str(), "--out", rig.as_str()];
        arguments.extend(more);
        let ran = fringetool(&arguments);
        assert!(ran.code == Some(2) && ran.stderr.contains(words), "{}", ran.stderr);
    }
}

/// Two cameras, 13 poses of 289 points, with what another program found (README of the set).
#[test]
#[cfg_attr(
    not(shared_data),
    ignore = "../shared/data is absent; with it: cargo test --test main point_lists::"
)]
fn lists_of_others_give_their_rig() {
    let Some(source) = real_data("calib_points_13pose") else { return };
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let file = |name: &str| source.join(name).canonicalize().unwrap().display().to_string();
    let mut text = format!("format = \"fringecell-points/1\"\ntarget = \"{}\"\n", file("X3D_Test_2.txt"));
    for (name, list) in [("left", "Left_Test_2.txt"), ("right", "Righ_Test_2.txt")] {
        let _ = write!(
            text,
            "[[device]]\nname = \"{name}\"\nwidth_px = 1440\nheight_px = 1080\npoints = \"{}\"\n",
            file(list)
        );
    }
    std::fs::write(path("points.toml"), text).unwrap();
    let (points, rig, json) = (path("points.toml"), path("rig.toml"), path("result.json"));
    let arguments = [
        "calibrate",
        "--points",
        &points,
        "--out",
        &rig,
        "--json",
        &json,
        "--board",
        "flat",
        "--pair",
        "p=left,right",
    ];
    fringetool(&arguments).expect_success();
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    for (number, focal_px) in [4743.1, 4736.8].into_iter().enumerate() {
        let camera = &result["cameras"][number];
        assert_eq!(camera["views"], 13, "{camera}");
        assert!(camera["rms_reprojection_px"].as_f64().unwrap() < 0.13, "{camera}");
        assert!((camera["focal_px"][0].as_f64().unwrap() - focal_px).abs() < 5.0, "{camera}");
    }
}

/// Frames of grey levels through a lossless video and the documented command.
#[test]
fn a_video_is_imported_through_its_frames() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let ffmpeg = |arguments: &[&str]| {
        let ran = std::process::Command::new("ffmpeg").args(["-v", "error"]).args(arguments).output();
        ran.ok().map(|ran| assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr)))
    };
    std::fs::create_dir(path("drawn")).unwrap();
    std::fs::create_dir(path("frames")).unwrap();
    for number in 0..3_u32 {
        let picture = image::GrayImage::from_fn(64, 48, |x, y| image::Luma([(40 * number + x + y) as u8]));
        picture.save(path(&format!("drawn/{number}.png"))).unwrap();
    }
    let (drawn, video) = (path("drawn/%d.png"), path("scan.avi"));
    if ffmpeg(&["-framerate", "10", "-i", &drawn, "-c:v", "ffv1", "-pix_fmt", "gray", &video]).is_none() {
        return eprintln!("skipped: ffmpeg is absent");
    }
    ffmpeg(&["-i", &video, "-fps_mode", "passthrough", "-pix_fmt", "gray", &path("frames/%04d.png")]);
    let layout = "format = \"fringecell-layout/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 64\nheight_px = 48\n\
        sequence = [{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 3 }]\n[[projector.camera]]\nname = \"cam1\"\n\
        files = \"frames/{nnnn}.png\"\nfirst = 1\n";
    std::fs::write(path("layout.toml"), layout).unwrap();
    let from = folder.path().to_str().unwrap();
    fringetool(&["import", &path("layout.toml"), "--from", from, "--out", &path("rec")]).expect_success();
    for number in 0..3_u32 {
        let seen = image::open(path(&format!("rec/frames/proj1/cam1/{number:03}.png"))).unwrap().into_luma8();
        assert_eq!(seen.get_pixel(5, 7).0, [(40 * number + 12) as u8]);
    }
}

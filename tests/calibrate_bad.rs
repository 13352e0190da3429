//! Images and target files that `fringetool calibrate` cannot use: exit code 2, one line that names what to mend, no file.

use crate::support::{Ran, fringetool};
use image::{GrayImage, Luma};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const SIZE_PX: (u32, u32) = (240, 180);
const FOCAL_PX: f64 = 260.0;
const PITCH_MM: f64 = 10.0;
/// Inner corners: an odd sum, so that the colours tell the numbering.
const BOARD: (u32, u32) = (8, 5);
const TARGET: &str = "kind = \"checkerboard\"\ncolumns = 8\nrows = 5\npitch_mm = 10.0\n";

/// Tilt about x, y and turn about z, rad; place, mm, from where the board is centred.
type Pose = [f64; 5];

const POSES: [Pose; 6] = [
    [0.5, 0.1, 0.0, 0.0, 0.0],
    [-0.5, 0.2, 0.2, 8.0, 0.0],
    [0.1, 0.5, -0.2, -8.0, 5.0],
    [0.2, -0.5, 0.1, 0.0, -8.0],
    [0.4, 0.4, 0.8, 6.0, 6.0],
    [-0.4, -0.3, -0.3, -6.0, -4.0],
];

/// A board before a pinhole camera, 160 mm away, without noise: nine samples a pixel.
fn picture((columns, rows): (u32, u32), [tilt_x, tilt_y, turn, x_mm, y_mm]: Pose) -> GrayImage {
    let rotation = nalgebra::Rotation3::from_euler_angles(tilt_x, tilt_y, turn);
    let at = nalgebra::Vector3::new(x_mm, y_mm, 160.0);
    let origin = rotation.inverse() * -at;
    let centre = (0.5 * f64::from(columns - 1), 0.5 * f64::from(rows - 1));
    let light = |u: f64, v: f64| {
        let pixel = (u - 0.5 * f64::from(SIZE_PX.0 - 1), v - 0.5 * f64::from(SIZE_PX.1 - 1));
        let ray = rotation.inverse() * nalgebra::Vector3::new(pixel.0 / FOCAL_PX, pixel.1 / FOCAL_PX, 1.0);
        let on = origin - ray * (origin.z / ray.z);
        let (x, y) = (on.x / PITCH_MM + centre.0, on.y / PITCH_MM + centre.1);
        let inside = x > -1.0 && y > -1.0 && x < f64::from(columns) && y < f64::from(rows);
        let dark = inside && (x.floor() + y.floor()).rem_euclid(2.0) == 0.0;
        if dark { 40.0 } else { 200.0 }
    };
    let thirds = [-1.0 / 3.0, 0.0, 1.0 / 3.0];
    GrayImage::from_fn(SIZE_PX.0, SIZE_PX.1, |x, y| {
        let sum: f64 =
            thirds.iter().flat_map(|dx| thirds.map(|dy| light(f64::from(x) + dx, f64::from(y) + dy))).sum();
        Luma([(sum / 9.0).round() as u8])
    })
}

/// A folder with a target file and images.
struct Set {
    folder: TempDir,
}

impl Set {
    fn new() -> Self {
        let set = Self { folder: TempDir::new().unwrap() };
        fs::write(set.path("target.toml"), TARGET).unwrap();
        set
    }

    /// Images `left0.png` … of a board in the given poses.
    fn of(board: (u32, u32), poses: &[Pose]) -> Self {
        let set = Self::new();
        for (number, pose) in poses.iter().enumerate() {
            set.save(&format!("left{number}.png"), &picture(board, *pose));
        }
        set
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn save(&self, name: &str, picture: &GrayImage) {
        picture.save(self.path(name)).unwrap();
    }

    /// Replaces each image by `change` of it.
    fn change(self, change: impl Fn(&GrayImage) -> GrayImage) -> Self {
        for number in 0..POSES.len() {
            let name = format!("left{number}.png");
            if Path::new(&self.path(&name)).exists() {
                self.save(&name, &change(&image::open(self.path(&name)).unwrap().to_luma8()));
            }
        }
        self
    }

    fn calibrate(&self, cameras: &[&str]) -> Ran {
        let images: Vec<String> =
            cameras.iter().map(|name| format!("{name}={}", self.path(&format!("{name}*.png")))).collect();
        let (target, out) = (self.path("target.toml"), self.path("rig.toml"));
        let mut arguments = vec!["calibrate", "--target", &target, "--out", &out];
        for image in &images {
            arguments.extend(["--images", image]);
        }
        fringetool(&arguments)
    }

    /// Fails unless the run ended with code 2, one line that holds all words, and no file.
    fn expect_refusal(&self, cameras: &[&str], words: &[&str]) {
        let before = self.files();
        let ran = self.calibrate(cameras);
        assert_eq!(ran.code, Some(2), "{}\n{}", ran.stdout, ran.stderr);
        assert_eq!(ran.stderr.lines().count(), 1, "{}", ran.stderr);
        let missing: Vec<_> = words.iter().filter(|word| !ran.stderr.contains(**word)).collect();
        assert!(missing.is_empty(), "lacks {missing:?}: {}", ran.stderr);
        assert_eq!(self.files(), before, "it left a file");
    }

    /// Fails unless the others calibrate the camera, and the picture that was left out is named with its reason.
    fn expect_left_out(&self, words: &[&str]) {
        let ran = self.calibrate(&["left"]);
        assert_eq!(ran.code, Some(0), "{}\n{}", ran.stdout, ran.stderr);
        let text = ran.stdout + &ran.stderr;
        let missing: Vec<_> =
            words.iter().chain(&["left out"]).filter(|word| !text.contains(**word)).collect();
        assert!(missing.is_empty(), "lacks {missing:?}: {text}");
        fs::remove_file(self.path("rig.toml")).unwrap();
    }

    fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// `target.toml` and good pictures `left0.png` … of its board in a folder.
pub fn boards(folder: &Path) {
    fs::write(folder.join("target.toml"), TARGET).unwrap();
    for (number, pose) in POSES.iter().enumerate() {
        picture(BOARD, *pose).save(folder.join(format!("left{number}.png"))).unwrap();
    }
}

/// The control: the images of the other tests are good ones.
#[test]
fn good_pictures_calibrate_whichever_side_is_called_columns() {
    let set = Set::of(BOARD, &POSES);
    for target in [TARGET.to_owned(), TARGET.replace("columns = 8\nrows = 5", "columns = 5\nrows = 8")] {
        fs::write(set.path("target.toml"), target).unwrap();
        set.calibrate(&["left"]).expect_success();
        let rig = files::rig_file::read_rig(set.path("rig.toml").as_ref()).unwrap();
        let focal_px = rig.rig.camera("left").unwrap().focal_px[0];
        assert!((focal_px - FOCAL_PX).abs() < 0.5, "{focal_px} px");
    }
}

#[test]
fn no_board_another_one_and_two_are_refused_with_what_was_seen() {
    let flat = |picture: &GrayImage| GrayImage::from_pixel(picture.width(), picture.height(), Luma([90]));
    let set = Set::of(BOARD, &POSES).change(flat);
    set.expect_refusal(&["left"], &["target.toml", "6 images", "left0.png", "no checkerboard", "focus"]);
    let set = Set::of((7, 5), &POSES);
    let words = ["found 7 x 5 inner corners, target.toml declares 8 x 5", "left0.png"];
    set.expect_refusal(&["left"], &words);
    let set = Set::of((9, 5), &POSES);
    let words = ["found 9 x 5 inner corners, target.toml declares 8 x 5", "left0.png"];
    set.expect_refusal(&["left"], &words);
    let twice = |picture: &GrayImage| {
        GrayImage::from_fn(2 * SIZE_PX.0, SIZE_PX.1, |x, y| *picture.get_pixel(x % SIZE_PX.0, y))
    };
    Set::of(BOARD, &POSES).change(twice).expect_refusal(&["left"], &["2 targets of 8 x 5", "left0.png"]);
}

#[test]
fn a_larger_board_in_most_pictures_counts_more_than_the_declared_one_in_some() {
    let set = Set::of(BOARD, &POSES[..3]);
    for (number, pose) in POSES[..4].iter().enumerate() {
        set.save(&format!("left{}.png", 3 + number), &picture((9, 5), *pose));
    }
    set.expect_refusal(&["left"], &["4 of 7 images", "left3.png", "found 9 x 5", "declares 8 x 5"]);
}

#[test]
fn blurred_and_saturated_pictures_are_refused() {
    let blur = |picture: &GrayImage| image::imageops::blur(picture, 12.0);
    Set::of(BOARD, &POSES).change(blur).expect_refusal(&["left"], &["left0.png", "focus"]);
    let white = |picture: &GrayImage| {
        let mut bright = picture.clone();
        bright.pixels_mut().for_each(|p| p.0[0] = p.0[0].saturating_mul(7));
        bright
    };
    Set::of(BOARD, &POSES).change(white).expect_refusal(&["left"], &["left0.png", "saturated"]);
}

#[test]
fn poses_that_determine_nothing_are_refused_with_what_is_missing() {
    Set::of(BOARD, &POSES[..2]).expect_refusal(&["left"], &["left: 2 usable views", "needs", "add poses"]);
    // Facing the camera, what noise makes of the focal length must not pass for tilt.
    for tilt in [[0.3, 0.1], [0.0, 0.0]] {
        let parallel: Vec<Pose> = POSES.iter().map(|p| [tilt[0], tilt[1], 0.0, p[3], p[4]]).collect();
        Set::of(BOARD, &parallel)
            .expect_refusal(&["left"], &["left: the 6 poses", "tilt the board about its x axis"]);
    }
}

#[test]
fn cameras_without_a_common_pose_are_named_in_their_groups() {
    let set = Set::new();
    let flat = GrayImage::from_pixel(SIZE_PX.0, SIZE_PX.1, Luma([90]));
    for number in 0..2 * POSES.len() {
        let board = picture(BOARD, POSES[number % POSES.len()]);
        let (left, right) = if number < POSES.len() { (&board, &flat) } else { (&flat, &board) };
        set.save(&format!("left{number}.png"), left);
        set.save(&format!("right{number}.png"), right);
    }
    set.expect_refusal(&["left", "right"], &["[left]", "[right]", "add poses"]);
    for number in 0..2 * POSES.len() {
        set.save(&format!("right{number}.png"), &flat);
    }
    set.expect_refusal(&["left", "right"], &["right: 0 usable views", "12 poses"]);
}

/// A copy would count as a second measurement.
#[test]
fn pictures_that_count_twice_are_refused() {
    let set = Set::of(BOARD, &POSES);
    let copy = set.path("left6.png");
    fs::copy(set.path("left1.png"), &copy).unwrap();
    set.expect_refusal(&["left"], &["left6.png", "left1.png", "a copy of the other"]);
    fs::remove_file(copy).unwrap();
    let other = |pose: Pose| picture(BOARD, [pose[0], pose[1], pose[2], pose[3] - 3.0, pose[4]]);
    POSES
        .iter()
        .enumerate()
        .for_each(|(number, pose)| set.save(&format!("right{number}.png"), &other(*pose)));
    set.calibrate(&["left", "right"]).expect_success();
    fs::remove_file(set.path("rig.toml")).unwrap();
    fs::remove_file(set.path("rig.covariance.json")).unwrap();
    fs::copy(set.path("left2.png"), set.path("right2.png")).unwrap();
    set.expect_refusal(&["left", "right"], &["right2.png", "left2.png", "a copy of the other"]);
}

/// One picture of another camera among many, and a camera that sharpens.
#[test]
fn pictures_of_another_camera_and_sharpened_ones_are_named() {
    let set = Set::of(BOARD, &POSES);
    let shrunk =
        image::imageops::resize(&picture(BOARD, POSES[3]), 230, 172, image::imageops::FilterType::Lanczos3);
    let mut other = GrayImage::from_pixel(SIZE_PX.0, SIZE_PX.1, Luma([200]));
    image::imageops::replace(&mut other, &shrunk, 4, 3);
    set.save("left3.png", &other);
    let ran = set.calibrate(&["left"]).expect_success();
    assert!(ran.stderr.contains("the two halves of the poses contradict each other"), "{}", ran.stderr);
    let soft = Set::of(BOARD, &POSES).change(|picture| image::imageops::blur(picture, 0.5));
    let ran = soft.calibrate(&["left"]).expect_success();
    assert!(!ran.stderr.contains("halves") && !ran.stderr.contains("sharpen"), "{}", ran.stderr);
    let sharp = Set::of(BOARD, &POSES).change(|picture| image::imageops::unsharpen(picture, 1.0, 0));
    let ran = sharp.calibrate(&["left"]).expect_success();
    assert!(ran.stderr.contains("does the camera sharpen"), "{}", ran.stderr);
}

#[test]
fn pictures_that_cannot_be_read_or_compared_are_named() {
    let set = Set::of(BOARD, &POSES);
    let bytes = fs::read(set.path("left3.png")).unwrap();
    fs::write(set.path("left3.png"), &bytes[..bytes.len() / 2]).unwrap();
    set.expect_left_out(&["left3.png"]);
    fs::write(set.path("left3.png"), "not a picture").unwrap();
    set.expect_left_out(&["left3.png", "convert it"]);
    fs::write(set.path("left3.png"), "").unwrap();
    set.expect_left_out(&["left3.png"]);
    fs::remove_file(set.path("left3.png")).unwrap();
    fs::create_dir(set.path("left3.png")).unwrap();
    set.expect_left_out(&["left3.png"]);
    fs::remove_dir(set.path("left3.png")).unwrap();
    set.save("left3.png", &GrayImage::from_pixel(120, 90, Luma([90])));
    set.expect_left_out(&["left3.png", "120 × 90", "240 × 180"]);
    set.save("left3.png", &GrayImage::from_pixel(9, 9, Luma([90])));
    set.expect_left_out(&["left3.png", "9 × 9"]);
    fs::remove_file(set.path("left3.png")).unwrap();
    set.save("right0.png", &picture(BOARD, POSES[0]));
    set.expect_refusal(&["left", "right"], &["--images", "\"right\" has 1", "\"left\" has 5"]);
    set.expect_refusal(&["left", "middle"], &["--images", "middle*.png", "no file matches"]);
    set.expect_refusal(&["left", "left"], &["left", "twice"]);
}

#[test]
fn target_files_without_sense_are_refused_with_key_value_and_limits() {
    let set = Set::of(BOARD, &POSES[..1]);
    for (from, to, words) in [
        ("columns = 8", "columns = 0", &["columns = 0", "3 to 500"][..]),
        ("columns = 8", "columns = -8", &["target.toml:2: columns", "-8"]),
        ("columns = 8", "columns = 4000000000", &["columns = 4000000000", "500"]),
        ("columns = 8", "columns = 1e300", &["target.toml:2"]),
        ("columns = 8", "", &["columns"]),
        ("rows = 5", "rows = 2", &["rows = 2", "3 to 500"]),
        ("rows = 5", "rows = 500\nspare = 1", &["target.toml:4", "spare"]),
        ("10.0", "nan", &["pitch_mm = NaN", "0.001"]),
        ("10.0", "-10.0", &["pitch_mm = -10", "0.001"]),
        ("10.0", "inf", &["pitch_mm = inf", "100000"]),
        ("10.0", "1e-9", &["pitch_mm"]),
        ("10.0", "\"ten\"", &["target.toml:4", "ten"]),
        ("checkerboard", "chequers", &["target.toml:1", "chequers", "checkerboard"]),
        ("checkerboard\"", "checkerboard", &["target.toml:1"]),
        ("checkerboard", "charuco", &["dictionary", "marker_mm", "DICT_4X4_50"]),
        ("10.0", "10.0\ndiameter_mm = 4", &["diameter_mm", "leave it out"]),
        ("10.0", "10.0\nmarker_mm = 4", &["marker_mm", "leave them out"]),
        (TARGET, "", &["kind"]),
    ] {
        fs::write(set.path("target.toml"), TARGET.replace(from, to)).unwrap();
        set.expect_refusal(&["left"], &[&["target.toml"], words].concat());
    }
    fs::write(set.path("target.toml"), [0xff, 0xfe, 0x00]).unwrap();
    set.expect_refusal(&["left"], &["target.toml", "UTF-8"]);
    fs::remove_file(set.path("target.toml")).unwrap();
    set.expect_refusal(&["left"], &["target.toml"]);
}

/// A recording with nothing but white, or black, of one camera.
fn record(set: &Set, name: &str, light: &str, picture: &GrayImage) {
    let frames = format!("{name}/frames/proj1/left");
    fs::create_dir_all(set.path(&frames)).unwrap();
    set.save(&format!("{frames}/000.png"), picture);
    let text = format!(
        "format = \"fringecell-recording/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\n\
         cameras = [\"left\"]\nsequence = [{{ set = \"{light}\" }}]\n"
    );
    fs::write(set.path(&format!("{name}/recording.toml")), text).unwrap();
}

#[test]
fn recordings_are_refused_like_pictures() {
    let set = Set::new();
    let recordings: Vec<String> = (0..3).map(|number| set.path(&format!("pose{number}"))).collect();
    let (target, out) = (set.path("target.toml"), set.path("rig.toml"));
    let calibrate = || {
        let mut arguments = vec!["calibrate", "--target", &target, "--out", &out];
        arguments.extend(recordings.iter().map(String::as_str));
        let ran = fringetool(&arguments);
        assert!(ran.code == Some(2) && ran.stderr.lines().count() == 1, "{:?} {}", ran.code, ran.stderr);
        assert!(!Path::new(&out).exists());
        ran.stderr
    };
    let cases = [
        ("white", GrayImage::from_pixel(SIZE_PX.0, SIZE_PX.1, Luma([90])), ["pose0", "no checkerboard"]),
        ("white", picture((7, 5), POSES[0]), ["pose0", "found 7 x 5 inner corners"]),
        ("black", picture(BOARD, POSES[0]), ["pose0", "neither white nor sines"]),
    ];
    for (light, picture, words) in cases {
        for number in 0..3 {
            record(&set, &format!("pose{number}"), light, &picture);
        }
        let message = calibrate();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
    record(&set, "pose1", "white", &picture(BOARD, POSES[1]));
    fs::write(set.path("pose1/frames/proj1/left/000.png"), "x").unwrap();
    let message = calibrate();
    assert!(message.contains("000.png"), "{message}");
}

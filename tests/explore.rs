//! Sequences that `fringetool explore` finds in frames alone: of recordings by others, and of a broken one.

use crate::support::{fringetool, real_data};
use serde_json::Value;
use std::path::Path;

/// The proposed sets of a folder, as lines of a recording.
fn sets(folder: &str, more: &[&str]) -> Vec<Value> {
    let out = tempfile::tempdir().unwrap();
    let json = out.path().join("found.json");
    let words = [&["explore", folder, "--json", json.to_str().unwrap()], more].concat();
    fringetool(&words).expect_success();
    let found: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(found["differing"], serde_json::json!([]), "{folder}");
    assert_eq!(found["cameras"][0]["found"]["unexplained"], serde_json::json!([]), "{folder}");
    let sets = found["cameras"][0]["found"]["sets"].as_array().unwrap();
    sets.iter().map(|set| set["set"].clone()).collect()
}

/// The sequence of a text in the form of a recording.
fn sequence(text: &str) -> Vec<Value> {
    let table: toml::Table = toml::from_str(&format!("sequence = [{text}]")).unwrap();
    serde_json::to_value(&table["sequence"]).unwrap().as_array().unwrap().clone()
}

#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main explore::")]
fn sequences_of_recordings_by_others_are_found() {
    let Some(real) = real_data("procam_skull").map(|path| path.parent().unwrap().to_owned()) else { return };
    let known = [
        (
            "fourstep_stereo",
            "1920x1080",
            "{ set = 'sine', axis = 'x', direction = '-', first_step_rad = 3.141592653589793, period_px = 60.0, steps = 4 }, \
             { set = 'gray', axis = 'x', bits = 6, stripe_px = 30.0 }",
        ),
        (
            "gray_stereo",
            "3840x2160",
            "{ set = 'white' }, { set = 'black' }, { set = 'gray', axis = 'x', bits = 9, stripe_px = 8.0 }, \
             { set = 'gray', axis = 'x', bits = 9, invert = true, stripe_px = 8.0 }, \
             { set = 'gray', axis = 'y', bits = 9, stripe_px = 8.0 }, \
             { set = 'gray', axis = 'y', bits = 9, invert = true, stripe_px = 8.0 }",
        ),
        (
            "procam_board_gray/pose_0",
            "1024x768",
            "{ set = 'gray', axis = 'x', bits = 10, stripe_px = 1.0 }, \
             { set = 'gray', axis = 'x', bits = 10, invert = true, stripe_px = 1.0 }, \
             { set = 'gray', axis = 'y', bits = 10, stripe_px = 1.0 }, \
             { set = 'gray', axis = 'y', bits = 10, invert = true, stripe_px = 1.0 }, { set = 'white' }, { set = 'black' }",
        ),
        (
            "procam_mono",
            "1920x1080",
            "{ set = 'sine', axis = 'x', direction = '-', first_step_rad = 3.141592653589793, period_px = 60.0, steps = 12 }, \
             { set = 'gray', axis = 'x', bits = 6, stripe_px = 30.0 }",
        ),
        (
            "procam_skull/skull_gray",
            "1824x1140",
            "{ set = 'white' }, { set = 'black' }, { set = 'gray', axis = 'x', bits = 10, stripe_px = 2.0 }",
        ),
        (
            "procam_skull/skull_2x3",
            "1824x1140",
            "{ set = 'sine', axis = 'x', period_px = 114.0, steps = 3 }, { set = 'sine', axis = 'x', period_px = 1824.0, steps = 3 }",
        ),
        (
            "procam_skull/calibration/calseq2",
            "1824x1140",
            "{ set = 'sine', axis = 'x', period_px = 114.0, steps = 3 }, { set = 'sine', axis = 'x', period_px = 1824.0, steps = 3 }, \
             { set = 'sine', axis = 'y', period_px = 71.25, steps = 3 }, { set = 'sine', axis = 'y', period_px = 1140.0, steps = 3 }",
        ),
        ("procam_skull_3step", "1824x1140", "{ set = 'sine', axis = 'x', period_px = 1824.0, steps = 3 }"),
    ];
    for (set, size, expected) in known {
        let folder = real.join(set).display().to_string();
        assert_eq!(sets(&folder, &["--projector-size", size]), sequence(expected), "{set}");
    }
    // Lengths cannot be told, ratios can: 28 : 26 : 24.
    let plane = sets(&real.join("stereo_plane").display().to_string(), &[]);
    let period = |set: usize| plane[set]["period_px"].as_f64().unwrap();
    assert!((period(0) / period(2) / (28.0 / 24.0) - 1.0).abs() < 0.005);
    assert!((period(1) / period(2) / (26.0 / 24.0) - 1.0).abs() < 0.005);
    assert!(plane.iter().all(|set| set["steps"] == 12));
}

/// A proposal can be decoded at once, and says in its file what is uncertain.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main explore::")]
fn a_proposed_recording_decodes_and_names_its_doubts() {
    let Some(set) = real_data("procam_mono") else { return };
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("proposed").display().to_string();
    let explored = ["explore", set.to_str().unwrap(), "--projector-size", "1920x1080", "--out", &folder];
    fringetool(&explored).expect_success();
    let text = std::fs::read_to_string(Path::new(&folder).join("recording.toml")).unwrap();
    assert!(
        text.starts_with("# Proposed by `fringetool explore`") && text.contains("just cover the projector")
    );
    for picture in ["L-saturation.png", "L-modulation.png", "proj1-L-x-phase.png", "proj1-L-x-relief.png"] {
        assert!(Path::new(&folder).join(picture).is_file(), "{picture}");
    }
    fringetool(&["decode", &folder]).expect_success();
    // The folder has a recording now, which is tested by its own sequence and not replaced.
    let again = fringetool(&["explore", &folder]).expect_success();
    assert!(again.stdout.contains("the frames show the sets of recording.toml"), "{}", again.stdout);
    refused(&explored, "is not empty");
}

/// A recording whose description was exchanged for that of another one.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main explore::")]
fn a_wrong_description_is_told() {
    let Some(set) = real_data("procam_skull_3step") else { return };
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("rec");
    let frames = folder.join("frames/proj1/cam1");
    std::fs::create_dir_all(&frames).unwrap();
    for number in 0..3 {
        let name = format!("{number:03}.png");
        std::fs::copy(set.join("frames/proj1/cam1").join(&name), frames.join(&name)).unwrap();
    }
    let text = std::fs::read_to_string(set.join("recording.toml")).unwrap();
    let wrong = text.replace(
        "{ set = \"sine\", axis = \"x\", period_px = 1824.0, steps = 3 }",
        "{ set = \"gray\", axis = \"x\", bits = 3, stripe_px = 228.0 }",
    );
    assert_ne!(wrong, text);
    std::fs::write(folder.join("recording.toml"), wrong).unwrap();
    let ran = fringetool(&["explore", folder.to_str().unwrap()]).expect_success();
    assert!(ran.stdout.contains("do NOT show the sets"), "{}", ran.stdout);
}

/// Exit code 2 and a message with these words.
fn refused(words: &[&str], message: &str) {
    let ran = fringetool(words);
    assert_eq!(ran.code, Some(2), "{words:?}");
    assert!(ran.stderr.contains(message), "{}", ran.stderr);
}

#[test]
fn what_cannot_be_explored_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_str().unwrap();
    refused(&["explore", path], "no picture files");
    refused(&["explore", "no/such/folder"], "cannot be listed");
    refused(&["explore", path, "--projector-size", "0x5"], "1 … 65535");
    let grey = image::GrayImage::from_pixel(40, 30, image::Luma([90]));
    for number in 0..4 {
        grey.save(folder.path().join(format!("{number}.png"))).unwrap();
    }
    refused(&["explore", path], "no pattern");
    image::GrayImage::from_pixel(10, 30, image::Luma([9])).save(folder.path().join("4.png")).unwrap();
    refused(&["explore", path], "frame 4 has 10 × 30 px");
    std::fs::write(folder.path().join("4.png"), b"no picture").unwrap();
    refused(&["explore", path], "4.png");
}

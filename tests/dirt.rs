//! Recordings with faults: named on the console and in JSON, and used where what is left determines the phase. Clean ones raise no alarm.

use crate::running::{Cell, results, text};
use crate::support::{Small, fringetool, real_data};
use serde_json::Value;
use tempfile::TempDir;

/// Decodes a recording; its JSON and its console.
fn decode(recording: &str, json: &str) -> (Value, String) {
    let ran = fringetool(&["decode", recording, "--json", json]).expect_success();
    (serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap(), ran.stdout)
}

/// Valid pixels of all views.
fn valid(result: &Value) -> u64 {
    result["views"].as_array().unwrap().iter().map(|view| view["valid"].as_u64().unwrap()).sum()
}

fn faults(result: &Value) -> Vec<&Value> {
    result["views"].as_array().unwrap().iter().flat_map(|view| view["findings"].as_array().unwrap()).collect()
}

#[test]
fn faulty_frames_are_named_and_the_others_are_used() {
    let small = Small::new();
    let (recording, json) = (small.path("rec"), small.path("decode.json"));
    let (clean, _) = decode(&recording, &json);
    assert_eq!(faults(&clean), Vec::<&Value>::new());
    let points = |small: &Small| {
        small.reconstruct(&[]).expect_success();
        files::ply::read_cloud(small.path("cloud.ply").as_ref()).unwrap().points.len()
    };
    let before = points(&small);
    // A trigger that was lost, in one camera.
    let place = small.path("rec/frames/proj1/cam1/003.png");
    let picture = image::open(&place).unwrap().into_luma8();
    image::GrayImage::new(picture.width(), picture.height()).save(&place).unwrap();
    let (black, console) = decode(&recording, &json);
    let found = faults(&black);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(
        (found[0]["kind"].as_str(), found[0]["set"].as_u64(), found[0]["frame"].as_u64()),
        (Some("black"), Some(1), Some(4))
    );
    assert!(console.contains("frame 4 of set 1 is black; left out"), "{console}");
    assert!(valid(&black) * 100 > valid(&clean) * 97, "{} of {}", valid(&black), valid(&clean));
    assert!(points(&small) * 100 > before * 95, "{} of {before}", points(&small));
}

/// Proves: what the decoder of a cell makes up for stands with the result, and beside the verdict in the report.
#[test]
fn a_cell_says_which_frame_it_made_up_for() {
    let cell = Cell::played("dirty", 0.0, "");
    let place = cell.small.path("rec/frames/proj1/cam1/003.png");
    let picture = image::open(&place).unwrap().into_luma8();
    image::GrayImage::new(picture.width(), picture.height()).save(&place).unwrap();
    let ran = cell.run("played.toml", &["--cycles", "1"]);
    assert_eq!(ran.status.code(), Some(0), "{}", text(&ran.stderr));
    let told = "camera \"cam1\": frame 4 of set 1 is black; left out";
    assert_eq!(results(&cell.out())[0]["warnings"], serde_json::json!([told]));
    let report = std::fs::read_to_string(cell.out().join("report.html")).unwrap();
    assert!(report.contains(&format!("<b>Warning:</b> {}", told.replace('"', "&quot;"))));
}

#[test]
fn a_missing_code_frame_is_named_and_the_rest_is_used() {
    let small = Small::new();
    let (recording, json) = (small.path("rec"), small.path("decode.json"));
    let (clean, _) = decode(&recording, &json);
    assert_eq!(clean["missing"], serde_json::json!([]));
    // Frame 16 is the last bit of the code.
    for camera in ["cam1", "cam2"] {
        std::fs::remove_file(small.path(&format!("rec/frames/proj1/{camera}/016.png"))).unwrap();
    }
    let ran = fringetool(&["decode", &recording]);
    assert_eq!(ran.code, Some(2));
    assert!(ran.stderr.contains("missing: 016") && ran.stderr.contains("missing = ["), "{}", ran.stderr);
    small.edit("rec/recording.toml", "width_px = 608", "missing = [16]\nwidth_px = 608");
    let (left, console) = decode(&recording, &json);
    let note = "proj1: set 2 (\"gray\") misses frame 7 of 7: decoded as 6 bits with stripes of 16 px";
    assert_eq!(left["missing"], serde_json::json!([note]));
    assert!(console.contains(note), "{console}");
    assert!(valid(&left) * 100 > valid(&clean) * 90, "{} of {}", valid(&left), valid(&clean));
    assert!(small.reconstruct(&[]).expect_success().stdout.contains(note));
    // A bit in the middle cannot be told from the others.
    small.edit("rec/recording.toml", "missing = [16]", "missing = [12]");
    let ran = fringetool(&["decode", &recording]);
    assert_eq!(ran.code, Some(2));
    assert!(ran.stderr.contains("a code without bit 3 of 7 numbers nothing"), "{}", ran.stderr);
}

/// Real recordings without known faults: none is found.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main dirt::")]
fn real_recordings_raise_no_alarm() {
    for (set, layout) in [
        ("stereo_plane", "stereo_plane"),
        ("procam_mono", "procam_mono"),
        ("procam_skull", "procam_skull_2x3"),
    ] {
        let Some(source) = real_data(set) else { return };
        let folder = TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let layout = format!("tests/layouts/{layout}.toml");
        let (from, recording) = (source.to_str().unwrap(), path("rec"));
        fringetool(&["import", &layout, "--from", from, "--out", &recording]).expect_success();
        let (result, console) = decode(&recording, &path("decode.json"));
        assert_eq!(faults(&result), Vec::<&Value>::new(), "{set}: {console}");
    }
    for set in ["fourstep_stereo", "gray_stereo", "procam_skull_3step"] {
        let Some(source) = real_data(set) else { return };
        let folder = TempDir::new().unwrap();
        let json = folder.path().join("decode.json").to_str().unwrap().to_owned();
        let (result, console) = decode(source.to_str().unwrap(), &json);
        assert_eq!(faults(&result), Vec::<&Value>::new(), "{set}: {console}");
    }
}

//! Clean pictures of a part with faces in every direction, seen from its sides: rims between surfaces are no fault of a frame.

use crate::support::{fringetool, root};
use serde_json::Value;
use std::fs;
use tempfile::TempDir;

/// Columns and rows of the cameras.
const SIZE_PX: (u32, u32) = (450, 300);

/// Proves: all cameras decode the clean pictures of both projectors along both axes; no frame is named, and hardly a pixel is left out.
#[test]
fn clean_pictures_of_oblique_views_are_decoded_and_no_frame_is_named() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let rig = twin::thesis::rig(SIZE_PX.0, SIZE_PX.1);
    files::rig_file::write_rig(path("rig.toml").as_ref(), &rig, &toml::Table::new(), None).unwrap();
    let scene = root().join("configs/complex-artefact.scene.toml").display().to_string();
    let cell = fs::read_to_string(root().join("configs/calibration.toml")).unwrap();
    let cell = cell.replace("demo-rig.toml", "rig.toml").replace("board.scene.toml", &scene);
    fs::write(path("cell.toml"), cell).unwrap();
    let (cell, recording, json) = (path("cell.toml"), path("rec"), path("decode.json"));
    fringetool(&["simulate", &cell, "--out", &recording]).expect_success();
    let ran = fringetool(&["decode", &recording, "--out", &path("out"), "--json", &json]).expect_success();
    let found: Value = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    let views = found["views"].as_array().unwrap();
    assert_eq!(views.len(), 16, "{found}");
    for view in views {
        assert_eq!(view["findings"], Value::Array(Vec::new()), "{view}");
        let [valid, open] = ["valid", "ambiguous"].map(|name| view[name].as_u64().unwrap());
        assert!(valid > 10_000 && open * 50 < valid, "{view}");
    }
    let said = [ran.stdout, ran.stderr].concat();
    assert!(!said.contains("contradict"), "{said}");
}

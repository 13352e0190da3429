//! `register`: motions that are known beforehand, and those that the surfaces do not determine.

use crate::compare::{Folder, face, lifted, ply, stl};
use crate::support::fringetool;
use std::path::Path;

/// Turned by 0.4 rad about z and shifted.
fn turned([x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sine, cosine) = 0.4_f64.sin_cos();
    [cosine * x - sine * y + 30.0, sine * x + cosine * y - 12.0, z + 7.0]
}

#[test]
fn register_undoes_a_known_motion_and_writes_it() {
    let folder = Folder::new();
    let reference = folder.write("reference.ply", ply(&face(0.2, lifted(0.0))));
    let cloud = ply(&face(0.25, turned)).replacen(
        "element",
        "comment edge_px: 2\ncomment pairs: [\"p\"]\nelement",
        1,
    );
    let cloud = folder.write("cloud.ply", cloud);
    let (out, json) = (folder.path("out.ply"), folder.path("out.json"));
    fringetool(&["register", &cloud, "--to", &reference, "--out", &out, "--json", &json]).expect_success();
    let result = folder.json("out.json");
    assert_eq!(
        (result["converged"].as_bool(), result["undetermined"].as_array().unwrap().len()),
        (Some(true), 0)
    );
    // The motion back takes what was turned to where it was.
    let matrix = |r: usize, c: usize| result["matrix"][r][c].as_f64().unwrap();
    let [x, y, z] = turned([10.0, 8.0, 0.0]);
    for (row, expected) in [10.0, 8.0, 0.0].into_iter().enumerate() {
        let found = matrix(row, 0) * x + matrix(row, 1) * y + matrix(row, 2) * z + matrix(row, 3);
        assert!((found - expected).abs() < 2e-3, "row {row}: {found}");
        assert_eq!(result["translation_mm"][row], result["matrix"][row][3]);
        assert_eq!(result["rotation"][row][0], result["matrix"][row][0]);
    }
    // What was left out at rims is true of the moved cloud, where cameras stood is not.
    let written = std::fs::read(&out).unwrap();
    let header = String::from_utf8_lossy(&written[..written.len().min(1000)]);
    assert!(header.contains("comment edge_px: 2") && !header.contains("comment pairs"), "{header}");
    // The written cloud lies on the reference, and its transform is a start like any other.
    let report = folder.path("compare.json");
    fringetool(&["compare", &out, &reference, "--json", &report]).expect_success();
    assert!(folder.json("compare.json")["rms_mm"].as_f64().unwrap() < 1e-3);
    let again = folder.path("again.json");
    let arguments =
        ["register", &cloud, "--to", &reference, "--out", &out, "--start", &json, "--json", &again];
    fringetool(&arguments).expect_success();
    assert_eq!(folder.json("again.json")["start"], "given");
}

#[test]
fn several_clouds_go_into_a_folder() {
    let folder = Folder::new();
    let reference = folder.write("reference.ply", ply(&face(0.3, lifted(0.0))));
    let (a, b) =
        (folder.write("a.ply", ply(&face(0.4, lifted(0.1)))), folder.write("b.ply", ply(&face(0.4, turned))));
    let out = folder.path("out");
    fringetool(&["register", &a, &b, "--to", &reference, "--out", &out]).expect_success();
    for name in ["out/a.ply", "out/a.json", "out/b.ply", "out/b.json"] {
        assert!(Path::new(&folder.path(name)).is_file(), "{name}");
    }
}

#[test]
fn a_plane_on_a_plane_is_reported_as_undetermined() {
    let folder = Folder::new();
    let plate = folder.write("plate.stl", stl());
    let cloud = folder.write("cloud.ply", ply(&face(0.5, |[x, y, _]| [x, y, 0.2])));
    let (out, json) = (folder.path("out.ply"), folder.path("out.json"));
    let arguments =
        ["register", &cloud, "--to", &plate, "--out", &out, "--start", "as-it-lies", "--json", &json];
    let ran = fringetool(&arguments).expect_success();
    assert!(ran.stdout.contains("UNDETERMINED"), "{}", ran.stdout);
    let result = folder.json("out.json");
    assert_eq!(result["undetermined"].as_array().unwrap().len(), 3);
    assert!(ran.stdout.contains("u of the centre (undetermined, undetermined, "), "{}", ran.stdout);
    assert!(result["u_translation_mm"][0].is_null() && result["covariance"][2][2].is_null(), "{result}");
    assert!(result["u_translation_mm"][2].is_number(), "{result}");
}

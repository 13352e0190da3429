//! A rig comes back with the digits that it had; an invalid rig is reported with line, key and remedy.

use super::*;
use crate::testing::{camera, rig};
use fringe::sensor::{Footprint, Sensor};
use std::fs;

fn read(text: &str) -> Result<RigFile, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.toml");
    fs::write(&path, text).unwrap();
    read_rig(&path).map_err(|error| error.to_string())
}

fn whole() -> Rig {
    let mut whole = rig(1124, 750);
    whole.projectors = vec![camera("proj1", 608, 684), camera("proj2", 608, 684)];
    whole
}

#[test]
fn a_rig_comes_back_with_its_digits_and_provenance() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.toml");
    let mut provenance = toml::Table::new();
    provenance.insert("rms_px".into(), 0.1.into());
    provenance.insert("views".into(), toml::Table::from_iter([("cam1".into(), 12.into())]).into());
    let covariance = CovarianceRef { file: "rig.cov".into(), sha256: "ab".into() };
    let sha256 = write_rig(&path, &whole(), &provenance, Some(&covariance)).unwrap();
    let file = read_rig(&path).unwrap();
    assert_eq!(
        (file.sha256.as_str(), file.provenance, file.covariance),
        (sha256.as_str(), provenance, Some(covariance))
    );
    assert_eq!(file.rig.pairs, whole().pairs);
    let views = |rig: &Rig| rig.cameras.iter().chain(&rig.projectors).cloned().collect::<Vec<_>>();
    for (read, written) in views(&file.rig).iter().zip(&views(&whole())) {
        let (a, b) = (&read.camera, &written.camera);
        assert_eq!(read.name, written.name);
        assert_eq!(
            (a.width_px, a.focal_px, a.principal_point_px),
            (b.width_px, b.focal_px, b.principal_point_px)
        );
        assert_eq!((a.skew, a.distortion), (b.skew, b.distortion));
        assert_eq!(a.camera_from_world.translation, b.camera_from_world.translation);
        // The matrix in the file is exact; the quaternion that is made from it differs in the last digit.
        assert!(a.camera_from_world.rotation.angle_to(&b.camera_from_world.rotation) < 1e-14);
    }
}

#[test]
fn what_may_be_left_out_has_its_meaning() {
    let text = r#"format = "fringecell-rig/1"
[[camera]]
name = "a"
width_px = 10
height_px = 10
focal_px = [100, 100]
principal_point_px = [5, 5]
distortion = { model = "brown-conrady", k = [0.1] }
from_world = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [0, 0, 0] }
[provenance]
anything = "goes"
"#;
    let file = read(text).unwrap();
    assert_eq!(file.rig.cameras[0].camera.distortion, Lens::brown_conrady([0.1, 0.0, 0.0], [0.0, 0.0]));
    assert!(file.rig.pairs.is_empty() && file.rig.projectors.is_empty());
    let plain = text.replace("distortion = { model = \"brown-conrady\", k = [0.1] }\n", "");
    assert_eq!(read(&plain).unwrap().rig.cameras[0].camera.distortion, Lens::default());
}

#[test]
fn every_kind_of_lens_comes_back_as_it_was_written() {
    let all = [0.1, -0.2, 0.3, 1e-3, -2e-3, 0.4, 0.5, 0.6, 1e-4, 2e-4, 3e-4, 4e-4];
    for (kind, has) in [
        (LensKind::BrownConrady, 0..5),
        (LensKind::Rational, 0..8),
        (LensKind::ThinPrism, 0..12),
        (LensKind::Fisheye, 0..3),
    ] {
        let mut own = std::array::from_fn(|i| if has.contains(&i) { all[i] } else { 0.0 });
        if kind == LensKind::Fisheye {
            own[5] = all[5];
        }
        let mut one = Rig { cameras: vec![camera("cam1", 640, 480)], ..Rig::default() };
        one.cameras[0].camera.distortion = Lens::from_coefficients(kind, own);
        let found = read(&rig_text(&one, &toml::Table::new(), None)).unwrap();
        assert_eq!(found.rig.cameras[0].camera.distortion, one.cameras[0].camera.distortion);
    }
    let text = rig_text(&whole(), &toml::Table::new(), None).replace("brown-conrady", "fisheye");
    assert!(read(&text).unwrap_err().contains("\"fisheye\" has at most 0"), "a fisheye has no p");
}

/// A footprint comes back with its change over the picture; a change that leaves none somewhere, or that has no mean, is refused.
#[test]
fn a_footprint_over_the_picture_comes_back_or_is_refused() {
    let mut one = Rig { cameras: vec![camera("cam1", 640, 480)], ..Rig::default() };
    let footprint = Footprint { sigma_px: [0.5, 0.6], u_px: None, field_px2: 0.12 };
    one.sensors.insert("cam1".into(), Sensor { footprint: Some(footprint), ..Sensor::default() });
    let text = rig_text(&one, &toml::Table::new(), None);
    assert_eq!(read(&text).unwrap().rig.sensors, one.sensors);
    for (from, to, expected) in [
        ("field_px2 = 0.12", "field_px2 = 0.8", "camera[0].footprint_field_px2"),
        ("field_px2 = 0.12", "field_px2 = nan", "footprint_field_px2"),
        ("field_px2 = 0.12", "field_px2 = -0.5", "must leave the squares"),
        ("footprint_px = [0.5, 0.6]\n", "", "needs footprint_px, the mean over the picture"),
    ] {
        let error = read(&text.replace(from, to)).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    let old = read(&text.replace("footprint_field_px2 = 0.12\n", "")).unwrap();
    assert_eq!(old.rig.sensors["cam1"].footprint.map(|f| f.field_px2), Some(0.0));
}

#[test]
fn a_pair_without_projector_takes_the_only_one_that_lit_both() {
    let cameras = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<String>>();
    let (both, one) = (cameras(&["cam1", "cam2"]), cameras(&["cam1"]));
    let open = || {
        let mut open = whole();
        open.pairs.truncate(1);
        open.pairs[0].projector = String::new();
        open
    };
    let path = Path::new("rig.toml");
    let mut resolved = open();
    resolve_pairs(path, &mut resolved, &[("proj2", &one), ("proj7", &both)]).unwrap();
    assert_eq!(resolved.pairs[0].projector, "proj7");
    let mut conventional = open();
    conventional.pairs[0].right = "proj1".into();
    resolve_pairs(path, &mut conventional, &[]).unwrap();
    assert_eq!(conventional.pairs[0].projector, "proj1");
    for (lit, expected) in [
        (vec![("proj1", both.as_slice()), ("proj2", &both)], "2 projectors light both (proj1, proj2)"),
        (vec![("proj1", one.as_slice())], "0 projectors light both (none)"),
    ] {
        let error = resolve_pairs(path, &mut open(), &lit).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// What is changed in a plain rig, into what, and what the message then states.
const FAULTS: &[(&str, &str, &str)] = &[
    (
        "[[1.0, 0.0, 0.0]",
        "[[-1.0, 0.0, 0.0]",
        "rig.toml:11: camera[0].from_world: rotation is a mirror (determinant -1.000)",
    ),
    (
        "[[1.0, 0.0, 0.0]",
        "[[2.0, 0.0, 0.0]",
        "rotation is not orthonormal: largest entry of R·Rᵀ − 1 is 3.00e0",
    ),
    ("[[1.0, 0.0, 0.0]", "[[nan, 0.0, 0.0]", "rotation must be a finite number"),
    ("[[1.0, 0.0, 0.0]", "[[1.0, 0.0]", "rig.toml:11: from_world: invalid length 2"),
    (
        "translation_mm = [0.0, 0.0, 0.0]",
        "translation_mm = [inf, 0.0, 0.0]",
        "translation must be a finite number",
    ),
    ("focal_px = [100.0, 100.0]", "focal_px = [100.0, -1.0]", "focal length -1 px must be a positive number"),
    ("width_px = 10", "width_px = 0", "image size 0 × 8 px is outside 1 … 65535"),
    ("width_px = 10", "width_px = 99999999999", "rig.toml:5: width_px: "),
    ("skew = 0.0", "skw = 0.0", "did you mean \"skew\"?"),
    ("skew = 0.0", "skew = nan", "skew must be a finite number"),
    (
        "brown-conrady",
        "brown-conardy",
        "lens models: brown-conrady, rational, thin-prism, fisheye; did you mean",
    ),
    (
        "k = [0.0, 0.0, 0.0]",
        "k = [0.0, 0.0, 0.0, 0.1]",
        "k with 4 numbers is not allowed: \"brown-conrady\" has at most 3",
    ),
    ("p = [0.0, 0.0]", "p = [0.0, inf]", "distortion p must be a finite number"),
    ("name = \"b\"", "name = \"a\"", "view \"a\" occurs twice"),
    ("name = \"b\"", "name = \"../b\"", "value \"../b\" is not allowed"),
    ("right = \"b\"", "right = \"c\"", "camera or projector \"c\" is unknown; known: a, b"),
    ("left = \"a\"", "left = \"c\"", "pair[0].left: camera \"c\" is unknown; known: a, b"),
    ("right = \"b\"", "right = \"a\"", "a pair has two views"),
    (
        "fringecell-rig/1",
        "fringecell-recording/1",
        "format is \"fringecell-recording/1\", expected \"fringecell-rig/1\"",
    ),
];

#[test]
fn each_fault_is_reported_with_place_and_remedy() {
    let mut plain = rig(10, 8);
    plain.cameras.truncate(2);
    plain.pairs.truncate(1);
    for (camera, name) in plain.cameras.iter_mut().zip(["a", "b"]) {
        camera.name = name.into();
        camera.camera.focal_px = [100.0, 100.0];
        camera.camera.skew = 0.0;
        camera.camera.distortion = Lens::default();
        camera.camera.camera_from_world = nalgebra::Isometry3::identity();
    }
    (plain.pairs[0].left, plain.pairs[0].right) = ("a".into(), "b".into());
    let text = rig_text(&plain, &toml::Table::new(), None);
    read(&text).unwrap();
    for (from, to, expected) in FAULTS {
        assert!(text.contains(from), "{from} is not in {text}");
        let error = read(&text.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
    let error = read("format = \"fringecell-rig/1\"\n").unwrap_err();
    assert!(error.contains("[[camera]] is missing; a rig has at least one camera"), "{error}");
}

#[test]
fn a_covariance_is_read_only_as_it_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let (path, beside) = (dir.path().join("rig.toml"), dir.path().join("rig.covariance.json"));
    let good = r#"{"format": "fringecell-covariance/1", "devices": ["cam2", "cam1"], "parameters": ["fx_px", "k1"],
        "matrix": [[1, 0, 0, 0, 0.6], [0, 2, 0, 0, 0.6], [0, 0, 3, 0.5, 0.6], [0, 0, 0.5, 4, 0.6], [0.6, 0.6, 0.6, 0.6, 9]]}"#;
    let read = |text: &str| {
        fs::write(&beside, text).unwrap();
        let reference =
            CovarianceRef { file: "rig.covariance.json".into(), sha256: sha256_hex(text.as_bytes()) };
        write_rig(&path, &whole(), &toml::Table::new(), Some(&reference)).unwrap();
        read_rig(&path).unwrap().read_covariance().map_err(|error| error.to_string())
    };
    let covariance = read(good).unwrap().unwrap();
    assert_eq!(covariance.part(&["cam1"]).unwrap(), [3.0, 0.5, 0.5, 4.0]);
    assert_eq!(covariance.part(&["cam1", "cam2"]).unwrap()[10], 1.0);
    assert!(covariance.part(&["cam3"]).is_none());
    for (from, to, expected) in [
        ("covariance/1", "covariance/2", "format is \"fringecell-covariance/2\""),
        ("\"cam1\"", "\"cam9\"", "device \"cam9\" is unknown"),
        ("[0.6, 0.6, 0.6, 0.6, 9]", "[9]", "rows of another length"),
        ("\"cam1\"", "\"cam2\"", "value cam2 is not allowed: each device once"),
        (
            "[0, 2,",
            "[0, -2,",
            "value -2 in row 1, column 1 (counted from 0) is not allowed: variances are 0 or larger",
        ),
        ("[0, 0, 3, 0.5", "[0, 0, 3, 0.4", "a covariance is symmetric"),
        ("[[1, 0, 0, 0, 0.6]", "[[0.01, 0, 0, 0, 0.6]", "a correlation lies within -1 … 1"),
        (
            "[[1, 0, 0, 0, 0.6], [0, 2, 0, 0, 0.6]",
            "[[0.05, 0, 0, 0, 0.6], [0, 0.05, 0, 0, 0.6]",
            "the correlations contradict each other",
        ),
        ("\"matrix\"", "\"sensors\": {\"cam7\": {}}, \"matrix\"", "camera \"cam7\" is unknown"),
        (
            "\"matrix\"",
            "\"sensors\": {\"cam1\": {\"u_noise_dn\": [-1, 0]}}, \"matrix\"",
            "value -1 is not allowed: standard uncertainties",
        ),
        ("[1, 0", "[null, 0", "invalid type: null"),
    ] {
        let error = read(&good.replace(from, to)).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
    read(good).unwrap();
    fs::write(&beside, good.replace('9', "8")).unwrap();
    let file = read_rig(&path).unwrap();
    let error = file.read_covariance().unwrap_err().to_string();
    assert!(error.contains("it was changed or belongs to another rig"), "{error}");
    fs::remove_file(&beside).unwrap();
    let error = file.read_covariance().unwrap_err().to_string();
    assert!(
        error.contains("rig.covariance.json: cannot open it; ") && error.contains("rig.toml names it"),
        "{error}"
    );
    write_rig(&path, &whole(), &toml::Table::new(), None).unwrap();
    assert_eq!(read_rig(&path).unwrap().read_covariance().unwrap(), None);
}

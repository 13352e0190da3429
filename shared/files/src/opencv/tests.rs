//! Both languages give the same matrices; what is no calibration is refused.

use super::*;
use crate::testing::camera;
use fringe::geometry::camera::{Lens, LensKind};

const YAML: &str = "%YAML:1.0\n---\nrms: 0.25\nname: \"rig 1\"\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
    data: [ 2.5e+03, 0., 640.5, 0.,\n       2.4e+03, .5e+03, 0., 0., 1. ]\nnested:\n   a: 1\n   b: [ 1, 2 ]\n\
    D: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.2, 1e-4, -2e-4, 0.3 ]\n\
    P: !!opencv-matrix\n   rows: 2\n   cols: 1\n   dt: \"2f\"\n   data: [ 1, 2, 3, .Nan ]\n";

const XML: &str = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<K type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  \
    <cols>3</cols>\n  <dt>f</dt>\n  <data>\n    2.5e+03 0. 640.5 0. 2.4e+03 500.\n    0. 0. 1.</data></K>\n\
    <D type_id=\"opencv-matrix\"><rows>1</rows><cols>5</cols><dt>d</dt><data>-0.1 0.2 1e-4 -2e-4 0.3</data></D>\n\
    <rms>0.25</rms>\n<nested><a>1</a></nested></opencv_storage>\n";

fn read(text: &str) -> Result<Storage, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.yml");
    std::fs::write(&path, text).unwrap();
    Storage::read(&path).map_err(|error| error.to_string())
}

#[test]
fn yaml_and_xml_give_the_same() {
    let (yaml, xml) = (read(YAML).unwrap(), read(XML).unwrap());
    let expected = [[2500.0, 0.0, 640.5], [0.0, 2400.0, 500.0], [0.0, 0.0, 1.0]];
    for storage in [&yaml, &xml] {
        assert_eq!(storage.fixed::<3, 3>("K").unwrap(), expected);
        assert_eq!(storage.matrix("D").unwrap().data, [-0.1, 0.2, 1e-4, -2e-4, 0.3]);
        assert_eq!(storage.numbers.get("rms"), Some(&0.25));
        assert!(storage.fixed::<3, 1>("D").is_err());
    }
    assert_eq!(yaml.matrix("P").unwrap().columns, 2);
    assert!(yaml.fixed::<2, 2>("P").unwrap_err().to_string().contains("NaN"));
    assert!(yaml.matrix("k").unwrap_err().to_string().contains("known: D, K, P"));
    let old = read(&YAML.replace("---\n", "").replace('\n', "\r\n")).unwrap();
    assert_eq!(old.fixed::<3, 3>("K").unwrap(), expected);
}

#[test]
fn damaged_calibrations_are_told_with_key_and_line() {
    let cut = |text: &str, at: &str| text[..text.find(at).unwrap()].to_owned();
    for (text, expected) in [
        (YAML.replace("2.5e+03, ", ""), "K: data has 8 numbers, but the matrix has 3 rows × 3 cols"),
        (YAML.replace("2.5e+03", "two"), "K: \"two\" is no number"),
        (YAML.replace("rows: 3", "rows: -3"), "K: rows \"-3\" is no count"),
        (YAML.replace("rows: 3", "rows: 18446744073709551615"), "K: data has 9 numbers"),
        (cut(YAML, "data:"), "K: data has 0 numbers"),
        (cut(XML, "</opencv_storage>"), "ends before its root is closed"),
        (XML.replace("</K>", "</L>"), "c.yml:"),
        (XML.replace("2.5e+03", "2,5e"), "K: \"5e\" is no number"),
        ("{}".into(), "begins neither with %YAML nor with <"),
        ("<a>".repeat(100), "is nested deeper than 64 levels"),
    ] {
        let error = read(&text).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
}

#[test]
fn lens_models_beyond_k3_are_refused() {
    let lens = |values: &[f64]| lens_from_opencv(values, false);
    assert_eq!(lens(&[0.1, 0.2, 0.3, 0.4]).unwrap().k, [0.1, 0.2, 0.0]);
    assert_eq!(
        lens(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.0]).unwrap(),
        Lens::brown_conrady([0.1, 0.2, 0.5], [0.3, 0.4])
    );
    let rational = lens(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]).unwrap();
    assert_eq!((rational.kind, rational.more_k), (LensKind::Rational, [0.6, 0.7, 0.8]));
    let prism = lens(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 0.0, 0.0]).unwrap();
    assert_eq!((prism.kind, prism.prism), (LensKind::ThinPrism, [1.0, 2.0, 3.0, 4.0]));
    let fisheye = lens_from_opencv(&[0.1, 0.2, 0.3, 0.4], true).unwrap();
    assert_eq!((fisheye.k, fisheye.more_k[0], fisheye.p), ([0.1, 0.2, 0.3], 0.4, [0.0; 2]));
    assert!(lens_from_opencv(&[0.1, 0.2, 0.3, 0.4, 0.5], true).is_err());
    assert!(lens(&[&[0.0; 12][..], &[0.01]].concat()).unwrap_err().to_string().contains("coefficient 13"));
    assert!(lens(&[0.1]).is_err());
}

fn pair() -> (fringe::geometry::camera::Camera, fringe::geometry::camera::Camera) {
    let (left, mut right) = (camera("left", 640, 480).camera, camera("right", 640, 480).camera);
    right.camera_from_world = nalgebra::Isometry3::new(
        nalgebra::Vector3::new(-80.0, 1.0 / 3.0, 502.0),
        nalgebra::Vector3::new(0.12, -0.1, 0.31),
    );
    (left, right)
}

#[test]
fn a_pair_comes_back_from_what_was_written() {
    let (left, right) = pair();
    for language in [Language::Yaml, Language::Xml] {
        let storage = read(&pair_text(&left, &right, language).unwrap()).unwrap();
        let views = vec!["a".to_owned(), "b".to_owned()];
        let names = CalibrationNames { views, size_px: None, projector: false, fisheye: false, unit_mm: 1.0 };
        let rig = rig_of_calibration(&storage, &names).unwrap();
        for (found, truth) in [(rig.camera("a").unwrap(), &left), (rig.camera("b").unwrap(), &right)] {
            assert_eq!(
                (found.focal_px, found.skew, found.distortion),
                (truth.focal_px, truth.skew, truth.distortion)
            );
            assert_eq!((found.width_px, found.height_px), (640, 480));
            assert_eq!(found.principal_point_px, truth.principal_point_px);
            let difference = found.camera_from_world * truth.camera_from_world.inverse();
            assert!(difference.translation.vector.norm() < 1e-12 && difference.rotation.angle() < 1e-14);
        }
        assert_eq!((rig.pairs[0].left.as_str(), rig.pairs[0].projector.as_str()), ("a", ""));
        for key in ["E", "F", "R1", "R2", "P1", "P2", "Q"] {
            assert!(storage.matrix(key).is_ok(), "{key}");
        }
        let names = CalibrationNames { projector: true, ..names };
        assert!(rig_of_calibration(&storage, &names).unwrap().projector("b").is_some());
    }
    assert!(pair_text(&left, &left, Language::Yaml).is_err());
}

#[test]
fn calibrations_of_other_programs_are_understood_or_told_why_not() {
    let one = YAML.replace("rms: 0.25", "image_width: 1280\nimage_height: 1024");
    let names = |views: &[&str], size_px| CalibrationNames {
        views: views.iter().map(|v| (*v).to_owned()).collect(),
        size_px,
        fisheye: false,
        projector: false,
        unit_mm: 1.0,
    };
    let rig = rig_of_calibration(&read(&one).unwrap(), &names(&["cam1"], None)).unwrap();
    assert_eq!((rig.cameras[0].camera.width_px, rig.cameras[0].camera.distortion.k[2]), (1280, 0.3));
    assert!(rig.pairs.is_empty());
    let eight = YAML.replace("cols: 5", "cols: 8").replace("0.3 ]", "0.3, 0, 0, 0 ]");
    let rig = rig_of_calibration(&read(&eight).unwrap(), &names(&["cam1"], Some((640, 480)))).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion.k[2], 0.3);
    let rational = eight.replace("0.3, 0,", "0.3, 0.1,");
    let rig = rig_of_calibration(&read(&rational).unwrap(), &names(&["cam1"], Some((640, 480)))).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion.kind, LensKind::Rational);
    let tilted = YAML.replace("cols: 5", "cols: 14").replace("0.3 ]", "0.3, 0, 0, 0, 0, 0, 0, 0, 0.1, 0 ]");
    for (text, views, size, expected) in [
        (
            YAML.to_owned(),
            &["cam1"][..],
            None,
            "the image size of \"cam1\" (image_width, image_height) is missing",
        ),
        (YAML.to_owned(), &["a", "b"], Some((64, 48)), "the camera matrix of \"a\", such as M1 is missing"),
        (tilted, &["cam1"], Some((64, 48)), "coefficient 13 = 0.1"),
        (one.replace("1280", "12.5"), &["cam1"], None, "image_width: value 12.5 is not allowed"),
    ] {
        let error = rig_of_calibration(&read(&text).unwrap(), &names(views, size)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
}

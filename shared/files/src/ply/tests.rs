use super::*;
use bytemuck::Zeroable;

fn points(count: u32) -> Vec<Point> {
    let point = |i: u32| Point {
        position_mm: [f64::from(i) / 3.0, -f64::from(i) / 7.0, 100.0],
        normal: [0.6, 0.0, 0.8],
        sigma_mm: 0.01 / (i + 1) as f32,
        modulation: i as f32,
        pair: i % 2,
        ..Point::zeroed()
    };
    (0..count).map(point).collect()
}

fn read(bytes: &[u8]) -> Result<Cloud, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.ply");
    std::fs::write(&path, bytes).unwrap();
    read_cloud(&path).map_err(|error| error.to_string())
}

fn written(points: &[Point]) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.ply");
    write_cloud(&path, points, &[("rig_sha256", "ab"), ("recording", "a\nend_header")]).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn a_cloud_comes_back_bit_by_bit() {
    let points = points(2500);
    let bytes = written(&points);
    let cloud = read(&bytes).unwrap();
    assert_eq!(cloud.points, points);
    assert_eq!(cloud.columns, Columns { normal: true, sigma: true, modulation: true, pair: true });
    assert_eq!((cloud.comment("rig_sha256"), cloud.comment("recording")), (Some("ab"), Some("a end_header")));
    assert!(cloud.unit_hint().is_none());
    assert_eq!(read(&written(&[])).unwrap().points.len(), 0);
}

/// Proves: what points have in common is a column where any point has it, and none where there is nothing, beside other columns.
#[test]
fn what_points_have_in_common_comes_back_and_takes_no_place_without() {
    let mut points = points(1500);
    assert!(!written(&points).windows(12).any(|bytes| bytes == b"sigma_shared"));
    points[1200].shared_mm = 0.02;
    assert_eq!(read(&written(&points)).unwrap().points, points);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deviations.ply");
    let values: Vec<(f32, [u8; 3])> = (0..1500).map(|i| (i as f32, [1, 2, 3])).collect();
    write_deviations(&path, &points, &values, &[]).unwrap();
    assert_eq!(read_cloud(&path).unwrap().points, points);
    let negative = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        property float sigma_shared\nend_header\n1 2 3 -0.01\n";
    let error = read(negative.as_bytes()).unwrap_err();
    assert!(error.contains("sigma_shared"), "{error}");
}

#[test]
fn text_and_big_endian_and_unknown_elements_are_read() {
    let text = b"ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar int ids\nelement vertex 2\n\
        property float x\nproperty float y\nproperty uchar red\nproperty double z\nend_header\n\
        3 1 2 3\n1 2 255 1.25e-1\n4 -5 0 6\n";
    let cloud = read(text).unwrap();
    assert_eq!(cloud.points.len(), 2);
    assert_eq!(cloud.points[0].position_mm, [1.0, 2.0, 0.125]);
    assert_eq!((cloud.dropped, cloud.columns), (0, Columns::default()));
    let mut big =
        b"ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
        property float z\nend_header\n"
            .to_vec();
    for value in [0.001_f32, 0.002, 0.003, 0.004, 0.005, 0.006] {
        big.extend_from_slice(&value.to_be_bytes());
    }
    let cloud = read(&big).unwrap();
    assert_eq!(cloud.points[1].position_mm[2], f64::from(0.006_f32));
    assert!(cloud.unit_hint().unwrap().contains("metres"));
}

#[test]
fn another_unit_and_uncertainties_that_none_can_be_are_refused() {
    let text = |unit: &str, sigma: &str| {
        format!(
            "ply\nformat ascii 1.0\ncomment unit: {unit}\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
             property float sigma\nend_header\n1 2 3 0.01\n4 5 6 {sigma}\n"
        )
    };
    for unit in ["mm", "millimetres"] {
        assert_eq!(read(text(unit, "0").as_bytes()).unwrap().points.len(), 2);
    }
    for (unit, sigma, message) in
        [("inch", "0", "\"inch\""), ("mm", "-0.01", "1 of 2 points"), ("mm", "1e39", "1 of 2 points")]
    {
        let error = read(text(unit, sigma).as_bytes()).unwrap_err();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn points_that_are_no_numbers_are_left_out_and_counted() {
    let mut points = points(4);
    points[1].position_mm[2] = f64::NAN;
    points[3].position_mm[0] = f64::INFINITY;
    let cloud = read(&written(&points)).unwrap();
    assert_eq!((cloud.points, cloud.dropped), (vec![points[0], points[2]], 2));
}

#[test]
fn every_truncation_is_an_error() {
    let bytes = written(&points(3));
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length]).is_err(), "{length} of {} bytes", bytes.len());
    }
}

#[test]
fn more_than_the_header_counts_is_an_error() {
    let text = |body: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int v\nend_header\n1 2 3\n4 5 6\n{body}"
        )
    };
    assert_eq!(read(text("3 0 1 0\n").as_bytes()).unwrap().points.len(), 2);
    assert_eq!(read(text("3 0 1 0\n\n \r\n").as_bytes()).unwrap().points.len(), 2);
    let error = read(text("3 0 1 0\n7 8 9\n").as_bytes()).unwrap_err();
    assert!(error.contains("counts 2 \"vertex\", 1 \"face\"") && error.contains("6 bytes follow"), "{error}");
    assert!(read(text("").as_bytes()).is_err(), "a face is promised");
    let mut bytes = written(&points(3));
    let place = bytes.windows(8).position(|w| w == b"vertex 3").unwrap() + 7;
    bytes[place] = b'2';
    let error = read(&bytes).unwrap_err();
    assert!(error.contains("45 bytes follow"), "{error}");
}

#[test]
fn headers_that_lie_are_refused_before_memory_is_taken() {
    let head = |vertex: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\n{vertex}\nproperty double x\nproperty double y\n\
             property double z\nend_header\n"
        )
    };
    for vertex in [
        "element vertex 99999999999999999",
        "element nothing 9999999999999\nelement vertex 0",
        "element list 99999999999\nproperty list uchar int v\nelement vertex 0",
    ] {
        let error = read(head(vertex).as_bytes()).unwrap_err();
        assert!(error.contains("header and size disagree"), "{error}");
    }
    assert!(read(head("element vertex -1").as_bytes()).is_err());
    assert!(read(head("element vertex 18446744073709551616").as_bytes()).is_err());
}

#[test]
fn what_is_no_cloud_is_told_so() {
    for (bytes, expected) in [
        (&b""[..], "is no PLY file"),
        (b"solid part\n", "is no PLY file"),
        (b"ply\nformat ascii 1.0\nelement face 0\nproperty int a\nend_header\n", "element \"vertex\" is missing"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nend_header\n",
            "the property \"z\"",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
              end_header\n1 2 three\n",
            "is damaged or truncated",
        ),
    ] {
        let error = read(bytes).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

/// As PCL writes points that it does not have; and lines that do not fit the header.
#[test]
fn text_holds_points_that_are_nowhere_and_as_many_numbers_as_properties() {
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty double z\n\
                property uchar pair\nend_header\n";
    let cloud = read(format!("{head}1 2 3.25 1\n\nnan nan nan 0\n4 5 6e-1 1\n").as_bytes()).unwrap();
    assert_eq!((cloud.points.len(), cloud.dropped), (2, 1));
    assert_eq!((cloud.points[0].position_mm, cloud.points[1].pair), ([1.0, 2.0, 3.25], 1));
    for (body, expected) in [
        ("1 2 3 1\n4 5 6\n7 8 9 1\n", "the line of vertex 2 has 3 values"),
        ("1 2 3 1 7\n4 5 6 1\n7 8 9 1\n", "the line of vertex 1 has 5 values"),
        ("1 2 3 1\n4 5 6 300\n7 8 9 1\n", "\"300\" is no number of the property \"pair\""),
        ("1 2 3 1\n4 5 6 1\n", "ends after 2 of 3 vertices"),
        ("1 2 3 1\n4 5 6 1\n7 8 9 1\n1 1 1 1\n", "header and body"),
    ] {
        let error = read(format!("{head}{body}").as_bytes()).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_pair_beyond_a_byte_is_refused_and_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.ply");
    let point = Point { pair: 256, ..Point::zeroed() };
    assert!(write_cloud(&path, &[point], &[]).unwrap_err().to_string().contains("pair 256"));
    assert!(!path.exists());
}

//! Point clouds as PLY files.
//!
//! Written: binary little-endian, `x y z` as double, `nx ny nz sigma modulation` as float, `pair` as uchar, 45 bytes a
//! point, positions in mm in the world frame. Read: any PLY (text, both byte orders, float or double, elements and
//! properties in any order; those that nobody knows are skipped).

use crate::atomic;
use crate::error::{FileError, Problem};
use fringe::cloud::Point;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;

/// Bytes of one point as written.
const POINT_BYTES: usize = 45;

/// Their types and names, in order.
const PROPERTIES: &[(&str, &[&str])] = &[
    ("double", &["x", "y", "z"]),
    ("float", &["nx", "ny", "nz", "sigma", "modulation"]),
    ("uchar", &["pair"]),
];

/// Points that are put together before they are handed to the file: 45 KiB, within a processor's nearest cache.
const CHUNK_POINTS: usize = 1024;

/// A bounding box below this diagonal is more likely in metres than a part of that size in mm.
const METRES_BELOW_MM: f64 = 1.0;

/// A cloud as read.
#[derive(Debug, Clone, Default)]
pub struct Cloud {
    /// The points, in the order of the file. What the file does not carry (see `columns`) is zero.
    pub points: Vec<Point>,
    /// Which properties beyond the position the file carries.
    pub columns: Columns,
    /// Points whose position is NaN or infinite: counted here, left out of `points`.
    pub dropped: usize,
    /// Comment lines of the header.
    pub comments: Vec<String>,
}

/// Properties that a cloud may carry.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Columns {
    /// `nx ny nz`
    pub normal: bool,
    /// `sigma`
    pub sigma: bool,
    /// `modulation`
    pub modulation: bool,
    /// `pair`
    pub pair: bool,
}

impl Cloud {
    /// The value of a comment `key: value`.
    pub fn comment(&self, key: &str) -> Option<&str> {
        self.comments.iter().find_map(|line| line.strip_prefix(key)?.strip_prefix(": "))
    }

    /// Smallest and largest coordinates, mm; `None` for an empty cloud.
    pub fn bounds_mm(&self) -> Option<([f64; 3], [f64; 3])> {
        let first = self.points.first()?.position_mm;
        Some(self.points.iter().fold((first, first), |(low, high), point| {
            let fold = |a: [f64; 3], pick: fn(f64, f64) -> f64| {
                std::array::from_fn(|i| pick(a[i], point.position_mm[i]))
            };
            (fold(low, f64::min), fold(high, f64::max))
        }))
    }

    /// A sentence for a cloud whose extent suggests metres instead of mm.
    pub fn unit_hint(&self) -> Option<String> {
        let (low, high) = self.bounds_mm()?;
        let diagonal_mm = (0..3).map(|i| (high[i] - low[i]).powi(2)).sum::<f64>().sqrt();
        (self.points.len() > 1 && diagonal_mm < METRES_BELOW_MM).then(|| {
            format!(
                "the cloud's diagonal is {diagonal_mm:.4} mm: is the file in metres? lengths are read as mm"
            )
        })
    }
}

/// Writes a cloud, complete or not at all. Each comment becomes a line `comment key: value`.
///
/// # Errors
/// A pair number above 255, or a place that cannot be written.
pub fn write_cloud(path: &Path, points: &[Point], comments: &[(&str, &str)]) -> Result<(), FileError> {
    if let Some(point) = points.iter().find(|point| point.pair > 255) {
        let problem = Problem::Value {
            value: format!("pair {}", point.pair),
            limit: "a file holds pairs 0 … 255".into(),
        };
        return Err(FileError::new(path, problem, "write the pairs into several files"));
    }
    atomic::write_with(path, |out| {
        out.write_all(header_text(points.len(), comments).as_bytes())?;
        let mut buffer = Vec::with_capacity(CHUNK_POINTS * POINT_BYTES);
        for chunk in points.chunks(CHUNK_POINTS) {
            buffer.clear();
            for point in chunk {
                push(&mut buffer, point);
            }
            out.write_all(&buffer)?;
        }
        Ok(())
    })
}

fn header_text(count: usize, comments: &[(&str, &str)]) -> String {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\ncomment unit: mm\n");
    for (key, value) in comments {
        let line: String = format!("comment {key}: {value}")
            .chars()
            .map(|letter| if letter.is_control() { ' ' } else { letter })
            .collect();
        text.push_str(&line);
        text.push('\n');
    }
    let _ = writeln!(text, "element vertex {count}");
    for (kind, names) in PROPERTIES {
        for name in *names {
            let _ = writeln!(text, "property {kind} {name}");
        }
    }
    text.push_str("end_header\n");
    text
}

fn push(buffer: &mut Vec<u8>, point: &Point) {
    for value in point.position_mm {
        buffer.extend_from_slice(&value.to_le_bytes());
    }
    for value in point.normal.into_iter().chain([point.sigma_mm, point.modulation]) {
        buffer.extend_from_slice(&value.to_le_bytes());
    }
    // `write_cloud` has refused larger ones.
    buffer.push(point.pair as u8);
}

/// Reads a cloud.
///
/// # Errors
/// Not a PLY file, no `vertex` element with `x y z`, fewer bytes than its header promises, or a damaged body.
pub fn read_cloud(path: &Path) -> Result<Cloud, FileError> {
    let file = File::open(path).map_err(|source| FileError::io(path, "open it", source))?;
    let metadata = file.metadata().map_err(|source| FileError::io(path, "inspect it", source))?;
    if metadata.is_dir() {
        let problem = Problem::Unsupported("is a folder, not a file".into());
        return Err(FileError::new(path, problem, "name a PLY file"));
    }
    let mut reader = Reader::new(BufReader::with_capacity(1 << 20, file));
    let header = Parser::<Vertex>::new().read_header(&mut reader).map_err(|error| {
        let problem = Problem::Syntax(format!("is no PLY file: {error}"));
        FileError::new(path, problem, "name a point cloud in PLY format")
    })?;
    check_header(path, &header, metadata.len())?;
    read_body(path, &header, &mut reader)
}

fn read_body<T: BufRead>(path: &Path, header: &Header, reader: &mut Reader<T>) -> Result<Cloud, FileError> {
    let damaged = |error: io::Error| {
        let problem =
            Problem::Syntax(format!("is damaged or truncated: {}", error.to_string().replace('\n', " ")));
        FileError::new(path, problem, "write or copy it again")
    };
    for (name, element) in &header.elements {
        if name != "vertex" {
            Parser::<Skipped>::new()
                .read_payload_for_element(reader, element, header)
                .map_err(|error| damaged(io::Error::other(error.to_string())))?;
            continue;
        }
        let vertices = Parser::<Vertex>::new()
            .read_payload_for_element(reader, element, header)
            .map_err(|error| damaged(io::Error::other(error.to_string())))?;
        let total = vertices.len();
        let finite = |point: &Point| point.position_mm.iter().all(|v| v.is_finite());
        let points: Vec<Point> = vertices.into_iter().map(|vertex| vertex.0).filter(finite).collect();
        let has = |name: &str| element.properties.get(name).is_some();
        return Ok(Cloud {
            dropped: total - points.len(),
            points,
            columns: Columns {
                normal: ["nx", "ny", "nz"].into_iter().all(has),
                sigma: has("sigma"),
                modulation: has("modulation"),
                pair: has("pair"),
            },
            comments: header.comments.clone(),
        });
    }
    Err(FileError::new(path, Problem::Missing("the element \"vertex\"".into()), "is this a point cloud?"))
}

/// Refuses headers that promise what the file cannot hold, before anything is allocated for it.
fn check_header(path: &Path, header: &Header, file_bytes: u64) -> Result<(), FileError> {
    let Some(vertex) = header.elements.get("vertex") else {
        let problem = Problem::Missing("the element \"vertex\"".into());
        return Err(FileError::new(path, problem, "is this a point cloud?"));
    };
    for name in ["x", "y", "z"] {
        match vertex.properties.get(name).map(|property| &property.data_type) {
            Some(PropertyType::Scalar(ScalarType::Float | ScalarType::Double)) => {}
            None => {
                let problem = Problem::Missing(format!("the property \"{name}\" of \"vertex\""));
                return Err(FileError::new(path, problem, "a point has x, y and z in mm"));
            }
            Some(other) => {
                let problem = Problem::Unsupported(format!("property \"{name}\" has the type {other:?}"));
                return Err(FileError::new(path, problem, "write positions as float or double"));
            }
        }
    }
    for (name, element) in &header.elements {
        let needed = least_bytes(element, header.encoding).saturating_mul(element.count as u64);
        if needed > file_bytes || (element.properties.is_empty() && element.count > 0) {
            let problem = Problem::Disagreement {
                what: "header and size",
                here: format!("{} elements \"{name}\" need at least {needed} bytes", element.count),
                there: format!("the file has {file_bytes}"),
            };
            return Err(FileError::new(path, problem, "truncated? write or copy it again"));
        }
    }
    Ok(())
}

/// Bytes that one element takes at least.
fn least_bytes(element: &ElementDef, encoding: Encoding) -> u64 {
    let scalar = |kind: &ScalarType| match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let property = |kind: &PropertyType| match (encoding, kind) {
        // A digit and what separates it from the next one; the last line may lack its end.
        (Encoding::Ascii, _) => 1,
        (_, PropertyType::Scalar(kind) | PropertyType::List(kind, _)) => scalar(kind),
    };
    element.properties.iter().map(|(_, definition)| property(&definition.data_type)).sum()
}

/// A point on its way from the file.
#[derive(Debug)]
struct Vertex(Point);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(bytemuck::Zeroable::zeroed())
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let point = &mut self.0;
        match name {
            "x" => point.position_mm[0] = value,
            "y" => point.position_mm[1] = value,
            "z" => point.position_mm[2] = value,
            "nx" => point.normal[0] = value as f32,
            "ny" => point.normal[1] = value as f32,
            "nz" => point.normal[2] = value as f32,
            "sigma" => point.sigma_mm = value as f32,
            "modulation" => point.modulation = value as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set_double(name, f64::from(value))
    }

    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        self.set_uint(name, u32::from(value))
    }

    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.set_uint(name, u32::from(value))
    }

    fn set_uint(&mut self, name: &str, value: u32) -> PropertyAccessResult {
        if name != "pair" {
            return PropertyAccessResult::Ignored;
        }
        self.0.pair = value;
        PropertyAccessResult::Set
    }

    fn set_int(&mut self, name: &str, value: i32) -> PropertyAccessResult {
        u32::try_from(value).map_or(PropertyAccessResult::Ignored, |value| self.set_uint(name, value))
    }
}

/// An element that is read past.
#[derive(Debug)]
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

#[cfg(test)]
mod tests {
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
        assert_eq!(
            (cloud.comment("rig_sha256"), cloud.comment("recording")),
            (Some("ab"), Some("a end_header"))
        );
        assert!(cloud.unit_hint().is_none());
        assert_eq!(read(&written(&[])).unwrap().points.len(), 0);
    }

    #[test]
    fn text_and_big_endian_and_unknown_elements_are_read() {
        let text =
            b"ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar int ids\nelement vertex 2\n\
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

    #[test]
    fn a_pair_beyond_a_byte_is_refused_and_leaves_no_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("c.ply");
        let point = Point { pair: 256, ..Point::zeroed() };
        assert!(write_cloud(&path, &[point], &[]).unwrap_err().to_string().contains("pair 256"));
        assert!(!path.exists());
    }
}

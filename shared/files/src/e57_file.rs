//! Clouds as E57 files (ASTM E2807), which hold metres.

use crate::atomic;
use crate::document::open_input;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::memory;
use crate::ply::Cloud;
use bytemuck::Zeroable;
use e57::{CartesianCoordinate, E57Reader, E57Writer, Record, RecordDataType, RecordName, RecordValue};
use fringe::cloud::Point;
use std::fs::File;
use std::io::{BufReader, Cursor};
use std::os::unix::fs::FileExt as _;
use std::path::Path;

/// E57 files hold metres (ASTM E2807).
const MM_PER_METRE: f64 = 1000.0;

/// All clouds of the file in its common frame, in mm. Points without valid coordinates count as dropped.
///
/// # Errors
/// A file that is damaged, or that memory cannot hold.
pub fn read_cloud(path: &Path) -> Result<Cloud, FileError> {
    let fault = |error: e57::Error| {
        let problem =
            Problem::Syntax(format!("is no readable E57: {}", error.to_string().replace('\n', " ")));
        FileError::new(path, problem, "truncated? export or copy it again")
    };
    let (file, _) = open_input(path)?;
    check_e57_header(path, &file)?;
    let mut reader = E57Reader::new(BufReader::new(file)).map_err(fault)?;
    let mut cloud = Cloud::default();
    for scan in reader.pointclouds() {
        let bytes = scan.records.saturating_mul(2 * size_of::<Point>() as u64);
        memory::check(path, &format!("{} points", scan.records), bytes)?;
        for point in reader.pointcloud_simple(&scan).map_err(fault)? {
            match point.map_err(fault)?.cartesian {
                CartesianCoordinate::Valid { x, y, z } if [x, y, z].iter().all(|v| v.is_finite()) => {
                    let position_mm = [x, y, z].map(|v| v * MM_PER_METRE);
                    cloud.points.push(Point { position_mm, ..Point::zeroed() });
                }
                _ => cloud.dropped += 1,
            }
        }
    }
    Ok(cloud)
}

/// Refuses a header that promises more than the file has: the reader would make room for it. Bytes 24, 32 and 40: place and
/// length of the XML section, size of a page (ASTM E2807).
fn check_e57_header(path: &Path, file: &File) -> Result<(), FileError> {
    let bytes = file.metadata().map_err(|source| FileError::io(path, "inspect it", source))?.len();
    let mut header = [0; 48];
    // A shorter file is the reader's to refuse.
    if file.read_exact_at(&mut header, 0).is_err() {
        return Ok(());
    }
    let (words, _) = header.as_chunks::<8>();
    let [length, page] = [4, 5].map(|word| u64::from_le_bytes(words[word]));
    if length <= bytes && page <= bytes {
        return Ok(());
    }
    let problem = Problem::Disagreement {
        what: "header and size",
        here: format!("{length} bytes of XML in pages of {page}"),
        there: format!("the file has {bytes}"),
    };
    Err(FileError::new(path, problem, "truncated? export or copy it again"))
}

/// Writes a cloud, complete or not at all: a scan for each pair, with positions (double) and the modulation as intensity (single). The same
/// points give the same bytes; the identifiers are made of the content.
///
/// # Errors
/// A place that cannot be written.
pub fn write_cloud(path: &Path, points: &[Point]) -> Result<(), FileError> {
    let bytes = bytes_of(points).map_err(|error| {
        let problem = Problem::Unsupported(format!("cannot be written as E57: {error}"));
        FileError::new(path, problem, "write a PLY file instead")
    })?;
    atomic::write(path, &bytes)
}

fn bytes_of(points: &[Point]) -> e57::Result<Vec<u8>> {
    let hash = sha256_hex(bytemuck::cast_slice(points));
    let guid = |number: u64| {
        let h = &hash[..24];
        format!("{{{}-{}-{}-{}-{}{number:08x}}}", &h[..8], &h[8..12], &h[12..16], &h[16..20], &h[20..24])
    };
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, &guid(0))?;
    let mut pairs: Vec<u32> = points.iter().map(|point| point.pair).collect();
    pairs.sort_unstable();
    pairs.dedup();
    for pair in pairs {
        let number = u64::from(pair) + 1;
        let mut scan = writer.add_pointcloud(&guid(number), columns())?;
        scan.set_name(Some(format!("pair {number}")));
        for point in points.iter().filter(|point| point.pair == pair) {
            let mut values: Vec<RecordValue> =
                point.position_mm.iter().map(|mm| RecordValue::Double(mm / MM_PER_METRE)).collect();
            values.push(RecordValue::Single(point.modulation));
            scan.add_point(values)?;
        }
        scan.finalize()?;
    }
    writer.finalize()?;
    drop(writer);
    Ok(bytes.into_inner())
}

fn columns() -> Vec<Record> {
    let position = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]
        .map(|name| Record { name, data_type: RecordDataType::Double { min: None, max: None } });
    let modulation =
        Record { name: RecordName::Intensity, data_type: RecordDataType::Single { min: None, max: None } };
    position.into_iter().chain([modulation]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface_file::{Surface, read};
    use tempfile::TempDir;

    #[test]
    fn a_cloud_comes_back_pair_by_pair_and_the_same_bytes_are_written() {
        let folder = TempDir::new().unwrap();
        let [path, again] = ["a.e57", "b.e57"].map(|name| folder.path().join(name));
        let point = |x: f64, pair: u32| Point {
            position_mm: [x, -2.5, 1e3],
            modulation: 17.0,
            pair,
            ..Point::zeroed()
        };
        let points = [point(0.125, 1), point(2.0, 0), point(3.0, 1)];
        assert!(bytes_of(&[point(0.0, u32::MAX)]).is_ok());
        write_cloud(&path, &points).unwrap();
        write_cloud(&again, &points).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&again).unwrap());
        let back = read_cloud(&path).unwrap();
        let x: Vec<f64> = back.points.iter().map(|p| p.position_mm[0]).collect();
        assert_eq!(x, [2.0, 0.125, 3.0]);
        let reader = e57::E57Reader::from_file(&path).unwrap();
        let names: Vec<_> = reader.pointclouds().into_iter().map(|scan| scan.name.unwrap()).collect();
        assert_eq!(names, ["pair 1", "pair 2"]);
    }

    #[test]
    fn e57_is_in_metres() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("a.e57");
        let mut writer = e57::E57Writer::from_file(&path, "file").unwrap();
        let record = e57::RecordDataType::Double { min: None, max: None };
        let prototype =
            [e57::RecordName::CartesianX, e57::RecordName::CartesianY, e57::RecordName::CartesianZ]
                .map(|name| e57::Record { name, data_type: record.clone() });
        let mut cloud = writer.add_pointcloud("cloud", prototype.to_vec()).unwrap();
        cloud.add_point([0.001, -0.25, 2.0].map(e57::RecordValue::Double).to_vec()).unwrap();
        cloud.finalize().unwrap();
        writer.finalize().unwrap();
        match read(&path).unwrap() {
            Surface::Cloud(cloud) => assert_eq!(cloud.points[0].position_mm, [1.0, -250.0, 2000.0]),
            Surface::Mesh(_) => panic!("a cloud"),
        }
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(read(&path).is_err());
    }
}

//! Clouds as E57 files (ASTM E2807), which hold metres.

use crate::atomic;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
use fringe::cloud::Point;
use std::io::Cursor;
use std::path::Path;

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
    let guid = |number: u32| {
        let h = &hash[..24];
        format!("{{{}-{}-{}-{}-{}{number:08x}}}", &h[..8], &h[8..12], &h[12..16], &h[16..20], &h[20..24])
    };
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, &guid(0))?;
    let mut pairs: Vec<u32> = points.iter().map(|point| point.pair).collect();
    pairs.sort_unstable();
    pairs.dedup();
    for pair in pairs {
        let mut scan = writer.add_pointcloud(&guid(pair + 1), columns())?;
        scan.set_name(Some(format!("pair {}", pair + 1)));
        for point in points.iter().filter(|point| point.pair == pair) {
            let mut values: Vec<RecordValue> =
                point.position_mm.iter().map(|mm| RecordValue::Double(mm / 1000.0)).collect();
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
    use crate::surface_file::read_cloud;
    use bytemuck::Zeroable;

    #[test]
    fn a_cloud_comes_back_pair_by_pair_and_the_same_bytes_are_written() {
        let folder = tempfile::TempDir::new().unwrap();
        let [path, again] = ["a.e57", "b.e57"].map(|name| folder.path().join(name));
        let point = |x: f64, pair: u32| Point {
            position_mm: [x, -2.5, 1e3],
            modulation: 17.0,
            pair,
            ..Point::zeroed()
        };
        let points = [point(0.125, 1), point(2.0, 0), point(3.0, 1)];
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
}

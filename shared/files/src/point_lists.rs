//! Image points of a target that another program found, `fringecell-points/1`: lists of numbers, one row a point.
//!
//! `target` has a row x y \[z\] (mm) for each point; the list of a device has a row u v (px) for each point of the target in each
//! pose, pose after pose, in the order of the target. A point that is outside of the image or no number was not seen.

use crate::document::{Document, read_text};
use crate::error::{FileError, Problem};
use crate::name::{check_name, duplicate};
use characterise::calibration::{Device, DeviceKind, ImagePoint, Observations, View};
use nalgebra::{Matrix2, Point2, Point3};
use serde::Deserialize;
use std::path::Path;

/// Value of `format` in a file of point lists.
pub const POINTS_FORMAT: &str = "fringecell-points/1";

/// Standard uncertainty of a coordinate where none is stated, px: the calibration estimates it from its residuals.
const USUAL_SIGMA_PX: f64 = 0.1;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPoints {
    #[serde(rename = "format")]
    _format: String,
    target: String,
    #[serde(default)]
    device: Vec<RawDevice>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawDevice {
    name: String,
    #[serde(default)]
    kind: RawKind,
    width_px: u32,
    height_px: u32,
    points: String,
    sigma_px: Option<f64>,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum RawKind {
    #[default]
    Camera,
    Projector,
}

/// Reads the lists as observations; files are relative to the one that names them.
///
/// # Errors
/// Files that cannot be read, rows that are no points, lists that do not have all points of each pose, devices with other numbers of
/// poses, and what [`Observations::check`] refuses.
pub fn read_point_lists(path: &Path) -> Result<Observations, FileError> {
    let document = Document::read(path)?;
    let raw: RawPoints = document.parse(POINTS_FORMAT)?;
    if let Some((index, name)) = duplicate(raw.device.iter().map(|d| d.name.as_str())) {
        let problem = Problem::Duplicate { kind: "device", name: name.to_owned() };
        return Err(document.fault(&format!("device[{index}].name"), problem, "rename one of them"));
    }
    let beside = |file: &str| path.parent().unwrap_or(Path::new("")).join(file);
    let target_mm = target(&beside(&raw.target))?;
    let (mut devices, mut views, mut poses) = (Vec::new(), Vec::new(), None);
    for (number, device) in raw.device.iter().enumerate() {
        let key = |part: &str| format!("device[{number}].{part}");
        check_name(&device.name).map_err(|problem| document.fault(&key("name"), problem, ""))?;
        let sigma_px = device.sigma_px.unwrap_or(USUAL_SIGMA_PX);
        if !(1e-6..=1e3).contains(&sigma_px) {
            let problem = Problem::Value { value: sigma_px.to_string(), limit: "1e-6 … 1000 px".into() };
            return Err(document.fault(&key("sigma_px"), problem, ""));
        }
        let file = beside(&device.points);
        let rows = rows(&file, &[2])?;
        if rows.is_empty() || !rows.len().is_multiple_of(target_mm.len()) {
            let problem = Problem::Disagreement {
                what: "points and target",
                here: format!("{} rows", rows.len()),
                there: format!("the target has {} points", target_mm.len()),
            };
            let remedy =
                "write a row for each point in each pose; of a point that was not seen nan nan or -1 -1";
            return Err(FileError::new(&file, problem, remedy));
        }
        let count = rows.len() / target_mm.len();
        if *poses.get_or_insert(count) != count {
            let problem = Problem::Disagreement {
                what: "numbers of poses",
                here: format!("\"{}\" has {count}", device.name),
                there: format!("\"{}\" has {}", raw.device[0].name, poses.unwrap_or(0)),
            };
            let remedy = "of a pose that a device does not see, write each point as nan nan";
            return Err(document.fault(&key("points"), problem, remedy));
        }
        views.extend(views_of(device, number, sigma_px, &rows, target_mm.len()));
        let kind = match device.kind {
            RawKind::Camera => DeviceKind::Camera,
            RawKind::Projector => DeviceKind::Projector,
        };
        let (width_px, height_px) = (device.width_px, device.height_px);
        devices.push(Device { name: device.name.clone(), kind, width_px, height_px });
    }
    let poses = (0..poses.unwrap_or(0)).map(|pose| format!("pose{}", pose + 1)).collect();
    Ok(Observations { devices, target_mm, faces: Vec::new(), poses, views })
}

fn views_of(device: &RawDevice, number: usize, sigma_px: f64, rows: &[Vec<f64>], count: usize) -> Vec<View> {
    let far = |length: u32| f64::from(length) - 0.5;
    let seen = |row: &[f64]| {
        (-0.5..=far(device.width_px)).contains(&row[0]) && (-0.5..=far(device.height_px)).contains(&row[1])
    };
    let point = |(index, row): (usize, &Vec<f64>)| ImagePoint {
        index,
        pixel: Point2::new(row[0], row[1]),
        covariance_px2: Matrix2::identity() * (sigma_px * sigma_px),
        link: None,
    };
    let view = |(pose, rows): (usize, &[Vec<f64>])| {
        let image_points: Vec<ImagePoint> =
            rows.iter().enumerate().filter(|(_, row)| seen(row)).map(point).collect();
        (!image_points.is_empty()).then_some(View {
            device: number,
            pose,
            image_points,
            may_be_turned: false,
        })
    };
    rows.chunks(count).enumerate().filter_map(view).collect()
}

/// The points of the target, mm.
fn target(path: &Path) -> Result<Vec<Point3<f64>>, FileError> {
    let rows = rows(path, &[2, 3])?;
    if rows.is_empty() {
        let problem = Problem::Missing("a point of the target".into());
        return Err(FileError::new(path, problem, "write a row x y z (mm) for each point"));
    }
    Ok(rows.iter().map(|row| Point3::new(row[0], row[1], row.get(2).copied().unwrap_or(0.0))).collect())
}

/// The rows of a list: numbers between blanks, commas or semicolons; `#` begins a remark.
fn rows(path: &Path, lengths: &[usize]) -> Result<Vec<Vec<f64>>, FileError> {
    let text = read_text(path)?;
    let mut rows = Vec::new();
    for (line, text) in text.lines().enumerate() {
        let content = text.split('#').next().unwrap_or("");
        let words = content.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty());
        let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
        match numbers {
            Ok(numbers) if numbers.is_empty() => {}
            Ok(numbers) if lengths.contains(&numbers.len()) => rows.push(numbers),
            _ => {
                let limit =
                    if lengths.len() == 1 { "two numbers u v, px" } else { "two or three numbers x y z, mm" };
                let problem =
                    Problem::Value { value: format!("\"{}\"", content.trim()), limit: limit.into() };
                let mut fault = FileError::new(path, problem, "one row for each point");
                fault.line = Some(line + 1);
                return Err(fault);
            }
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "format = \"fringecell-points/1\"\ntarget = \"board.txt\"\n[[device]]\nname = \"cam1\"\nwidth_px = 640\n\
        height_px = 480\npoints = \"cam1.txt\"\n";

    fn read(file: &str, board: &str, list: &str) -> Result<Observations, String> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("points.toml", file), ("board.txt", board), ("cam1.txt", list)] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        read_point_lists(&folder.path().join("points.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn points_that_were_not_seen_are_left_out_and_poses_counted() {
        let read =
            read(FILE, "# x y z\n0 0 0\n10,0,0\n0;10\n", "1 2\n-1 -1\n3 4\n\nnan nan\n5 6\n700 3\n").unwrap();
        assert_eq!(read.target_mm[2], Point3::new(0.0, 10.0, 0.0));
        assert_eq!(read.poses.len(), 2);
        let indices: Vec<Vec<usize>> =
            read.views.iter().map(|v| v.image_points.iter().map(|p| p.index).collect()).collect();
        assert_eq!(indices, [vec![0, 2], vec![1]]);
    }

    #[test]
    fn lists_that_do_not_fit_are_named() {
        let board = "0 0\n10 0\n0 10\n";
        let all = "1 2\n3 4\n5 6\n";
        for (file, board, list, words) in [
            (FILE.to_owned(), board, "1 2\n3 4\n", ["cam1.txt", "3 points"]),
            (FILE.to_owned(), board, "1 2 3\n", ["cam1.txt", "two numbers"]),
            (FILE.to_owned(), "a b\n", all, ["board.txt", "three numbers"]),
            (FILE.to_owned(), "\n", all, ["board.txt", "row x y z"]),
            (FILE.replace("cam1.txt\"", "cam1.txt\"\nsigma_px = 0.0"), board, all, ["sigma_px", "1e-6"]),
            (FILE.replace("cam1.txt", "absent.txt"), board, all, ["absent.txt", "open it"]),
        ] {
            let error = read(&file, board, list).unwrap_err();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        }
    }
}

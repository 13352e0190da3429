//! Clouds as they are written.

use crate::atomic;
use crate::error::{FileError, Problem};
use fringe::cloud::Point;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Bytes of one point as written.
const POINT_BYTES: usize = 45;

/// Their types and names, in order.
const PROPERTIES: Columned<'_> = &[
    ("double", &["x", "y", "z"]),
    ("float", &["nx", "ny", "nz", "sigma", "modulation"]),
    ("uchar", &["pair"]),
];

/// What the points' uncertainties have in common, where any has something.
const SHARED: Columned<'_> = &[("float", &["sigma_shared"])];

/// Columns of a comparison.
const DEVIATION: Columned<'_> = &[("float", &["deviation"]), ("uchar", &["red", "green", "blue"])];

/// Types and names of properties.
type Columned<'a> = &'a [(&'static str, &'static [&'static str])];

/// Points that are put together before they are handed to the file: 45 KiB, within a processor's nearest cache.
const CHUNK_POINTS: usize = 1024;

/// Writes a cloud, complete or not at all. Each comment becomes a line `comment key: value`.
///
/// # Errors
/// A pair number above 255, or a place that cannot be written.
pub fn write_cloud(path: &Path, points: &[Point], comments: &[(&str, &str)]) -> Result<(), FileError> {
    write_points(path, points, comments, &[], |_, _| {})
}

/// As [`write_cloud`], with the columns `deviation` (float, mm; NaN for a point without one) and `red green blue` (uchar).
///
/// # Errors
/// As [`write_cloud`], and fewer values than points.
pub fn write_deviations(
    path: &Path,
    points: &[Point],
    values: &[(f32, [u8; 3])],
    comments: &[(&str, &str)],
) -> Result<(), FileError> {
    if values.len() != points.len() {
        let problem = Problem::Disagreement {
            what: "points and deviations",
            here: format!("{} points", points.len()),
            there: format!("{} deviations", values.len()),
        };
        return Err(FileError::new(path, problem, ""));
    }
    write_points(path, points, comments, DEVIATION, |buffer, index| {
        if let Some((deviation_mm, colour)) = values.get(index) {
            buffer.extend_from_slice(&deviation_mm.to_le_bytes());
            buffer.extend_from_slice(colour);
        }
    })
}

/// Writes points with further columns, which `more` appends for each point.
fn write_points(
    path: &Path,
    points: &[Point],
    comments: &[(&str, &str)],
    further: Columned<'_>,
    more: impl Fn(&mut Vec<u8>, usize),
) -> Result<(), FileError> {
    if let Some(point) = points.iter().find(|point| point.pair > 255) {
        let problem = Problem::Value {
            value: format!("pair {}", point.pair),
            limit: "a file holds pairs 0 … 255".into(),
        };
        return Err(FileError::new(path, problem, "write the pairs into several files"));
    }
    let shared = points.iter().any(|point| point.shared_mm != 0.0);
    let further = [if shared { SHARED } else { &[] }, further].concat();
    atomic::write_with(path, |out| {
        out.write_all(header_text(points.len(), comments, &further).as_bytes())?;
        let mut buffer = Vec::with_capacity(CHUNK_POINTS * POINT_BYTES);
        for (part, chunk) in points.chunks(CHUNK_POINTS).enumerate() {
            buffer.clear();
            for (place, point) in chunk.iter().enumerate() {
                push(&mut buffer, point);
                if shared {
                    buffer.extend_from_slice(&point.shared_mm.to_le_bytes());
                }
                more(&mut buffer, part * CHUNK_POINTS + place);
            }
            out.write_all(&buffer)?;
        }
        Ok(())
    })
}

/// A comment as a line of the header; what would end the line becomes a blank.
pub(crate) fn comment_line((key, value): &(&str, &str)) -> String {
    format!("comment {key}: {value}").replace(char::is_control, " ") + "\n"
}

fn header_text(count: usize, comments: &[(&str, &str)], further: Columned<'_>) -> String {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\ncomment unit: mm\n");
    for comment in comments {
        text.push_str(&comment_line(comment));
    }
    let _ = writeln!(text, "element vertex {count}");
    for (kind, names) in PROPERTIES.iter().chain(further) {
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
    // `write_points` has refused larger ones.
    buffer.push(point.pair as u8);
}

//! What a calibration target is: kind, numbers, pitch.

use super::error::TargetError;
use super::markers::MarkerDictionary;
use nalgebra::{Point3, Translation3};
use serde::{Deserialize, Serialize};

/// Value of the optional key `format` of a target file.
pub const TARGET_FORMAT: &str = "fringecell-target/1";

/// Most columns or rows that a target may have: with 500 points a side the squares are too small in any image.
const MAX_SIDE: u32 = 500;

/// What is printed on the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TargetKind {
    /// Black and white squares; the points are the inner corners.
    Checkerboard,
    /// Circles on a square lattice; the points are the centres.
    Circles,
    /// Circles of which every second row is shifted by half the distance of columns; the points are the centres.
    AsymmetricCircles,
    /// A checkerboard with coded markers in its light squares, which identify a visible part of it; the points are the
    /// inner corners.
    Charuco,
    /// Tags in rows and columns with small dark squares between their corners; the points are the corners of the tags.
    Aprilgrid,
}

impl TargetKind {
    /// What its points are called.
    pub(crate) fn points(self) -> &'static str {
        match self {
            Self::Checkerboard | Self::Charuco => "inner corners",
            Self::Circles | Self::AsymmetricCircles => "circles",
            Self::Aprilgrid => "corners of tags",
        }
    }
}

/// A calibration target as declared in `target.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetSpec {
    /// `fringecell-target/1`; may be absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// What is printed on it.
    pub kind: TargetKind,
    /// Points along a row: inner corners, circle centres, or corners of tags (two for each tag).
    pub columns: u32,
    /// Points along a column.
    pub rows: u32,
    /// Distance of neighbouring points, mm. Of an asymmetric grid: the distance of neighbouring rows, which is half
    /// the distance of the circles of one row (OpenCV's convention). Of an AprilGrid: from one tag to the next.
    pub pitch_mm: f64,
    /// Diameter of the circles, mm: optional, only for grids of circles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diameter_mm: Option<f64>,
    /// The markers of a ChArUco board, numbered as OpenCV does: row by row through the light squares, the square before point
    /// (0, 0) dark; or the tags of an AprilGrid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dictionary: Option<MarkerDictionary>,
    /// Side of the markers with their dark rim, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marker_mm: Option<f64>,
    /// Number of the first marker of a ChArUco board or AprilGrid in the dictionary; absent: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_marker: Option<u32>,
}

/// The markers of a ChArUco board.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Marking {
    pub dictionary: MarkerDictionary,
    /// Side of a marker over that of a square.
    pub size: f64,
}

impl TargetSpec {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the key, its value and its limits.
    pub fn check(&self) -> Result<(), TargetError> {
        if let Some(format) = self.format.as_deref().filter(|f| *f != TARGET_FORMAT) {
            return Err(TargetError::Format(format.to_owned()));
        }
        // Three points a side: with two, a row has no neighbour that could contradict a wrong one.
        let least = if self.kind == TargetKind::AsymmetricCircles { 2 } else { 3 };
        in_range("columns", f64::from(self.columns), f64::from(least), f64::from(MAX_SIDE))?;
        in_range("rows", f64::from(self.rows), 3.0, f64::from(MAX_SIDE))?;
        in_range("pitch_mm", self.pitch_mm, 1e-3, 1e5)?;
        self.check_markers()?;
        let Some(diameter_mm) = self.diameter_mm else { return Ok(()) };
        // Circles of one row of an asymmetric grid are two pitches apart, its nearest ones √2.
        let widest = match self.kind {
            TargetKind::Circles => 1.0,
            TargetKind::AsymmetricCircles => std::f64::consts::SQRT_2,
            TargetKind::Checkerboard | TargetKind::Charuco | TargetKind::Aprilgrid => {
                return Err(TargetError::DiameterOfSquares);
            }
        };
        in_range("diameter_mm", diameter_mm, 1e-3 * self.pitch_mm, widest * self.pitch_mm)
    }

    /// Markers where there are to be some, and nowhere else.
    fn check_markers(&self) -> Result<(), TargetError> {
        if !matches!(self.kind, TargetKind::Charuco | TargetKind::Aprilgrid) {
            return if self.dictionary.is_some() || self.marker_mm.is_some() || self.first_marker.is_some() {
                Err(TargetError::MarkersElsewhere)
            } else {
                Ok(())
            };
        }
        let (Some(dictionary), Some(marker_mm)) = (self.dictionary, self.marker_mm) else {
            return Err(TargetError::NoMarkers);
        };
        // Half of a square, so that cells can be resolved; a margin, so that the corners of the squares can.
        in_range("marker_mm", marker_mm, 0.4 * self.pitch_mm, 0.9 * self.pitch_mm)?;
        let (columns, rows) = (u64::from(self.columns), u64::from(self.rows));
        let there = dictionary.codes().len();
        if self.kind == TargetKind::Aprilgrid && (!columns.is_multiple_of(2) || !rows.is_multiple_of(2)) {
            return Err(TargetError::OddTags { columns: self.columns, rows: self.rows });
        }
        let needed = self.marker_numbers().end as u64;
        if needed > there as u64 { Err(TargetError::FewMarkers { needed, there }) } else { Ok(()) }
    }

    /// Numbers of the markers that it carries; none without markers.
    pub(crate) fn marker_numbers(&self) -> std::ops::Range<usize> {
        let (columns, rows) = (self.columns as usize, self.rows as usize);
        let count = match self.kind {
            TargetKind::Charuco => (columns + 1) * (rows + 1) / 2,
            TargetKind::Aprilgrid => columns * rows / 4,
            TargetKind::Checkerboard | TargetKind::Circles | TargetKind::AsymmetricCircles => 0,
        };
        let first = self.first_marker.unwrap_or(0) as usize;
        first..first + count
    }

    /// The markers of a ChArUco board.
    pub(crate) fn marking(&self) -> Option<Marking> {
        let (dictionary, marker_mm) = self.dictionary.zip(self.marker_mm)?;
        Some(Marking { dictionary, size: marker_mm / self.pitch_mm })
    }

    /// Number of points of the target.
    pub fn count(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Position of a point on the board, in units of the pitch (integers).
    pub(crate) fn lattice_of(&self, column: i64, row: i64) -> (i64, i64) {
        match self.kind {
            TargetKind::AsymmetricCircles => (2 * column + row.rem_euclid(2), row),
            _ => (column, row),
        }
    }

    /// Position of a point in the board's frame, mm: z = 0, x along the rows, y along the columns, (0, 0) at the origin.
    pub fn board_point_mm(&self, index: (u32, u32)) -> Point3<f64> {
        if let (TargetKind::Aprilgrid, Some(tag_mm)) = (self.kind, self.marker_mm) {
            let along = |i: u32| f64::from(i / 2) * self.pitch_mm + f64::from(i % 2) * tag_mm;
            return Point3::new(along(index.0), along(index.1), 0.0);
        }
        let (x, y) = self.lattice_of(i64::from(index.0), i64::from(index.1));
        Point3::new(x as f64 * self.pitch_mm, y as f64 * self.pitch_mm, 0.0)
    }

    /// The middle of all points in the board's frame, board_from_middle.
    pub fn middle_mm(&self) -> Translation3<f64> {
        let points = self.board_points_mm();
        let bound = |pick: fn(f64, f64) -> f64| {
            let first = points.first().map_or(Point3::origin(), |(_, point)| *point).coords;
            points.iter().fold(first, |bound, (_, point)| bound.zip_map(&point.coords, pick))
        };
        Translation3::from((bound(f64::min) + bound(f64::max)) * 0.5)
    }

    /// All points, row by row: index (column, row) and position in mm.
    pub fn board_points_mm(&self) -> Vec<((u32, u32), Point3<f64>)> {
        let indices = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        indices.map(|index| (index, self.board_point_mm(index))).collect()
    }
}

fn in_range(key: &'static str, value: f64, least: f64, most: f64) -> Result<(), TargetError> {
    // A NaN lies in no range.
    if (least..=most).contains(&value) { Ok(()) } else { Err(TargetError::Key { key, value, least, most }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl TargetSpec {
        /// As the reader of files does it; a text that is no target has its own message there.
        pub(crate) fn parse(text: &str) -> Result<Self, TargetError> {
            let spec: Self = toml::from_str(text).expect("TOML");
            spec.check().map(|()| spec)
        }
    }

    const TEXT: &str = "kind = \"asymmetric-circles\"\ncolumns = 4\nrows = 11\npitch_mm = 20.0\n";

    #[test]
    fn the_four_keys_of_the_contract_suffice_and_the_others_are_named() {
        let spec = TargetSpec::parse(TEXT).expect("valid");
        assert_eq!(spec.board_point_mm((3, 1)), Point3::new(140.0, 20.0, 0.0));
        assert!(TargetSpec::parse(&format!("{TEXT}format = \"{TARGET_FORMAT}\"")).is_ok());
    }

    #[test]
    fn impossible_numbers_are_named_with_their_limits() {
        for (from, to, key) in [
            ("columns = 4", "columns = 1", "columns"),
            ("rows = 11", "rows = 501", "rows"),
            ("pitch_mm = 20.0", "pitch_mm = nan", "pitch_mm"),
            ("pitch_mm = 20.0", "pitch_mm = 20.0\ndiameter_mm = 40.0", "diameter_mm"),
        ] {
            let error = TargetSpec::parse(&TEXT.replace(from, to)).expect_err(to);
            assert!(error.to_string().contains(key), "{error}");
        }
        let squares = TEXT.replace("asymmetric-circles", "checkerboard") + "diameter_mm = 3.0";
        assert_eq!(TargetSpec::parse(&squares), Err(TargetError::DiameterOfSquares));
    }
}

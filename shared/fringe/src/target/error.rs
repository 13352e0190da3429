//! Why a target cannot be read or found.

use thiserror::Error;

/// A refusal: no points are better than wrong ones.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TargetError {
    /// The text is not a target.
    #[error("target file: {0}")]
    Text(String),
    /// Another format.
    #[error("target key format = \"{0}\": must be \"fringecell-target/1\", or left out")]
    Format(String),
    /// A number of the target or of the settings is out of its range.
    #[error("target key {key} = {value}: must be {least} to {most}")]
    Key {
        /// The key.
        key: &'static str,
        /// As written.
        value: f64,
        /// Least.
        least: f64,
        /// Most.
        most: f64,
    },
    /// Squares have no diameter.
    #[error("target key diameter_mm: only circles and asymmetric-circles have one; leave it out")]
    DiameterOfSquares,
    /// A kind that is declared but not detected.
    #[error("target kind \"{0}\" is not supported yet; use checkerboard, circles or asymmetric-circles")]
    Unsupported(&'static str),
    /// The raster is too small, too large, or has another number of values than its size says.
    #[error(
        "image of {width_px} x {height_px} px with {values} values: it needs width x height values, 16 to 65535 a side, \
         at most {} in all",
        super::raster::MAX_PIXELS
    )]
    Size {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
        /// Values given.
        values: usize,
    },
    /// Nothing that looks like the target.
    #[error(
        "no {what} found ({candidates} single candidates): is the target in the image, in focus, lit and not saturated?"
    )]
    NoTarget {
        /// `checkerboard` or `grid of circles`.
        what: &'static str,
        /// Points that look like a corner or circle, without belonging to a grid.
        candidates: usize,
    },
    /// A grid of another size.
    #[error(
        "declared {columns} x {rows} points, found {}: is the target another one, partly hidden, or are columns and rows \
         counted as squares? (inner corners are one fewer)",
        sizes(found)
    )]
    OtherSize {
        /// Declared columns.
        columns: u32,
        /// Declared rows.
        rows: u32,
        /// Extent of the grids found, the largest first.
        found: Vec<(u32, u32)>,
    },
    /// The extent is right, but too many points are hidden.
    #[error("{found} of {count} points are visible; the settings need {needed}")]
    Hidden {
        /// Points found.
        found: usize,
        /// Points of the target.
        count: usize,
        /// Points needed.
        needed: usize,
    },
    /// More than one such target.
    #[error(
        "{count} targets of {columns} x {rows} points in one image: which one is meant? cover the others"
    )]
    Several {
        /// How many.
        count: usize,
        /// Declared columns.
        columns: u32,
        /// Declared rows.
        rows: u32,
    },
}

fn sizes(found: &[(u32, u32)]) -> String {
    let texts: Vec<String> =
        found.iter().take(4).map(|(columns, rows)| format!("{columns} x {rows}")).collect();
    texts.join(", ")
}

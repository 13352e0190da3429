//! Why a target cannot be read or found.

use thiserror::Error;

/// Most pixels of an image: four working rasters of f32 then take 3.2 GB at most.
pub(crate) const MAX_PIXELS: usize = 200_000_000;

/// A refusal: no points are better than wrong ones.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TargetError {
    /// The file has another format.
    #[error("format = \"{0}\": must be \"fringecell-target/1\", or left out")]
    Format(String),
    /// A number of the target or of the settings is out of its range.
    #[error("{key} = {value}: must be {least} to {most}")]
    Key {
        /// Key of the target file.
        key: &'static str,
        /// Value in the target file.
        value: f64,
        /// Smallest value that is allowed.
        least: f64,
        /// Largest value that is allowed.
        most: f64,
    },
    /// Squares have no diameter.
    #[error("diameter_mm: only circles and asymmetric-circles have one; leave it out")]
    DiameterOfSquares,
    /// A ChArUco board without its markers.
    #[error(
        "dictionary, marker_mm: a charuco or aprilgrid target needs both; dictionary is named as in OpenCV, such as \"DICT_4X4_50\""
    )]
    NoMarkers,
    /// Markers on something else.
    #[error("dictionary, marker_mm: only a charuco or aprilgrid target has markers; leave them out")]
    MarkersElsewhere,
    /// An AprilGrid has two corners of each tag in a row.
    #[error(
        "columns = {columns}, rows = {rows}: an aprilgrid has two points for each tag along a row and a column, so both are even"
    )]
    OddTags {
        /// Columns of the target file.
        columns: u32,
        /// Rows of the target file.
        rows: u32,
    },
    /// More squares than markers.
    #[error("dictionary: it has {there} markers, columns and rows need {needed}; give the printed one")]
    FewMarkers {
        /// Number of light squares that need a marker.
        needed: u64,
        /// Number of markers of the dictionary.
        there: usize,
    },
    /// Squares, but no markers that agree.
    #[error(
        "a checkerboard of {corners} inner corners is seen, but no two markers agree on its place ({read} read): do kind, \
         dictionary and marker_mm in target.toml fit the print?"
    )]
    Unmarked {
        /// Corners of the largest board.
        corners: usize,
        /// Number of markers that were read.
        read: usize,
    },
    /// A face without a name of its own.
    #[error("name = \"{name}\": each face needs a name of its own")]
    FaceName {
        /// The name, which is empty or another face's.
        name: String,
    },
    /// A face that cannot be told from its image.
    #[error(
        "face \"{name}\" of {columns} x {rows} points looks the same after half a turn; print a checkerboard of which columns and rows \
         add up to an odd number, or a charuco or aprilgrid"
    )]
    FaceTurns {
        /// Name of the face.
        name: String,
        /// Points along a row.
        columns: u32,
        /// Points along a column.
        rows: u32,
    },
    /// Two faces that look alike.
    #[error(
        "faces \"{}\" and \"{}\" look alike: give them markers with other numbers (first_marker), or other columns and rows",
        names[0], names[1]
    )]
    FacesAlike {
        /// Names of both faces.
        names: [String; 2],
    },
    /// The raster is too small, too large, or has another number of values than its size requires.
    #[error(
        "image of {width_px} x {height_px} px with {values} values: it needs width x height values, 16 to 65535 a side, \
         at most {} in all",
        MAX_PIXELS
    )]
    Size {
        /// Columns of the image, px.
        width_px: u32,
        /// Rows of the image, px.
        height_px: u32,
        /// Number of values given.
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
        "found {} {points}, target.toml declares {columns} x {rows}: is the target another one, partly hidden, or are columns \
         and rows counted as squares? (inner corners are one fewer)",
        sizes(found)
    )]
    OtherSize {
        /// `inner corners` or `circles`.
        points: &'static str,
        /// Columns declared in the target file.
        columns: u32,
        /// Rows declared in the target file.
        rows: u32,
        /// Extent of the grids found, the largest first.
        found: Vec<(u32, u32)>,
    },
    /// The extent is right, but too many points are hidden.
    #[error("{found} of {count} points are visible; the settings need {needed}")]
    Hidden {
        /// Number of points found.
        found: usize,
        /// Points of the target.
        count: usize,
        /// Number of points needed.
        needed: usize,
    },
    /// The extent is right, but the target runs out of the image on opposite sides.
    #[error(
        "{columns} x {rows} {points} are seen, but the target runs out of the image on opposite sides: it is undetermined where it ends; move it so that the image shows its end on one of them"
    )]
    Endless {
        /// `inner corners` or `circles`.
        points: &'static str,
        /// Columns declared in the target file.
        columns: u32,
        /// Rows declared in the target file.
        rows: u32,
    },
    /// More than one such target.
    #[error("{count} targets of {columns} x {rows} points in one image; cover all but one")]
    Several {
        /// Number of targets that were found.
        count: usize,
        /// Columns declared in the target file.
        columns: u32,
        /// Rows declared in the target file.
        rows: u32,
    },
}

impl TargetError {
    /// The key of the target file where the fault lies; empty where there is none.
    pub fn key(&self) -> &str {
        match self {
            Self::Key { key, .. } => key,
            Self::Format(_) => "format",
            Self::DiameterOfSquares => "diameter_mm",
            Self::NoMarkers => "kind",
            Self::FaceName { .. } => "name",
            Self::FaceTurns { .. } | Self::FacesAlike { .. } | Self::OddTags { .. } => "columns",
            Self::MarkersElsewhere | Self::FewMarkers { .. } => "dictionary",
            _ => "",
        }
    }
}

fn sizes(found: &[(u32, u32)]) -> String {
    let texts: Vec<String> =
        found.iter().take(4).map(|(columns, rows)| format!("{columns} x {rows}")).collect();
    texts.join(", ")
}

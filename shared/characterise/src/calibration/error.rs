//! Why there is no calibration.

use thiserror::Error;

/// Why there is no calibration.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CalibrationError {
    /// The observations have no device or no view.
    #[error("no device or no view: nothing to calibrate")]
    Empty,
    /// Image size out of range.
    #[error("{device}: image size {width_px} × {height_px} px is outside 2 … 65535")]
    Size {
        /// Name of the device.
        device: String,
        /// Columns of the image, px.
        width_px: u32,
        /// Rows of the image, px.
        height_px: u32,
    },
    /// A name or view occurs twice.
    #[error("{0} occurs twice; each device, and each view of a pose, may occur once")]
    Duplicate(String),
    /// The target cannot be used.
    #[error("target: {what}")]
    Target {
        /// What is wrong with the target.
        what: String,
    },
    /// An index out of range or repeated.
    #[error("view {view}: {what} does not exist or occurs twice")]
    Index {
        /// Which view, from 0.
        view: usize,
        /// The index that is out of range.
        what: String,
    },
    /// A pixel or covariance that no detector can have meant.
    #[error("{view}: point {index} at pixel ({}, {}) is not finite, or its covariance is not positive", pixel[0], pixel[1])]
    ImagePoint {
        /// Device and pose of the view.
        view: String,
        /// Index of the target point.
        index: usize,
        /// Pixel of the image point, px.
        pixel: [f64; 2],
    },
    /// A setting out of range.
    #[error("{key} = {value}: must be in {limits}")]
    Setting {
        /// Name of the setting.
        key: &'static str,
        /// Value given for the setting.
        value: f64,
        /// Interval allowed for the setting.
        limits: &'static str,
    },
    /// A device has too few usable views.
    #[error("{device}: {views} usable views of the board, needs {needs}; add poses with different tilts")]
    TooFewPoses {
        /// Name of the device.
        device: String,
        /// Views with enough points.
        views: usize,
        /// Fewest views that are needed.
        needs: usize,
    },
    /// The poses do not determine a device.
    #[error("{device}: the {views} poses do not determine {what}: {remedy}")]
    Degenerate {
        /// Name of the device.
        device: String,
        /// Number of views used.
        views: usize,
        /// What stays open, with its uncertainty where there is one.
        what: String,
        /// What the user can do.
        remedy: String,
    },
    /// Devices that no common pose connects.
    #[error(
        "no pose connects the groups {}; add poses that devices of both groups see ({})",
        listed(groups),
        hints.join("; ")
    )]
    Unconnected {
        /// Names of the devices of each group.
        groups: Vec<Vec<String>>,
        /// Poses that nearly connect them, and those that each group sees alone.
        hints: Vec<String>,
    },
    /// So many outliers that they are the rule.
    #[error(
        "{device}: {outliers} of {points} points are outliers, limit {:.0} %{}; check that the board is the declared one (columns, rows, pitch) and did not move", limit * 100.0, among(worst)
    )]
    Outliers {
        /// Name of the device.
        device: String,
        /// Number of points that are outliers.
        outliers: usize,
        /// Number of points of the device.
        points: usize,
        /// Largest fraction of outliers allowed.
        limit: f64,
        /// The poses that are wrong as a whole.
        worst: Vec<String>,
    },
    /// The iteration did not settle.
    #[error("{stage}: no convergence after {iterations} iterations; do all views show the declared board?")]
    NoConvergence {
        /// Which of the adjustments failed.
        stage: String,
        /// Iterations before it ended.
        iterations: usize,
    },
}

/// Poses that are wrong as a whole, as text.
fn among(poses: &[String]) -> String {
    match poses {
        [] => String::new(),
        [only] => format!(", all of them in {only}"),
        several => format!(", all of them in {}", several.join(", ")),
    }
}

/// Groups of names as text: "[cam1, cam2] [cam3]".
fn listed(groups: &[Vec<String>]) -> String {
    groups.iter().map(|group| format!("[{}]", group.join(", "))).collect::<Vec<_>>().join(" ")
}

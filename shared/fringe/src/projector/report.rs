//! What an intersection did.

use crate::surface::SurfaceReport;
use serde::Serialize;

/// What became of the pixels; all add up to `valid`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ProjectorReport {
    /// Pixels valid along all given axes.
    pub valid: u32,
    /// The ray does not meet the column within the projector's image and the depth limits.
    pub missed: u32,
    /// Pixels where the two projector axes disagree.
    pub contradicting: u32,
    /// Root mean square disagreement of both axes, projector pixels; absent with one axis.
    pub epipolar_rms_px: Option<f64>,
    /// Dropped at the surface, and points.
    pub surface: SurfaceReport,
    /// Points written, the same number as `surface.points`.
    pub points: u32,
}

/// Counts of one part.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Task {
    pub(super) valid: u32,
    pub(super) missed: u32,
    pub(super) contradicting: u32,
    pub(super) checked: u32,
    pub(super) squares_px2: f64,
}

/// The counts of all parts.
pub(super) fn summed(tasks: &[Task]) -> ProjectorReport {
    let mut report = ProjectorReport::default();
    let (mut squares, mut checked) = (0.0, 0);
    for task in tasks {
        report.valid += task.valid;
        report.missed += task.missed;
        report.contradicting += task.contradicting;
        squares += task.squares_px2;
        checked += task.checked;
    }
    report.epipolar_rms_px = (checked > 0).then(|| (squares / f64::from(checked)).sqrt());
    report
}

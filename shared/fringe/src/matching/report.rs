//! What a matching did, and the parts in which it works.

use crate::surface::SurfaceReport;
use serde::Serialize;

/// Rectified rows per part of parallel work; fixed, so that no result depends on the number of threads.
pub(super) const PART_ROWS: usize = 16;

/// What became of the left pixels. All numbers count pixels; they add up to `valid`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MatchReport {
    /// Valid left pixels that have an epipolar line in the right image.
    pub valid: u32,
    /// The right row does not show their phase: occluded, or outside the image or the depth limits.
    pub unmatched: u32,
    /// More than one place in a row shows their phase.
    pub ambiguous: u32,
    /// The backward search does not return to them.
    pub inconsistent: u32,
    /// The phase around the match is no continuous surface, or too uncertain.
    pub discontinuous: u32,
    /// Of the points, how many were read bilinearly for want of a 4 × 4 neighbourhood (before support is judged).
    pub bilinear: u32,
    /// Dropped as spikes, crumbs or steep, and points.
    pub surface: SurfaceReport,
    /// Points written: `surface.points`.
    pub points: u32,
}

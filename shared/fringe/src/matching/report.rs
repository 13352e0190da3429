//! What a matching did, and the parts in which it works.

use crate::surface::{Cause, SurfaceReport};
use serde::Serialize;

/// Rectified rows per part of parallel work; fixed, so that no result depends on the number of threads.
pub(super) const PART_ROWS: usize = 8;

/// What became of the left pixels. All numbers count pixels; beside `outside` they add up to `valid`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MatchReport {
    /// Valid left pixels that have an epipolar line in the right image.
    pub valid: u32,
    /// Valid left pixels beside these: the right image has no epipolar line of theirs.
    pub outside: u32,
    /// The right row does not show their phase: occluded, or outside the image or the depth limits.
    pub unmatched: u32,
    /// More than one place in a row shows their phase.
    pub ambiguous: u32,
    /// The backward search does not return to them.
    pub inconsistent: u32,
    /// The phase around the match is no continuous surface.
    pub discontinuous: u32,
    /// The match is more uncertain than any smoothing could mend (see `surface.uncertain` for what it did not mend).
    pub uncertain: u32,
    /// Of the points, how many were read bilinearly for want of a 4 × 4 neighbourhood (before support is checked).
    pub bilinear: u32,
    /// Dropped at the surface, and points.
    pub surface: SurfaceReport,
    /// Points written, the same number as `surface.points`.
    pub points: u32,
}

impl MatchReport {
    /// Counts a pixel without a match.
    pub(super) fn count(&mut self, cause: Cause) {
        match cause {
            Cause::Unmatched => self.unmatched += 1,
            Cause::Ambiguous => self.ambiguous += 1,
            Cause::Inconsistent => self.inconsistent += 1,
            Cause::Uncertain => self.uncertain += 1,
            _ => self.discontinuous += 1,
        }
    }
}

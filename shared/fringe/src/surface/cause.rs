//! Why a pixel gives no point.

use serde::Serialize;

/// What became of a pixel. Each pixel has exactly one cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
#[repr(u8)]
pub enum Cause {
    /// Not lit, or masked when it was decoded.
    #[default]
    Dark,
    /// It has a point.
    Point,
    /// No epipolar line in the other image.
    Outside,
    /// The other view does not show its phase within the depth limits.
    Unmatched,
    /// Several places show its phase.
    Ambiguous,
    /// The backward search does not return to it, or both axes disagree.
    Inconsistent,
    /// The phase around the match is no continuous surface.
    Discontinuous,
    /// Beside the projector's image or outside the depth limits.
    Missed,
    /// Too few neighbours on the same surface.
    Spike,
    /// In a patch that is too small.
    Crumb,
    /// The surface is seen too steeply, or turns away from a camera and ends nearby in its picture.
    Steep,
    /// At the rim of its surface.
    Rim,
    /// Too uncertain, even after smoothing.
    Uncertain,
}

impl Cause {
    /// All, in the order of their numbers.
    pub const ALL: [Self; 13] = [
        Self::Dark,
        Self::Point,
        Self::Outside,
        Self::Unmatched,
        Self::Ambiguous,
        Self::Inconsistent,
        Self::Discontinuous,
        Self::Missed,
        Self::Spike,
        Self::Crumb,
        Self::Steep,
        Self::Rim,
        Self::Uncertain,
    ];

    /// In words, for a legend.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dark => "not lit, or not decoded",
            Self::Point => "point",
            Self::Outside => "outside the other view",
            Self::Unmatched => "not seen by the other view",
            Self::Ambiguous => "several matches",
            Self::Inconsistent => "contradicting",
            Self::Discontinuous => "at a step or an edge of the other view",
            Self::Missed => "beside the projector or outside the depth limits",
            Self::Spike => "single, without neighbours",
            Self::Crumb => "in a small patch",
            Self::Steep => "too steep",
            Self::Rim => "at a rim",
            Self::Uncertain => "too uncertain",
        }
    }
}

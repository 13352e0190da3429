//! What the work on one part of the rows needs and finds.

use super::epipolar_rows::Row;
use super::report::MatchReport;
use crate::surface::Samples;

/// What was found of a group.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// Number of the group.
    pub group: usize,
    pub samples: Samples,
}

impl Hit {
    pub const NONE: Self = Self { group: 0, samples: Samples::NONE };
}

/// Buffers and counts of one part.
#[derive(Debug, Clone, Default)]
pub(super) struct Task {
    pub left: Row,
    pub right: Row,
    /// Groups of the part that have a lit pixel.
    pub lit: usize,
    pub report: MatchReport,
}

impl Task {
    /// With room for rows of these lengths.
    pub fn with_capacity(left: usize, right: usize) -> Self {
        Self { left: Row::with_capacity(left), right: Row::with_capacity(right), ..Self::default() }
    }
}

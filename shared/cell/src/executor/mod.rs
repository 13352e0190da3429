//! One executor for each kind of work: stages, replay, offline reconstruction and benchmarks all call these.
//!
//! | work | executor |
//! |---|---|
//! | accumulate, phase | [`ViewDecoder`]: one per camera and projector, with all exposures |
//! | match | [`PairMatcher`]: two cameras, or a camera and its projector |
//! | fuse | [`fringe::fusion::Fuser`] with the settings of the cell |
//! | inspect | [`metrology::inspection::evaluate`] with the plan of the recipe |
//!
//! [`InProcess`] does all of them one after another in the order of the schedule.

mod decode;
mod evidence;
mod exposures;
mod in_process;
mod matching;
mod phase_method;
mod projector_check;

pub use decode::{Decoded, View, ViewDecoder, ViewError, decoder, decoder_of_size};
pub use evidence::{Expected, Threshold, median_valid};
pub use in_process::{Frames, InProcess, SourceError, WorkError};
pub use matching::{Matched, Method, PairMatcher, Views, method_name};
pub use phase_method::{PhaseMethod, PhaseMethodError};
pub use projector_check::ProjectorCheck;

use crate::cell::Cell;
use crate::error::CellError;
use fringe::fusion::{FusionReport, FusionSettings};

/// The matcher of a pair of a cell.
///
/// # Errors
/// As [`PairMatcher::new`].
pub fn pair_matcher(cell: &Cell, pair: usize) -> Result<PairMatcher, CellError> {
    let rig = &cell.config.rig;
    PairMatcher::new(rig, &rig.pairs[pair], pair, &cell.config.settings.matching)
}

/// Why the fused cloud has no point: none came, or all that came were left out.
pub fn no_point(report: &FusionReport, settings: &FusionSettings) -> String {
    let left_out: u64 = report.removed.iter().map(|&points| u64::from(points)).sum();
    if left_out == 0 {
        return "no point at all: the frames are dark or saturated, or the views share no valid phase; look at a recording of them \
                (--record) with `fringetool decode`"
            .into();
    }
    let given = settings.radius_mm.is_some();
    let radius = if given { "" } else { ", which follows from the spacing of the points" };
    let remedy = if given { "enlarge radius_mm or leave it out" } else { "state a larger radius_mm" };
    format!(
        "no point at all: the pairs have {left_out}, and the fusion left them out as isolated, since fewer than {} others lie within \
         radius_mm = {}{radius}; {remedy}, or lower min_neighbours ([fusion] of the configuration)",
        settings.min_neighbours, report.radius_mm
    )
}

/// Builds what the stages will build, to find out before a process starts whether it can be built.
///
/// # Errors
/// Settings that a kernel refuses, cameras that make no pair.
pub fn check(cell: &Cell) -> Result<(), CellError> {
    for (number, projector) in cell.graph.projectors.iter().enumerate() {
        for &camera in &projector.cameras {
            decoder(cell, number, camera)?;
        }
    }
    (0..cell.graph.pairs.len()).try_for_each(|pair| pair_matcher(cell, pair).map(drop))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_were_left_out_are_not_called_missing() {
        let report = |removed: &[u32], radius_mm| FusionReport {
            points: 0,
            removed: removed.to_vec(),
            radius_mm,
            overlaps: Vec::new(),
            disagreeing: 0,
        };
        let mut settings = FusionSettings { radius_mm: Some(1e-6), ..FusionSettings::default() };
        let none = no_point(&report(&[0, 0], 0.0), &settings);
        assert!(none.contains("dark or saturated") && !none.contains("isolated"), "{none}");
        let given = no_point(&report(&[700, 11], 1e-6), &settings);
        let parts = ["have 711", "fewer than 4 others", "radius_mm = 0.000001;", "leave it out"];
        assert!(parts.iter().all(|part| given.contains(part)) && !given.contains("dark"), "{given}");
        settings.radius_mm = None;
        let found = no_point(&report(&[3], 0.25), &settings);
        assert!(
            found.contains("radius_mm = 0.25, which follows") && !found.contains("leave it out"),
            "{found}"
        );
    }
}

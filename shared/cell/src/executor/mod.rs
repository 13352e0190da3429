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

pub use decode::{Decoded, View, ViewDecoder, ViewError, decoder, decoder_of_size};
pub use evidence::{Expected, Threshold, median_valid};
pub use in_process::{Frames, InProcess, SourceError, WorkError};
pub use matching::{Matched, Method, PairMatcher, Views, method_name};
pub use phase_method::{PhaseMethod, PhaseMethodError};

use crate::cell::Cell;
use crate::error::CellError;

/// The matcher of a pair of a cell.
///
/// # Errors
/// As [`PairMatcher::new`].
pub fn pair_matcher(cell: &Cell, pair: usize) -> Result<PairMatcher, CellError> {
    let rig = &cell.config.rig;
    PairMatcher::new(rig, &rig.pairs[pair], pair, &cell.config.settings.matching)
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

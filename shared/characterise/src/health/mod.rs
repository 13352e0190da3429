//! The state of a rig, estimated from any object that was lit with both fringe directions.
//!
//! The phases of both projector axes name the same surface point in two views without any geometry: the rig is not used
//! to match, so its epipolar constraint is a test (Bräuer-Burchardt 2011, "phase in two directions as an online epipolar
//! check"). A camera against a characterised projector needs no search at all: its phases are the projector pixel.
//!
//! 1. [`match_views`], [`match_projector`]: local quadratic fits of both phases on windows of 5 × 5 pixels, windows at
//!    steps and shadow edges left out, sub-pixel place with the covariance that the phase noise gives it.
//! 2. [`check_pair`]: Sampson distances; a robust fit of what a drift of the right view would do to them (rotations, shifts
//!    across the baseline, focal length); and a score test of that drift against phase noise, the calibration's
//!    covariance and the error of the phase itself. A healthy rig passes it with the given probability. A smooth
//!    pattern that the drift leaves is tested beside it: a lens that changed, or a phase worse than stated.
//!
//! 3. [`estimate_view`], [`ViewEstimate::choose`]: the state of a drifted view, and which of its causes changed, where the residuals tell.
//!    Where a partner and the projector that lights both measure places together, the view must see these where it does, along the
//!    epipolar lines too; places that the pairs or certified lengths contradict are left out ([`ThreeViews`]).
//!
//! What no epipolar residual can detect: a shift along the baseline (it only scales the measured lengths), and which of
//! the two views moved; where a view has several partners, it is the one that all unhealthy pairs have in common.

mod along;
mod calibrated;
mod choice;
mod correct;
mod drift;
mod error;
mod lengths;
mod matches;
mod parameters;
mod quadratic;
mod robust;
mod rows;
mod settings;
mod state;
#[cfg(test)]
mod tests;
mod three;
mod tiles;
mod volume;

pub use calibrated::ViewCovariance;
pub use choice::{Choice, KNOWN_LENGTH, ViewCorrection};
pub use correct::{LengthReading, ViewEstimate, estimate_view};
pub use drift::{Cause, Drift, PairHealth, check_pair};
pub use error::HealthError;
pub use matches::{Lit, Match, MatchCounts, Matches, match_projector, match_views};
pub use parameters::PairCovariance;
pub use settings::HealthSettings;
pub use state::{Partner, stepped};
pub use three::ThreeViews;

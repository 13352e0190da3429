//! What the pairs of a rig will see of a part, before anything is built.
//!
//! The surface of the part's mesh, in the world frame, is divided into [`Element`]s. For each of them and each pair of the rig
//! [`Planner::seeing`] follows the rays of both views and of the light: field of view, occlusion by the part itself, shadow, the
//! matcher's limit of incidence, the decoder's limits of brightness and noise, and the rim that the matcher leaves out. Where a pair sees an
//! element, modulation, noise and uncertainty of a point follow from the formulas of the planner for patterns ([`fringe::planning`]).
//!
//! # Assumptions
//! - Faces are matt: the light that they send to a camera goes with the cosine at which the light comes in and with the inverse square of
//!   the projector's distance. Gloss is not in it, nor is the texture of the part.
//! - Of light that bounces, the first bounce: a face receives ρ · mean(E) of the light E on the other faces around it, the mean
//!   over directions spread with the cosine, and ρ the share of light that the part reflects.
//! - The mesh is the part: a facet lies as far from a curved face as its chord does.
//!
//! [`Planner::phase`] predicts whole phase maps, with noise, which the matcher takes like measured ones: for the uncertainty of features.

mod bounce;
mod conditions;
mod coverage;
mod elements;
mod error;
mod patches;
mod phases;
mod planner;
mod propose;
mod rim;
mod seeing;
#[cfg(test)]
mod tests;
mod view;

pub use conditions::{Conditions, Fringes};
pub use coverage::{CauseArea, Coverage, PairCoverage, coverage};
pub use elements::{Element, elements};
pub use error::ViewPlanError;
pub use patches::{Patch, patches};
pub use planner::Planner;
pub use propose::{Proposal, propose, turned_pairs};
pub use seeing::{Cause, Seeing};

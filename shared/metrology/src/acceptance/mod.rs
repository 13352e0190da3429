//! Acceptance tests of VDI/VDE 2634 and ISO 10360-13: rule sets that are data, statistics, decision.
//!
//! Nothing here certifies: a report states "evaluated following …" with the rule set and its edition, and which of the
//! rule set's values are assumed because the text of the standard was not at hand.
//!
//! # The flow
//! [`TestPlan`] and [`RuleSet`] → [`Evaluator::new`] (does the plan fulfil the rules?) → [`Evaluator::add`] for each
//! position (find the artefact in each view, register the views, fit) → [`Evaluator::finish`] → [`TestReport`].
//!
//! # Where it differs from thesis chapter 6
//! * The worst value over all positions decides, with its sign; the thesis takes means and standard deviations.
//! * Probing form is a range; sigma and the 95 % spread stand beside it under names of their own.
//! * The views of a sphere position are registered and give one sphere; the thesis evaluates each alone.
//! * The scatter of repeats and the scatter of positions are two numbers; repeats are no independent positions.
//! * The uncertainty of a test value comes from artefact and temperature alone (ISO/TS 23165), not from the errors found.

mod arrangement;
mod certificate;
mod conform;
mod copies;
mod date;
mod elements;
mod error;
mod evaluate;
mod excuses;
mod fitted;
mod join;
mod patches;
mod plan;
mod register;
mod result;
mod retest;
mod rules;
mod segment;
mod summary;
#[cfg(test)]
mod tests;
mod values;

pub use date::Day;
pub use error::AcceptanceError;
pub use evaluate::Evaluator;
pub use plan::{
    Artefact, Conditions, Decision, DecisionRule, LengthLimit, Limit, Measurement, PositionPlan, Reference,
    RegisterBy, Segmentation, TEST_FORMAT, TestPlan, ViewPlan, Volumes,
};
pub use result::{
    ArtefactRecord, Characteristic, Input, LateralResolution, PositionValue, RuleSetId, TestReport,
    Violation, Volume, decision_words,
};
pub use rules::{
    CharacteristicRule, CloudOf, Kind, Quantity, RULES_FORMAT, RejectFraction, RetestRule, Rule, RuleSet,
    Statistic, Status,
};

use crate::fit::FitError;

fn at(place: &str, source: FitError) -> AcceptanceError {
    AcceptanceError::Fit { place: place.to_owned(), source }
}

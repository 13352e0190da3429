//! Acceptance tests of VDI/VDE 2634 and ISO 10360-13: rule sets that are data, statistics, decision.
//!
//! Nothing here certifies: a report says "evaluated following …" with the rule set and its edition, and which of the
//! rule set's values are assumed because the text of the standard was not at hand.

mod result;

pub use result::{
    ArtefactRecord, Characteristic, PositionValue, RuleSetId, TestReport, TestVerdict, Violation, Volume,
};

//! Inspection of synthetic clouds of the demo part, and of everything that is not that part.

mod artefact;
mod beyond;
mod by_hand;
mod characteristics;
mod clouds;
mod coverage;
mod datums;
mod drafts;
mod flatness;
mod freeform;
mod outlines;
mod part;
mod places;
mod plans;
mod turned;

use super::{Plan, PlanError};

impl Plan {
    /// As the reader of files does it; a text that is no plan has its own message there.
    fn from_toml(text: &str) -> Result<Self, PlanError> {
        let refused = |e: toml::de::Error| PlanError::Part { place: "line".into(), message: e.to_string() };
        Self::new(toml::from_str(text).map_err(refused)?)
    }
}

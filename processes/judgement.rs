//! What the inspection tells the supervisor.

use rig::result::{FeatureResult, ResultVerdict};
use serde::{Deserialize, Serialize};

/// What the inspection tells the supervisor about a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Absent without plan.
    pub verdict: Option<ResultVerdict>,
    /// In the order of the plan.
    pub features: Vec<FeatureResult>,
    /// Why the part was not found.
    pub alignment_failure: Option<String>,
}

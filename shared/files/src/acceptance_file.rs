//! Plans and rule sets of acceptance tests, `fringecell-test/1` and `fringecell-rules/1`.

use crate::document::Document;
use crate::error::{FileError, Problem};
use metrology::acceptance::{AcceptanceError, RULES_FORMAT, RuleSet, TEST_FORMAT, TestPlan};

/// Checks everything of a test plan that needs no rules.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, numbers out of range, names that do not fit together.
pub fn parse_test_plan(document: &Document) -> Result<TestPlan, FileError> {
    let plan: TestPlan = document.parse(TEST_FORMAT)?;
    plan.check().map_err(|error| fault(document, &error))?;
    Ok(plan)
}

/// Checks a rule set.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, limits that cannot be met, statistics that do not suit their artefact.
pub fn parse_rules(document: &Document) -> Result<RuleSet, FileError> {
    let rules: RuleSet = document.parse(RULES_FORMAT)?;
    rules.check().map_err(|error| fault(document, &error))?;
    Ok(rules)
}

fn fault(document: &Document, error: &AcceptanceError) -> FileError {
    let unknown = match error {
        AcceptanceError::Unknown { name, known, .. } => Some((name.as_str(), known.as_str())),
        _ => None,
    };
    document.fault_at(error.place(), unknown, Problem::Acceptance(error.clone()))
}

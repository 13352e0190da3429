//! Plans and rule sets of acceptance tests, `fringecell-test/1` and `fringecell-rules/1`.

use crate::bundled::RULE_SETS;
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

/// A rule set that comes with the programs; `None` for another identifier.
///
/// # Errors
/// As [`parse_rules`]; those of the programs have none.
pub fn bundled_rules(id: &str) -> Result<Option<RuleSet>, FileError> {
    let text = RULE_SETS.iter().find(|(known, _)| *known == id).map(|(_, text)| (*text).to_owned());
    text.map(|text| parse_rules(&Document { path: id.into(), text })).transpose()
}

/// A rule set from a file: under an identifier of its own, so that no other rules go by the name of those of the programs.
///
/// # Errors
/// As [`parse_rules`]; the identifier of a rule set that comes with the programs, with other contents.
pub fn own_rules(document: &Document) -> Result<RuleSet, FileError> {
    let rules = parse_rules(document)?;
    if bundled_rules(&rules.id)?.is_some_and(|known| known != rules) {
        let error = AcceptanceError::Plan {
            place: "id".to_owned(),
            message: format!(
                "\"{}\" is a rule set of this program, and this file states other rules: give it an id of its own",
                rules.id
            ),
        };
        return Err(fault(document, &error));
    }
    Ok(rules)
}

fn fault(document: &Document, error: &AcceptanceError) -> FileError {
    let unknown = match error {
        AcceptanceError::Unknown { name, known, .. } => Some((name.as_str(), known.as_str())),
        _ => None,
    };
    document.fault_at(error.place(), unknown, Problem::Acceptance(error.clone()))
}

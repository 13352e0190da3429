//! Measuring again after a broken limit, where the rule set has a rule for it.

use super::AcceptanceError;
use super::plan::TestPlan;
use super::rules::RuleSet;

/// Whether the retests of a plan are those that the rule set allows.
///
/// # Errors
/// Retests without a rule, of too many positions, too few or too many of one, or of a position without a first measurement.
pub(super) fn check(plan: &TestPlan, rules: &RuleSet) -> Result<(), AcceptanceError> {
    let mut names: Vec<&str> = plan.positions.iter().filter(|p| p.retest).map(|p| p.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let Some(first) = names.first() else { return Ok(()) };
    let fault = |name: &str, message: String| {
        Err(AcceptanceError::Plan { place: format!("position \"{name}\""), message })
    };
    let Some(rule) = &rules.retest else {
        let message = format!(
            "retest = true, but the rule set {} has no [retest]: every value counts; drop it",
            rules.id
        );
        return fault(first, message);
    };
    if names.len() > rule.most_positions {
        let message =
            format!("{} positions have a retest, the rule set allows {}", names.len(), rule.most_positions);
        return fault(first, message);
    }
    for name in names {
        let of_position = || plan.positions.iter().filter(|p| p.name == name);
        let again = of_position().filter(|p| p.retest).count();
        if again != rule.measurements {
            let message = format!(
                "{again} measurements with retest = true, the rule set asks for {}",
                rule.measurements
            );
            return fault(name, message);
        }
        if of_position().all(|p| p.retest) {
            let message = "only retests, and no measurement that they repeat: keep the first one in the plan";
            return fault(name, message.to_owned());
        }
    }
    Ok(())
}

//! What a result must say that names a rule set of this program: the rules are known, so they are held against it.

use super::error::{AcceptanceReportError, Checked};
use files::acceptance_file::bundled_rules;
use metrology::acceptance::{
    Characteristic, CharacteristicRule, Kind, RuleSet, Statistic, TestReport, decision_words,
};

/// Conditions without which no test is a full one.
const STATEMENTS: [&str; 4] = ["instrument", "operator", "date", "operating mode"];

/// Coverage factor of the stated uncertainties.
const COVERAGE: f64 = 2.0;

/// A length of a certificate may be moved by temperature, and a sum of squares is rounded: by no more than this share.
const ROUNDED: f64 = 1e-9;

/// Checks a result against its own statements, and where it names a rule set of this program against that.
pub(super) fn check(report: &TestReport) -> Checked {
    statements(report)?;
    let Some(rules) = bundled_rules(&report.rule_set.id)? else { return Ok(()) };
    if rules.id() != report.rule_set {
        let says = format!("it names the rule set {:?}", report.rule_set.id);
        return contradiction(
            "rule_set",
            says,
            "standard, edition, wording or assumed values are not those of it",
        );
    }
    for one in &report.characteristics {
        let place = format!("characteristic {:?}", one.symbol);
        let Some(rule) = rules.characteristics.iter().find(|rule| rule.symbol == one.symbol) else {
            return contradiction(&place, "it is evaluated".to_owned(), "its rule set does not have it");
        };
        if (&rule.name, &rule.definition, rule.decides) != (&one.name, &one.definition, one.decides) {
            let but = "name, definition or whether it decides is not that of its rule set";
            return contradiction(&place, "it is evaluated".to_owned(), but);
        }
        uncertainties(report, one, rule)?;
    }
    if report.reduced.is_empty() { full(report, &rules) } else { Ok(()) }
}

/// Guard factor, decision rule and simulation stand twice: as numbers, and in the words that people read.
fn statements(report: &TestReport) -> Checked {
    let stated = |label: &str| {
        report.conditions.iter().find(|(name, _)| name.to_lowercase() == label).map(|(_, text)| text.as_str())
    };
    let decided = decision_words(report.guard_factor);
    if let Some(text) = stated("decision rule").filter(|text| *text != decided) {
        return contradiction(
            "conditions, decision rule",
            format!("{text:?} is stated"),
            &format!("the guard factor gives {decided:?}"),
        );
    }
    if stated("simulated").is_some() != report.simulated {
        let says = format!("simulated is {}", report.simulated);
        return contradiction("simulated", says, "the conditions state the contrary");
    }
    Ok(())
}

/// A full test has every characteristic that decides, names who tested what, and its artefacts have certificates with days.
fn full(report: &TestReport, rules: &RuleSet) -> Checked {
    let says = || "it is stated as a full test".to_owned();
    let absent = |rule: &&CharacteristicRule| {
        rule.decides && report.characteristics.iter().all(|one| one.symbol != rule.symbol)
    };
    if let Some(rule) = rules.characteristics.iter().find(absent) {
        return contradiction("reduced", says(), &format!("{:?} decides and was not measured", rule.symbol));
    }
    let blank = |label: &&&str| {
        let stated = report.conditions.iter().find(|(name, _)| name.to_lowercase() == ***label);
        stated.is_none_or(|(_, text)| text.trim().is_empty())
    };
    if let Some(label) = STATEMENTS.iter().find(blank) {
        return contradiction("reduced", says(), &format!("its conditions do not state the {label}"));
    }
    let undated = |a: &&metrology::acceptance::ArtefactRecord| {
        !(a.validity.contains("from ") && a.validity.contains("until "))
    };
    if let Some(artefact) = report.artefacts.iter().find(undated) {
        return contradiction(
            "reduced",
            says(),
            &format!("the certificate of {:?} has no days", artefact.id),
        );
    }
    Ok(())
}

/// No test value is more certain than the best of its artefacts.
fn uncertainties(report: &TestReport, one: &Characteristic, rule: &CharacteristicRule) -> Checked {
    let Some(least) = least_u_mm(report, rule) else { return Ok(()) };
    for position in &one.positions {
        let stated = position.test_value_u.unwrap_or(0.0);
        if stated < COVERAGE * least * (1.0 - ROUNDED) {
            let place = format!("characteristic {:?}", one.symbol);
            let says = format!("position {:?} has U = {stated} mm", position.position);
            let but = format!("the certificates of the artefacts leave {} mm at least", COVERAGE * least);
            return contradiction(&place, says, &but);
        }
    }
    Ok(())
}

/// The smallest standard uncertainty that the certificates allow, mm; `None` where no artefact has the value.
fn least_u_mm(report: &TestReport, rule: &CharacteristicRule) -> Option<f64> {
    let kind = Kind::name(rule.artefact);
    let values = || report.artefacts.iter().filter(|a| a.kind == kind).flat_map(|a| &a.values);
    let least = |list: &mut dyn Iterator<Item = f64>| list.reduce(f64::min);
    let named = |word: &'static str| {
        values().filter(move |(name, _, _)| name.starts_with(word)).map(|(_, _, u)| u.unwrap_or(0.0))
    };
    match rule.statistic {
        Statistic::FormRange | Statistic::FormSigma | Statistic::FormD95 | Statistic::Form25 => least(
            &mut values().filter(|(name, _, _)| name == "form deviation").map(|(_, form, _)| 0.5 * form),
        ),
        Statistic::Size | Statistic::Size25 => least(&mut named("diameter")),
        Statistic::Spacing | Statistic::SpacingAndSize | Statistic::LengthBidirectional => {
            least(&mut named("spacing"))
        }
    }
}

fn contradiction(place: &str, says: String, but: &str) -> Checked {
    Err(AcceptanceReportError::Contradiction { place: place.to_owned(), says, but: but.to_owned() })
}

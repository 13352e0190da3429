//! What a report must not say: a standard without its edition, numbers that are none, verdicts that do not follow.

use super::error::{AcceptanceReportError, Checked};
use super::words::verdict_key;
use metrology::acceptance::{Characteristic, PositionValue, TestReport, Volume};
use metrology::verdict::Verdict;

/// Checks that a report may be written.
///
/// # Errors
/// See [`AcceptanceReportError`].
pub fn check(report: &TestReport) -> Checked {
    rule_set(report)?;
    if report.characteristics.is_empty() {
        return Err(AcceptanceReportError::Empty);
    }
    volume("sensor_volume", &report.sensor_volume)?;
    volume("total_volume", &report.total_volume)?;
    for violation in &report.reduced {
        finite(|| format!("reduced {:?} required", violation.rule), violation.required)?;
        finite(|| format!("reduced {:?} actual", violation.rule), violation.actual)?;
    }
    for artefact in &report.artefacts {
        for (name, value, u) in &artefact.values {
            finite(|| format!("artefact {:?} {name:?}", artefact.id), *value)?;
            at_least_zero(|| format!("artefact {:?} {name:?} uncertainty", artefact.id), *u)?;
        }
    }
    at_least_zero(|| "guard_factor".to_owned(), Some(report.guard_factor))?;
    report.characteristics.iter().try_for_each(|one| characteristic(one, report.guard_factor))?;
    verdict(report)?;
    super::check_rules::check(report)
}

/// Names of standards; text that has one needs an edition beside it.
fn rule_set(report: &TestReport) -> Checked {
    let set = &report.rule_set;
    let fault = |key, found: &str| {
        let (found, standard) = (found.to_owned(), set.standard.clone());
        Err(AcceptanceReportError::RuleSet { key, found, standard })
    };
    let blank = |text: &str| !text.chars().any(char::is_alphanumeric);
    if blank(&set.id) {
        return fault("id", &set.id);
    }
    if blank(&set.edition) {
        return fault("edition", &set.edition);
    }
    // The sentence stands alone in banners and in other programs, so the edition has to be in it.
    if !set.wording.contains(&set.edition) || set.wording.to_lowercase().contains("certified") {
        return fault("wording", &set.wording);
    }
    Ok(())
}

fn volume(key: &str, volume: &Volume) -> Checked {
    for length in volume.size_mm.iter().chain([&volume.body_diagonal_mm]) {
        at_least_zero(|| key.to_owned(), Some(*length))?;
    }
    Ok(())
}

fn characteristic(one: &Characteristic, guard_factor: f64) -> Checked {
    let key = |what: &str| format!("characteristic {:?} {what}", one.symbol);
    if one.unit != "mm" {
        let (symbol, unit) = (one.symbol.clone(), one.unit.clone());
        return Err(AcceptanceReportError::Unit { symbol, unit });
    }
    finite(|| key("value"), one.value)?;
    at_least_zero(|| key("limit"), one.limit)?;
    at_least_zero(|| key("test_value_u"), one.test_value_u)?;
    if one.limit.is_some() && one.positions.iter().any(|p| p.test_value_u.is_none()) {
        let but = "a position has none, and without it nothing is proven".to_owned();
        return contradiction(one, "each test value has an uncertainty".to_owned(), but);
    }
    at_least_zero(|| key("repeatability"), one.repeatability)?;
    at_least_zero(|| key("between_positions"), one.between_positions)?;
    for position in &one.positions {
        finite(|| key(&format!("position {:?}", position.position)), position.value)?;
        at_least_zero(|| key(&format!("position {:?} limit", position.position)), position.limit)?;
        at_least_zero(
            || key(&format!("position {:?} test_value_u", position.position)),
            position.test_value_u,
        )?;
    }
    worst(one)?;
    verdicts(one, guard_factor)
}

fn contradiction(one: &Characteristic, says: String, but: String) -> Checked {
    let place = format!("characteristic {:?}", one.symbol);
    Err(AcceptanceReportError::Contradiction { place, says, but })
}

/// The worst value is one of those at the positions, with the uncertainty of that one, and none is worse.
fn worst(one: &Characteristic) -> Checked {
    let counting = || one.positions.iter().filter(|p| !p.replaced);
    // Of a limit that grows with the length the worst value takes up most; quotients are rounded.
    let share = |value: f64, limit: Option<f64>| value.abs() / limit.unwrap_or(1.0);
    let most = share(one.value, one.limit) * (1.0 + 1e-12);
    if let Some(worse) = counting().find(|p| share(p.value, one.limit_of(p)) > most) {
        let but = format!("position {:?} has {} mm", worse.position, worse.value);
        return contradiction(one, format!("the worst value is {} mm", one.value), but);
    }
    let here = |p: &&PositionValue| p.value == one.value && p.test_value_u == one.test_value_u;
    if !counting().any(|p| here(&p)) {
        let says = format!("the worst value is {} mm, its uncertainty {:?} mm", one.value, one.test_value_u);
        return contradiction(one, says, "no position has them".to_owned());
    }
    Ok(())
}

/// Every verdict is decided again from value, uncertainty, limit and guard factor.
fn verdicts(one: &Characteristic, guard_factor: f64) -> Checked {
    let named = |verdict: Option<Verdict>| verdict_key(verdict);
    for position in &one.positions {
        let decided = one.verdict_at(position, guard_factor);
        if decided != position.verdict {
            let says = format!("position {:?} is stated as {}", position.position, named(position.verdict));
            let but = format!(
                "{} mm with U = {:?} mm, limit {:?} mm and guard factor {guard_factor} give {}",
                position.value,
                position.test_value_u,
                one.limit_of(position),
                named(decided)
            );
            return contradiction(one, says, but);
        }
    }
    let decided = one.verdict_over_positions(guard_factor);
    if decided != one.verdict {
        let says = format!("its verdict is stated as {}", named(one.verdict));
        return contradiction(one, says, format!("its positions give {}", named(decided)));
    }
    Ok(())
}

/// The verdict of the test follows from those of the characteristics.
fn verdict(report: &TestReport) -> Checked {
    let decided = report.verdict_of_characteristics();
    if decided == report.verdict {
        return Ok(());
    }
    Err(AcceptanceReportError::Contradiction {
        place: "verdict".to_owned(),
        says: format!("the test is stated as {}", verdict_key(Some(report.verdict))),
        but: format!("its characteristics give {}", verdict_key(Some(decided))),
    })
}

fn finite(key: impl Fn() -> String, value: f64) -> Checked {
    if value.is_finite() {
        return Ok(());
    }
    Err(AcceptanceReportError::Number { key: key(), value, limit: "a finite number" })
}

fn at_least_zero(key: impl Fn() -> String, value: Option<f64>) -> Checked {
    match value {
        Some(value) if !value.is_finite() || value < 0.0 => {
            Err(AcceptanceReportError::Number { key: key(), value, limit: "a finite number, 0 or above" })
        }
        _ => Ok(()),
    }
}

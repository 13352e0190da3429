//! Compares a plan with a rule set: every condition that it breaks, with both numbers.

use super::certificate::u_test_value_mm;
use super::date::Day;
use super::plan::{Artefact, Decision, DecisionRule, PositionPlan, TestPlan};
use super::result::{COVERAGE_FACTOR, Violation, Volume};
use super::rules::{Kind, Quantity, Rule, RuleSet};

/// Quantile of 95 % of the normal distribution, to two digits.
const LEAST_GUARD_FACTOR: f64 = 1.64;

/// The rules that a plan breaks, as far as the plan alone shows.
pub fn violations(plan: &TestPlan, rules: &RuleSet) -> Vec<Violation> {
    let mut list = missing(plan);
    list.extend(super::excuses::violations(plan, rules));
    list.extend(rules.rules.iter().flat_map(|rule| broken(plan, rules, rule)));
    let (asked, most) = (plan.reject_fraction(rules), rules.reject_fraction.most);
    if asked > most {
        let text = format!("rejected fraction: {:.2} %, at most {:.2} %", 100.0 * asked, 100.0 * most);
        let (required, actual) = (100.0 * most, 100.0 * asked);
        list.push(Violation { rule: "rejected fraction".into(), required, actual, unit: "%".into(), text });
    }
    let Decision { rule, guard_factor } = plan.decision;
    if rule == DecisionRule::Iso14253 && guard_factor < LEAST_GUARD_FACTOR {
        let (name, unit) = ("guard factor".to_owned(), "standard uncertainties".to_owned());
        let text = format!(
            "{name}: {guard_factor}, at least {LEAST_GUARD_FACTOR} (a conformance probability of 95 %, ISO 14253-1); write rule = \
             \"simple\" in [decision] where the parties agreed on no guard band"
        );
        list.push(Violation { rule: name, required: LEAST_GUARD_FACTOR, actual: guard_factor, unit, text });
    }
    list
}

/// What a verdict needs: who tested what, when and how, where the volume is, and certificates that hold.
fn missing(plan: &TestPlan) -> Vec<Violation> {
    let conditions = &plan.conditions;
    let instrument = conditions.instrument.as_deref().unwrap_or("");
    let mut texts = Vec::new();
    for (key, value, example) in [
        ("instrument", instrument, "maker, type, serial number"),
        ("operator", &conditions.operator, "name"),
        ("operating_mode", &conditions.operating_mode, "exposures, patterns, averaging, filters"),
    ] {
        if value.trim().is_empty() {
            texts.push(format!("conditions: {key} is missing: write {key} = \"{example}\""));
        }
    }
    let day = Day::parse(&conditions.date);
    if day.is_none() {
        let found = &conditions.date;
        texts.push(format!(
            "conditions: date = \"{found}\" is no day: write date = \"YYYY-MM-DD\", the day of the test"
        ));
    }
    let of_clouds = plan.positions.iter().flat_map(|p| &p.views).any(|view| view.cloud.is_some());
    if of_clouds && conditions.cloud_filters.as_deref().is_none_or(|text| text.trim().is_empty()) {
        texts.push(
            "conditions: cloud_filters is missing, and what was left out of a cloud before cannot be seen in it: write \
             cloud_filters = \"none\", or which points were left out"
                .to_owned(),
        );
    }
    if plan.volume.center_mm.is_none() {
        texts.push(
            "volume: center_mm is missing, so it is unknown whether the positions lie in the volume: write center_mm = \
             [x, y, z], the middle of the total volume in the frame of the clouds"
                .to_owned(),
        );
    }
    texts.extend(plan.artefacts.iter().flat_map(|artefact| certificate(artefact, day)));
    let violation = |text| Violation {
        rule: "statements of the test".into(),
        required: 1.0,
        actual: 0.0,
        unit: "statements".into(),
        text,
    };
    texts.into_iter().map(violation).collect()
}

/// A certificate holds from its day to the last of its validity.
fn certificate(artefact: &Artefact, test: Option<Day>) -> Vec<String> {
    let mut texts = Vec::new();
    let mut read = |key: &str, text: &Option<String>| {
        let found = text.as_deref().and_then(Day::parse);
        if found.is_none() {
            texts.push(format!(
                "artefact \"{}\": {key} is missing or no day: write {key} = \"YYYY-MM-DD\"",
                artefact.id
            ));
        }
        found
    };
    let from = read("certificate_date", &artefact.certificate_date);
    let until = read("certificate_valid_until", &artefact.certificate_valid_until);
    let (Some(from), Some(until), Some(test)) = (from, until, test) else { return texts };
    if !(from..=until).contains(&test) {
        texts.push(format!(
            "artefact \"{}\": the certificate {} is valid from {} until {}, the day of the test is outside: have it calibrated",
            artefact.id,
            artefact.certificate,
            artefact.certificate_date.as_deref().unwrap_or(""),
            artefact.certificate_valid_until.as_deref().unwrap_or(""),
        ));
    }
    texts
}

/// Values that a rule looks at, each with what it belongs to.
fn broken(plan: &TestPlan, rules: &RuleSet, rule: &Rule) -> Vec<Violation> {
    let volume = Volume::new(plan.volume.total_mm);
    let mut used: Vec<(&PositionPlan, &Artefact)> =
        plan.positions.iter().filter_map(|p| Some((p, plan.artefact_of(p)?))).collect();
    used.retain(|(_, artefact)| artefact.kind == rule.artefact);
    let mut artefacts: Vec<&Artefact> = Vec::new();
    for (_, artefact) in &used {
        if artefacts.iter().all(|known| known.id != artefact.id) {
            artefacts.push(artefact);
        }
    }
    match rule.quantity {
        Quantity::Positions => {
            let mut names: Vec<&str> = used.iter().map(|(position, _)| position.name.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            check(rule, &volume, names.len() as f64, rule.artefact.name()).into_iter().collect()
        }
        Quantity::Views => used
            .iter()
            .filter_map(|(p, _)| check(rule, &volume, p.views.len() as f64, &format!("position {}", p.name)))
            .collect(),
        _ => {
            let of_one = |artefact: &&Artefact| {
                // Two spheres that both break a rule by nearly the same size are reported once.
                let values = of_artefact(rule, plan, rules, artefact);
                values.into_iter().find_map(|value| check(rule, &volume, value, &artefact.id))
            };
            artefacts.iter().filter_map(of_one).collect()
        }
    }
}

/// Values of an artefact that a rule limits; empty where its points give them, see [`super::arrangement`].
fn of_artefact(rule: &Rule, plan: &TestPlan, rules: &RuleSet, artefact: &Artefact) -> Vec<f64> {
    let volume = Volume::new(plan.volume.total_mm);
    let l0 = volume.body_diagonal_mm;
    let longest = artefact.spacings_mm.iter().copied().fold(0.0, f64::max);
    let [short, long] = artefact.size_mm.map_or([0.0, 0.0], |[a, b]| [a.min(b), a.max(b)]);
    match rule.quantity {
        Quantity::DiameterOverDiagonal => artefact.diameters_mm.iter().map(|d| d / l0).collect(),
        Quantity::LongestOverDiagonal => vec![longest / l0],
        Quantity::LongestOverShortestSide => vec![longest / shortest_mm(&volume)],
        Quantity::Lengths => vec![artefact.spacings_mm.len() as f64],
        Quantity::LengthOverDiagonal => vec![long / l0],
        Quantity::WidthMm => vec![short],
        Quantity::ZoneOverDiameter => {
            let zone = |d: &f64| plan.segmentation.zone_mm.map_or(0.5, |zone| zone / d);
            artefact.diameters_mm.iter().map(zone).collect()
        }
        Quantity::FormOverLimit | Quantity::UncertaintyOverLimit => {
            against_limits(rule, plan, rules, artefact)
        }
        Quantity::Positions
        | Quantity::Views
        | Quantity::Coverage
        | Quantity::ApartOverDiagonal
        | Quantity::Directions
        | Quantity::ExcludedShare
        | Quantity::ExtentOverVolume => Vec::new(),
    }
}

/// Form deviation of an artefact over the limits of forms, or uncertainty of test values over all limits, of what decides.
fn against_limits(rule: &Rule, plan: &TestPlan, rules: &RuleSet, artefact: &Artefact) -> Vec<f64> {
    let of_form = rule.quantity == Quantity::FormOverLimit;
    let deciding = rules
        .characteristics
        .iter()
        .filter(|one| one.decides && one.artefact == artefact.kind && (!of_form || one.statistic.of_form()));
    let mut values = Vec::new();
    for one in deciding {
        let Some(limit) = plan.limits.get(&one.symbol) else { continue };
        let lengths = if one.statistic.of_length() { artefact.spacings_mm.len() } else { 1 };
        for index in 0..lengths {
            let Some(limit_mm) = limit.at(artefact.spacings_mm.get(index).copied()) else { continue };
            let u_mm = u_test_value_mm(one.statistic, index, artefact, &plan.conditions);
            let value = if of_form { artefact.form_mm } else { COVERAGE_FACTOR * u_mm };
            values.push(value / limit_mm);
        }
    }
    values.sort_unstable_by(|a, b| b.total_cmp(a));
    values
}

/// Compares a value with every rule about a quantity of an artefact.
pub(super) fn measured(
    rules: &RuleSet,
    volume: &Volume,
    (kind, quantity): (Kind, Quantity),
    what: &str,
    value: f64,
) -> Vec<Violation> {
    let about = |rule: &&Rule| rule.quantity == quantity && rule.artefact == kind;
    rules.rules.iter().filter(about).filter_map(|rule| check(rule, volume, value, what)).collect()
}

fn shortest_mm(volume: &Volume) -> f64 {
    volume.size_mm.iter().copied().fold(f64::INFINITY, f64::min)
}

fn check(rule: &Rule, volume: &Volume, value: f64, what: &str) -> Option<Violation> {
    let (word, limit) = match (rule.least, rule.most) {
        (Some(least), _) if value < least => ("at least", least),
        (_, Some(most)) if value > most => ("at most", most),
        _ => return None,
    };
    let (factor, unit) = rule.quantity.reported(volume.body_diagonal_mm, shortest_mm(volume));
    let (required, actual) = (limit * factor, value * factor);
    // A count needs no unit: the rule's name says what is counted.
    let number = |value: f64| match unit {
        "mm" => format!("{value:.3} mm"),
        "%" => format!("{value:.1} %"),
        _ => format!("{value:.0}"),
    };
    let of = match rule.quantity {
        Quantity::DiameterOverDiagonal
        | Quantity::LongestOverDiagonal
        | Quantity::LengthOverDiagonal
        | Quantity::ApartOverDiagonal => {
            format!(" ({limit:.4} of the body diagonal, {:.1} mm)", volume.body_diagonal_mm)
        }
        Quantity::LongestOverShortestSide => " (the shortest side of the volume)".to_owned(),
        _ => String::new(),
    };
    let text = format!("{}: {} for {what}, {word} {}{of}", rule.name, number(actual), number(required));
    Some(Violation { rule: rule.name.clone(), required, actual, unit: unit.to_owned(), text })
}

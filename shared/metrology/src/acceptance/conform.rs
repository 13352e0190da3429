//! Holds a plan against a rule set: every condition that it breaks, with both numbers.

use super::plan::{Artefact, PositionPlan, TestPlan};
use super::result::{Violation, Volume};
use super::rules::{Kind, Quantity, Rule, RuleSet};

/// The rules that a plan breaks, as far as the plan alone tells.
pub fn violations(plan: &TestPlan, rules: &RuleSet) -> Vec<Violation> {
    let mut list: Vec<Violation> = rules.rules.iter().flat_map(|rule| broken(plan, rule)).collect();
    let (asked, most) = (plan.reject_fraction(rules), rules.reject_fraction.most);
    if asked > most {
        let text = format!("rejected fraction: {:.2} %, at most {:.2} %", 100.0 * asked, 100.0 * most);
        let (required, actual) = (100.0 * most, 100.0 * asked);
        list.push(Violation { rule: "rejected fraction".into(), required, actual, unit: "%".into(), text });
    }
    list
}

/// Values that a rule looks at, each with what it belongs to.
fn broken(plan: &TestPlan, rule: &Rule) -> Vec<Violation> {
    let volume = Volume::new(plan.volume.total_mm);
    let of_kind = |kind: Kind| {
        let mut used: Vec<(&PositionPlan, &Artefact)> =
            plan.positions.iter().filter_map(|p| Some((p, plan.artefact_of(p)?))).collect();
        used.retain(|(_, artefact)| artefact.kind == kind);
        used
    };
    let used = of_kind(rule.artefact);
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
        // Told by the points, see `coverage`.
        Quantity::Coverage => Vec::new(),
        _ => artefacts.iter().flat_map(|artefact| of_artefact(rule, &volume, artefact)).collect(),
    }
}

fn of_artefact(rule: &Rule, volume: &Volume, artefact: &Artefact) -> Vec<Violation> {
    let l0 = volume.body_diagonal_mm;
    let shortest = shortest_mm(volume);
    let longest = artefact.spacings_mm.iter().copied().fold(0.0, f64::max);
    let [short, long] = artefact.size_mm.map_or([0.0, 0.0], |[a, b]| [a.min(b), a.max(b)]);
    let values: Vec<f64> = match rule.quantity {
        Quantity::DiameterOverDiagonal => artefact.diameters_mm.iter().map(|d| d / l0).collect(),
        Quantity::LongestOverDiagonal => vec![longest / l0],
        Quantity::LongestOverShortestSide => vec![longest / shortest],
        Quantity::Lengths => vec![artefact.spacings_mm.len() as f64],
        Quantity::LengthOverDiagonal => vec![long / l0],
        Quantity::WidthMm => vec![short],
        Quantity::Positions | Quantity::Views | Quantity::Coverage => Vec::new(),
    };
    // Two spheres that both break a rule by nearly the same size are told once.
    values.into_iter().filter_map(|value| check(rule, volume, value, &artefact.id)).take(1).collect()
}

/// Holds the covered share of a sphere at a position against the rules.
pub(super) fn coverage(rules: &RuleSet, volume: &Volume, position: &str, share: f64) -> Vec<Violation> {
    let about = |rule: &&Rule| rule.quantity == Quantity::Coverage;
    rules
        .rules
        .iter()
        .filter(about)
        .filter_map(|rule| check(rule, volume, share, &format!("position {position}")))
        .collect()
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
    let (factor, unit) = rule.quantity.told(volume.body_diagonal_mm, shortest_mm(volume));
    let (required, actual) = (limit * factor, value * factor);
    let digits = if unit == "mm" { 3 } else { 0 };
    let of = match rule.quantity {
        Quantity::DiameterOverDiagonal | Quantity::LongestOverDiagonal | Quantity::LengthOverDiagonal => {
            format!(" ({limit:.4} of the body diagonal, {:.1} mm)", volume.body_diagonal_mm)
        }
        Quantity::LongestOverShortestSide => " (the volume's shortest side)".to_owned(),
        _ => String::new(),
    };
    let text =
        format!("{}: {what} has {actual:.digits$} {unit}, {word} {required:.digits$} {unit}{of}", rule.name);
    Some(Violation { rule: rule.name.clone(), required, actual, unit: unit.to_owned(), text })
}
